"""Whether a value is what a quantity accepts, and its canonical form."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError, nearest
from neuro.core.hints import axes, near, notation
from neuro.core.inputs import file_path
from neuro.core.quantities import KINDS, LARGEST, Kind, Quantity, is_written, with_unit
from neuro.core.values import FromFile, shown

_HUGE = int(sys.float_info.max)
_Check = TypeVar("_Check", bound=Callable[[Quantity, Any, str], Any])
_BOOLEANS = {"true": "true", "yes": "true", "on": "true", "false": "false", "no": "false", "off": "false"}


def check(q: Quantity, value: Any, what: str, path: tuple[str, ...] = ()) -> Any:
    """Return `value` in its canonical form, or say what is wrong with it.

    Args:
        q: what the parameter may be.
        value: a number, word, list, array, distribution or `FromFile`.
        what: the full name for the message, e.g. "iaf_psc_exp.tau_m".
        path: the words that lead to the value inside its part; the last word of `what` if not given.

    Raises:
        ModelError: it is none of the accepted kinds, or out of bounds (the first such element is named).
    """
    if value is None and q.optional:
        return None
    try:
        return KINDS[q.kind].check(q, value, what)
    except ModelError as error:
        error.path = (*(path or (re.split(r"[^\w]", what)[-1],)), *error.path)
        raise


def argument(name: str, value: Any, **more: Any) -> Any:
    """The canonical form of a single argument of a function.

    Args:
        name: of the argument, for messages.
        value: what was given.
        more: what it may be, as of `Quantity`; with `words` and no kind, one of these.

    Raises:
        ModelError: as `check`.
    """
    kind = "word" if "words" in more else "number"
    return check(Quantity(**{"kind": kind, **more}), value, name)


def check_fields(part: Any, place: str = "") -> None:
    """Bring the fields of a frozen dataclass that carry a `Quantity` to their canonical form.

    Args:
        part: the dataclass, from its `__post_init__`.
        place: what stands before the names of its fields in messages, e.g. "task.ball".

    Raises:
        ModelError: as `check`; its path are the words of `place` and the field's name.
    """
    for one in fields(part):
        if q := one.metadata.get("quantity"):
            words = (*filter(None, place.split(".")), one.name)
            object.__setattr__(part, one.name, check(q, getattr(part, one.name), ".".join(words), words))


def wrong(q: Quantity, value: Any, what: str, *index: int) -> ModelError:
    """The error for a value, or the element of it at `index`, that a quantity does not accept."""
    place = f"{what}[{', '.join(map(str, index))}]" if index else what
    found = f"{place} has no value" if value is None else f"{place} = {shown(value)}"
    expected = _with_exceeded(q, value).expected()
    if isinstance(value, float) and not math.isfinite(value):
        expected = expected.replace("a number", "a finite number", 1)
    return ModelError(f"{found}: expected {expected}", hint=_hint(q, value), path=tuple(map(str, index)))


def _with_exceeded(q: Quantity, value: Any) -> Quantity:
    """The quantity with the bound of all whole numbers, where it has none on that side and the value is beyond it."""
    if q.kind in ("integer", "shape", "ids") and is_number(value):
        if q.at_most is None and value > LARGEST:
            return replace(q, at_most=LARGEST)
        if q.at_least is None and value < -LARGEST:
            return replace(q, at_least=-LARGEST)
    return q


def _hint(q: Quantity, value: Any) -> str:
    if isinstance(value, type) and hasattr(value, "called"):
        return f"write {value.called()}(...)"
    if q.of_distance and getattr(value, "kind", "") == "profile":
        return f"write neuro.of_distance({_home(type(value))}{value!r})"
    if q.part is not None:
        return f"its words are {', '.join(q.part.quantities())}"
    if q.choice is not None and isinstance(value, Mapping) and len(value) == 1:
        return _as_call(q.choice, *next(iter(value.items())))
    if not isinstance(value, str):
        return ""
    if q.kind == "word" or (q.kind == "integer" and q.words):
        return nearest(value, q.words)
    if q.kind == "boolean":
        return f"write {_BOOLEANS[value.lower()]}" if value.lower() in _BOOLEANS else ""
    if q.kind == "shape":
        return axes(value) or near(value, q.words)
    return notation(value) if q.kind not in ("name", "receptor", "names", "part", "choice") else ""


def _as_call(base: type[Any], name: object, said: Any) -> str:
    """How to write in Python a choice that is said as in YAML, or ""."""
    found = next((kind for kind in base.__subclasses__() if kind.called() == name), None)
    if found is None or not isinstance(said, Mapping) or not set(said) <= set(found.quantities()):
        return ""
    words = ", ".join(f"{word}={value!r:.60}" for word, value in said.items())
    return f"write {_home(found)}{name}({words})"


def _home(kind: type[Any]) -> str:
    return "neuro." if kind.__module__.startswith("neuro.") else ""


def check_span(after: int, to: int, since: float | None, until: float | None) -> None:
    """Refuse a stretch of steps that ends before it begins, said by times in ms.

    Raises:
        ModelError: it does.
    """
    if since is not None and until is not None and after > to:
        raise ModelError(f"since = {since:g} ms and until = {until:g} ms: expected an end after the begin")


def is_number(value: Any) -> bool:
    """Whether a value is a single number that a double can hold; true and false are none."""
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) <= _HUGE
    return isinstance(value, (float, np.integer, np.floating))


def _within(q: Quantity, x: float) -> bool:
    return not (
        math.isnan(x)
        or (q.whole and not x.is_integer())
        or (q.nonzero and x == 0.0)
        or (math.isinf(x) and not q.infinite)
        or not all(holds(x, bound) for _, bound, holds in q.bounds)
    )


def _kind(name: str, noun: str, listed: bool = False) -> Callable[[_Check], _Check]:
    """Decorate the function that checks values of a kind; see `Kind`."""

    def define(check: _Check) -> _Check:
        KINDS[name] = Kind(noun, check, listed)
        return check

    return define


@_kind("number", "a number")
def _number(q: Quantity, value: Any, what: str) -> Any:
    if is_written(value):
        if q.of_value:
            return value
        value = with_unit(q, value, what)
    if is_number(value):
        if not _within(q, float(value)):
            raise wrong(q, value, what)
        return float(value)
    if not q.arrays:
        raise wrong(q, value, what)
    kind = "" if isinstance(value, type) else getattr(value, "kind", "")
    if kind == "distribution" or (q.of_distance and kind == "of_distance"):
        return value if q.of_value else value.in_unit(q, what)
    if isinstance(value, FromFile):
        _each(q, value.values, what)
        return value
    if q.of_value and isinstance(value, (list, tuple)) and any(map(is_written, value)):
        return tuple(value)
    array = _array(q, value, what)
    _each(q, array, what)
    return array


@_kind("delay", "a time > 0 ms")
def _delay(q: Quantity, value: Any, what: str) -> float:
    if is_written(value):
        value = with_unit(q, value, what)
    if not is_number(value) or not math.isfinite(value) or value <= 0:
        raise wrong(q, value, what)
    return float(value)


@_kind("array", "a number", listed=True)
def _undrawn(q: Quantity, value: Any, what: str) -> Any:
    if is_number(value) or getattr(value, "kind", "") == "distribution":
        raise ModelError(f"{what} = {shown(value)}: expected a list or a file")
    return _number(q, value, what)


def numbers(values: Any, what: str) -> NDArray[np.float64]:
    """Any array of numbers as float64.

    Raises:
        ModelError: an element is not a number, or masked.
    """
    refuse_masked(values, what)
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.asarray(None)
    if array.dtype.kind == "O" and all(map(is_number, array.flat)):  # some have more than 64 bits
        array = array.astype(np.float64)
    if array.size and array.dtype.kind not in "iuf":
        items = [repr(item) if isinstance(item, str) else item for item in array.ravel().tolist()]
        raise ModelError(f"{what}: found {shown(items if array.ndim else array.item())}: expected numbers")
    return array.astype(np.float64)


def finite(values: Any, what: str, **bounds: Any) -> NDArray[np.float64]:
    """Any array of finite numbers as float64.

    Args:
        values: what was given.
        what: its name, for messages.
        bounds: of every element, as of `Quantity`.

    Raises:
        ModelError: an element is not a number, infinite, NaN, masked, or out of bounds.
    """
    array = numbers(values, what)
    try:
        _each(Quantity(**bounds), array, what)
    except ModelError as error:
        error.path = (what, *error.path)
        raise
    return array


def refuse_masked(value: Any, what: str) -> None:
    """Refuse what numpy would take for other numbers: what lies under a mask, and the ids of neurons.

    Raises:
        ModelError: a value is masked, or these are neurons.
    """
    if getattr(type(value), "are_neurons", False):
        raise ModelError(
            f"{what}: found neurons, {shown(value)}: expected numbers", hint="their ids are np.asarray(...)"
        )
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        index = np.argwhere(np.ma.getmaskarray(value))[0]
        place = f"{what}[{', '.join(map(str, index))}]" if index.size else what
        raise ModelError(f"{place} is masked: expected values for all", hint="fill it: values.filled(...)")


def _array(q: Quantity, value: Any, what: str) -> NDArray[np.float64]:
    """A list, nested evenly, or an array of numbers as doubles that cannot be written."""
    refuse_masked(value, what)
    if isinstance(value, (list, tuple)):
        value = _leaves(q, value, what)
    elif isinstance(value, (str, bytes)) or np.ndim(value) == 0 or np.asarray(value).dtype.kind not in "iuf":
        raise wrong(q, value, what)
    try:
        array = np.array(value, dtype=np.float64)
    except ValueError:
        raise ModelError(f"{what} has rows of different lengths: expected as many numbers in each") from None
    array.flags.writeable = False
    return array


def _leaves(q: Quantity, items: Any, what: str, *index: int) -> Any:
    """The items, those with a unit as numbers; nothing is copied where none has one."""
    found = items
    for k, item in enumerate(items):
        refuse_masked(item, f"{what}[{', '.join(map(str, (*index, k)))}]")
        leaf = item
        if isinstance(item, (list, tuple)):
            leaf = _leaves(q, item, what, *index, k)
        elif isinstance(item, str) and is_written(item):
            try:
                leaf = with_unit(q, item, f"{what}[{', '.join(map(str, (*index, k)))}]")
            except ModelError as error:
                error.path = tuple(map(str, (*index, k)))
                raise
        elif not is_number(item) and not (isinstance(item, np.ndarray) and item.dtype.kind in "iuf"):
            raise wrong(q, item, what, *index, k)
        if leaf is not item:
            found = list(items) if found is items else found
            found[k] = leaf
    return found


def _each(q: Quantity, array: NDArray[np.float64], what: str) -> None:
    good = ~np.isnan(array)
    if not q.infinite:
        good &= np.isfinite(array)
    if q.whole:
        good &= array == np.floor(array)
    if q.nonzero:
        good &= array != 0.0
    for _, bound, holds in q.bounds:
        good &= holds(array, bound)
    if not good.all():
        index = tuple(int(i) for i in np.argwhere(~good)[0])
        raise wrong(q, float(array[index]), what, *index)


def _is_whole(value: Any, most: float = LARGEST) -> bool:
    return is_number(value) and -most <= value <= most and float(value).is_integer()


@_kind("integer", "a whole number")
def _integer(q: Quantity, value: Any, what: str) -> int | str:
    if isinstance(value, str) and value in q.words:
        return value
    most = LARGEST if q.at_most is None else abs(q.at_most)
    if not _is_whole(value, max(most, LARGEST)) or not _within(q, int(value)):
        raise wrong(q, value, what)
    return int(value)


@_kind("microseconds", "a whole number of us")
def _microseconds(q: Quantity, value: Any, what: str) -> int:
    """A float such as 1e6 is one, too."""
    least = -(1 << 63) if q.at_least is None else q.at_least
    if not _is_whole(value, 1 << 63) or not least <= int(value) < 1 << 63:
        raise wrong(q, value, what)
    return int(value)


@_kind("boolean", "true or false")
def _boolean(q: Quantity, value: Any, what: str) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        raise wrong(q, value, what)
    return bool(value)


@_kind("name", "a name")
@_kind("receptor", "a name")
def _name(q: Quantity, value: Any, what: str) -> str:
    text = getattr(value, "name", value)
    if not isinstance(text, str):
        raise wrong(q, value, what)
    return text


@_kind("names", "names")
def _names(q: Quantity, value: Any, what: str) -> tuple[str, ...]:
    items = [value] if isinstance(value, str) else value
    if not isinstance(items, (list, tuple)):
        raise wrong(q, value, what)
    for k, item in enumerate(items):
        if not isinstance(item, str):
            raise wrong(q, item, what, k)
    return tuple(items)


@_kind("words", "{name: value}")
def _words(q: Quantity, value: Any, what: str) -> dict[str, Any]:
    """Numbers and texts, or lists of these, by name; a name may be written as a number."""
    if not isinstance(value, Mapping) or not value:
        raise wrong(q, value, what)
    for name, given in value.items():
        for item in given if isinstance(given, (list, tuple)) else (given,):
            if not isinstance(item, str) and not is_number(item):
                raise ModelError(f"{what}: {name} = {shown(item)}: expected a number or a text", path=(str(name),))
    return {str(name): list(given) if isinstance(given, tuple) else given for name, given in value.items()}


@_kind("word", "a word")
def _word(q: Quantity, value: Any, what: str) -> str:
    if not isinstance(value, str) or value not in q.words:
        raise wrong(q, value, what)
    return value


@_kind("shape", "whole numbers")
def _shape(q: Quantity, value: Any, what: str) -> tuple[int | str, ...]:
    items = [value] if is_number(value) or (isinstance(value, str) and value in q.words) else value
    if not isinstance(items, (list, tuple, np.ndarray)) or len(items) == 0:
        raise wrong(q, value, what)
    for k, item in enumerate(items):
        if is_number(item) and item > LARGEST and float(item).is_integer():
            _check_count((int(item),), what)
        if not (isinstance(item, str) and item in q.words) and not (_is_whole(item) and _within(q, float(item))):
            raise wrong(q, item, what, *([k] if items is value else []))
    sizes = tuple(item if isinstance(item, str) else int(item) for item in items)
    _check_count(sizes, what)
    return sizes


def _check_count(sizes: tuple[int | str, ...], what: str) -> None:
    if math.prod(size for size in sizes if isinstance(size, int)) > LARGEST:
        found = shown(sizes if len(sizes) > 1 else sizes[0])
        raise ModelError(f"{what} = {found}: expected at most {LARGEST} elements")


@_kind("ids", "whole numbers", listed=True)
def _ids(q: Quantity, value: Any, what: str) -> NDArray[np.int64]:
    array = value.values if isinstance(value, FromFile) else _array(q, value, what)
    if array.ndim != 1:
        raise wrong(q, value, what)
    bad = np.flatnonzero(~((array >= 0) & (array <= LARGEST) & (array == np.floor(array))))
    if bad.size:
        raise wrong(q, float(array[bad[0]]), what, int(bad[0]))
    ids = array.astype(np.int64)
    ids.flags.writeable = False
    return ids


@_kind("times", "a list of spike times in ms for each neuron", listed=True)
def _times(q: Quantity, value: Any, what: str) -> tuple[NDArray[np.float64], ...]:
    """One list for each neuron; rows of a file end in NaN where they are shorter than the longest."""
    if isinstance(value, FromFile):
        table = np.atleast_2d(value.values)
        return tuple(
            _train(q, row[: row.size - int(np.isnan(row[::-1]).cumprod().sum())], what, [n])
            for n, row in enumerate(table)
        )
    if not isinstance(value, (list, tuple, np.ndarray)):
        raise wrong(q, value, what)
    if len(value) and all(map(is_number, value)):
        return (_train(q, value, what, []),)
    return tuple(_train(q, row, what, [n]) for n, row in enumerate(value))


def _train(q: Quantity, row: Any, what: str, index: list[int]) -> NDArray[np.float64]:
    if not isinstance(row, (list, tuple, np.ndarray)):
        raise wrong(q, row, what, *index)
    times = _array(q, row, what)
    if times.ndim != 1:
        raise wrong(q, row, what, *index)
    bad = np.flatnonzero(~(np.isfinite(times) & (times > 0) & (np.diff(times, prepend=0.0) >= 0)))
    if bad.size:
        k = int(bad[0])
        place = ", ".join(map(str, [*index, k]))
        message = f"{what}[{place}] = {shown(float(times[k]))}: expected spike times > 0 ms in ascending order"
        raise ModelError(message, path=tuple(map(str, [*index, k])))
    return times


@_kind("moments", "times > 0 ms, each later than the one before", listed=True)
def _moments(q: Quantity, value: Any, what: str) -> NDArray[np.float64]:
    times = value.values if isinstance(value, FromFile) else _listed(q, value, what)
    if times.ndim != 1:
        raise wrong(q, value, what)
    bad = np.flatnonzero(~(np.isfinite(times) & (np.diff(times, prepend=0.0) > 0)))
    if bad.size:
        raise wrong(q, float(times[bad[0]]), what, int(bad[0]))
    return times


@_kind("series", "a list of numbers", listed=True)
def _series(q: Quantity, value: Any, what: str) -> NDArray[np.float64]:
    array = value.values if isinstance(value, FromFile) else _listed(q, value, what)
    if array.ndim not in (1, 2):
        raise wrong(q, value, what)
    _each(q, array, what)
    return array


@_kind("train", "a row for each spike: a time > 0 ms, not before the last one, and a neuron", listed=True)
@_kind(
    "graded_train",
    "a row for each spike: a time > 0 ms, not before the last one, a neuron and a whole payload of 32 bits",
    listed=True,
)
def _spikes(q: Quantity, value: Any, what: str) -> NDArray[np.float64]:
    rows = value.values if isinstance(value, FromFile) else _listed(q, value, what)
    columns = 2 if q.kind == "train" else 3
    rows = rows.reshape(0, columns) if rows.size == 0 else rows
    if rows.ndim != 2 or rows.shape[1] != columns:
        raise wrong(q, value, what)
    times, ids, payloads = rows[:, 0], rows[:, 1], rows[:, 2:]
    bad = ~(np.isfinite(times) & (times > 0) & (np.diff(times, prepend=0.0) >= 0))
    bad |= ~((ids >= 0) & (ids <= LARGEST) & (ids == np.floor(ids)))
    bad |= ~((np.abs(payloads) < 2**31) & (payloads == np.floor(payloads))).all(axis=1)
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        before = f" after {shown(float(times[k - 1]))} ms" if k and times[k] < times[k - 1] else ""
        carried = "".join(f" with payload {_or_beyond(payload)}" for payload in payloads[k])
        found = f"{shown(float(times[k]))} ms of neuron {_or_beyond(ids[k])}{carried}{before}"
        raise ModelError(f"{what}[{k}] = {found}: expected {q.expected()}", path=(str(k),))
    return rows


def _or_beyond(value: float) -> str:
    """A number, with the bound of whole numbers where it is beyond that."""
    beyond = f", above {LARGEST}" if value > LARGEST else f", below -{LARGEST}" if value < -LARGEST else ""
    return shown(float(value)) + beyond


def _listed(q: Quantity, value: Any, what: str) -> NDArray[np.float64]:
    """A list or an array; a distribution is none."""
    if not isinstance(value, (list, tuple, np.ndarray)):
        raise wrong(q, value, what)
    return _array(q, value, what)


@_kind("codes", "a code, or a list of codes")
def _codes(q: Quantity, value: Any, what: str) -> tuple[Any, ...]:
    if not isinstance(value, tuple) or not all(getattr(item, "kind", "") == "code" for item in value):
        raise wrong(q, value, what)
    return value


@_kind("file", "the name of a file")
def _file(q: Quantity, value: Any, what: str) -> Path:
    if isinstance(value, str) and not value:
        raise wrong(q, value, what)
    return file_path(value, what)


@_kind("events", "events")
def _events(q: Quantity, value: Any, what: str) -> Any:
    """As it is: the function that takes events says which."""
    return value


@_kind("choice", "")
def _choice(q: Quantity, value: Any, what: str) -> Any:
    assert q.choice is not None
    if q.at_least is not None and is_number(value):
        return _number(q, value, what)
    if not isinstance(value, q.choice):
        raise wrong(q, value, what)
    return value.in_unit(q, what) if q.at_least is not None else value


@_kind("part", "")
def _part(q: Quantity, value: Any, what: str) -> Any:
    assert q.part is not None
    if isinstance(value, q.part):
        return value
    if not isinstance(value, Mapping):
        raise wrong(q, value, what)
    return q.part.from_words(value)


def check_returned(values: Any, shape: tuple[int, ...], label: str) -> NDArray[Any]:
    """What a third-party part returned, as numbers of a shape; they may be NaN.

    Args:
        values: that.
        shape: the shape they must have.
        label: what gave them, with a verb, e.g. "normal() drew".

    Raises:
        ModelError: they have another shape, or are not numbers.
    """
    array = np.asarray(values)
    if array.shape != shape or array.dtype.kind not in "fiu":
        found = f"shape {list(array.shape)} and type {array.dtype}"
        raise ModelError(f"{label} values of {found}: expected {math.prod(shape)} numbers")
    return array
