"""What a process does for `_store`: decode a batch of samples and pack them into a small HDF5 file."""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from neuro.core.processes import Work
from neuro.events.errors import EventFileError, EventFileWarning

CHOICES = ("skip", "mend", "stop")
"""What may become of a damaged sample."""


FORMAT = "neuro event batch 1"


@dataclass(frozen=True, slots=True)
class Job:
    """What all batches share.

    Attributes:
        samples: of the whole data set.
        sensor_size: for `load`.
        damaged: one of `CHOICES`.
        folder: where the small files go.
    """

    samples: tuple[Any, ...]
    sensor_size: tuple[int, int] | None
    damaged: str
    folder: str


def begin(job: Job) -> Work:
    """What packs batches in a process of its own."""
    return lambda numbers, attempt, tell: pack(job, numbers)


def pack(job: Job, numbers: Sequence[int]) -> int:
    """Pack some samples into a small file that is whole or not there.

    Args:
        job: what it is done for.
        numbers: of the samples.

    Returns:
        How many they are.

    Raises:
        EventFileError: one is damaged, and that is to stop.
    """
    from neuro.core.hdf5 import new_file
    from neuro.core.outputs import Kind, output
    from neuro.events.formats.hdf5 import write_sample

    path = Path(job.folder) / f"{numbers[0]:08d}.h5"
    damaged = {}
    with output(path, Kind("a batch"), replace=True) as part, new_file(part, FORMAT, libver=("v108", "v108")) as file:
        for number in numbers:
            events, fault = _loaded(job, job.samples[number])
            if fault:
                damaged[str(number)] = fault
            if events is not None:
                write_sample(file, str(number), events)
        file.attrs["damaged"] = json.dumps(damaged)
    return len(numbers)


def _loaded(job: Job, sample: Any) -> tuple[Any, str]:
    """The events of a sample and what is wrong with it, None where nothing is to be kept."""
    if job.damaged != "mend":
        try:
            return sample.load(sensor_size=job.sensor_size), ""
        except EventFileError as error:
            if job.damaged == "stop":
                raise
            return None, _told(error)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", EventFileWarning)
        try:
            events = sample.load(sensor_size=job.sensor_size, strict=False)
        except EventFileError as error:
            return None, _told(error)
    return events, "; ".join(str(one.message).removeprefix(f"{sample.path}: ") for one in told)


def _told(error: EventFileError) -> str:
    return error.what if error.offset is None else f"byte {error.offset}: {error.what}"
