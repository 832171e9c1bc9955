"""Repetition of results, models and pages from the data that they contain, and the first difference of two files.

A command runs again in an empty folder. Its recorded inputs are copied to the same paths below that folder.
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
"""Endings of files whose code Python runs."""
_SETTINGS = (".numba_config.yaml", "matplotlibrc")
"""Files in the current folder that numba and matplotlib read as settings."""


class NewFolder:
    """A folder that replaces the root of the file system, so that no recorded path leads out of it.

    With `root` /tmp/new, a command in /home/ann that reads ../data/a.h5 runs in /tmp/new/home/ann, where the same path
    leads to /tmp/new/home/data/a.h5. Folders are created and files are copied; there are no links to the outside.

    Args:
        root: an empty folder.
        current: absolute path of the folder in which the command ran.

    Attributes:
        current: folder in which the command runs now.
    """

    def __init__(self, root: str, current: str) -> None:
        self._root, self._recorded = os.path.realpath(root), current
        self._copies: dict[Path, tuple[int, int]] = {}
        self.current = self._inside(".")
        self.current.mkdir(parents=True, exist_ok=True)

    def _inside(self, text: str) -> Path:
        return Path(self._root + os.path.normpath(f"/{os.path.join(self._recorded, text)}".replace("//", "/")))

    def place(self, text: str) -> str:
        """Convert a path of the command to a path in the new folder. Relative paths, texts and numbers stay."""
        inside = self._inside(text)
        inside.parent.mkdir(parents=True, exist_ok=True)
        is_inside = not os.path.isabs(text) and os.path.normpath(os.path.join(self.current, text)) == str(inside)
        return text if is_inside else str(inside)

    def add(self, name: str, source: Path) -> None:
        """Copy an input to its recorded path in the new folder.

        Raises:
            ModelError: see `copy_input`.
        """
        for copy in copy_input(source, self._inside(name)):
            self._copies[copy] = _identity(copy)

    def new_files(self, name: str) -> list[Path]:
        """Return the new or changed files of a name, or else with the same ending."""
        files = sorted(Path(folder, file) for folder, _, names in os.walk(self._root) for file in names)
        new = [path for path in files if not path.is_symlink() and self._copies.get(path) != _identity(path)]
        return [path for path in new if path.name == name] or [path for path in new if path.suffix == Path(name).suffix]


def _identity(path: Path) -> tuple[int, int]:
    state = path.stat()
    return state.st_ino, state.st_mtime_ns


def copy_input(source: Path, to: Path) -> Iterator[Path]:
    """Copy a file, or all files of a folder, without replacing files. Yield each copy.

    Devices, pipes, settings of other packages, and Python files that the user did not name are not copied.

    Raises:
        ModelError: a link leads out of the folder, or the disk is too small for the copies.
    """
    if not source.exists():
        return
    pairs = [(source, to)] if source.is_file() else list(_files(source, to))
    pairs = [(path, copy) for path, copy in pairs if path.is_file() and not copy.exists() and _may_be_copied(path)]
    to.parent.mkdir(parents=True, exist_ok=True)
    needed, n_free = sum(path.stat().st_size for path, _ in pairs), shutil.disk_usage(to.parent).free
    if needed > n_free:
        raise ModelError(f"{source}: needs {needed:,} bytes in {to.parent}: found {n_free:,} free bytes")
    for path, copy in pairs:
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, copy)
        yield copy


def _files(folder: Path, target: Path) -> Iterator[tuple[Path, Path]]:
    """Yield the files in a folder, each with the path of its copy."""
    top = os.path.realpath(folder) + os.sep
    for root, folders, names in os.walk(folder):
        for name in (*folders, *names):
            path = Path(root, name)
            if path.is_symlink() and not os.path.realpath(path).startswith(top):
                raise ModelError(f"{path}: is a link out of {folder}: expected files")
        yield from ((path := Path(root, name), target / path.relative_to(folder)) for name in names)


def _may_be_copied(path: Path) -> bool:
    if path.name.endswith(_CODE):
        return os.path.realpath(path) in map(os.path.realpath, extensions())
    return path.name not in _SETTINGS


Repeat = Callable[[Sequence[str], Callable[[str], str]], list[str]]
"""Function that returns the arguments of a recorded command for a new folder, see `cli.recorded.repeated`."""

# Advice for a file that cannot be repeated here.
_BY_HAND = "repeat it yourself, and compare with neuro rerun FILE --against OTHER"


_LONGEST = 1 << 16
"""Largest length of a repeated command in characters."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result of repeating a file.

    Attributes:
        difference: description of the first difference; "" if all bits are equal.
        changed: changes of versions, inputs and the backend since the file was written.
    """

    difference: str
    changed: tuple[str, ...]

    @property
    def same(self) -> bool:
        """True if all bits are equal."""
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
    """Repeat the computation of a file from the data that it contains, and compare the results.

    The file may come from an unknown source. Only files that the user named by `--with` may contain code. No connection
    is opened, and only a new folder is written.

    Args:
        path: results, a model, a page, or the folder of a run of a sweep or a tuning.
        backend: another backend, for results and runs of networks.
        inputs: folders in which missing inputs are searched by content.
        against: compare with this file instead of repeating the computation.
        bar: progress bar.
        repeat: function that checks and converts the command of a page or a model, see `Repeat`; with None, pages and
            models are refused.

    Raises:
        ModelError: the file does not contain its origin, or cannot be repeated.
    """
    path = file_path(path, "path")
    if path.name == "run.json" or (path / "run.json").is_file():
        with _closed_streams():
            return _rerun_run(path.parent if path.name == "run.json" else path, backend, inputs)
    if not path.is_file():
        raise ModelError(f"{path}: no such file: expected results, a model, a page, or the folder of a run")
    if against is not None:
        return Verdict(first_difference(path, against), tuple(differences(record_of(path), record_of(against))))
    with _closed_streams():
        if files.KIND.ours(path):
            return _rerun_results(path, backend, inputs, bar)
        record = record_of(path)
        if backend:
            raise ModelError(f"backend = '{backend}': only for results and runs of networks")
        return _rerun_command(path, record, inputs, repeat)


@contextmanager
def _closed_streams() -> Iterator[None]:
    """Refuse to open addresses of streams, in this process and its child processes."""
    old_value = os.environ.get(CLOSED)
    os.environ[CLOSED] = "1"
    try:
        yield
    finally:
        if old_value is None:
            del os.environ[CLOSED]


def _rerun_results(path: Path, backend: str, inputs: Sequence[Path], bar: Bar | None) -> Verdict:
    """Repeat the run of a file of results, and compare all results."""
    old = files.read(path)
    record = record_of(path, str(old.about.get(ATTRIBUTE) or ""))
    if record.get("steered"):
        calls = ", ".join(f"sim.{name}" for name in record["steered"])
        message = f"{path}: the run was steered by {calls}: expected a run without such calls"
        raise ModelError(message, hint=_origin_hint(record))
    new_paths = find_moved(record.get("inputs", {}), inputs)
    with tempfile.TemporaryDirectory() as folder:
        try:
            net = _network(old, record, new_paths, Path(folder))
        except ModelError as error:
            raise error.but(message=f"{path}: {error.message}", where=None) from None
        new = replace(_run(old, net, record, backend, bar), files=old.files)
        if not old.finished:  # an interrupted run has no weights, and its last chunk may be incomplete
            facts = new.about | {"finished": False}
            new = replace(new, about=facts, projections={n: _unweighted(p) for n, p in new.projections.items()})
            files.write(old, Path(folder) / "then.h5")
        files.write(new, Path(folder) / "now.h5")
        first = first_difference(path if old.finished else Path(folder) / "then.h5", Path(folder) / "now.h5")
    return Verdict(
        first,
        (*differences(record, json.loads(new.about[ATTRIBUTE])), *input_changes(record.get("inputs", {}), new_paths)),
    )


def _run(old: files.Results, net: Network, record: Mapping[str, Any], backend: str, bar: Bar | None) -> files.Results:
    """Run a network again with the recorded seed, threads and inputs, and return the new results."""
    from neuro import compile
    from neuro.apps import advance, collect

    backend_name, threads = backend or str(old.about["backend"]), int(old.about["threads"])
    extra = {"record": record.get("record", ()), "all_weights": record.get("all_weights", False), "threads": threads}
    if "world" in record:
        return lived_again(net, record["world"], backend_name, **extra)
    sim = compile(net, backend=backend_name, seed=int(old.about["seed"]), threads=threads)
    steps = Clock(net.resolution).step(old.duration_ms, "run")
    sim.replay(old)
    if bar is not None:
        advance(sim, steps, bar)
    else:
        sim.run(old.duration_ms)
    return collect(sim, net, **extra)


def _unweighted(part: Weights) -> Weights:
    """Return the entry of a projection without its weights."""
    return Weights(part.source, part.target, part.synapse, part.synapses, part.counts)


def _network(results: files.Results, record: Mapping[str, Any], new_paths: Mapping[str, str], folder: Path) -> Network:
    """Return the network of a file of results, with its recordings in the folder.

    Raises:
        ModelError: a recording is missing.
    """
    for name, content in results.files.items():
        (folder / name).write_bytes(content)
    for name in {file for file in _files_of(plain(read_yaml(folder / files.YAML))) if not (folder / file).exists()}:
        if os.path.isabs(name) or ".." in Path(name).parts:
            raise ModelError(f"plays {shown(name)}: expected a file beside the network")
        recorded = next((key for key in record.get("inputs", {}) if key.endswith(f"{os.sep}{name}")), name)
        new_path = Path(new_paths.get(recorded, recorded))
        if not new_path.exists():
            hint = "--moved-to FOLDER searches a folder for the file, by content"
            raise ModelError(f"plays {recorded}, which is missing", hint=hint)
        for _ in copy_input(new_path, folder / name):
            pass
    net = load(folder / files.YAML)
    for part in net.populations.values():
        if isinstance(part.model, event_camera) and part.model.stream:
            hint = "'neuro events listen' records a stream; a recording can be played again"
            raise ModelError(f"listens to {part.model.stream}: a stream cannot be repeated", hint=hint)
    return net


def _files_of(value: Any) -> Iterator[str]:
    """Yield the files that a description in plain YAML names."""
    if isinstance(value, Mapping):
        if isinstance(value.get("file"), str):
            yield value["file"]
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from _files_of(item)


def _rerun_run(folder: Path, backend: str, inputs: Sequence[Path]) -> Verdict:
    """Repeat a run of a sweep or a tuning, and compare the metrics, and the results if they were kept."""
    from neuro_sweeps.definition import recorded_run
    from neuro_sweeps.folder import PRUNED, Folder
    from neuro_sweeps.network import NetworkRun

    runs = Folder(folder.absolute().parent.parent)
    outcome = runs.outcome(folder.absolute().name)
    if outcome is None:
        raise ModelError(f"{folder}: not a run of a {runs.kind.what}, as 'neuro {runs.kind.command} run' keeps it")
    if outcome.failed:
        raise ModelError(f"{folder}: the run failed: {outcome.error}: expected a run that is done")
    if outcome.outcome == PRUNED:
        raise ModelError(f"{folder}: the run was pruned: expected a run that is done")
    record, run = _check_record(folder, outcome.provenance), recorded_run(runs, runs.read())
    new_paths = find_moved(record["inputs"], inputs)
    if isinstance(run, NetworkRun):
        place = Path(new_paths.get(str(run.file), run.file))
        run = replace(run, file=place, backend=backend or run.backend)
    elif backend:
        raise ModelError(f"backend = '{backend}': only for networks: this {runs.kind.what} runs a function")
    metrics, fill, entries = run(outcome.point, outcome.seed)
    difference = next(
        (
            f"metric {name}: {outcome.metrics.get(name)!r} then, {metrics.get(name)!r} now"
            for name in dict.fromkeys((*outcome.metrics, *metrics))
            if json.dumps(outcome.metrics.get(name)) != json.dumps(metrics.get(name))
        ),
        "",
    )
    if not difference and fill is not None and (folder / "results.h5").exists():
        with tempfile.TemporaryDirectory() as new_folder:
            fill(Path(new_folder))
            difference = first_difference(folder / "results.h5", Path(new_folder) / "results.h5")
    new_record = provenance((), **entries)
    return Verdict(difference, (*differences(record, new_record), *input_changes(record["inputs"], new_paths)))


def _rerun_command(path: Path, record: Mapping[str, Any], inputs: Sequence[Path], repeat: Repeat | None) -> Verdict:
    """Repeat a command of neuro in an empty folder, and compare the file that it writes."""
    if len(record["command"]) > _LONGEST:  # the time to split a command grows with the square of its length
        size = len(record["command"])
        raise ModelError(f"{path}: its command has {size:,} characters: expected at most {_LONGEST:,}")
    try:
        arguments_recorded = shlex.split(record["command"])
    except ValueError:
        arguments_recorded = []
    if arguments_recorded[:1] != ["neuro"] or hdf5.has_format(path, state.FORMAT) or repeat is None:
        raise ModelError(f"{path}: was not written by a command of neuro", hint=_origin_hint(record))
    new_paths = find_moved(record["inputs"], inputs)
    with tempfile.TemporaryDirectory() as root:
        try:
            folder = NewFolder(root, record["folder"])
            for name in record["inputs"]:
                folder.add(name, Path(new_paths.get(name, name)))
            arguments = repeat(arguments_recorded[1:], folder.place)
        except ModelError as error:
            message = f"{path}: {error.message.replace(root, '')}"
            raise error.but(message=message, hint=error.hint or _origin_hint(record), where=None) from None
        except OSError as error:
            message = f"{path}: cannot be repeated: {error.strerror or error}"
            raise ModelError(message, hint=_origin_hint(record)) from None
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(os.path.abspath(entry) for entry in sys.path)}
        command = [sys.executable, "-P", "-m", "neuro", *arguments]
        process = subprocess.run(command, cwd=folder.current, env=env, capture_output=True, text=True)
        # `neuro doctor` writes its page and exits with 1 if it finds a fault.
        if process.returncode and not (process.returncode == 1 and arguments_recorded[1:2] == ["doctor"]):
            error_line = _error_line(process.stderr, root)
            raise ModelError(f"{shlex.join(arguments_recorded)}: exited with {process.returncode}: {error_line}")
        new = next(iter(folder.new_files(path.name)), None)
        if new is None:
            raise ModelError(f"{path}: its command no longer writes a file of that name")
        difference = (_text_difference if path.suffix in (".html", ".htm") else first_difference)(path, new)
        return Verdict(difference, (*differences(record, record_of(new)), *input_changes(record["inputs"], new_paths)))


def _error_line(printed: str, root: str) -> str:
    """Return the error of a command, or else its last printed line, with `root` removed from paths."""
    lines = printed.replace(root, "").strip().splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    return (errors or lines or ["no message"])[-1].removeprefix("error: ")


def _text_difference(old_page: Path, new_page: Path) -> str:
    """Describe the first line that differs in two pages, except provenance and digests."""
    old_lines, new_lines = (
        [line for line in page.read_text("utf-8").splitlines() if _is_compared(line)] for page in (old_page, new_page)
    )
    for k, (old, new) in enumerate(zip(old_lines, new_lines, strict=False)):
        if old != new:
            position = next(i for i, (x, y) in enumerate(zip(old + "\0", new + "\0", strict=False)) if x != y)
            part = slice(max(0, position - 10), position + 30)
            return f"line {k + 1}: {shown(old[part])} then, {shown(new[part])} now"
    return "" if len(old_lines) == len(new_lines) else f"{len(old_lines)} lines then, {len(new_lines)} now"


def _is_compared(line: str) -> bool:
    return f'<meta name="{ATTRIBUTE}"' not in line and "<!-- digest" not in line


def _origin_hint(record: Mapping[str, Any]) -> str:
    command, folder = (
        text if len(text) <= 1000 else f"{text[:1000]}..." for text in (record["command"], record["folder"])
    )
    return f"written by: {command or 'a program'}, in {folder or 'a folder'}; {_BY_HAND}"


_ON_PAGE = re.compile(rf'<meta name="{ATTRIBUTE}" content="([^"]*)">')


def record_of(path: Path, text: str = "") -> dict[str, Any]:
    """Return the provenance record of an HDF5 file or a page; `text` is the record as text, if it was read already.

    Raises:
        ModelError: the file has no record, or is damaged.
    """
    if not text and path.suffix in (".html", ".htm"):
        match = _ON_PAGE.search(path.read_text("utf-8", "replace"))
        text = html.unescape(match[1]) if match else ""
    elif not text and path.is_file() and hdf5.check(path):
        with h5py.File(path) as file:
            text = str(file.attrs.get(ATTRIBUTE, ""))
    try:
        record = json.loads(text)
    except (ValueError, RecursionError):
        record = None
    return _check_record(path, record)


def _check_record(path: Path, record: Any) -> dict[str, Any]:
    """Return a record with valid inputs, command and folder.

    Raises:
        ModelError: the record is missing or damaged.
    """
    if not isinstance(record, dict) or not record:
        hint = "expected a file that neuro wrote, with the record of its run, or the folder of a run of a sweep"
        raise ModelError(f"{path}: found no provenance", hint=hint)
    complete: dict[str, Any] = {"inputs": {}, "command": "", "folder": "", **record}
    names, texts = complete["inputs"], (complete["command"], complete["folder"])
    if (
        not isinstance(names, dict)
        or not all(isinstance(text_value, str) for text_value in (*names, *names.values(), *texts))
        or "\0" in "".join((*names, *texts))
    ):
        raise ModelError(f"{path}: damaged provenance: expected a command, its folder and inputs by name")
    return complete


def find_moved(inputs: Mapping[str, str], folders: Iterable[Path]) -> dict[str, str]:
    """Return the new paths of missing inputs, searched by content.

    Args:
        inputs: hashes by recorded path.
        folders: folders to search, with all subfolders.
    """
    missing_names = {digest: name for name, digest in inputs.items() if not Path(name).exists()}
    paths: dict[str, str] = {}
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if missing_names and (path.is_file() or path.is_dir()) and (name := missing_names.get(digest_of(path))):
                paths.setdefault(name, str(path.absolute()))
    return paths


def input_changes(inputs: Mapping[str, str], new_paths: Mapping[str, str]) -> list[str]:
    """Describe the changes of inputs."""
    lines = []
    for name, digest in inputs.items():
        new_digest = digest_of(new_paths.get(name, name))
        if name in new_paths:
            lines.append(f"input {name}: moved to {new_paths[name]}, with the same content")
        elif not new_digest:
            lines.append(f"input {name}: is missing")
        elif new_digest != digest:
            lines.append(f"input {name}: was edited")
    return lines


_ORIGIN = {ATTRIBUTE, "neuro", "python", "numpy", "numba", "backend", "threads"}
"""Attributes with provenance, which is compared separately."""


_INPUT_GROUPS = {"fed", "live"}
"""Groups with inputs of a run, and with wall-clock times, which are not compared."""


def first_difference(then: Path, now: Path) -> str:
    """Describe the first difference of two HDF5 files; "" if all arrays, texts and attributes have equal bits.

    Raises:
        ModelError: a file is not HDF5, or is damaged.
    """
    try:
        hdf5.check(then)
        hdf5.check(now)
        with h5py.File(then) as a, h5py.File(now) as b:
            hdf5.check_tree(a, several_names=True)
            hdf5.check_tree(b, several_names=True)
            return _group_difference(a, b, _INPUT_GROUPS)
    except (OSError, ValueError):
        raise ModelError(f"{then}: cannot be compared: expected two HDF5 files") from None


def _group_difference(old_group: Any, new_group: Any, ignored: Collection[str] = ()) -> str:
    for name in dict.fromkeys((*old_group, *new_group)):
        if name in ignored:
            continue
        path = f"{old_group.name.rstrip('/')}/{name}".lstrip("/")
        if (name in old_group) != (name in new_group):
            return f"{path}: {'present then, missing now' if name in old_group else 'missing then, present now'}"
        old, new = old_group[name], new_group[name]
        if isinstance(old, h5py.Group) != isinstance(new, h5py.Group):
            return f"{path}: a group then or now, an array in the other"
        if isinstance(old, h5py.Group):
            difference = _group_difference(old, new)
        else:
            difference = _array_difference(path, old[()], new[()]) or _attribute_difference(old, new)
        if difference:
            return difference
    return _attribute_difference(old_group, new_group)


def _attribute_difference(old_node: Any, new_node: Any) -> str:
    for name in dict.fromkeys((*old_node.attrs, *new_node.attrs)):
        if name in _ORIGIN or name.startswith(files.RECORDING):
            continue
        old, new = old_node.attrs.get(name), new_node.attrs.get(name)
        if not _same(old, new):
            path = f"{old_node.name}.{name}".lstrip("/.")
            return f"{path}: {_short_text(old)} then, {_short_text(new)} now"
    return ""


def _array_difference(path: str, old: Any, new: Any) -> str:
    if _same(old, new):
        return ""
    old, new = np.asarray(old), np.asarray(new)
    if old.dtype != new.dtype or old.ndim != new.ndim or old.ndim == 0:
        return f"{path}: {_short_text(old)} then, {_short_text(new)} now"
    shapes = "" if old.shape == new.shape else f" (shape {old.shape} then, {new.shape} now)"
    common = tuple(slice(min(pair)) for pair in zip(old.shape, new.shape, strict=True))
    differences = np.argwhere(_unequal(old[common], new[common]))
    if not differences.size:
        return f"{path}: shape {old.shape} then, {new.shape} now"
    index = tuple(int(k) for k in differences[0])
    index_text = ", ".join(map(str, index))
    return f"{path}[{index_text}]: {_short_text(old[index])} then, {_short_text(new[index])} now{shapes}"


def _unequal(a: Any, b: Any) -> Any:
    return (a != b) & ~((a != a) & (b != b)) if a.dtype.kind == "f" else a != b


def _same(a: Any, b: Any) -> bool:
    """Return whether two values have the same bits."""
    if a is None or b is None:
        return a is b
    a, b = np.asarray(a), np.asarray(b)
    if a.dtype.kind == "O" or b.dtype.kind == "O":
        return bool(a.shape == b.shape and a.tolist() == b.tolist())
    return bool(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes())


def _short_text(value: Any) -> str:
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    array = np.asarray(value)
    return repr(array.item()) if array.ndim == 0 and array.dtype.kind != "O" else shown(value)
