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


def numbers(values: Any, label: str) -> NDArray[np.float64]:
    """Return an array of numbers as float64.

    Raises:
        ModelError: an element is masked or is not a number.
    """
    refuse_masked(values, label)
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.asarray(None)
    if array.dtype.kind == "O" and all(map(is_number, array.flat)):  # integers of more than 64 bits
        array = array.astype(np.float64)
    if array.size and array.dtype.kind not in "iuf":
        items = [repr(item) if isinstance(item, str) else item for item in array.ravel().tolist()]
        raise ModelError(f"{label}: found {shown(items if array.ndim else array.item())}: expected numbers")
    return array.astype(np.float64)


def finite(values: Any, label: str, **bounds: Any) -> NDArray[np.float64]:
    """Return an array of finite numbers as float64.

    Args:
        values: the array.
        label: name of the array in messages.
        bounds: bounds of every element, see `Quantity`.

    Raises:
        ModelError: an element is not a number, infinite, NaN, masked, or out of bounds.
    """
    array = numbers(values, label)
    try:
        check_each(Quantity(**bounds), array, label)
    except ModelError as error:
        error.path = (label, *error.path)
        raise
    return array


def refuse_masked(value: Any, label: str) -> None:
    """Refuse masked values and views of neurons. NumPy would convert both to other numbers.

    Raises:
        ModelError: an element is masked, or `value` is a view of neurons.
    """
    if getattr(type(value), "are_neurons", False):
        raise ModelError(
            f"{label}: found neurons, {shown(value)}: expected numbers", hint="np.asarray(...) returns their ids"
        )
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        index = np.argwhere(np.ma.getmaskarray(value))[0]
        name = f"{label}[{', '.join(map(str, index))}]" if index.size else label
        raise ModelError(f"{name} is masked: expected values for all", hint="fill it: values.filled(...)")


def array_of(q: Quantity, value: Any, label: str) -> NDArray[np.float64]:
    """Return an evenly nested list or an array of numbers as a read-only array of doubles."""
    refuse_masked(value, label)
    if isinstance(value, (list, tuple)):
        value = _leaves(q, value, label)
    elif isinstance(value, (str, bytes)) or np.ndim(value) == 0 or np.asarray(value).dtype.kind not in "iuf":
        raise wrong(q, value, label)
    try:
        array = np.array(value, dtype=np.float64)
    except ValueError:
        raise ModelError(f"{label} has rows of different lengths: expected as many numbers in each") from None
    array.flags.writeable = False
    return array


def _leaves(q: Quantity, items: Any, label: str, *index: int) -> Any:
    """Convert items with a unit to numbers. The list is copied only if an item changes."""
    numbers = items
    for k, item in enumerate(items):
        refuse_masked(item, f"{label}[{', '.join(map(str, (*index, k)))}]")
        leaf = item
        if isinstance(item, (list, tuple)):
            leaf = _leaves(q, item, label, *index, k)
        elif isinstance(item, str) and is_written(item):
            try:
                leaf = with_unit(q, item, f"{label}[{', '.join(map(str, (*index, k)))}]")
            except ModelError as error:
                error.path = tuple(map(str, (*index, k)))
                raise
        elif not is_number(item) and not (isinstance(item, np.ndarray) and item.dtype.kind in "iuf"):
            raise wrong(q, item, label, *index, k)
        if leaf is not item:
            numbers = list(items) if numbers is items else numbers
            numbers[k] = leaf
    return numbers


def check_each(q: Quantity, array: NDArray[np.float64], label: str) -> None:
    """Raise an error if an element is out of bounds. The error names the first such element."""
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
        raise wrong(q, float(array[index]), label, *index)


def check_returned(values: Any, shape: tuple[int, ...], label: str) -> NDArray[Any]:
    """Convert the values that a third-party part returned to an array of numbers; NaN is allowed.

    Args:
        values: the returned values.
        shape: expected shape.
        label: subject and verb of the message, e.g. "normal() drew".

    Raises:
        ModelError: the values have another shape, or are not numbers.
    """
    array = np.asarray(values)
    if array.shape != shape or array.dtype.kind not in "fiu":
        shape_and_type = f"shape {list(array.shape)} and type {array.dtype}"
        raise ModelError(f"{label} values of {shape_and_type}: expected {math.prod(shape)} numbers")
    return array
