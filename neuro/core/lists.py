"""Kinds of quantities that are lists: ids, spike times, moments, series of values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.arrays import array_of, check_each
from neuro.core.errors import ModelError
from neuro.core.quantities import KINDS, LARGEST, Quantity, kind
from neuro.core.values import FromFile, is_number, shown
from neuro.core.wrong import wrong


@kind("array", "a number", is_list=True)
def _undrawn(q: Quantity, value: Any, label: str) -> Any:
    if is_number(value) or getattr(value, "kind", "") == "distribution":
        raise ModelError(f"{label} = {shown(value)}: expected a list or a file")
    return KINDS["number"].check(q, value, label)


@kind("ids", "whole numbers", is_list=True)
def _ids(q: Quantity, value: Any, label: str) -> NDArray[np.int64]:
    array = value.values if isinstance(value, FromFile) else array_of(q, value, label)
    if array.ndim != 1:
        raise wrong(q, value, label)
    bad = np.flatnonzero(~((array >= 0) & (array <= LARGEST) & (array == np.floor(array))))
    if bad.size:
        raise wrong(q, float(array[bad[0]]), label, int(bad[0]))
    ids = array.astype(np.int64)
    ids.flags.writeable = False
    return ids


@kind("times", "a list of spike times in ms for each neuron", is_list=True)
def _times(q: Quantity, value: Any, label: str) -> tuple[NDArray[np.float64], ...]:
    """Return one list for each neuron. Rows of a file are padded with NaN to the length of the longest."""
    if isinstance(value, FromFile):
        table = np.atleast_2d(value.values)
        return tuple(
            _train(q, row[: row.size - int(np.isnan(row[::-1]).cumprod().sum())], label, [n])
            for n, row in enumerate(table)
        )
    if not isinstance(value, (list, tuple, np.ndarray)):
        raise wrong(q, value, label)
    if len(value) and all(map(is_number, value)):
        return (_train(q, value, label, []),)
    return tuple(_train(q, row, label, [n]) for n, row in enumerate(value))


def _train(q: Quantity, row: Any, label: str, index: list[int]) -> NDArray[np.float64]:
    if not isinstance(row, (list, tuple, np.ndarray)):
        raise wrong(q, row, label, *index)
    times = array_of(q, row, label)
    if times.ndim != 1:
        raise wrong(q, row, label, *index)
    bad = np.flatnonzero(~(np.isfinite(times) & (times > 0) & (np.diff(times, prepend=0.0) >= 0)))
    if bad.size:
        k = int(bad[0])
        position = ", ".join(map(str, [*index, k]))
        message = f"{label}[{position}] = {shown(float(times[k]))}: expected spike times > 0 ms in ascending order"
        raise ModelError(message, path=tuple(map(str, [*index, k])))
    return times


@kind("moments", "times > 0 ms, each later than the one before", is_list=True)
def _moments(q: Quantity, value: Any, label: str) -> NDArray[np.float64]:
    times = value.values if isinstance(value, FromFile) else _rows(q, value, label)
    if times.ndim != 1:
        raise wrong(q, value, label)
    bad = np.flatnonzero(~(np.isfinite(times) & (np.diff(times, prepend=0.0) > 0)))
    if bad.size:
        raise wrong(q, float(times[bad[0]]), label, int(bad[0]))
    return times


@kind("series", "a list of numbers", is_list=True)
def _series(q: Quantity, value: Any, label: str) -> NDArray[np.float64]:
    array = value.values if isinstance(value, FromFile) else _rows(q, value, label)
    if array.ndim not in (1, 2):
        raise wrong(q, value, label)
    check_each(q, array, label)
    return array


@kind("train", "a row for each spike: a time > 0 ms, not before the last one, and a neuron", is_list=True)
@kind(
    "graded_train",
    "a row for each spike: a time > 0 ms, not before the last one, a neuron and a whole payload of 32 bits",
    is_list=True,
)
def _spikes(q: Quantity, value: Any, label: str) -> NDArray[np.float64]:
    rows = value.values if isinstance(value, FromFile) else _rows(q, value, label)
    columns = 2 if q.kind == "train" else 3
    rows = rows.reshape(0, columns) if rows.size == 0 else rows
    if rows.ndim != 2 or rows.shape[1] != columns:
        raise wrong(q, value, label)
    times, ids, payloads = rows[:, 0], rows[:, 1], rows[:, 2:]
    bad = ~(np.isfinite(times) & (times > 0) & (np.diff(times, prepend=0.0) >= 0))
    bad |= ~((ids >= 0) & (ids <= LARGEST) & (ids == np.floor(ids)))
    bad |= ~((np.abs(payloads) < 2**31) & (payloads == np.floor(payloads))).all(axis=1)
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        previous = f" after {shown(float(times[k - 1]))} ms" if k and times[k] < times[k - 1] else ""
        carried = "".join(f" with payload {_or_beyond(payload)}" for payload in payloads[k])
        spike = f"{shown(float(times[k]))} ms of neuron {_or_beyond(ids[k])}{carried}{previous}"
        raise ModelError(f"{label}[{k}] = {spike}: expected {q.expected()}", path=(str(k),))
    return rows


def _or_beyond(value: float) -> str:
    """Return a number as text. A number beyond the bound is followed by the bound: "3e+09, above 2147483647"."""
    bound = f", above {LARGEST}" if value > LARGEST else f", below -{LARGEST}" if value < -LARGEST else ""
    return shown(float(value)) + bound


def _rows(q: Quantity, value: Any, label: str) -> NDArray[np.float64]:
    """Return a list or an array as an array; distributions are refused."""
    if not isinstance(value, (list, tuple, np.ndarray)):
        raise wrong(q, value, label)
    return array_of(q, value, label)
