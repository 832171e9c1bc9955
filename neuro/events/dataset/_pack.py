"""What a process does for `_store`: decode a batch of samples and pack them into a small HDF5 file."""

from __future__ import annotations

import json
import os
import signal
import threading
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing import connection, parent_process
from pathlib import Path
from typing import Any

from neuro.core.extension import run_extensions
from neuro.events.errors import EventFileError, EventFileWarning

CHOICES = ("skip", "mend", "stop")
"""What may become of a damaged sample."""


@dataclass(frozen=True, slots=True)
class Job:
    """What all batches share.

    Attributes:
        samples: of the whole data set.
        sensor_size: for `load`.
        damaged: one of `CHOICES`.
        folder: where the small files go.
        extensions: files of the user's that register parts.
    """

    samples: tuple[Any, ...]
    sensor_size: tuple[int, int] | None
    damaged: str
    folder: str
    extensions: tuple[str, ...] = ()


_job: Job


def begin(job: Job, alone: bool = True) -> None:
    """Set a process up.

    Args:
        job: what it will work for.
        alone: whether the process is there for nothing else: then Ctrl-C is left to the one that started it, and it
            ends with that one, also where that is killed.
    """
    global _job
    _job = job
    if alone:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        threading.Thread(target=_end_with_parent, daemon=True).start()
        run_extensions(job.extensions)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def pack(numbers: Sequence[int]) -> int:
    """Pack some samples into a small file that is whole or not there.

    Args:
        numbers: of the samples.

    Returns:
        How many they are.

    Raises:
        EventFileError: one is damaged, and that is to stop.
    """
    from neuro.core.hdf5 import new_file
    from neuro.core.outputs import Kind, output
    from neuro.events.formats.hdf5 import write_sample

    path = Path(_job.folder) / f"{numbers[0]:08d}.h5"
    damaged = {}
    with output(path, Kind("a batch"), replace=True) as part, new_file(part, libver=("v108", "v108")) as file:
        for number in numbers:
            events, fault = _loaded(_job.samples[number])
            if fault:
                damaged[str(number)] = fault
            if events is not None:
                write_sample(file, str(number), events)
        file.attrs["damaged"] = json.dumps(damaged)
    return len(numbers)


def _loaded(sample: Any) -> tuple[Any, str]:
    """The events of a sample and what is wrong with it, None where nothing is to be kept."""
    if _job.damaged != "mend":
        try:
            return sample.load(sensor_size=_job.sensor_size), ""
        except EventFileError as error:
            if _job.damaged == "stop":
                raise
            return None, _told(error)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", EventFileWarning)
        try:
            events = sample.load(sensor_size=_job.sensor_size, strict=False)
        except EventFileError as error:
            return None, _told(error)
    return events, "; ".join(str(one.message).removeprefix(f"{sample.path}: ") for one in told)


def _told(error: EventFileError) -> str:
    return error.what if error.offset is None else f"byte {error.offset}: {error.what}"
