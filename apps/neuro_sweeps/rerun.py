"""Results, models and pages made again from what they hold, and the first difference of two files.

A command is run again in an empty folder, into which its recorded inputs are copied, at the paths that they had.
"""

from __future__ import annotations

import html
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.machinery import all_suffixes
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from neuro import ModelError, Network, event_camera, load
from neuro.apps import (
    ATTRIBUTE,
    CLOSED,
    Bar,
    Clock,
    differences,
    digest_of,
    extensions,
    file_path,
    hdf5,
    lived_again,
    plain,
    provenance,
    read as read_yaml,
    results as files,
    shown,
    state,
)
from neuro.results import Weights

_CODE = (*all_suffixes(), ".pth")
_SETTINGS = (".numba_config.yaml", "matplotlibrc")
"""Files by which numba and matplotlib change what they do, if they lie in the current folder."""


class NewFolder:
    """A folder that stands for the root of the file system, so that no recorded path leads out of it.

    With `root` /tmp/new, a command in /home/ann that reads ../data/a.h5 runs in /tmp/new/home/ann, where the same text
    leads to /tmp/new/home/data/a.h5. Folders are made and files are copied; no link leads out.

    Args:
        root: an empty folder.
        current: the absolute path of the folder in which the command ran.

    Attributes:
        current: the folder in which the command runs now.
    """

    def __init__(self, root: str, current: str) -> None:
        self._root, self._recorded = os.path.realpath(root), current
        self._copies: dict[Path, tuple[int, int]] = {}
        self.current = self._inside(".")
        self.current.mkdir(parents=True, exist_ok=True)

    def _inside(self, text: str) -> Path:
        return Path(self._root + os.path.normpath(f"/{os.path.join(self._recorded, text)}".replace("//", "/")))

    def place(self, text: str) -> str:
        """Return a value of the command as it leads to the same place below the new folder; texts and numbers stay."""
        inside = self._inside(text)
        inside.parent.mkdir(parents=True, exist_ok=True)
        stays = not os.path.isabs(text) and os.path.normpath(os.path.join(self.current, text)) == str(inside)
        return text if stays else str(inside)

    def add(self, name: str, source: Path) -> None:
        """Copy an input to where it was.

        Raises:
            ModelError: as `copy_input`.
        """
        for copy in copy_input(source, self._inside(name)):
            self._copies[copy] = _identity(copy)

    def made(self, name: str) -> list[Path]:
        """Return the files of a name, or else with its ending, that are no unchanged copies of inputs."""
        files = sorted(Path(folder, each) for folder, _, names in os.walk(self._root) for each in names)
        new = [path for path in files if not path.is_symlink() and self._copies.get(path) != _identity(path)]
        return [path for path in new if path.name == name] or [path for path in new if path.suffix == Path(name).suffix]


def _identity(path: Path) -> tuple[int, int]:
    state = path.stat()
    return state.st_ino, state.st_mtime_ns


def copy_input(source: Path, to: Path) -> Iterator[Path]:
    """Copy a file, or a folder with all files in it, to where nothing is yet, and yield each copy.

    Left out are devices and pipes, settings of other packages, and Python files that the user did not name.

    Raises:
        ModelError: a link leads out of the folder, or there is no room for the copies.
    """
    if not source.exists():
        return
    pairs = [(source, to)] if source.is_file() else list(_files(source, to))
    pairs = [(path, copy) for path, copy in pairs if path.is_file() and not copy.exists() and _may_be_copied(path)]
    to.parent.mkdir(parents=True, exist_ok=True)
    needed, free = sum(path.stat().st_size for path, _ in pairs), shutil.disk_usage(to.parent).free
    if needed > free:
        raise ModelError(f"{source}: has {needed:,} bytes to copy into {to.parent}, where {free:,} are free")
    for path, copy in pairs:
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, copy)
        yield copy


def _files(folder: Path, to: Path) -> Iterator[tuple[Path, Path]]:
    """Yield the files in a folder, each with the path of its copy."""
    top = os.path.realpath(folder) + os.sep
    for root, folders, names in os.walk(folder):
        for name in (*folders, *names):
            path = Path(root, name)
            if path.is_symlink() and not os.path.realpath(path).startswith(top):
                raise ModelError(f"{path}: a link that leads out of {folder}: expected files")
        yield from ((path := Path(root, name), to / path.relative_to(folder)) for name in names)


def _may_be_copied(path: Path) -> bool:
    if path.name.endswith(_CODE):
        return os.path.realpath(path) in map(os.path.realpath, extensions())
    return path.name not in _SETTINGS


Repeat = Callable[[Sequence[str], Callable[[str], str]], list[str]]
"""Gives the arguments by which a recorded command is run again; see `neuro_sweeps.cli.recorded.repeated`."""

_WAYS = "make it again yourself, then neuro rerun FILE --against OTHER compares the two"


_LONGEST = 1 << 16
"""Characters of a command that is repeated."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What came of making a file again.

    Attributes:
        difference: the first, in words; "" where all are the same bits.
        changed: what is not as it was: versions, inputs, the backend.
    """

    difference: str
    changed: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether all bits are the same."""
        return not self.difference


def rerun(
    path: Path,
    *,
    backend: str = "",
    inputs: Sequence[Path] = (),
    against: Path | None = None,
    bar: Bar | None = None,
    repeat: Repeat | None = None,
) -> Verdict:
    """Make a file again from what it holds, beside it, and compare.

    The file may be a stranger's. It runs no code but that of files which the user named by `--with`, opens no
    connection, and writes into a new folder only.

    Args:
        path: results, a model, a page, or the folder of a run of a sweep or a tuning.
        backend: of results and of runs of networks, another one.
        inputs: folders in which inputs are looked for, by content, that are not where they were.
        against: a file that was made again by other means.
        bar: shows how far it is.
        repeat: decides on the command of a page or a model; without it these are refused.

    Raises:
        ModelError: it does not say where it comes from, or cannot be made again from that.
    """
    path = file_path(path, "path")
    if path.name == "run.json" or (path / "run.json").is_file():
        with _closed_streams():
            return _of_run(path.parent if path.name == "run.json" else path, backend, inputs)
    if not path.is_file():
        raise ModelError(f"{path}: no such file: expected results, a model, a page, or the folder of a run")
    if against is not None:
        return Verdict(first_difference(path, against), tuple(differences(record_of(path), record_of(against))))
    with _closed_streams():
        if files.KIND.ours(path):
            return _of_results(path, backend, inputs, bar)
        record = record_of(path)
        if backend:
            raise ModelError(f"backend = '{backend}': only results and runs of networks can be made again on another")
        return _of_command(path, record, inputs, repeat)


@contextmanager
def _closed_streams() -> Iterator[None]:
    """Let neither this process nor those that it starts open the address of a stream."""
    before = os.environ.get(CLOSED)
    os.environ[CLOSED] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[CLOSED]


def _of_results(path: Path, backend: str, inputs: Sequence[Path], bar: Bar | None) -> Verdict:
    then = files.read(path)
    record = record_of(path, str(then.about.get(ATTRIBUTE) or ""))
    if record.get("steered"):
        calls = ", ".join(f"sim.{name}" for name in record["steered"])
        raise ModelError(f"{path}: was changed while it ran by {calls}: expected a run without", hint=_by(record))
    elsewhere = moved(record.get("inputs", {}), inputs)
    with tempfile.TemporaryDirectory() as folder:
        try:
            net = _network(then, record, elsewhere, Path(folder))
        except ModelError as error:
            raise error.but(message=f"{path}: {error.message}", where=None) from None
        now = replace(_run(then, net, record, backend, bar), files=then.files)
        if not then.finished:  # it has no weights, and may have been cut off within a commit
            about = now.about | {"finished": False}
            now = replace(now, about=about, projections={n: _unweighted(p) for n, p in now.projections.items()})
            files.write(then, Path(folder) / "then.h5")
        files.write(now, Path(folder) / "now.h5")
        first = first_difference(path if then.finished else Path(folder) / "then.h5", Path(folder) / "now.h5")
    return Verdict(
        first, (*differences(record, json.loads(now.about[ATTRIBUTE])), *edited(record.get("inputs", {}), elsewhere))
    )


def _run(then: files.Results, net: Network, record: Mapping[str, Any], backend: str, bar: Bar | None) -> files.Results:
    from neuro import compile
    from neuro.apps import advance, collect

    on, threads = backend or str(then.about["backend"]), int(then.about["threads"])
    keep = {"record": record.get("record", ()), "all_weights": record.get("all_weights", False), "threads": threads}
    if "world" in record:
        return lived_again(net, record["world"], on, **keep)
    sim = compile(net, backend=on, seed=int(then.about["seed"]), threads=threads)
    steps = Clock(net.resolution).step(then.duration_ms, "run")
    sim.replay(then)
    if bar is not None:
        advance(sim, steps, bar)
    else:
        sim.run(then.duration_ms)
    return collect(sim, net, **keep)


def _unweighted(part: Weights) -> Weights:
    return Weights(part.source, part.target, part.synapse, part.synapses, part.counts)


def _network(results: files.Results, record: Mapping[str, Any], elsewhere: Mapping[str, str], folder: Path) -> Network:
    """The network in a file of results, with the recordings that it plays beside it.

    Raises:
        ModelError: one is lost.
    """
    for name, content in results.files.items():
        (folder / name).write_bytes(content)
    for name in {file for file in _files_of(plain(read_yaml(folder / files.YAML))) if not (folder / file).exists()}:
        if os.path.isabs(name) or ".." in Path(name).parts:
            raise ModelError(f"plays {shown(name)}: expected a file beside the network")
        was = next((each for each in record.get("inputs", {}) if each.endswith(f"{os.sep}{name}")), name)
        now = Path(elsewhere.get(was, was))
        if not now.exists():
            hint = "--moved-to FOLDER looks for it there, by its content"
            raise ModelError(f"plays {was}, which is not there any more", hint=hint)
        for _ in copy_input(now, folder / name):
            pass
    net = load(folder / files.YAML)
    for part in net.populations.values():
        if isinstance(part.model, event_camera) and part.model.stream:
            hint = "'neuro events listen' keeps a stream as a recording, which can be played again"
            raise ModelError(f"listens to {part.model.stream}: what came from there does not come again", hint=hint)
    return net


def _files_of(value: Any) -> Iterator[str]:
    """Yield the files that a description in plain YAML names."""
    if isinstance(value, Mapping):
        if isinstance(value.get("file"), str):
            yield value["file"]
        value = list(value.values())
    if isinstance(value, list):
        for each in value:
            yield from _files_of(each)


def _of_run(folder: Path, backend: str, inputs: Sequence[Path]) -> Verdict:
    """A run of a sweep or a tuning: its metrics, and its results where it has kept these."""
    from neuro_sweeps.definition import recorded_run
    from neuro_sweeps.folder import PRUNED, Folder
    from neuro_sweeps.network import NetworkRun

    runs = Folder(folder.absolute().parent.parent)
    outcome = runs.outcome(folder.absolute().name)
    if outcome is None:
        of = runs.holding
        raise ModelError(f"{folder}: not a run of a {of.what}, as 'neuro {of.command} run' keeps it")
    if outcome.failed:
        raise ModelError(f"{folder}: has failed: {outcome.error}: expected a run that is done")
    if outcome.outcome == PRUNED:
        raise ModelError(f"{folder}: was pruned: expected a run that is done")
    record, run = _checked(folder, outcome.provenance), recorded_run(runs, runs.read())
    elsewhere = moved(record["inputs"], inputs)
    if isinstance(run, NetworkRun):
        place = Path(elsewhere.get(str(run.file), run.file))
        run = replace(run, file=place, backend=backend or run.backend)
    elif backend:
        what = runs.holding.what
        raise ModelError(f"backend = '{backend}': this {what} is over a function, which says for itself how it runs")
    metrics, fill, about = run(outcome.point, outcome.seed)
    difference = next(
        (
            f"metric {name}: {outcome.metrics.get(name)!r} then, {metrics.get(name)!r} now"
            for name in dict.fromkeys((*outcome.metrics, *metrics))
            if json.dumps(outcome.metrics.get(name)) != json.dumps(metrics.get(name))
        ),
        "",
    )
    if not difference and fill is not None and (folder / "results.h5").exists():
        with tempfile.TemporaryDirectory() as place_now:
            fill(Path(place_now))
            difference = first_difference(folder / "results.h5", Path(place_now) / "results.h5")
    now = provenance((), **about)
    return Verdict(difference, (*differences(record, now), *edited(record["inputs"], elsewhere)))


def _of_command(path: Path, record: Mapping[str, Any], inputs: Sequence[Path], repeat: Repeat | None) -> Verdict:
    """What a command of ours made: the same command in an empty folder."""
    if len(record["command"]) > _LONGEST:  # to split it takes the square of its length
        size = len(record["command"])
        raise ModelError(f"{path}: its command has {size:,} characters: expected at most {_LONGEST:,}")
    try:
        words = shlex.split(record["command"])
    except ValueError:
        words = []
    if words[:1] != ["neuro"] or hdf5.has_format(path, state.FORMAT) or repeat is None:
        raise ModelError(f"{path}: was not made by a command of neuro: expected one", hint=_by(record))
    elsewhere = moved(record["inputs"], inputs)
    with tempfile.TemporaryDirectory() as root:
        try:
            folder = NewFolder(root, record["folder"])
            for name in record["inputs"]:
                folder.add(name, Path(elsewhere.get(name, name)))
            asked = repeat(words[1:], folder.place)
        except ModelError as error:
            message = f"{path}: {error.message.replace(root, '')}"
            raise error.but(message=message, hint=error.hint or _by(record), where=None) from None
        except OSError as error:
            raise ModelError(f"{path}: cannot be made again: {error.strerror or error}", hint=_by(record)) from None
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(os.path.abspath(each) for each in sys.path)}
        done = subprocess.run(
            [sys.executable, "-P", "-m", "neuro", *asked], cwd=folder.current, env=env, capture_output=True, text=True
        )
        # A verdict is written, too: `neuro doctor` ends with 1 where it finds a fault, as it did the first time.
        if done.returncode and not (done.returncode == 1 and words[1:2] == ["doctor"]):
            raise ModelError(f"{shlex.join(words)}: ended with {done.returncode}: {_error_line(done.stderr, root)}")
        made = next(iter(folder.made(path.name)), None)
        if made is None:
            raise ModelError(f"{path}: its command writes no file of that name now")
        if path.suffix in (".html", ".htm"):
            difference = _of_texts(path, made)
        else:
            difference = first_difference(path, made)
        return Verdict(difference, (*differences(record, record_of(made)), *edited(record["inputs"], elsewhere)))


def _error_line(printed: str, root: str) -> str:
    """Return the line of a command's error, its last line otherwise; names are those of the record, without `root`."""
    lines = printed.replace(root, "").strip().splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    return (errors or lines or ["no word"])[-1].removeprefix("error: ")


def _of_texts(then: Path, now: Path) -> str:
    """The first line that differs in two pages, where they come from and their digests left out."""
    one, other = ([line for line in each.read_text("utf-8").splitlines() if _counts(line)] for each in (then, now))
    for k, (a, b) in enumerate(zip(one, other, strict=False)):
        if a != b:
            at = next(i for i, (x, y) in enumerate(zip(a + "\0", b + "\0", strict=False)) if x != y)
            begin = max(0, at - 10)
            return f"line {k + 1}: {shown(a[begin : at + 30])} then, {shown(b[begin : at + 30])} now"
    return "" if len(one) == len(other) else f"{len(one)} lines then, {len(other)} now"


def _counts(line: str) -> bool:
    return f'<meta name="{ATTRIBUTE}"' not in line and "<!-- digest" not in line


def _by(record: Mapping[str, Any]) -> str:
    command, folder = (
        text if len(text) <= 1000 else f"{text[:1000]}..." for text in (record["command"], record["folder"])
    )
    return f"it was made by: {command or 'a program'}, in {folder or 'a folder'}; {_WAYS}"


_ON_PAGE = re.compile(rf'<meta name="{ATTRIBUTE}" content="([^"]*)">')


def record_of(path: Path, text: str = "") -> dict[str, Any]:
    """The record in an HDF5 file or in a page; of results that were read, `text`.

    Raises:
        ModelError: it holds none, or is damaged.
    """
    if not text and path.suffix in (".html", ".htm"):
        found = _ON_PAGE.search(path.read_text("utf-8", "replace"))
        text = html.unescape(found[1]) if found else ""
    elif not text and path.is_file() and hdf5.check(path):
        with h5py.File(path) as file:
            text = str(file.attrs.get(ATTRIBUTE, ""))
    try:
        record = json.loads(text)
    except (ValueError, RecursionError):
        record = None
    return _checked(path, record)


def _checked(path: Path, record: Any) -> dict[str, Any]:
    """Return a record whose inputs, command and folder are what they ought to be.

    Raises:
        ModelError: it is none.
    """
    if not isinstance(record, dict) or not record:
        hint = "files that neuro wrote since it records where they come from have it; runs of sweeps are folders"
        raise ModelError(f"{path}: does not say where it comes from", hint=hint)
    whole: dict[str, Any] = {"inputs": {}, "command": "", "folder": "", **record}
    names, texts = whole["inputs"], (whole["command"], whole["folder"])
    if (
        not isinstance(names, dict)
        or not all(isinstance(each, str) for each in (*names, *names.values(), *texts))
        or "\0" in "".join((*names, *texts))
    ):
        raise ModelError(f"{path}: where it comes from is damaged: expected a command, its folder and inputs by name")
    return whole


def moved(inputs: Mapping[str, str], folders: Iterable[Path]) -> dict[str, str]:
    """Where inputs that are not where they were lie now, by their content.

    Args:
        inputs: hashes by path.
        folders: in which they are looked for, at any depth.
    """
    lost = {digest: name for name, digest in inputs.items() if not Path(name).exists()}
    found: dict[str, str] = {}
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if lost and (path.is_file() or path.is_dir()) and (name := lost.get(digest_of(path))):
                found.setdefault(name, str(path.absolute()))
    return found


def edited(inputs: Mapping[str, str], elsewhere: Mapping[str, str]) -> list[str]:
    """What has become of inputs, in words."""
    lines = []
    for name, digest in inputs.items():
        now = digest_of(elsewhere.get(name, name))
        if name in elsewhere:
            lines.append(f"input {name}: lies at {elsewhere[name]} now, with the same content")
        elif not now:
            lines.append(f"input {name}: is not there any more")
        elif now != digest:
            lines.append(f"input {name}: was edited")
    return lines


_ORIGIN = {ATTRIBUTE, "neuro", "python", "numpy", "numba", "backend", "threads"}
"""Attributes that tell where a file comes from, which is compared apart."""


_BESIDE = {"fed", "live"}
"""Groups of what a run was given, and of the clock on the wall."""


def first_difference(then: Path, now: Path) -> str:
    """What differs first in two HDF5 files, in words; "" if all arrays, texts and attributes are the same bits.

    Raises:
        ModelError: one is no HDF5 file, or damaged.
    """
    try:
        hdf5.check(then)
        hdf5.check(now)
        with h5py.File(then) as a, h5py.File(now) as b:
            hdf5.check_tree(a, several_names=True)
            hdf5.check_tree(b, several_names=True)
            return _of_groups(a, b, _BESIDE)
    except (OSError, ValueError):
        raise ModelError(f"{then}: cannot be compared: expected two HDF5 files") from None


def _of_groups(a: Any, b: Any, but: Collection[str] = ()) -> str:
    for name in dict.fromkeys((*a, *b)):
        if name in but:
            continue
        place = f"{a.name.rstrip('/')}/{name}".lstrip("/")
        if (name in a) != (name in b):
            return f"{place}: {'there then, not now' if name in a else 'not there then, there now'}"
        one, other = a[name], b[name]
        if isinstance(one, h5py.Group) != isinstance(other, h5py.Group):
            return f"{place}: of another kind"
        difference = _of_groups(one, other) if isinstance(one, h5py.Group) else _of_arrays(place, one[()], other[()])
        if not difference and not isinstance(one, h5py.Group):
            difference = _of_attributes(one, other)
        if difference:
            return difference
    return _of_attributes(a, b)


def _of_attributes(a: Any, b: Any) -> str:
    for name in dict.fromkeys((*a.attrs, *b.attrs)):
        if name in _ORIGIN or name.startswith(files.RECORDING):
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
