"""Plain data as YAML that people like to read, and large arrays as HDF5. Equal networks give equal bytes."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from neuro.core.errors import ModelError, Where
from neuro.core.hdf5 import has_format, new_file
from neuro.core.outputs import Kind, Unwritable, output, sealed
from neuro.core.paths import file_path
from neuro.model.language.describe import Arrays, describe
from neuro.model.language.reader import scalar
from neuro.model.parts import Description

WIDTH = 110
ENDINGS = (".yaml", ".yml")
MARK = "# saved by neuro"
NETWORK = sealed("a network that was saved", MARK, ", digest {}")
_ARRAYS = "neuro arrays 1"
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")
_ELSEWHERE_BOOLEANS = ("yes", "no", "on", "off", "y", "n", "true", "false", "null")


def save(net: Description, path: str | Path, anywhere: bool = False) -> None:
    """Write a network as YAML, with an HDF5 file of the same stem beside it if it has large arrays.

    Args:
        net: the network.
        path: ends in `.yaml` or `.yml`.
        anywhere: whether recordings that the network plays may lie elsewhere or in memory; the file tells them then,
            but stands for the network only where they are.

    Raises:
        ModelError: the file cannot be written, or an HDF5 file of that name holds something else.
    """
    file = file_path(path, "path")
    where = Where(str(file))
    if file.suffix not in ENDINGS:
        raise ModelError("cannot be written: expected a name ending in .yaml or .yml", where=where)
    beside = file.with_name(re.sub(r"[^\w .-]", "_", file.stem) + ".h5")
    arrays = Arrays(beside.name, None if anywhere else file.parent)
    text = to_text(describe(net, arrays))
    with ExitStack() as files:
        files.enter_context(output(file, NETWORK)).write_text(NETWORK.seal(f"{MARK}\n{text}"), encoding="utf-8")
        if arrays.kept:
            _write_arrays(files.enter_context(_claimed(beside)), arrays)


def to_text(sections: dict[str, Any]) -> str:
    """YAML of a description: one part a line where it fits."""
    lines = []
    for word, section in sections.items():
        if isinstance(section, dict):
            lines.append(f"{word}:")
            lines += [line for name, part in section.items() for line in _lines(name, part, "  ")]
        else:
            lines += _lines(word, section, "")
    return "\n".join(lines) + "\n"


def _lines(word: str, value: Any, indent: str) -> list[str]:
    line = f"{indent}{_word(word)}: {_flow(value)}"
    if len(line) <= WIDTH or not value or not isinstance(value, (dict, list)):
        return [line]
    if isinstance(value, dict):
        inner = [line for name, part in value.items() for line in _lines(name, part, indent + "  ")]
        return [f"{indent}{_word(word)}:", *inner]
    return _filled(f"{indent}{_word(word)}: [", [_flow(item) for item in value], indent + "  ")


def _filled(line: str, items: list[str], indent: str) -> list[str]:
    """A list over several lines."""
    lines = []
    for k, item in enumerate(items):
        text = item + ("]" if k == len(items) - 1 else ",")
        if k and len(line) + len(text) + 1 > WIDTH:
            lines.append(line)
            line = indent + text
        else:
            line += (" " if k else "") + text
    return [*lines, line]


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_word(word)}: {_flow(inner)}" for word, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, str):
        return _word(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and math.isinf(value):
        return ".inf" if value > 0 else "-.inf"
    return repr(value)


def _word(text: str) -> str:
    """Text that is read back as itself, in quotes where it needs them here or in other readers of YAML."""
    plain = _PLAIN.fullmatch(text) and text.lower() not in _ELSEWHERE_BOOLEANS and scalar(text, Where("")) == text
    return text if plain else json.dumps(text, ensure_ascii=False)


@contextmanager
def _claimed(path: Path) -> Iterator[Path]:
    """Where the arrays may be written."""
    try:
        kind = Kind("the arrays of a network that was saved", lambda path: has_format(path, _ARRAYS))
        with output(path, kind) as part:
            yield part
    except Unwritable as error:
        hint = "choose another name for the network's file, whose arrays go to an HDF5 file of the same stem"
        raise error.but(hint=hint) from None


def _write_arrays(path: Path, arrays: Arrays) -> None:
    with new_file(path, _ARRAYS) as file:
        file.attrs["format"] = _ARRAYS
        for key, array in arrays.kept.items():
            file.create_dataset(key, data=array, track_times=False)
