"""Writing events into HDF5: a recording as a file, and a sample into a data set."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.core.hdf5 import new_file
from neuro.events._events import EVENT, Events
from neuro.events.formats._format import Unsavable
from neuro.events.formats._hdf5_attributes import describe

FORMAT = "neuro events 1"

SAMPLE = np.dtype([("ts", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
"""A row of a sample: aertb's field names, with times that are exact."""

CHUNK = 1 << 15
"""Events of a chunk; 256 KiB of times, within HDF5's cache of 1 MiB."""

INDEX_LIMIT = 10**8
"""Longest recording that gets an index, ms: 28 hours."""
INDEX_BLOCK = 10**6

PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "shuffle": True}


def write(parts: Iterator[Events], path: Path) -> None:
    """Encode as HDF5, laid out as DSEC's recordings are; see `neuro.events.formats.hdf5`.

    Raises:
        Unsavable: a time lies 2^63 us or more after the first.
    """
    # The format of HDF5 1.8 has room for attributes longer than 64 KiB.
    with new_file(path, FORMAT, libver=("v108", "v108")) as file:
        group = file.create_group("events")
        columns = {key: _column(group, key, EVENT[key]) for key in "txyp"}
        index, offset, done = _column(file, "ms_to_idx", np.dtype("<u8")), 0, 0
        for events in parts:
            describe(group, events.sensor_size, events.metadata)
            if not len(events):
                continue
            offset = offset if done else int(events.t[0])
            if int(events.t[-1]) - offset >= 1 << 63:
                raise Unsavable(f"t {events.t[-1]} lies 2^63 us or more after the first", done + len(events) - 1)
            t = events.t - offset
            for key, values in (("t", t), ("x", events.x), ("y", events.y), ("p", events.p)):
                _append(columns[key], values)
            if index is not None and t[-1] // 1000 >= INDEX_LIMIT:
                del file["ms_to_idx"]
                index = None
            if index is not None:
                _extend_index(index, t, done)
            done += len(events)
        file.create_dataset("t_offset", data=np.int64(offset))


def write_sample(group: Any, name: str, events: Events) -> None:
    """Write a recording into a data set as one array of rows ts, x, y, p, as aertb lays data sets out.

    Args:
        group: an open h5py group, that of the class.
        name: of the sample.
        events: what to write; sensor size and metadata become attributes.

    Raises:
        ValueError: the group has something of this name.
    """
    rows = np.empty(len(events), SAMPLE)
    rows["ts"], rows["x"], rows["y"], rows["p"] = events.t, events.x, events.y, events.p
    chunk = max(1, min(len(rows), CHUNK))
    dataset = group.create_dataset(name, data=rows, maxshape=(None,), chunks=(chunk,), **PACKED)
    describe(dataset, events.sensor_size, events.metadata)


def _column(group: Any, name: str, kind: np.dtype[Any]) -> Any:
    return group.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(CHUNK,), **PACKED)


def _append(dataset: Any, values: npt.NDArray[Any]) -> None:
    begin = dataset.shape[0]
    dataset.resize((begin + values.size,))
    dataset[begin:] = values


def _extend_index(index: Any, t: npt.NDArray[np.int64], done: int) -> None:
    """Go on with the number of the first event at or after each ms, for those until the last event."""
    end = int(t[-1]) // 1000 + 1
    for begin in range(index.shape[0], end, INDEX_BLOCK):
        starts = 1000 * np.arange(begin, min(end, begin + INDEX_BLOCK), dtype=np.int64)
        _append(index, done + np.searchsorted(t, starts).astype(np.uint64))
