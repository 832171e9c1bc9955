"""Writing of networks as readable YAML, with large arrays as HDF5. Equal networks give equal bytes."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.choice import Choice
from neuro.core.errors import ModelError, Where
from neuro.core.hdf5 import has_format, new_file
from neuro.core.inputs import file_path
from neuro.core.outputs import Kind, Unwritable, check_output, output, sealed
from neuro.core.quantities import word_of
from neuro.core.values import FromFile
from neuro.model.equations import EquationNeuron, EquationSynapse
from neuro.model.language.including import VERSION
from neuro.model.language.reader import scalar
from neuro.model.parts import Description, Group, Part, Population, Projection, refuse
from neuro.model.space import of_distance
from neuro.model.views import View

WIDTH = 110
ENDINGS = (".yaml", ".yml")
MARK = "# saved by neuro"
NETWORK = sealed("a network that was saved", MARK, ", digest {}")
_ARRAYS = "neuro arrays 1"
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")
_YAML_1_1_WORDS = ("yes", "no", "on", "off", "y", "n", "true", "false", "null")


def save(net: Description, path: str | Path, anywhere: bool = False) -> None:
    """Write a network as YAML, with an HDF5 file of the same stem beside it if there are large arrays.

    Args:
        net: the network.
        path: a name ending in `.yaml` or `.yml`.
        anywhere: whether the network may play recordings that are in other folders or in memory. Such a file can
            only be loaded where these recordings are found.

    Raises:
        ModelError: the file cannot be written, or the HDF5 file exists and holds something else.
    """
    file = check_network_file(path)
    arrays_path = file.with_name(re.sub(r"[^\w .-]", "_", file.stem) + ".h5")
    arrays = Arrays(arrays_path.name, None if anywhere else file.parent)
    text = to_text(describe(net, arrays))
    with ExitStack() as files:
        files.enter_context(output(file, NETWORK)).write_text(NETWORK.seal(f"{MARK}\n{text}"), encoding="utf-8")
        if arrays.by_key:
            with new_file(files.enter_context(_claimed(arrays_path)), _ARRAYS) as arrays_file:
                arrays_file.attrs["format"] = _ARRAYS
                for key, array in arrays.by_key.items():
                    arrays_file.create_dataset(key, data=array, track_times=False)


def check_network_file(path: str | Path) -> Path:
    """Return the path of a network's file if it may be written.

    Raises:
        ModelError: the name has another ending, or the file exists and is not a saved network.
    """
    file = file_path(path, "path")
    if file.suffix not in ENDINGS:
        message = "cannot be written: expected a name ending in .yaml or .yml"
        raise ModelError(message, where=Where(str(file)))
    check_output(file, NETWORK)
    return file


def to_text(sections: dict[str, Any]) -> str:
    """Return a description as YAML. A part that fits in a line is written on one line."""
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


def _filled(current: str, items: list[str], indent: str) -> list[str]:
    """Return a list broken into several lines."""
    lines = []
    for k, item in enumerate(items):
        text = item + ("]" if k == len(items) - 1 else ",")
        if k and len(current) + len(text) + 1 > WIDTH:
            lines.append(current)
            current = indent + text
        else:
            current += (" " if k else "") + text
    return [*lines, current]


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
    """Return text, in quotes if this reader or other readers of YAML need quotes."""
    plain = _PLAIN.fullmatch(text) and text.lower() not in _YAML_1_1_WORDS and scalar(text, Where("")) == text
    return text if plain else json.dumps(text, ensure_ascii=False)


@contextmanager
def _claimed(path: Path) -> Iterator[Path]:
    """Yield the path at which the arrays may be written.

    Raises:
        Unwritable: the file exists and holds something else.
    """
    try:
        kind = Kind("the arrays of a network that was saved", lambda path: has_format(path, _ARRAYS))
        with output(path, kind) as part:
            yield part
    except Unwritable as error:
        hint = "choose another name for the network; its arrays go to an HDF5 file of the same stem"
        raise error.but(hint=hint) from None


LARGEST_INLINE = 64
NAMED = (
    *("distribution", "code", "profile", "mask", "model", "rule", "synapse", "source", "encoder", "decoder", "teacher"),
)
"""Kinds of choices that are written as name and parameters. Others, such as `labels`, are written without a name."""


class Arrays:
    """Arrays that are too large for the text, each replaced by `{file, key}`, and names of recordings.

    Args:
        file: the name of the HDF5 file of the arrays.
        folder: the folder of the text. Recordings must be in this folder or below. If it is None, recordings may be
            anywhere and keep the names that the network has for them.
    """

    def __init__(self, file: str, folder: Path | None = None) -> None:
        self.file, self._folder = file, folder
        self.by_key: dict[str, NDArray[Any]] = {}

    def keep(self, key: str, array: NDArray[Any]) -> dict[str, str]:
        """Store an array and return its file and key."""
        self.by_key[key] = array
        return {"file": self.file, "key": key}

    def recording(self, path: Path, key: str) -> str:
        """Return the name of a recording in the text.

        Raises:
            ModelError: the recording is not in the folder of the text or below.
        """
        if self._folder is None:
            return path.as_posix()
        folder = self._folder.resolve()
        if not path.resolve().is_relative_to(folder):
            message = f"{key} = {str(path)!r}: expected a file in the folder of the description, or below"
            raise ModelError(message, hint=f"copy it to {self._folder}, or save the network beside it")
        return path.resolve().relative_to(folder).as_posix()

    def events(self, key: str) -> None:
        """Return None, the value in the text of events that the user passed as an object in Python.

        Raises:
            ModelError: recordings must be files in the folder of the text.
        """
        if self._folder is not None:
            raise ModelError(
                f"{key} = events of a program: expected a file", hint="use neuro.events.save(events, 'walk.h5')"
            )


def describe(net: Description, arrays: Arrays) -> dict[str, Any]:
    """Return all sections of a network, without parameters that have their default.

    Args:
        net: the network.
        arrays: collects the large arrays.
    """
    sections: dict[str, Any] = {"neuro": VERSION, "name": net.name, "resolution": net.resolution}
    sections["models"] = _models(net)
    for word in ("populations", "projections", "signals", "groups"):
        sections[word] = {name: _part(part, arrays) for name, part in getattr(net, word).items()}
    if net.trials_section is not None:
        sections["trials"] = _parameters(net.trials_section, arrays, "trials")
    sections["probes"] = {part.name: _part(part, arrays) for part in net.probes.values()}
    if net.readout_section is not None:
        sections["readout"] = _parameters(net.readout_section, arrays, "readout")
    if net.world_section is not None:
        sections["world"] = _parameters(net.world_section, arrays, "world")
    return {word: section for word, section in sections.items() if section != {}}


def _part(part: Part, arrays: Arrays) -> Any:
    """Return the words of a part that differ from their defaults. A group is written as its choice."""
    if isinstance(part, Group):
        return _choice(part.choice, arrays, part.name)
    values = {word: part.value(word) for word in part.words}
    default_words = {
        word for word, value in values.items() if value is None or value is False or (word == "initial" and not value)
    }
    return _values({word: value for word, value in values.items() if word not in default_words}, arrays, part.name)


def _models(net: Description) -> dict[str, Any]:
    """Return the definitions of the models in equations that the network uses.

    Raises:
        ModelError: two different models have the same name.
    """
    models: dict[str, Any] = {}
    parts: list[tuple[Population | Projection, type[Choice]]] = [(p, type(p.model)) for p in net.populations.values()]
    parts += [(p, type(p.synapse)) for p in net.projections.values()]
    for part, model in parts:
        if (
            issubclass(model, EquationNeuron | EquationSynapse)
            and models.setdefault(model.called(), model) is not model
        ):
            text = f"another model of the network is also called '{model.called()}'"
            refuse(part, text, "rename one of the two models")
    return {name: plain_words(model.definition) for name, model in models.items()}


def plain_words(words: Any) -> Any:
    """Return mappings and lists as plain dicts and lists."""
    if isinstance(words, Mapping):
        return {str(word): plain_words(value) for word, value in words.items()}
    return [plain_words(value) for value in words] if isinstance(words, list | tuple) else words


def _choice(choice: Choice, arrays: Arrays, key: str) -> Any:
    parameters = _parameters(choice, arrays, key)
    return {choice.name: parameters} if parameters else choice.name


def _parameters(choice: Choice, arrays: Arrays, key: str) -> dict[str, Any]:
    return _values({word_of(name): value for name, value in choice.changed().items()}, arrays, key)


def _values(values: Any, arrays: Arrays, key: str) -> dict[str, Any]:
    return {word: _value(value, arrays, f"{key}.{word}") for word, value in values.items()}


def _value(value: Any, arrays: Arrays, key: str) -> Any:
    if isinstance(value, FromFile):
        value = value.values
    if isinstance(value, Path):
        return arrays.recording(value, key)
    if isinstance(value, View):
        return {value.population.name: _value(value.written(), arrays, key)}
    if isinstance(value, Mapping):
        return _values(value, arrays, key)
    if getattr(value, "kind", "") == "recording":
        return arrays.events(key)
    if isinstance(value, np.ndarray):
        inline = value.size <= LARGEST_INLINE and np.array(value.tolist()).shape == value.shape
        return value.tolist() if inline else arrays.keep(key, value)
    if isinstance(value, of_distance):
        return {value.name: _choice(value.profile, arrays, key)}
    if isinstance(value, Choice):
        return _choice(value, arrays, key) if value.kind in NAMED else _parameters(value, arrays, key)
    if isinstance(value, tuple) and value and all(isinstance(row, np.ndarray) for row in value):
        if len(value) + sum(row.size for row in value) <= LARGEST_INLINE:
            return [row.tolist() for row in value]
        return arrays.keep(key, _table(value))
    if isinstance(value, tuple) and value and all(isinstance(item, Choice) for item in value):
        items = [_value(item, arrays, f"{key}.{k}") for k, item in enumerate(value)]
        return items[0] if len(items) == 1 else items
    return plain_words(value) if isinstance(value, tuple) else value


def _table(rows: tuple[NDArray[Any], ...]) -> NDArray[np.float64]:
    """Return rows of different lengths as one array, with NaN after shorter rows."""
    table = np.full((len(rows), max(row.size for row in rows)), np.nan)
    for n, row in enumerate(rows):
        table[n, : row.size] = row
    return table
