"""Views of some neurons of a population, chosen by an index such as `exc[:100]`, `grid[2:4, :]` or `exc[[3, 7]]`.

`view_of_text` and `view_of_index` make the same views from text.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError, unknown
from neuro.core.values import shown

Ids = NDArray[np.int64]
Axis = int | slice
_MOST_LISTED = 6


class HasShape(Protocol):
    """Protocol of an object with a name and a shape of neurons, such as a population."""

    @property
    def name(self) -> str:
        """Name of the population."""

    @property
    def shape(self) -> tuple[int | str, ...]:
        """Sizes of the axes. An axis as text, such as "auto", is not known before the network is compiled."""


@dataclass(frozen=True, slots=True)
class NameAndShape:
    """Name and shape of a population of a finished run, from which views can be made."""

    name: str
    shape: tuple[int | str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class View:
    """Some neurons of one population, without repetition, in the order of the index.

    An index is made as in NumPy: a number or a slice for each axis of the population's shape (`exc[:100]`, `exc[7]`,
    `grid[2:4, :]`; negative numbers count from the end), or a mask of that shape. A list of numbers is a list of neuron
    ids for any number of axes. A bound beyond the shape is an error, unlike in Python. `len` counts neurons.
    Iteration yields a view of each neuron.

    Attributes:
        population: the population.
        index: a number or a slice for each axis, or the ids.

    Raises:
        ModelError: a property needs the shape, which is not known before the network is compiled.
    """

    are_neurons: ClassVar[bool] = True
    population: HasShape
    index: tuple[Axis, ...] | Ids

    @cached_property
    def _ids_and_shape(self) -> tuple[Ids, tuple[int, ...]]:
        return self._ids_and_shape_within(_known_shape(self.population, repr(self)))

    @property
    def ids(self) -> Ids:
        """Ids of the neurons, counted from 0 in C order of the population's shape."""
        return self._ids_and_shape[0]

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes of the axes of the view, without axes that are indexed by a number. The shape of one neuron is (1,)."""
        return self._ids_and_shape[1]

    def within(self, shape: tuple[int, ...]) -> tuple[Ids, tuple[int, ...]]:
        """Return ids and shape of the view if the population has this shape.

        Raises:
            ModelError: the view reaches beyond the shape.
        """
        return self._ids_and_shape if shape == self.population.shape else self._ids_and_shape_within(shape)

    def _ids_and_shape_within(self, shape: tuple[int, ...]) -> tuple[Ids, tuple[int, ...]]:
        if not isinstance(self.index, tuple):
            return self.index, self.index.shape
        ids, sizes = np.zeros(1, dtype=np.int64), []
        for item, n in zip(_axes(self.index, shape, repr(self)), shape, strict=True):
            numbers = np.arange(n, dtype=np.int64)[item] if isinstance(item, slice) else np.array([item])
            ids = (ids[:, None] * n + numbers).reshape(-1)
            sizes += [numbers.size] if isinstance(item, slice) else []
        ids.flags.writeable = False
        return ids, tuple(sizes) or (1,)

    def written(self) -> str | Ids:
        """Return the index as text in YAML, e.g. "0:100" or "2:4, :". An index by ids is returned as the ids."""
        if not isinstance(self.index, tuple):
            return self.index
        return ", ".join(_text(item, n) for item, n in zip(self.index, _sizes(self.population), strict=True))

    def __len__(self) -> int:
        return len(self.ids)

    def __iter__(self) -> Iterator[View]:
        shape = _known_shape(self.population, repr(self))
        return (View(self.population, tuple(map(int, np.unravel_index(neuron, shape)))) for neuron in self.ids)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the ids of the neurons."""
        return np.array(self.ids, dtype=dtype)

    def __getitem__(self, index: Any) -> View:
        inner = view(NameAndShape(repr(self), self.shape), index)
        if not (isinstance(self.index, tuple) and isinstance(inner.index, tuple)):
            return View(self.population, _read_only(self.ids[inner.ids]))
        items, axes = iter(inner.index), []
        for item, n in zip(self.index, _known_shape(self.population, repr(self)), strict=True):
            numbers = range(n)[item][next(items)] if isinstance(item, slice) else item
            axes.append(_minimal_slice(numbers) if isinstance(numbers, range) else numbers)
        return View(self.population, tuple(axes))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, View):
            return NotImplemented
        if self.population.name != other.population.name or self.population.shape != other.population.shape:
            return False
        if isinstance(self.index, tuple) and isinstance(other.index, tuple):
            return self.index == other.index
        return _is_known(self.population) and self.shape == other.shape and np.array_equal(self.ids, other.ids)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        index = self.written()
        return f"{self.population.name}[{index if isinstance(index, str) else _short_list(index)}]"


def view(population: HasShape, index: Any) -> View:
    """Return the view of a population that an index describes, see `View`.

    Raises:
        ModelError: the index is not valid, reaches beyond the population, or chooses no neuron or a neuron twice.
    """
    if isinstance(index, (list, range, np.ndarray)):
        return View(population, _read_only(_ids(population, _array(index))))
    items = index if isinstance(index, tuple) else (index,)
    label = f"{population.name}[{', '.join(_text(item) for item in items)}]"
    sizes = _sizes(population)
    return View(population, _axes(_fill_axes(items, len(sizes), label), sizes, label))


def count(population: HasShape) -> int:
    """Return the number of neurons of a population.

    Raises:
        ModelError: the shape is not known before the network is compiled.
    """
    return math.prod(_known_shape(population, f"'{population.name}'"))


def _sizes(population: HasShape) -> tuple[int | str, ...]:
    """Return the sizes of the axes. An axis whose size is not known yet is text."""
    sizes: tuple[int | str, ...] = getattr(population, "sizes", population.shape)
    return sizes


def _is_known(population: HasShape) -> bool:
    return not any(isinstance(n, str) for n in _sizes(population))


def _known_shape(population: HasShape, what: str) -> tuple[int, ...]:
    sizes = _sizes(population)
    if any(isinstance(n, str) for n in sizes):
        raise ModelError(
            f"{what}: the shape {shown(population.shape)} of '{population.name}' is unknown before compilation: "
            "expected numbers",
            hint="write the numbers, or index the population itself with a number or a slice for each axis",
        )
    return tuple(int(n) for n in sizes)


def _fill_axes(items: Sequence[Any], n_axes: int, what: str) -> tuple[Any, ...]:
    """Return an item for each axis. `...` and omitted axes stand for whole axes."""
    places = [k for k, item in enumerate(items) if item is Ellipsis]
    if len(places) > 1 or len(items) - len(places) > n_axes:
        raise ModelError(f"{what}: found {len(items)} indices: expected at most {n_axes}, one for each axis")
    ellipsis_at = places[0] if places else len(items)
    whole_axes = (slice(None),) * (n_axes - len(items) + len(places))
    return (*items[:ellipsis_at], *whole_axes, *items[ellipsis_at + 1 :])


def _axes(items: Sequence[Any], shape: Sequence[int | str], what: str) -> tuple[Axis, ...]:
    return tuple(
        _axis(item, n, f"{what}: axis {k}" if len(shape) > 1 else what)
        for k, (item, n) in enumerate(zip(items, shape, strict=True))
    )


def _axis(item: Any, n: int | str, what: str) -> Axis:
    """Return the item of one axis. Negative numbers are counted from the beginning if the size is known."""
    if not isinstance(item, slice):
        number = _number(item, what)
        return _check_range(number, n, n - 1, what) % n if isinstance(n, int) else number
    start, stop, step = (None if part is None else _number(part, what) for part in (item.start, item.stop, item.step))
    if step == 0:
        raise ModelError(f"{what}: found a step of 0: expected another number")
    if isinstance(n, str):
        return slice(start, stop, step)
    for bound in (start, stop):
        if bound is not None:
            _check_range(bound, n, n, what)
    numbers = range(n)[slice(start, stop, step)]
    if not numbers:
        raise ModelError(f"{what} chooses no neuron: expected at least one")
    return _minimal_slice(numbers)


def _number(item: Any, what: str) -> int:
    if isinstance(item, (bool, np.bool_)):
        raise ModelError(f"{what}: found {shown(bool(item))}: expected a number or a slice")
    try:
        return operator.index(item)
    except TypeError:
        hint = "use a list of ids or a mask of the population's shape as the only index" if np.ndim(item) else ""
        raise ModelError(f"{what}: found {shown(item)}: expected a number or a slice", hint=hint) from None


def _check_range(number: int, n: int, most: int, what: str) -> int:
    if not -n <= number <= most:
        raise ModelError(f"{what}: found {number}: expected {-n} to {most}")
    return number


def _minimal_slice(numbers: range) -> slice:
    """Return the same slice for equal ranges, e.g. `slice(0, 9, 4)` for both `range(0, 9, 4)` and `range(0, 12, 4)`."""
    first, last, step = numbers[0], numbers[-1], numbers.step if len(numbers) > 1 else 1
    stop = last + (1 if step > 0 else -1)
    return slice(first, None if stop < 0 else stop, step)


def _array(index: Any) -> NDArray[Any]:
    try:
        return np.asarray(index)
    except ValueError:  # rows of different lengths
        return np.asarray(index, dtype=object)


def _ids(population: HasShape, array: NDArray[Any]) -> Ids:
    """Return the ids that a mask or a list of ids chooses, counted from 0."""
    name = population.name
    if array.dtype == bool:
        shape = _known_shape(population, f"{name}[mask]")
        if array.shape not in (shape, (math.prod(shape),)):
            raise ModelError(f"{name}[mask]: a mask of shape {list(array.shape)}: expected {list(shape)}")
        ids = np.flatnonzero(array)
    elif array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        kind = f"{array.dtype} of shape {list(array.shape)}"
        raise ModelError(f"{name}[...]: found an array of {kind}: expected a list of whole numbers, or a mask")
    else:
        ids = array.astype(np.int64)
    label = f"{name}[{_short_list(ids)}]"
    if ids.size == 0:
        raise ModelError(f"{label} chooses no neuron: expected at least one")
    size = math.prod(_known_shape(population, label))
    outside_indices = np.flatnonzero((ids < -size) | (ids >= size))
    if outside_indices.size:
        raise ModelError(f"{label}: found {ids[outside_indices[0]]}: expected {-size} to {size - 1}")
    ids = ids % size
    numbers, counts = np.unique(ids, return_counts=True)
    if numbers.size < ids.size:
        raise ModelError(f"{label} chooses neuron {numbers[counts > 1][0]} more than once: expected each once")
    return ids


def _read_only(ids: Ids) -> Ids:
    ids.flags.writeable = False
    return ids


def _text(item: Any, n: int | str | None = None) -> str:
    """Return one axis of an index as text. Bounds that are the ends of an axis of n neurons are left out."""
    if item is Ellipsis:
        return "..."
    if not isinstance(item, slice):
        return shown(item)
    start, stop, step = item.start, item.stop, item.step
    if isinstance(n, int):
        first = 0 if step > 0 else n - 1
        start = None if start == first else start
        stop = None if stop is not None and range(n)[item] == range(n)[item.start :: step] else stop
    bounds = ":".join("" if bound is None else shown(bound) for bound in (start, stop))
    return bounds if step in (None, 1) else f"{bounds}:{shown(step)}"


def _short_list(ids: Ids) -> str:
    numbers = [str(neuron) for neuron in ids[: _MOST_LISTED - 1]]
    if len(ids) > _MOST_LISTED:
        numbers.append("...")
    return f"[{', '.join(numbers + [str(neuron) for neuron in ids[_MOST_LISTED - 1 :][-1:]])}]"


AXIS = r"-?\d+|-?\d*:-?\d*(:-?\d+)?"
"""One axis of an index: a number, or begin:end:step as in Python."""
_AXIS = re.compile(AXIS)
_LIST = re.compile(r"\[\s*-?\d+\s*(,\s*-?\d+\s*)*\]")


def view_of_index(of: Any, populations: Mapping[str, HasShape]) -> Any:
    """Return the view that a text or a mapping from YAML describes. Parts and names without an index do not change.

    Raises:
        ModelError: the population does not exist, or the index is not valid.
    """
    if isinstance(of, str):
        return view_of_text(of, populations) if "[" in of else of
    if not isinstance(of, Mapping) or len(of) != 1:
        return of
    [(name, index)] = of.items()
    if name not in populations:
        raise unknown("population", name, populations)
    if isinstance(index, str):
        return view(populations[name], indices(index, name))
    if isinstance(index, Mapping):
        return _by_columns(populations[name], index)
    ids = isinstance(index, (list, tuple, range, np.ndarray))
    return view(populations[name], np.asarray(index) if ids else index)


def _by_columns(population: HasShape, only: Mapping[str, Any]) -> View:
    """Return the neurons that have these values in the table of neurons."""
    where = getattr(type(population), "where", None)
    if where is None:
        raise ModelError(f"'{population.name}' has no table of neurons: expected an index, or ids")
    neurons: View = where(population, **only)
    return neurons


def view_of_text(text: str, populations: Mapping[str, HasShape]) -> HasShape | View:
    """Return the population or view that a text of a command line names.

    Examples: `exc`, `exc[:100]`, `grid[2:4, :]`, `exc[[3, 7]]`, and by columns of a table `brain[type=KC, side=left]`.

    Args:
        text: the name, with an index in brackets or without.
        populations: the existing populations, by name.

    Raises:
        ModelError: the population does not exist, or the index in brackets is not valid.
    """
    name, bracket, index_text = text.strip().partition("[")
    name = name.strip()
    if name not in populations:
        raise unknown("population", name, populations)
    if not bracket:
        return populations[name]
    if not index_text.endswith("]"):
        raise ModelError(f"found '{text}': expected ']' at its end", hint=f"write '{name}[0:100]'")
    index = index_text[:-1].strip()
    if index.startswith("["):
        if not _LIST.fullmatch(index):
            raise ModelError(f"{name}: found '{index}': expected a list of ids such as [3, 7]")
        return view(populations[name], [int(neuron) for neuron in index[1:-1].split(",")])
    if "=" in index:
        pairs = (item.partition("=") for item in index.split(","))
        return _by_columns(populations[name], {column.strip(): value.strip() for column, _, value in pairs})
    return view(populations[name], indices(index, name))


def indices(text: str, name: str) -> tuple[int | slice, ...]:
    """Parse an index as text into a number or a slice for each axis."""
    items = [item.strip() for item in text.split(",")]
    for item in items:
        if not _AXIS.fullmatch(item):
            message = f"{name}: found '{item}': expected a number or begin:end:step for each axis"
            raise ModelError(message, hint='write "0:100" or "2:4, :"')
    return tuple(_parse_axis(item) for item in items)


def _parse_axis(text: str) -> int | slice:
    if ":" not in text:
        return int(text)
    return slice(*(int(part) if part else None for part in text.split(":")))
