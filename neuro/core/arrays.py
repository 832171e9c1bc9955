"""Arrays of numbers: conversion of lists and arrays to doubles, and checks of the bounds of their elements."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.quantities import Quantity, is_written, with_unit
from neuro.core.values import is_number, shown
from neuro.core.wrong import wrong


def numbers(values: Any, what: str) -> NDArray[np.float64]:
    """Return an array of numbers as float64.

    Raises:
        ModelError: an element is not a number, or masked.
    """
    refuse_masked(values, what)
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.asarray(None)
    if array.dtype.kind == "O" and all(map(is_number, array.flat)):  # integers of more than 64 bits
        array = array.astype(np.float64)
    if array.size and array.dtype.kind not in "iuf":
        items = [repr(item) if isinstance(item, str) else item for item in array.ravel().tolist()]
        raise ModelError(f"{what}: found {shown(items if array.ndim else array.item())}: expected numbers")
    return array.astype(np.float64)


def finite(values: Any, what: str, **bounds: Any) -> NDArray[np.float64]:
    """Return an array of finite numbers as float64.

    Args:
        values: the array.
        what: name of the array in messages.
        bounds: bounds of every element, see `Quantity`.

    Raises:
        ModelError: an element is not a number, infinite, NaN, masked, or out of bounds.
    """
    array = numbers(values, what)
    try:
        check_each(Quantity(**bounds), array, what)
    except ModelError as error:
        error.path = (what, *error.path)
        raise
    return array


def refuse_masked(value: Any, what: str) -> None:
    """Refuse masked values and views of neurons, which numpy would convert to other numbers.

    Raises:
        ModelError: a value is masked, or the value is a view of neurons.
    """
    if getattr(type(value), "are_neurons", False):
        raise ModelError(
            f"{what}: found neurons, {shown(value)}: expected numbers", hint="np.asarray(...) returns their ids"
        )
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        index = np.argwhere(np.ma.getmaskarray(value))[0]
        name = f"{what}[{', '.join(map(str, index))}]" if index.size else what
        raise ModelError(f"{name} is masked: expected values for all", hint="fill it: values.filled(...)")


def array_of(q: Quantity, value: Any, what: str) -> NDArray[np.float64]:
    """Return an evenly nested list or an array of numbers as a read-only array of doubles."""
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
    """Return the items with those that have a unit as numbers; copy the list only if an item changes."""
    numbers = items
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
            numbers = list(items) if numbers is items else numbers
            numbers[k] = leaf
    return numbers


def check_each(q: Quantity, array: NDArray[np.float64], what: str) -> None:
    """Raise an error that names the first element out of bounds, if there is one."""
    is_valid = ~np.isnan(array)
    if not q.infinite:
        is_valid &= np.isfinite(array)
    if q.whole:
        is_valid &= array == np.floor(array)
    if q.nonzero:
        is_valid &= array != 0.0
    for _, bound, holds in q.bounds:
        is_valid &= holds(array, bound)
    if not is_valid.all():
        index = tuple(int(i) for i in np.argwhere(~is_valid)[0])
        raise wrong(q, float(array[index]), what, *index)


def check_returned(values: Any, shape: tuple[int, ...], label: str) -> NDArray[Any]:
    """Return what a third-party part returned as an array of numbers; NaN is allowed.

    Args:
        values: the returned values.
        shape: expected shape.
        label: source of the values with a verb, e.g. "normal() drew".

    Raises:
        ModelError: the values have another shape, or are not numbers.
    """
    array = np.asarray(values)
    if array.shape != shape or array.dtype.kind not in "fiu":
        shape_and_type = f"shape {list(array.shape)} and type {array.dtype}"
        raise ModelError(f"{label} values of {shape_and_type}: expected {math.prod(shape)} numbers")
    return array
