"""Neurons of a population as text: `exc[:100]`, `grid[2:4, :]`, `exc[[3, 7]]`; in a program also `{"exc": "0:100"}`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from neuro.core.errors import ModelError, unknown
from neuro.model.views import Laid, View, view

AXIS = r"-?\d+|-?\d*:-?\d*(:-?\d+)?"
"""One axis of an index: a number, or begin:end:step as in Python."""
_AXIS = re.compile(AXIS)
_LIST = re.compile(r"\[\s*-?\d+\s*(,\s*-?\d+\s*)*\]")


def named(of: Any, populations: Mapping[str, Laid]) -> Any:
    """A view that is written as on a command line or in YAML; all else, a name or a part, as it is.

    Raises:
        ModelError: there is no such population, or what is written is no index of it.
    """
    if isinstance(of, str):
        return on_a_line(of, populations) if "[" in of else of
    if not isinstance(of, Mapping) or len(of) != 1:
        return of
    [(name, index)] = of.items()
    if name not in populations:
        raise unknown("population", name, populations)
    if isinstance(index, str):
        return view(populations[name], indices(index, name))
    ids = isinstance(index, (list, tuple, range, np.ndarray))
    return view(populations[name], np.asarray(index) if ids else index)


def on_a_line(text: str, populations: Mapping[str, Laid]) -> Laid | View:
    """A population, or a view of it, as a command line says it: `exc`, `exc[:100]`, `grid[2:4, :]`, `exc[[3, 7]]`.

    Args:
        text: what is said.
        populations: those that there are, by name.

    Raises:
        ModelError: there is no such population, or what stands in the brackets is no index of it.
    """
    name, bracket, rest = text.strip().partition("[")
    name = name.strip()
    if name not in populations:
        raise unknown("population", name, populations)
    if not bracket:
        return populations[name]
    if not rest.endswith("]"):
        raise ModelError(f"found '{text}': expected ']' at its end", hint=f"write '{name}[0:100]'")
    index = rest[:-1].strip()
    if index.startswith("["):
        if not _LIST.fullmatch(index):
            raise ModelError(f"{name}: found '{index}': expected a list of ids such as [3, 7]")
        return view(populations[name], [int(neuron) for neuron in index[1:-1].split(",")])
    return view(populations[name], indices(index, name))


def indices(text: str, name: str) -> tuple[int | slice, ...]:
    """An index for each axis."""
    items = [item.strip() for item in text.split(",")]
    for item in items:
        if not _AXIS.fullmatch(item):
            message = f"{name}: found '{item}': expected a number or begin:end:step for each axis"
            raise ModelError(message, hint='write "0:100" or "2:4, :"')
    return tuple(_axis(item) for item in items)


def _axis(text: str) -> int | slice:
    if ":" not in text:
        return int(text)
    return slice(*(int(part) if part else None for part in text.split(":")))
