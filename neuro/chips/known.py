"""The chips by name: tables in this package, and tables of users."""

from __future__ import annotations

from functools import cache
from os import PathLike
from pathlib import Path

from neuro.chips.description import Chip
from neuro.chips.table import like, load, parse
from neuro.core.errors import unknown

TABLES = Path(__file__).parent / "tables"


def chips() -> tuple[str, ...]:
    """Names of the chips and processors that there are tables of."""
    return tuple(sorted(path.stem for path in TABLES.glob("*.yaml")))


def chip(name: str | PathLike[str]) -> Chip:
    """The chip of that name, or of a table file of the user.

    Raises:
        ModelError: there is none, or the file is not such a table.
    """
    text = str(name)
    if text.endswith((".yaml", ".yml")):
        return read_chip(Path(name))
    if text not in chips():
        raise unknown("target", text, chips())
    return _own(text)


def read_chip(path: Path) -> Chip:
    """The chip that a table file describes.

    A table with `like: loihi` starts from ours and changes what it names.

    Raises:
        ModelError: the file is not a table, a word is unknown, or a number has no source; it says where.
    """
    root = load(path)
    base = like(root)
    if base is not None and base.value not in chips():
        raise unknown("target", base.value, chips(), base.where)
    return parse(root, path, None if base is None else chip(base.value))


@cache
def _own(name: str) -> Chip:
    return read_chip(TABLES / f"{name}.yaml")
