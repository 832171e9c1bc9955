"""Writing a data set to one HDF5 file: by all cores, and so that a kill costs only what was being done.

Processes decode samples and pack them into small HDF5 files in a folder beside the one to be written, each of which is
whole or not there. When all samples are done, their packed rows are copied as they are into one file, which takes its
name at the end. So all files are valid at any time, and the same call goes on with the samples that are missing.

The layout is aertb's: ``/<class>/<sample>`` with rows ts, x, y, p, see `neuro.events.formats.hdf5`; all else is in
attributes.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import shutil
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from neuro.core.errors import unknown
from neuro.core.hdf5 import has_format, is_whole, new_file
from neuro.core.outputs import Kind, output, write_text
from neuro.core.processes import Done, Lost, Processes, Raised, Work, cores
from neuro.events.dataset._stored import CLASSES, FORMAT, NUMBER, opened
from neuro.events.errors import EventFileError, EventFileWarning

BATCH = 64
"""Samples of a small file; a kill costs at most so many of each process."""

PLAN = "plan"
"""Attribute of the file: what was asked for; equal for equal calls."""
CHOICE = "choice"
"""Attribute of the file: what was to become of damaged samples."""
DAMAGED = "damaged"
"""Attribute of the file: number of each damaged sample, and what is wrong with it, as JSON."""

_LOST = "a process that packs samples {}, {} times: it was killed or ran out of memory; the same call goes on"

Report = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class StoredDataSet:
    """What `Dataset.to_hdf5` did.

    Attributes:
        path: the file.
        samples: how many samples it holds.
        damaged: path of each damaged sample and what is wrong with it.
    """

    path: str
    samples: int
    damaged: Mapping[str, str]


def store(
    samples: Sequence[Any],
    classes: Sequence[str],
    path: Path,
    sensor_size: tuple[int, int] | None,
    *,
    jobs: int | None,
    damaged: str,
    report: Report | None,
) -> StoredDataSet:
    """Write samples to one file; arguments and errors as of `neuro.events.Dataset.to_hdf5`."""
    if damaged not in CHOICES:
        raise unknown("choice for damaged", damaged, CHOICES)
    tell = report or (lambda what, done, total: None)
    plan = _plan(samples, classes, sensor_size)
    if path.exists():
        return _finished(path, samples, plan, damaged)
    folder = path.with_name(f"{path.name}.parts")
    _begin(folder, f"{plan} {damaged}")
    done = _done(folder)
    missing = [k for k in range(len(samples)) if k not in done]
    tell("reading", len(done), len(samples))
    job = ConversionJob(tuple(samples), sensor_size, damaged, str(folder))
    size = max(1, min(BATCH, len(missing) // (8 * (jobs or cores()))))
    batches = [missing[k : k + size] for k in range(0, len(missing), size)]
    count = len(done)
    for finished in _pack_all(job, batches, jobs or cores()):
        count += finished
        tell("reading", count, len(samples))
    _join(folder, path, samples, classes, {PLAN: plan, CHOICE: damaged}, tell)
    shutil.rmtree(folder)
    return _finished(path, samples, plan, damaged)


def _plan(samples: Sequence[Any], classes: Sequence[str], size: tuple[int, int] | None) -> str:
    digest = hashlib.sha256(repr((1, tuple(classes), size)).encode())
    for sample in samples:
        digest.update(f"\0{sample.name}\0{sample.label}".encode())
    return digest.hexdigest()


def _finished(path: Path, samples: Sequence[Any], plan: str, choice: str) -> StoredDataSet:
    """What a finished file holds.

    Raises:
        EventFileError: it is another file, or damaged.
    """
    if has_format(path, FORMAT):
        with opened(str(path)) as file:
            damaged = json.loads(file.attrs.get(DAMAGED, "{}"))
            if file.attrs.get(PLAN) == plan and (not damaged or file.attrs[CHOICE] == choice):
                count = sum(len(file[name]) for name in file)
                return StoredDataSet(str(path), count, {samples[int(k)].path: what for k, what in damaged.items()})
    raise EventFileError(str(path), "exists and holds something else; expected a new name")


def _begin(folder: Path, plan: str) -> None:
    """Make the folder, or see that it is of this plan."""
    note = folder / "plan.txt"
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise EventFileError(str(folder), f"cannot write: {error.strerror}") from None
    if note.exists():
        if note.read_text() != plan:
            text = "is what another conversion to the same name has done so far; go on with that one, or remove it"
            raise EventFileError(str(folder), text)
    elif any(folder.glob("*.h5")):
        raise EventFileError(str(folder), "exists and is no conversion that was begun; expected a new name")
    else:
        write_text(note, plan, Kind("a plan"))


def _done(folder: Path) -> set[int]:
    """The numbers of all samples in whole small files; others, and what was being written, are removed."""
    import h5py

    done: set[int] = set()
    for stray in folder.glob(".*.part"):
        stray.unlink(missing_ok=True)
    for part in folder.glob("*.h5"):
        if not is_whole(part, BATCH_FORMAT):
            part.unlink()
            continue
        with h5py.File(part, "r") as file:
            done |= {*map(int, file), *map(int, json.loads(file.attrs[DAMAGED]))}
    return done


def _pack_all(job: ConversionJob, batches: Sequence[Sequence[int]], jobs: int) -> Iterator[int]:
    """Pack all batches; gives the number of samples of each when it is done."""
    if jobs == 1 or len(batches) < 2:
        yield from (pack(job, batch) for batch in batches)
        return
    with Processes(partial(start_worker, job), min(jobs, len(batches))) as pool:
        for batch in batches:
            pool.put(batch)
        while pool.busy:
            for event in pool.hear():
                if isinstance(event, Done):
                    yield event.found
                elif isinstance(event, Raised):
                    raise event.error
                elif isinstance(event, Lost):
                    raise EventFileError(job.folder, _LOST.format(event.how, event.attempts))


def _names(samples: Sequence[Any], classes: Sequence[str]) -> list[str]:
    """``class/sample`` of each: the file's name without ending, or the whole path where a class has that name twice."""
    stems = [f"{classes[s.label]}/{_stem(s.name)}" for s in samples]
    often = Counter(stems)
    whole = [f"{classes[s.label]}/{s.name.replace('/', '_')}" for s in samples]
    return [stem if often[stem] == 1 else name for stem, name in zip(stems, whole, strict=True)]


def _stem(name: str) -> str:
    file, mark, number = PurePosixPath(name).name.partition("#")
    return PurePosixPath(file).stem + (f"_{number}" if mark else "")


def _join(
    folder: Path, path: Path, samples: Sequence[Any], classes: Sequence[str], notes: Mapping[str, str], tell: Report
) -> None:
    """Copy all small files into one, in the order of the samples: the same bytes, however often it was gone on with."""
    import h5py

    names = _names(samples, classes)
    places, damaged = _contents(folder)
    done, order = 0, sorted(places)
    tell("writing", done, len(order))
    with output(path, Kind("a data set")) as part, new_file(part, FORMAT, libver=("v108", "v108")) as out:
        for small, numbers in itertools.groupby(order, key=places.__getitem__):
            with h5py.File(small, "r") as file:
                for number in numbers:
                    group, _, name = names[number].partition("/")
                    target = out.require_group(group)
                    file.copy(str(number), target, name)
                    target[name].attrs[NUMBER] = number
                    done += 1
            tell("writing", done, len(order))
        out.attrs[CLASSES] = json.dumps(list(classes))
        out.attrs[DAMAGED] = json.dumps(damaged)
        out.attrs.update(notes)


def _contents(folder: Path) -> tuple[dict[int, Path], dict[str, str]]:
    """In which small file each sample is, and what is wrong with the damaged ones."""
    import h5py

    places, damaged = dict[int, Path](), dict[str, str]()
    for small in folder.glob("*.h5"):
        with h5py.File(small, "r") as file:
            places |= dict.fromkeys(map(int, file), small)
            damaged |= json.loads(file.attrs[DAMAGED])
    return places, {number: damaged[number] for number in sorted(damaged, key=int)}


CHOICES = ("skip", "mend", "stop")
"""What may become of a damaged sample."""


BATCH_FORMAT = "neuro event batch 1"


@dataclass(frozen=True, slots=True)
class ConversionJob:
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


def start_worker(job: ConversionJob) -> Work:
    """What packs batches in a process of its own."""
    return lambda numbers, attempt, tell: pack(job, numbers)


def pack(job: ConversionJob, numbers: Sequence[int]) -> int:
    """Pack some samples into a small file that is whole or not there.

    Args:
        job: what it is done for.
        numbers: of the samples.

    Returns:
        How many they are.

    Raises:
        EventFileError: one is damaged, and that is to stop.
    """
    from neuro.events.formats.hdf5 import write_sample

    path = Path(job.folder) / f"{numbers[0]:08d}.h5"
    damaged = {}
    with (
        output(path, Kind("a batch"), replace=True) as part,
        new_file(part, BATCH_FORMAT, libver=("v108", "v108")) as file,
    ):
        for number in numbers:
            events, fault = _loaded(job, job.samples[number])
            if fault:
                damaged[str(number)] = fault
            if events is not None:
                write_sample(file, str(number), events)
        file.attrs[DAMAGED] = json.dumps(damaged)
    return len(numbers)


def _loaded(job: ConversionJob, sample: Any) -> tuple[Any, str]:
    """The events of a sample and what is wrong with it, None where nothing is to be kept."""
    if job.damaged != "mend":
        try:
            return sample.load(sensor_size=job.sensor_size), ""
        except EventFileError as error:
            if job.damaged == "stop":
                raise
            return None, _told(error)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", EventFileWarning)
        try:
            events = sample.load(sensor_size=job.sensor_size, strict=False)
        except EventFileError as error:
            return None, _told(error)
    return events, "; ".join(str(one.message).removeprefix(f"{sample.path}: ") for one in caught)


def _told(error: EventFileError) -> str:
    return error.what if error.offset is None else f"byte {error.offset}: {error.what}"
