"""The chips by name: tables in this package, those of installed packages and of programs, and tables by their file."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from neuro.chips.description import Chip
from neuro.chips.table import like, load, parse
from neuro.core.errors import ModelError, unknown
from neuro.core.registry import Registry
from neuro.model.language.reader import Node

TABLES = Path(__file__).parent / "tables"
_reading: list[Path] = []
"""The tables that are being read, each like the next."""


def _own() -> list[Chip]:
    """The chips of this package; none of its tables starts from another."""
    return [parse(load(path), path, None) for path in sorted(TABLES.glob("*.yaml"))]


CHIPS: Registry[Chip] = Registry(
    "chip", _own(), takes=lambda thing: isinstance(thing, Chip), group="neuro.chips", name=lambda chip: chip.name
)
"""All chips that have a name; `neuro.register(neuro.chips.chip("my.yaml"))` adds one."""


def chips() -> tuple[str, ...]:
    """Names of the chips and processors that are known."""
    return tuple(sorted(CHIPS))


def chip(name: str | PathLike[str]) -> Chip:
    """The chip of that name, or of a table file, which is read each time.

    Raises:
        ModelError: there is none, or the file is not such a table.
    """
    text = str(name)
    if is_table(text):
        return read_chip(Path(text))
    if text not in CHIPS:
        raise unknown("target", text, chips())
    return CHIPS[text]


def is_table(name: str) -> bool:
    """Whether a name is that of a table file."""
    return name.endswith((".yaml", ".yml"))


def read_chip(path: Path) -> Chip:
    """The chip that a table file describes.

    A table with `like: loihi` starts from that chip and changes what it names.

    Raises:
        ModelError: the file is not a table, a word is unknown, or a number has no source; it says where.
    """
    root = load(path)
    base = like(root)
    if base is None:
        return parse(root, path, None)
    if is_table(base.value):
        return parse(root, path, _of_file(path, base))
    if base.value not in CHIPS:
        raise unknown("target", base.value, chips(), base.where)
    return parse(root, path, CHIPS[base.value])


def _of_file(path: Path, base: Node) -> Chip:
    """The chip of another table, which lies beside the one that is like it."""
    other = path.parent / str(base.value)
    if not other.is_file():
        raise ModelError(f"like: there is no file '{other}'", where=base.where)
    if path.resolve() in _reading:
        raise ModelError(f"like: '{base.value}' is like this table", where=base.where)
    _reading.append(path.resolve())
    try:
        return read_chip(other)
    finally:
        _reading.pop()
