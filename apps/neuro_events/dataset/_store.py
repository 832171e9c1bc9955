"""Data sets in an HDF5 file with samples ``/<class>/<sample>``: reading, and writing with several processes."""

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
from neuro.apps import Kind, LazyModule, Lost, Processes, Work, cores, hdf5, output, unknown, write_text
from neuro_events._events import Events
from neuro_events.dataset._layouts import FileContent, natural
from neuro_events.formats._format import Damage
from neuro_events.formats._hdf5_recording import FAILURES, member, one_line
from neuro_events.source import EventFileError, EventFileWarning

h5py = LazyModule("h5py")

FORMAT = "neuro event data set 1"
CLASSES = "classes"
"""Attribute of the file: class names in the order of their labels, as JSON."""
NUMBER = "number"
"""Attribute of a sample: its number in the original data set."""


def opened(path: str, is_checked: bool = False) -> Any:
    """Open an HDF5 file. The digest of a file of this package is checked first.

    Args:
        path: the file.
        is_checked: True if the digest was checked before. The check is then skipped.

    Raises:
        EventFileError: the file is damaged or was changed.
    """
    try:
        if not is_checked:
            hdf5.check(Path(path))
        return h5py.File(path, "r")
    except ModelError as error:
        raise EventFileError(path, error.message.removeprefix(f"{Path(path)}: "), hint=error.hint) from None
    except OSError as error:
        raise EventFileError(path, f"not an intact HDF5 file: {error}") from None


class _File:
    """An HDF5 file that is opened on use. Another process opens the file again, without a second check."""

    def __init__(self, path: str, is_checked: bool = False) -> None:
        self.path, self._is_checked = path, is_checked
        self._open: Any = None

    def __getstate__(self) -> tuple[str, bool]:
        return self.path, self._is_checked

    def __setstate__(self, state: tuple[str, bool]) -> None:
        self.__init__(*state)  # type: ignore[misc]

    @property
    def file(self) -> Any:
        if self._open is None:
            self._open = opened(self.path, self._is_checked)
            self._is_checked = True
        return self._open

    def close(self) -> None:
        """Close the file until its next use."""
        if self._open is not None:
            self._open.close()
            self._open = None


@dataclass(frozen=True, slots=True)
class StoredSample:
    """A sample of an HDF5 file.

    Attributes:
        name: ``class/sample``.
        path: path of the file followed by the name, for messages.
        label: index of its class.
    """

    name: str
    path: str
    label: int
    _place: int
    _file: _File

    @property
    def number(self) -> int:
        """Number in the original data set, or the position by name in a file of another library."""
        with self._naming_sample():
            return int(self._file.file[self.name].attrs.get(NUMBER, self._place))

    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """Return the events; arguments and errors as for `neuro.events.load`. `strict` has no effect on samples."""
        from neuro_events.formats.hdf5 import read_sample

        with self._naming_sample():
            events = read_sample(self._file.file[self.name])
            if sensor_size is None or sensor_size == events.sensor_size:
                return events
            return Events(events.t, events.x, events.y, events.p, sensor_size, events.metadata)

    def read(self) -> bytes:
        """Return sensor and events as bytes; see `Sample`."""
        events = self.load()
        return repr(events.sensor_size).encode() + events.records().tobytes()

    def stamp(self) -> str:
        """Return the stamp of the file; see `Sample`."""
        return FileContent(Path(self._file.path)).stamp()

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Return width and height, and whether they are stated; see `Sample`."""
        from neuro_events.formats.hdf5 import sample_size

        with self._naming_sample():
            size = sample_size(self._file.file[self.name])
        return (size, True) if size else (self.load().sensor_size, False)

    @contextmanager
    def _naming_sample(self) -> Iterator[None]:
        """Convert errors to an `EventFileError` that names the sample, and close the file."""
        try:
            yield
        except (Damage, EventFileError) as error:
            self._file.close()
            raise EventFileError(self.path, error.what, error.offset) from None
        except FAILURES as error:
            self._file.close()
            raise EventFileError(self.path, one_line(error)) from None


def stored_samples(path: str, classes: Sequence[str] | None = None) -> tuple[tuple[str, ...], tuple[StoredSample, ...]]:
    """Return the classes and samples of a file, sorted by class and name (numbers by value).

    Args:
        path: the HDF5 file.
        classes: names in the order of their labels. None: the names that the file states, else its groups by name.

    Raises:
        EventFileError: the file has no samples, or a class that is not in ``classes``.
    """
    holder = _File(path)
    with _naming_file(holder):
        return _read_listing(holder, path, classes)


def holds_samples(path: str) -> bool:
    """Return whether an HDF5 file is a data set. Otherwise it may be a recording.

    Raises:
        EventFileError: the file is damaged.
    """
    if hdf5.has_format(Path(path), FORMAT):
        return True
    holder = _File(path)
    with _naming_file(holder):
        has_samples = any(True for _ in _names(holder.file))
    holder.close()
    return has_samples


@contextmanager
def _naming_file(holder: _File) -> Iterator[None]:
    """Convert errors to an `EventFileError` that names the file, and close the file."""
    try:
        yield
    except FAILURES as error:
        holder.close()
        if isinstance(error, EventFileError):
            raise
        message = error.what if isinstance(error, Damage) else f"not an intact HDF5 file: {one_line(error)}"
        raise EventFileError(holder.path, message) from None


def _names(file: Any) -> Iterator[tuple[str, str]]:
    """Yield class and name of each sample."""
    if "CD/events" in file:  # a recording of Prophesee, see `neuro.events.formats.hdf5`
        return
    is_own = CLASSES in file.attrs  # all members are samples; opening each of 10,000 would take seconds
    for group in sorted((name for name in file if isinstance(member(file, name), h5py.Group)), key=natural):
        for name in sorted(members := file[group], key=natural):
            if is_own or getattr(getattr(member(members, name), "dtype", None), "names", None):
                yield group, name


def _read_listing(
    holder: _File, path: str, classes: Sequence[str] | None
) -> tuple[tuple[str, ...], tuple[StoredSample, ...]]:
    file = holder.file
    names = list(_names(file))
    if not names:
        raise EventFileError(path, "has no samples, expected /<class>/<sample> with rows ts, x, y, p")
    groups = list(dict.fromkeys(group for group, _ in names))
    class_names = tuple(classes if classes is not None else _class_names(file, groups))
    if missing := [group for group in groups if group not in class_names]:
        raise EventFileError(path, f"class {missing[0]!r} is new, expected one of {', '.join(class_names)}")
    samples = (
        StoredSample(f"{group}/{name}", f"{path}/{group}/{name}", class_names.index(group), k, holder)
        for k, (group, name) in enumerate(names)
    )
    return class_names, tuple(samples)


def _class_names(file: Any, groups: Sequence[str]) -> Sequence[str]:
    """Return the class names that a file states, or its groups if the statement is missing or invalid."""
    text = file.attrs.get(CLASSES)
    try:
        names = json.loads(text) if isinstance(text, str) else groups
    except ValueError:
        names = groups
    return names if isinstance(names, list) and set(groups) <= set(names) else groups


BATCH = 64
"""Number of samples in a batch file, and thus the largest loss per process at an interruption."""

PLAN = "plan"
"""Attribute of the file: digest of the arguments, equal for equal calls."""
CHOICE = "choice"
"""Attribute of the file: treatment of damaged samples."""
DAMAGED = "damaged"
"""Attribute of the file: number and fault of each damaged sample, as JSON."""

STAMPS = "stamps"
"""Attribute of a batch file: the stamp of each sample by its number, as JSON. In the final file: one digest of them."""

_LOST = "a process that packs samples {}, {} times: it was killed or ran out of memory; the same call resumes"

Report = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class StoredDataSet:
    """Result of `Dataset.to_hdf5`.

    Attributes:
        path: the file.
        samples: number of samples in the file.
        damaged: path and fault of each damaged sample.
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
    """Write samples to one file; arguments and errors as for `neuro.events.Dataset.to_hdf5`."""
    if damaged not in CHOICES:
        raise unknown("choice for damaged", damaged, CHOICES)
    progress = report or (lambda what, n_done, total: None)
    plan = _plan(samples, classes, sensor_size)
    if path.exists():
        return _result_of_file(path, samples, plan, damaged)
    folder = path.with_name(f"{path.name}.parts")
    _prepare_folder(folder, f"{plan} {damaged}")
    packed_numbers = _packed_numbers(folder, samples)
    missing_numbers = [k for k in range(len(samples)) if k not in packed_numbers]
    progress("reading", len(packed_numbers), len(samples))
    job = ConversionJob(tuple(samples), sensor_size, damaged, str(folder))
    size = max(1, min(BATCH, len(missing_numbers) // (8 * (jobs or cores()))))
    batches = [missing_numbers[k : k + size] for k in range(0, len(missing_numbers), size)]
    count = len(packed_numbers)
    for n_packed in _pack_all(job, batches, jobs or cores()):
        count += n_packed
        progress("reading", count, len(samples))
    stamps = _stamps(samples)
    if stale := set(range(len(samples))) - _packed_numbers(folder, samples):
        raise EventFileError(samples[min(stale)].path, "was changed during the conversion: the same call resumes")
    _join(folder, path, samples, classes, {PLAN: plan, CHOICE: damaged, STAMPS: stamps or ""}, progress)
    shutil.rmtree(folder)
    return _result_of_file(path, samples, plan, damaged)


def _plan(samples: Sequence[Any], classes: Sequence[str], size: tuple[int, int] | None) -> str:
    """Return the digest `PLAN`."""
    digest = hashlib.sha256(repr((1, tuple(classes), size)).encode())
    for sample in samples:
        digest.update(f"\0{sample.name}\0{sample.label}".encode())
    return digest.hexdigest()


def _stamps(samples: Sequence[Any]) -> str | None:
    """Return a digest of the stamps of all samples, None if one is missing."""
    try:
        return hashlib.sha256("\0".join(sample.stamp() for sample in samples).encode()).hexdigest()
    except OSError:
        return None


def _result_of_file(path: Path, samples: Sequence[Any], plan: str, choice: str) -> StoredDataSet:
    """Return the result of an existing file.

    Raises:
        EventFileError: the file is damaged, or is not the result of the same call.
    """
    if hdf5.has_format(path, FORMAT):
        with opened(str(path)) as file:
            damaged = json.loads(file.attrs.get(DAMAGED, "{}"))
            if file.attrs.get(PLAN) == plan and (not damaged or file.attrs[CHOICE] == choice):
                if file.attrs.get(STAMPS) != (stamps := _stamps(samples)) and stamps is not None:
                    raise EventFileError(
                        str(path), "was made from samples that changed later, or by neuro 0.2.0; expected a new name"
                    )
                count = sum(len(file[name]) for name in file)
                return StoredDataSet(str(path), count, {samples[int(k)].path: damage for k, damage in damaged.items()})
    raise EventFileError(str(path), "exists with other content; expected a new name")


def _prepare_folder(folder: Path, plan: str) -> None:
    """Make the folder for batch files, or check that an existing folder belongs to this plan."""
    note = folder / "plan.txt"
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise EventFileError(str(folder), f"cannot write: {error.strerror}") from None
    if note.exists():
        if note.read_text() != plan:
            text = "belongs to another unfinished conversion to the same name; resume that one, or remove the folder"
            raise EventFileError(str(folder), text)
    elif any(folder.glob("*.h5")):
        raise EventFileError(str(folder), "exists and is not an unfinished conversion; expected a new name")
    else:
        write_text(note, plan, Kind("a plan"))


def _packed_numbers(folder: Path, samples: Sequence[Any]) -> set[int]:
    """Return the numbers of all samples in intact batch files.

    A batch file is removed if it is damaged or incomplete, or if one of its samples was changed later.
    """
    numbers: set[int] = set()
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
        numbers |= {*map(int, stamps)}
    return numbers


def _pack_all(job: ConversionJob, batches: Sequence[Sequence[int]], jobs: int) -> Iterator[int]:
    """Pack all batches, and yield the number of samples of each finished batch."""
    if jobs == 1 or len(batches) < 2:
        yield from (pack(job, batch) for batch in batches)
        return
    with Processes(partial(start_worker, job), min(jobs, len(batches))) as pool:
        for batch in batches:
            pool.put(batch)
        while pool.busy:
            for task in pool.hear():
                try:
                    yield task.result()
                except Lost as lost:
                    raise EventFileError(job.folder, _LOST.format(lost.how, lost.attempts)) from None


def _unique_names(samples: Sequence[Any], classes: Sequence[str]) -> list[str]:
    """Return a unique ``class/sample`` for each sample.

    ``sample`` is the name of its file without ending, or the complete path if the class has this name twice.
    """
    stems = [f"{classes[s.label]}/{_stem(s.name)}" for s in samples]
    counts = Counter(stems)
    long_names = [f"{classes[s.label]}/{s.name.replace('/', '_')}" for s in samples]
    return [stem if counts[stem] == 1 else name for stem, name in zip(stems, long_names, strict=True)]


def _stem(name: str) -> str:
    file, mark, number = PurePosixPath(name).name.partition("#")
    return PurePosixPath(file).stem + (f"_{number}" if mark else "")


def _join(
    folder: Path,
    path: Path,
    samples: Sequence[Any],
    classes: Sequence[str],
    attributes: Mapping[str, str],
    progress: Report,
) -> None:
    """Copy all batch files into one file, in the order of the samples. Interruptions do not change the bytes."""
    names = _unique_names(samples, classes)
    places, damaged = _contents(folder)
    n_done, order = 0, sorted(places)
    progress("writing", n_done, len(order))
    with output(path, Kind("a data set")) as part, hdf5.new_file(part, FORMAT, libver=("v108", "v108")) as out:
        for batch_file, numbers in itertools.groupby(order, key=places.__getitem__):
            with h5py.File(batch_file, "r") as file:
                for number in numbers:
                    group, _, name = names[number].partition("/")
                    target = out.require_group(group)
                    file.copy(str(number), target, name)
                    target[name].attrs[NUMBER] = number
                    n_done += 1
            progress("writing", n_done, len(order))
        out.attrs[CLASSES] = json.dumps(list(classes))
        out.attrs[DAMAGED] = json.dumps(damaged)
        out.attrs.update(attributes)


def _contents(folder: Path) -> tuple[dict[int, Path], dict[str, str]]:
    """Return the batch file of each sample, and the faults of the damaged samples."""
    places, damaged = dict[int, Path](), dict[str, str]()
    for batch_file in folder.glob("*.h5"):
        with h5py.File(batch_file, "r") as file:
            places |= dict.fromkeys(map(int, file), batch_file)
            damaged |= json.loads(file.attrs[DAMAGED])
    return places, {number: damaged[number] for number in sorted(damaged, key=int)}


CHOICES = ("skip", "mend", "stop")
"""Treatments of damaged samples."""


BATCH_FORMAT = "neuro event batch 2"


@dataclass(frozen=True, slots=True)
class ConversionJob:
    """Parameters that all batches share.

    Attributes:
        samples: the samples of the data set.
        sensor_size: argument of `load`.
        damaged: one of `CHOICES`.
        folder: folder for the batch files.
    """

    samples: tuple[Any, ...]
    sensor_size: tuple[int, int] | None
    damaged: str
    folder: str


def start_worker(job: ConversionJob) -> Work:
    """Return the function that packs batches in a worker process."""
    return lambda numbers, attempt, tell: pack(job, numbers)


def pack(job: ConversionJob, numbers: Sequence[int]) -> int:
    """Pack some samples into a batch file, which appears only when it is complete.

    Args:
        job: the conversion.
        numbers: numbers of the samples.

    Returns:
        The number of samples.

    Raises:
        EventFileError: a sample is damaged, with "stop".
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
            events, fault = _load_sample(job, job.samples[number])
            if fault:
                damaged[str(number)] = fault
            if events is not None:
                write_sample(file, str(number), events)
        file.attrs[DAMAGED], file.attrs[STAMPS] = json.dumps(damaged), json.dumps(stamps)
    return len(numbers)


def _load_sample(job: ConversionJob, sample: Any) -> tuple[Any, str]:
    """Return the events of a sample (None: skipped) and the fault of the sample, "" if none."""
    if job.damaged != "mend":
        try:
            return sample.load(sensor_size=job.sensor_size), ""
        except EventFileError as error:
            if job.damaged == "stop":
                raise
            return None, _fault_text(error)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", EventFileWarning)
        try:
            events = sample.load(sensor_size=job.sensor_size, strict=False)
        except EventFileError as error:
            return None, _fault_text(error)
    return events, "; ".join(str(warning.message).removeprefix(f"{sample.path}: ") for warning in caught)


def _fault_text(error: EventFileError) -> str:
    return error.what if error.offset is None else f"byte {error.offset}: {error.what}"
