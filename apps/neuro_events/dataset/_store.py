"""Samples in an HDF5 file that is laid out ``/<class>/<sample>``."""

from __future__ import annotations

import hashlib
import itertools
import json
import shutil
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from neuro import ModelError
from neuro.apps import Done, Kind, LazyModule, Lost, Processes, Raised, Work, cores, hdf5, output, unknown, write_text
from neuro_events._events import Events
from neuro_events.dataset._layouts import FileContent, natural
from neuro_events.formats._format import Damage
from neuro_events.formats._hdf5_recording import FAILURES, member, one_line
from neuro_events.source import EventFileError, EventFileWarning

h5py = LazyModule("h5py")

FORMAT = "neuro event data set 1"
CLASSES = "classes"
"""Attribute of the file: names in the order of their labels, as JSON."""
NUMBER = "number"
"""Attribute of a sample: its number in the data set that it was made of."""


def opened(path: str, whole: bool = False) -> Any:
    """An open HDF5 file.

    Args:
        path: of the file.
        whole: whether it was checked before.

    Raises:
        EventFileError: it is no whole HDF5 file, or not what this package wrote.
    """
    try:
        if not whole:
            hdf5.check(Path(path))
        return h5py.File(path, "r")
    except ModelError as error:
        raise EventFileError(path, error.message.removeprefix(f"{Path(path)}: "), hint=error.hint) from None
    except OSError as error:
        raise EventFileError(path, f"no whole HDF5: {error}") from None


class _File:
    """An HDF5 file that is opened when it is used, and anew in another process, which need not check it again."""

    def __init__(self, path: str, whole: bool = False) -> None:
        self.path, self._whole = path, whole
        self._open: Any = None

    def __getstate__(self) -> tuple[str, bool]:
        return self.path, self._whole

    def __setstate__(self, state: tuple[str, bool]) -> None:
        self.__init__(*state)  # type: ignore[misc]

    @property
    def file(self) -> Any:
        if self._open is None:
            self._open = opened(self.path, self._whole)
            self._whole = True
        return self._open

    def close(self) -> None:
        """Close the file until it is used again."""
        if self._open is not None:
            self._open.close()
            self._open = None


@dataclass(frozen=True, slots=True)
class StoredSample:
    """A sample of an HDF5 file.

    Attributes:
        name: ``class/sample``.
        path: the file with the name behind it, for messages.
        label: index of its class.
    """

    name: str
    path: str
    label: int
    _place: int
    _file: _File

    @property
    def number(self) -> int:
        """Its number in the data set that the file was made of; by name in a file of another library."""
        with self._told():
            return int(self._file.file[self.name].attrs.get(NUMBER, self._place))

    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """The events; arguments and errors as of `neuro.events.load`. Samples have no damage that could be left out."""
        from neuro_events.formats.hdf5 import read_sample

        with self._told():
            events = read_sample(self._file.file[self.name])
            if sensor_size is None or sensor_size == events.sensor_size:
                return events
            return Events(events.t, events.x, events.y, events.p, sensor_size, events.metadata)

    def read(self) -> bytes:
        """Sensor and events as bytes; see `Sample`."""
        events = self.load()
        return repr(events.sensor_size).encode() + events.records().tobytes()

    def stamp(self) -> str:
        """Return the stamp of the file; see `Sample`."""
        return FileContent(Path(self._file.path)).stamp()

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Width and height, and whether they are stated; see `Sample`."""
        from neuro_events.formats.hdf5 import sample_size

        with self._told():
            size = sample_size(self._file.file[self.name])
        return (size, True) if size else (self.load().sensor_size, False)

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Tell what is wrong with the sample as an `EventFileError` that names it; the file is closed then."""
        try:
            yield
        except (Damage, EventFileError) as error:
            self._file.close()
            raise EventFileError(self.path, error.what, error.offset) from None
        except FAILURES as error:
            self._file.close()
            raise EventFileError(self.path, one_line(error)) from None


def stored_samples(path: str, classes: Sequence[str] | None = None) -> tuple[tuple[str, ...], tuple[StoredSample, ...]]:
    """The classes and samples of a file, sorted by class and name (numbers by value).

    Args:
        path: the HDF5 file.
        classes: names in the order of their labels; None takes those that the file states, else its groups by name.

    Raises:
        EventFileError: it has no samples, or a class that ``classes`` lacks.
    """
    holder = _File(path)
    with _damage_told(holder):
        return _listed(holder, path, classes)


def holds_samples(path: str) -> bool:
    """Whether an HDF5 file is a data set; if not, it may be a recording.

    Raises:
        EventFileError: it is no whole HDF5 file.
    """
    if hdf5.has_format(Path(path), FORMAT):
        return True
    holder = _File(path)
    with _damage_told(holder):
        found = any(True for _ in _names(holder.file))
    holder.close()
    return found


@contextmanager
def _damage_told(holder: _File) -> Iterator[None]:
    """Report what is wrong with a file as an `EventFileError` that names it; the file is closed then."""
    try:
        yield
    except FAILURES as error:
        holder.close()
        if isinstance(error, EventFileError):
            raise
        what = error.what if isinstance(error, Damage) else f"no whole HDF5: {one_line(error)}"
        raise EventFileError(holder.path, what) from None


def _names(file: Any) -> Iterator[tuple[str, str]]:
    """Class and name of each sample."""
    if "CD/events" in file:  # Prophesee's place for the events of a recording, see `neuro.events.formats.hdf5`
        return
    own = CLASSES in file.attrs  # then all are samples; to open each of 10,000 takes seconds
    for group in sorted((name for name in file if isinstance(member(file, name), h5py.Group)), key=natural):
        for name in sorted(members := file[group], key=natural):
            if own or getattr(getattr(member(members, name), "dtype", None), "names", None):
                yield group, name


def _listed(
    holder: _File, path: str, classes: Sequence[str] | None
) -> tuple[tuple[str, ...], tuple[StoredSample, ...]]:
    file = holder.file
    names = list(_names(file))
    if not names:
        raise EventFileError(path, "holds no samples, expected /<class>/<sample> with rows ts, x, y, p")
    groups = list(dict.fromkeys(group for group, _ in names))
    known = tuple(classes if classes is not None else _named(file, groups))
    if missing := [group for group in groups if group not in known]:
        raise EventFileError(path, f"class {missing[0]!r} is new, expected one of {', '.join(known)}")
    samples = (
        StoredSample(f"{group}/{name}", f"{path}/{group}/{name}", known.index(group), k, holder)
        for k, (group, name) in enumerate(names)
    )
    return known, tuple(samples)


def _named(file: Any, groups: Sequence[str]) -> Sequence[str]:
    text = file.attrs.get(CLASSES)
    try:
        names = json.loads(text) if isinstance(text, str) else groups
    except ValueError:
        names = groups
    return names if isinstance(names, list) and set(groups) <= set(names) else groups


BATCH = 64
"""Samples of a small file; a kill costs at most so many of each process."""

PLAN = "plan"
"""Attribute of the file: what was asked for; equal for equal calls."""
CHOICE = "choice"
"""Attribute of the file: what was to become of damaged samples."""
DAMAGED = "damaged"
"""Attribute of the file: number of each damaged sample, and what is wrong with it, as JSON."""

STAMPS = "stamps"
"""Attribute of a small file: the stamp of each sample in it by its number, as JSON. Of the whole file: their digest."""

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
    done = _done(folder, samples)
    missing = [k for k in range(len(samples)) if k not in done]
    tell("reading", len(done), len(samples))
    job = ConversionJob(tuple(samples), sensor_size, damaged, str(folder))
    size = max(1, min(BATCH, len(missing) // (8 * (jobs or cores()))))
    batches = [missing[k : k + size] for k in range(0, len(missing), size)]
    count = len(done)
    for finished in _pack_all(job, batches, jobs or cores()):
        count += finished
        tell("reading", count, len(samples))
    stamps = _stamps(samples)
    if stale := set(range(len(samples))) - _done(folder, samples):
        raise EventFileError(samples[min(stale)].path, "was changed while it was converted: the same call goes on")
    _join(folder, path, samples, classes, {PLAN: plan, CHOICE: damaged, STAMPS: stamps or ""}, tell)
    shutil.rmtree(folder)
    return _finished(path, samples, plan, damaged)


def _plan(samples: Sequence[Any], classes: Sequence[str], size: tuple[int, int] | None) -> str:
    digest = hashlib.sha256(repr((1, tuple(classes), size)).encode())
    for sample in samples:
        digest.update(f"\0{sample.name}\0{sample.label}".encode())
    return digest.hexdigest()


def _stamps(samples: Sequence[Any]) -> str | None:
    """Return a digest of the stamps of all samples, None where one is there no more."""
    try:
        return hashlib.sha256("\0".join(sample.stamp() for sample in samples).encode()).hexdigest()
    except OSError:
        return None


def _finished(path: Path, samples: Sequence[Any], plan: str, choice: str) -> StoredDataSet:
    """What a finished file holds.

    Raises:
        EventFileError: it is another file, or damaged.
    """
    if hdf5.has_format(path, FORMAT):
        with opened(str(path)) as file:
            damaged = json.loads(file.attrs.get(DAMAGED, "{}"))
            if file.attrs.get(PLAN) == plan and (not damaged or file.attrs[CHOICE] == choice):
                if file.attrs.get(STAMPS) != (stamps := _stamps(samples)) and stamps is not None:
                    raise EventFileError(
                        str(path), "was made of samples that have changed since, or by neuro 0.2.0; expected a new name"
                    )
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


def _done(folder: Path, samples: Sequence[Any]) -> set[int]:
    """Return the numbers of all samples in whole small files.

    Other small files, those with a sample that has changed since, and what was being written are removed.
    """
    done: set[int] = set()
    for stray in folder.glob(".*.part"):
        stray.unlink(missing_ok=True)
    for part in folder.glob("*.h5"):
        if not hdf5.is_whole(part, BATCH_FORMAT):
            part.unlink()
            continue
        with h5py.File(part, "r") as file:
            stamps = json.loads(file.attrs[STAMPS])
        if any(samples[int(number)].stamp() != stamp for number, stamp in stamps.items()):
            part.unlink()
            continue
        done |= {*map(int, stamps)}
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
                    yield event.result
                elif isinstance(event, Raised):
                    raise event.error
                elif isinstance(event, Lost):
                    raise EventFileError(job.folder, _LOST.format(event.how, event.attempts))


def _unique_names(samples: Sequence[Any], classes: Sequence[str]) -> list[str]:
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
    names = _unique_names(samples, classes)
    places, damaged = _contents(folder)
    done, order = 0, sorted(places)
    tell("writing", done, len(order))
    with output(path, Kind("a data set")) as part, hdf5.new_file(part, FORMAT, libver=("v108", "v108")) as out:
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
    places, damaged = dict[int, Path](), dict[str, str]()
    for small in folder.glob("*.h5"):
        with h5py.File(small, "r") as file:
            places |= dict.fromkeys(map(int, file), small)
            damaged |= json.loads(file.attrs[DAMAGED])
    return places, {number: damaged[number] for number in sorted(damaged, key=int)}


CHOICES = ("skip", "mend", "stop")
"""What may become of a damaged sample."""


BATCH_FORMAT = "neuro event batch 2"


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
    from neuro_events.formats.hdf5 import write_sample

    path = Path(job.folder) / f"{numbers[0]:08d}.h5"
    damaged = {}
    with (
        output(path, Kind("a batch"), replace=True) as part,
        hdf5.new_file(part, BATCH_FORMAT, libver=("v108", "v108")) as file,
    ):
        stamps = {str(number): job.samples[number].stamp() for number in numbers}
        for number in numbers:
            events, fault = _loaded(job, job.samples[number])
            if fault:
                damaged[str(number)] = fault
            if events is not None:
                write_sample(file, str(number), events)
        file.attrs[DAMAGED], file.attrs[STAMPS] = json.dumps(damaged), json.dumps(stamps)
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
