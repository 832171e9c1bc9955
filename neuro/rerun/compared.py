"""The first difference of two files that should be the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from neuro.core.errors import ModelError
from neuro.core.hdf5 import check
from neuro.core.provenance import ATTRIBUTE
from neuro.core.values import shown
from neuro.files.results import RECORDING

_ORIGIN = {ATTRIBUTE, "neuro", "python", "numpy", "numba", "backend", "threads"}
"""Attributes that tell where a file comes from, which is compared apart."""


def first_difference(then: Path, now: Path) -> str:
    """What differs first in two HDF5 files, in words; "" if all arrays, texts and attributes are the same bits.

    Raises:
        ModelError: one is no HDF5 file, or damaged.
    """
    import h5py

    try:
        check(then)
        check(now)
        with h5py.File(then) as a, h5py.File(now) as b:
            return _of_groups(a, b)
    except OSError:
        raise ModelError(f"{then}: cannot be compared: expected two HDF5 files") from None


def _of_groups(a: Any, b: Any) -> str:
    import h5py

    for name in dict.fromkeys((*a, *b)):
        place = f"{a.name.rstrip('/')}/{name}".lstrip("/")
        if (name in a) != (name in b):
            return f"{place}: {'there then, not now' if name in a else 'not there then, there now'}"
        one, other = a[name], b[name]
        if isinstance(one, h5py.Group) != isinstance(other, h5py.Group):
            return f"{place}: of another kind"
        told = _of_groups(one, other) if isinstance(one, h5py.Group) else _of_arrays(place, one[()], other[()])
        if not told and not isinstance(one, h5py.Group):
            told = _of_attributes(one, other)
        if told:
            return told
    return _of_attributes(a, b)


def _of_attributes(a: Any, b: Any) -> str:
    for name in dict.fromkeys((*a.attrs, *b.attrs)):
        if name in _ORIGIN or name.startswith(RECORDING):
            continue
        one, other = a.attrs.get(name), b.attrs.get(name)
        if not _same(one, other):
            place = f"{a.name}.{name}".lstrip("/.")
            return f"{place}: {_told(one)} then, {_told(other)} now"
    return ""


def _of_arrays(place: str, one: Any, other: Any) -> str:
    if _same(one, other):
        return ""
    one, other = np.asarray(one), np.asarray(other)
    if one.dtype != other.dtype or one.ndim != other.ndim or one.ndim == 0:
        return f"{place}: {_told(one)} then, {_told(other)} now"
    message = "" if one.shape == other.shape else f" (shape {one.shape} then, {other.shape} now)"
    least = tuple(slice(min(pair)) for pair in zip(one.shape, other.shape, strict=True))
    differs = np.argwhere(_unequal(one[least], other[least]))
    if not differs.size:
        return f"{place}: shape {one.shape} then, {other.shape} now"
    at = tuple(int(k) for k in differs[0])
    where = ", ".join(map(str, at))
    return f"{place}[{where}]: {_told(one[at])} then, {_told(other[at])} now{message}"


def _unequal(a: Any, b: Any) -> Any:
    return (a != b) & ~((a != a) & (b != b)) if a.dtype.kind == "f" else a != b


def _same(a: Any, b: Any) -> bool:
    """Whether two values are the same bits."""
    if a is None or b is None:
        return a is b
    a, b = np.asarray(a), np.asarray(b)
    if a.dtype.kind == "O" or b.dtype.kind == "O":
        return bool(a.shape == b.shape and a.tolist() == b.tolist())
    return bool(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes())


def _told(value: Any) -> str:
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    array = np.asarray(value)
    return repr(array.item()) if array.ndim == 0 and array.dtype.kind != "O" else shown(value)
