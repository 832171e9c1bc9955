"""The known chips and the arithmetic of the emulated families. Tables of chips have a source for every number."""

from __future__ import annotations

import math
from collections.abc import Mapping
from os import PathLike
from pathlib import Path

from neuro.chips.arithmetic import Arithmetic
from neuro.chips.description import CONDITIONS, COSTS, LIMITS, Chip, Figure, Mesh, Range
from neuro.chips.loihi import LOIHI
from neuro.chips.loihi2 import LOIHI2
from neuro.chips.spinnaker import SPINNAKER
from neuro.core.errors import ModelError, unknown
from neuro.core.registry import Registry
from neuro.model.language.reader import Node, found_text, mistake, read, words

ARITHMETICS = {arithmetic.name: arithmetic for arithmetic in (LOIHI, LOIHI2, SPINNAKER)}
"""The arithmetic of each emulated family of chips, by name."""

WORDS = ("like", "name", "title", "arithmetic", "limits", "mesh", "step_s", "costs")
PARTS = {"limits": "limit", "costs": "cost"}
FIGURE = ("value", "source", "conditions", "low", "high", "spread", "holds", "beyond", "guess")
ENDS = ("low", "high")
TILES = ("columns", "rows", "cores_per_tile")


def parse(root: Node, path: Path, base: Chip | None) -> Chip:
    """Return the chip described by a table.

    Args:
        root: root node of the table.
        path: file of the table.
        base: the chip on which the table is based (`like`), or None.

    Raises:
        ModelError: a word is unknown, or a number has no source or is not allowed. The message has the place.
    """
    table = words(root, WORDS, "a table of a chip")
    base = base or Chip("", "", "")
    name = _text(table["name"], "name") if "name" in table else path.stem
    chip = Chip(
        name=name,
        title=_text(table["title"], "title") if "title" in table else base.title or name,
        arithmetic=_arithmetic(table["arithmetic"]) if "arithmetic" in table else base.arithmetic,
        limits={**base.limits, **_limits(table)},
        mesh=_mesh(table["mesh"]) if "mesh" in table else base.mesh,
        step_s=_figure(table["step_s"], "step_s", "s") if "step_s" in table else base.step_s,
        costs={
            **base.costs,
            **{word: _figure(node, word, COSTS[word][0]) for word, node in _entries(table, "costs", COSTS).items()},
        },
        path=str(path),
    )
    _check_core_count(chip, root)
    return chip


def load(path: Path) -> Node:
    """Read a table file as nodes."""
    try:
        return read(path)
    except ModelError as error:
        if error.kind == "empty":
            message = "the file is empty: expected a table of a chip"
            raise ModelError(message, where=error.where, hint="begin: like: loihi") from None
        raise


def like(root: Node) -> Node | None:
    """Return the node `like` with the chip on which a table is based, or None."""
    return words(root, WORDS, "a table of a chip").get("like")


def _entries(table: Mapping[str, Node], part: str, allowed: Mapping[str, object]) -> Mapping[str, Node]:
    kind = PARTS[part]
    return words(table[part], allowed, f"{part} of a chip", kind=kind) if part in table else {}


def _limits(table: Mapping[str, Node]) -> dict[str, Figure]:
    limits = {}
    for name, node in _entries(table, "limits", LIMITS).items():
        limits[name] = _figure(node, name, "")
        if limits[name].value < 1 or limits[name].value % 1:
            raise mistake(_value(node), f"{name}: value = {limits[name].value:g}: expected a whole number >= 1")
    return limits


def _figure(node: Node, name: str, unit: str) -> Figure:
    """Return a number with its source. Messages about a missing number name `unit`."""
    if not isinstance(node.value, dict):
        raise mistake(node, f"{name}: {found_text(node)}: expected a figure", "write {value: ..., source: ...}")
    parts = words(node, FIGURE, f"figure '{name}'", needs=("value", "source"))
    value = _quantity(parts["value"], f"{name}: value", name, unit)
    low, high = (_quantity(parts[end], f"{name}: {end}", name, unit) if end in parts else None for end in ENDS)
    if (low is not None and low > value) or (high is not None and high < value):
        end = "low" if low is not None and low > value else "high"
        ends = {"low": low, "value": value, "high": high}
        range_text = ", ".join(f"{word} = {n:g}" for word, n in ends.items() if n is not None)
        raise mistake(parts[end], f"{name}: {end}: expected low <= value <= high, found {range_text}")
    return Figure(
        value,
        _text(parts["source"], f"{name}: source"),
        low=low,
        high=high,
        holds={
            word: _range(part, f"{name}: holds: {word}")
            for word, part in words(parts["holds"], CONDITIONS, f"{name}: holds", kind="condition").items()
        }
        if "holds" in parts
        else {},
        beyond=_range(parts["beyond"], f"{name}: beyond") if "beyond" in parts else None,
        **{word: _text(parts[word], f"{name}: {word}") for word in ("conditions", "spread", "guess") if word in parts},
    )


def _quantity(node: Node, label: str, name: str, unit: str) -> float:
    """Return a number >= 0. Messages about a missing number name `unit`."""
    value = node.value
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        hint = f"write 23.6 p{unit} as 23.6e-12" if unit else ""
        raise mistake(node, f"{label}: {found_text(node)}: expected {_number(unit)}", hint)
    if not 0 <= value < math.inf:
        raise mistake(node, f"{label} = {value:g}: expected {_number(unit)}")
    return float(value)


def _range(node: Node, label: str) -> Range:
    """Return two numbers, the smaller first."""
    ends = [part.value for part in node.value] if isinstance(node.value, list) else []
    numbers = [n for n in ends if isinstance(n, (int, float)) and not isinstance(n, bool) and n >= 0]
    if len(ends) != 2 or len(numbers) != 2 or numbers[0] > numbers[1]:
        raise mistake(node, f"{label}: {found_text(node)}: expected two numbers >= 0, the smaller first")
    return float(numbers[0]), float(numbers[1])


def _number(unit: str) -> str:
    return f"a number >= 0 in {unit}" if unit else "a number >= 0"


def _value(node: Node) -> Node:
    value: Node = node.value["value"]
    return value


def _text(node: Node, name: str) -> str:
    if not isinstance(node.value, str) or not node.value.strip():
        raise mistake(node, f"{name}: {found_text(node)}: expected text", "text that looks like a number needs quotes")
    return node.value


def _arithmetic(node: Node) -> str:
    names = ("", *ARITHMETICS)
    if node.value not in names:
        texts = ", ".join(f"'{name}'" for name in names)
        raise mistake(node, f"arithmetic: {found_text(node)}: expected one of {texts}", "'' has limits and costs only")
    return str(node.value)


def _mesh(node: Node) -> Mesh:
    parts = words(node, (*TILES, "source", "conditions"), "a mesh", needs=(*TILES, "source"))
    _text(parts["source"], "mesh: source")
    for name in TILES:
        size = parts[name].value
        if type(size) is not int or size < 1:
            raise mistake(parts[name], f"mesh: {name}: {found_text(parts[name])}: expected a whole number >= 1")
    return Mesh(*(parts[name].value for name in TILES))


def _check_core_count(chip: Chip, root: Node) -> None:
    """Refuse a mesh whose number of cores differs from the limit `cores_per_chip`."""
    cores = chip.limit("cores_per_chip")
    if chip.mesh is None or cores is None:
        return
    mesh_cores = chip.mesh.columns * chip.mesh.rows * chip.mesh.cores_per_tile
    if mesh_cores != cores:
        raise ModelError(
            f"mesh has {mesh_cores} cores (columns x rows x cores_per_tile): expected cores_per_chip = {cores}",
            where=root.value["mesh" if "mesh" in root.value else "limits"].label,
        )


TABLES = Path(__file__).parent / "tables"
_reading: list[Path] = []
"""Tables that are being read, each based on the next; used to detect cycles."""


CHIPS: Registry[Chip] = Registry(
    "chip",
    [parse(load(path), path, None) for path in sorted(TABLES.glob("*.yaml"))],  # no built-in table is based on another
    takes=lambda thing: isinstance(thing, Chip),
    group="neuro.chips",
    name=lambda chip: chip.name,
)
"""All registered chips, by name; `neuro.register(neuro.chips.chip("my.yaml"))` adds one."""


def chips() -> tuple[str, ...]:
    """Return the names of the known chips and processors."""
    return tuple(sorted(CHIPS))


def chip(name: str | PathLike[str]) -> Chip:
    """Return the chip with a name, or of a table file. A file is read at each call.

    Raises:
        ModelError: no chip has this name, or the file is not a valid table.
    """
    text = str(name)
    if is_table(text):
        return read_chip(Path(text))
    if text not in CHIPS:
        raise unknown("chip", text, chips())
    return CHIPS[text]


def is_table(name: str) -> bool:
    """Return whether a name is a path of a table file."""
    return name.endswith((".yaml", ".yml"))


def read_chip(path: Path) -> Chip:
    """Return the chip described by a table file.

    A table with `like: loihi` is based on that chip and replaces only its own entries.

    Raises:
        ModelError: the file is not a table, a word is unknown, or a number has no source. The message has the place.
    """
    root = load(path)
    base = like(root)
    if base is None:
        return parse(root, path, None)
    if is_table(base.value):
        return parse(root, path, _of_file(path, base))
    if base.value not in CHIPS:
        raise unknown("chip", base.value, chips(), base.where)
    return parse(root, path, CHIPS[base.value])


def _of_file(path: Path, base: Node) -> Chip:
    """Return the chip of the table file that `like` names, relative to the folder of the present table."""
    base_path = path.parent / str(base.value)
    if not base_path.is_file():
        raise ModelError(f"like: there is no file '{base_path}'", where=base.where)
    if path.resolve() in _reading:
        raise ModelError(f"like: '{base.value}' is like this table", where=base.where)
    _reading.append(path.resolve())
    try:
        return read_chip(base_path)
    finally:
        _reading.pop()


def arithmetic_of(chip: Chip) -> Arithmetic:
    """Return the arithmetic of a chip.

    Raises:
        ModelError: the chip's arithmetic is not emulated.
    """
    if chip.arithmetic not in ARITHMETICS:
        raise ModelError(
            f"chip '{chip.name}' has no arithmetic here: expected one of {', '.join(ARITHMETICS)}",
            hint="use its limits and costs for placing and energy only",
        )
    return ARITHMETICS[chip.arithmetic]


def placed_as(chip: Chip) -> Arithmetic:
    """Return the arithmetic for placing: the chip's own if it is emulated, else the arithmetic of Loihi 1."""
    return ARITHMETICS.get(chip.arithmetic, LOIHI)
