"""The folder of a sweep or a tuning. Each run is a folder, whose name is the hash of the run's inputs.

```
sweep.json        the run, its space and limits, provenance (in a tuning: tune.json)
runs/HASH/        a run
    run.json      point, seed, outcome, metrics or error, seconds, provenance
    results.h5    recorded data, if they are kept
    output.txt    printed text, if any
claims/HASH       the process that works on the run
```
A run is written to a temporary folder, which is renamed when the run is complete. If two processes do the same run, the
first is kept. A run that does not match its checksum is damaged, counts as missing, and is done again.

Each running run has a claim, a file that a process creates only if it does not exist. A process removes its claims
when the runs are kept, or when it closes, e.g. after an interrupt. The claim of a dead process is taken over: on the
machine of that process at once, on other machines when the file has not been touched for a while.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
import platform
import re
import shlex
import shutil
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from functools import cache
from itertools import count
from pathlib import Path
from threading import Event, Thread
from typing import Any

from neuro import ModelError
from neuro.apps import Kind, Unwritable, make_folder, only_on_linux, sealed, write_text

LEASE_S = 60.0
"""A claim of another machine is void if its file was last touched this long ago, or lies this far in the future."""

WRITING_S = 1.0
"""Age in seconds after which an empty claim is void. A younger claim may still be written by its process."""

BEAT_S = 10.0
"""Interval in seconds at which a process touches its claims."""


@dataclass(frozen=True, slots=True)
class Holder:
    """The process that holds a claim.

    Attributes:
        machine: identity of the machine, see `machine`.
        process: process number on the machine.
        began: start time of the process, see `began`.
    """

    machine: str
    process: int
    began: str

    def __str__(self) -> str:
        return f"process {self.process} on {self.machine.partition(' ')[0]}"


class Claims:
    """The claims of a process in a folder.

    Args:
        folder: folder of the claims.

    Raises:
        ModelError: the system is not Linux, which is needed to tell whether a process is alive.
    """

    def __init__(self, folder: Path) -> None:
        only_on_linux("a sweep")
        self._folder = folder
        self._content = json.dumps(asdict(Holder(machine(), os.getpid(), began(os.getpid())))).encode()
        self._keys: set[str] = set()
        self._stop = Event()

    def take(self, key: str) -> bool:
        """Claim a run. Returns False if a living process holds the claim.

        Raises:
            Unwritable: the claim cannot be written.
        """
        path = self._folder / key
        with writing(path):
            is_mine = self._create(path) or (not alive(path) and self._take_over(path))
        if is_mine:
            self._keys.add(key)
        return is_mine

    def give_up(self, key: str) -> None:
        """Remove the claim of a run that is kept, or that has not begun."""
        self._keys.discard(key)
        (self._folder / key).unlink(missing_ok=True)

    def close(self) -> None:
        """Remove all claims. Other processes cannot take over the claims of this process while this process lives."""
        self._stop.set()
        for key in tuple(self._keys):
            self.give_up(key)

    def beat(self) -> None:
        """Start a thread that touches the claims, so that other machines see that this process is alive."""
        Thread(target=self._beat, daemon=True).start()

    def _beat(self) -> None:
        while not self._stop.wait(BEAT_S):
            for key in tuple(self._keys):
                with suppress(OSError):
                    os.utime(self._folder / key)

    def _create(self, path: Path) -> bool:
        try:
            with path.open("xb", buffering=0) as file:
                file.write(self._content)
        except FileExistsError:
            return False
        except OSError:  # the disk is full: an empty claim would block other processes
            path.unlink(missing_ok=True)
            raise
        return True

    def _take_over(self, path: Path) -> bool:
        """Replace a void claim. A lock allows one process at a time, which checks again."""
        with locked(self._folder / ".lock"):
            if alive(path):
                return False
            path.unlink(missing_ok=True)
            return self._create(path)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn errors of the system into errors that name the path."""
    try:
        yield
    except OSError as error:
        raise Unwritable(path, f"cannot be written: {error.strerror or error}") from None


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a lock, after waiting for other processes. The system releases the lock of a killed process.

    Raises:
        Unwritable: the lock file cannot be written.
    """
    with writing(path):
        file = path.open("ab")
    with file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def claimed(folder: Path) -> list[str]:
    """Return the names of the claims that living processes hold."""
    return [name for name in os.listdir(folder) if not name.startswith(".") and alive(folder / name)]


def alive(path: Path) -> bool:
    """Return whether the process that holds a claim is alive, as far as this machine can tell.

    For another machine only the time of the file counts, within `LEASE_S` of now in both directions, since clocks
    differ.
    """
    try:
        touched = path.stat().st_mtime
    except OSError:
        return False
    holder = holder_of(path)
    if holder is not None and holder.machine == machine():
        start = began(holder.process)
        return bool(start) and start == holder.began
    return abs(time.time() - touched) < (WRITING_S if holder is None else LEASE_S)


def holder_of(path: Path) -> Holder | None:
    """Return the process that holds a claim, or None if the file does not name it."""
    try:
        holder = Holder(**parsed(path.read_bytes()))
    except (OSError, ValueError, TypeError):
        return None
    return holder if [*map(type, asdict(holder).values())] == [str, int, str] else None


def waiting(folder: Path, keys: Sequence[str]) -> str:
    """Return a message about the processes for which this one waits.

    Args:
        folder: folder of the claims.
        keys: names of the claims that other processes hold.
    """
    unit = "trial" if keys[0].startswith("trial-") else "run"
    holder = holder_of(folder / keys[0]) or "an unknown process"
    names = f"{len(keys):,} {unit}{'s' * (len(keys) != 1)}"
    return f"waiting for {names} of other processes, first {holder} ({folder / keys[0]})"


def parsed(content: bytes | str) -> Any:
    """Parse JSON.

    Raises:
        ValueError: the text is not JSON, or is nested too deep.
    """
    try:
        return json.loads(content)
    except RecursionError:
        raise ValueError("too deep") from None


@cache
def machine() -> str:
    """Return the identity of this machine, its start and its process namespace, in which process numbers are unique."""
    parts = [platform.node()]
    with suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text().strip())
    with suppress(OSError):
        parts.append(os.readlink("/proc/self/ns/pid"))
    return " ".join(parts)


def began(process: int) -> str:
    """Return the start time of a process, in ticks since the machine's start; "" if there is no such living process.

    Source: proc(5), /proc/pid/stat, fields 3 and 22
    """
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if fields[0] in "ZX" else fields[19]


DONE, FAILED, PRUNED = "done", "failed", "pruned"
_RUN = "neuro run of a sweep 1"
_TEXTS = {"network": ("file", "backend"), "function": ("name", "module", "file")}
"""Keys that must have a text in the description of a run in the folder's file, by kind of the run."""
SUM = "sum"
"""Key of the checksum of runs, and of lines of a journal."""

_TEMPORARY = re.compile(r"\.[0-9a-f]+\.([0-9a-f]+)\.(\d+)-(\d+)\.\d+")
_number = count()


@dataclass(frozen=True, slots=True)
class FolderKind:
    """The kind of a folder of runs.

    Attributes:
        what: "sweep" or "tuning".
        command: command of neuro that writes and reads the folder.
    """

    what: str
    command: str

    @property
    def file(self) -> str:
        """Name of the folder's file."""
        return f"{self.command}.json"

    @property
    def format(self) -> str:
        """Format mark of the folder's file."""
        return f"neuro {self.command} 1"

    @property
    def file_kind(self) -> Kind:
        """Kind of the folder's file, with a digest."""
        return sealed(f"a {self.what}", f'"format": "{self.format}"', ', "digest": "{}"')


SWEEP = FolderKind("sweep", "sweep")
TUNING = FolderKind("tuning", "tune")
KINDS = {kind.command: kind for kind in (SWEEP, TUNING)}


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """The outcome of a run.

    Attributes:
        key: hash of the inputs.
        point: values of the parameters.
        seed: seed; None for runs without a seed.
        outcome: "done", "failed" or "pruned".
        metrics: metrics by name; empty for a run that is not done.
        error: error message of a failed run.
        trace: traceback, if the error is a bug of the function.
        seconds: duration in seconds.
        attempts: number of attempts.
        provenance: record from which the run can be repeated.
        steps: reported values by step.
    """

    key: str
    point: dict[str, Any]
    seed: int | None
    outcome: str
    metrics: dict[str, Any] = field(default_factory=dict)
    error: str = ""
    trace: str = ""
    seconds: float = 0.0
    attempts: int = 1
    provenance: dict[str, Any] = field(default_factory=dict)
    steps: dict[str, float] = field(default_factory=dict)

    @property
    def failed(self) -> bool:
        """True for a run with an error."""
        return self.outcome == FAILED


class Folder:
    """The folder of a sweep or a tuning.

    Args:
        path: path of the folder.
        kind: `SWEEP` or `TUNING`; default: the kind of the existing folder.
    """

    def __init__(self, path: Path, kind: FolderKind | None = None) -> None:
        self.path = path
        self.kind = kind or (TUNING if (path / TUNING.file).exists() else SWEEP)
        self.runs, self.claims = path / "runs", path / "claims"

    def begin(self, content: Mapping[str, Any]) -> None:
        """Create the folder and its file with `content`, or continue in the folder of the same sweep.

        Raises:
            ModelError: the folder belongs to another sweep, has other files, or cannot be written.
        """
        for link in (self.path / name for name in ("runs", "claims", "journal.log", self.kind.file)):
            if link.is_symlink():  # a link of someone else could lead files out of the folder
                raise ModelError(f"{link}: is a link: expected a folder with its own runs")
        has_other_files = self._has_other_files()  # before other processes of the same sweep add theirs
        file = self.path / self.kind.file
        if file.exists():
            self._check_same(content)
        elif has_other_files:
            raise ModelError(f"{self.path}: is not the folder of a {self.kind.what}: expected a new or empty folder")
        with writing(self.path):
            for path in (self.path, self.runs, self.claims):
                make_folder(path)
            self.tidy()
            (self.claims / f".try-{os.getpid()}").touch()
            (self.claims / f".try-{os.getpid()}").unlink()
        if not file.exists():
            self.write(content)
            self._check_same(content)
        # Workers run the code that the file names. A file of someone else must not choose the code.
        existing = self.read()
        if _code_and_plan(existing) != _code_and_plan(content):
            unchanged = {word: value for word, value in existing.items() if word not in ("format", "digest")}
            self.write(unchanged | {word: content[word] for word in ("what", "with", "plan") if word in content})

    def tidy(self) -> None:
        """Remove temporary folders of killed processes of this machine."""
        for name in os.listdir(self.runs):
            match = _TEMPORARY.fullmatch(name)
            if match and match[1] == _tag() and began(int(match[2])) != match[3]:
                shutil.rmtree(self.runs / name, ignore_errors=True)

    def write(self, content: Mapping[str, Any]) -> None:
        """Write the folder's file. A file of another program is not replaced."""
        text = json.dumps({"format": self.kind.format, **content}, indent=1, ensure_ascii=False)
        write_text(self.path / self.kind.file, text + "\n", self.kind.file_kind)

    def _has_other_files(self) -> bool:
        """Return whether the folder contains files of something other than this sweep."""
        if not self.path.is_dir():
            return False
        names = {path.name for path in self.path.iterdir() if not path.name.startswith(f".{self.kind.file}.")}
        return not names <= {"runs", "claims"} or (self.runs.is_dir() and any(self.runs.iterdir()))

    def read(self) -> dict[str, Any]:
        """Return the content of the folder's file.

        Raises:
            ModelError: the file is missing or damaged.
        """
        path = self.path / self.kind.file
        name = self.kind.what
        try:
            content = parsed(path.read_bytes())
        except FileNotFoundError:
            message = f"{self.path}: found no {name}: expected a folder with {path.name}"
            raise ModelError(message, hint=self._hint()) from None
        except (OSError, ValueError) as error:
            raise ModelError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or 'damaged'}") from None
        if not isinstance(content, dict) or content.get("format") != self.kind.format:
            raise ModelError(f"{path}: not a {name}, as 'neuro {self.kind.command} run' writes it")
        if not self.kind.file_kind.ours(path):
            damage = "damaged, or edited by hand" if "digest" in content else "damaged"
            expected = f"expected the file that 'neuro {self.kind.command} run' wrote"
            raise ModelError(f"{path}: {damage}: {expected}", hint="restore the file from a copy")
        run = content.get("what")
        run = run if isinstance(run, dict) else {}
        texts = _TEXTS.get(str(run.get("kind")), ())
        if not texts or not all(isinstance(run.get(word), str) for word in texts):
            raise ModelError(f"{path}: damaged: expected a network or a function under 'what'")
        return content

    def _hint(self) -> str:
        for kind in KINDS.values():
            if kind != self.kind and (self.path / kind.file).exists():
                return f"the folder has a {kind.what}: neuro {kind.command} status {shlex.quote(str(self.path))}"
        command = self.kind.command
        return f"neuro {command} run {command}.yaml --out FOLDER creates one"

    def _check_same(self, content: Mapping[str, Any]) -> None:
        """Refuse the folder of another sweep or tuning. The message names the first input that differs."""
        existing, name = self.read(), self.kind.what
        identity = "same" if self.kind == TUNING else "digest_of_runs"
        if existing.get(identity) == content[identity]:
            return
        hint = f"expected the same {name}, or the name of a new folder"
        message = f"{self.path}: the folder of another {name}"
        stored, inputs = existing.get("same", {}), content["same"]
        for word in inputs:
            if stored.get(word) != inputs[word]:
                old, new = (_difference(stored.get(word), inputs[word]), _difference(inputs[word], stored.get(word)))
                raise ModelError(f"{message}: {word} is {old} there, {new} now", hint=hint)
        runs = f"{len(existing.get('runs', ())):,} runs there, {len(content.get('runs', ())):,} now"
        raise ModelError(f"{message}: its space differs, {runs}", hint=hint)

    def outcome(self, key: str) -> RunOutcome | None:
        """Return the outcome of a run, or None if the run is missing, damaged, or has another key."""
        try:
            content = parsed((self.runs / key / "run.json").read_bytes())
            if content.pop(SUM) != sum_of(content) or content["key"] != key:
                return None
            return RunOutcome(**{name: content[name] for name in RunOutcome.__dataclass_fields__ if name in content})
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            return None

    def outcomes(self, keys: Iterable[str]) -> dict[str, RunOutcome]:
        """Return the outcomes of the kept runs among `keys`, by key."""
        names = set(os.listdir(self.runs)) if self.runs.is_dir() else set()
        outcomes = ((key, self.outcome(key)) for key in keys if key in names)
        return {key: outcome for key, outcome in outcomes if outcome is not None}

    def keep(self, outcome: RunOutcome, fill: Callable[[Path], None] | None = None) -> None:
        """Keep a run, unless it is kept already.

        Args:
            outcome: the outcome of the run.
            fill: function that writes further files into the run's folder.

        Raises:
            Unwritable: the disk is full, or the folder cannot be written.
        """
        temporary = self._temporary(outcome.key)
        with writing(self.runs / outcome.key):
            try:
                temporary.mkdir()
                if fill is not None:
                    fill(temporary)
                content = {"format": _RUN, **asdict(outcome)}
                content[SUM] = sum_of(content)
                (temporary / "run.json").write_text(json.dumps(content, ensure_ascii=False) + "\n", "utf-8")
                try:
                    temporary.rename(self.runs / outcome.key)
                except OSError as error:
                    if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                        raise
                    if self.outcome(outcome.key) is None:  # damaged by a loss of power
                        self.remove(outcome.key)
                        temporary.rename(self.runs / outcome.key)
            finally:
                if temporary.exists():
                    shutil.rmtree(temporary, ignore_errors=True)

    def remove(self, key: str) -> None:
        """Remove a run in one step: other processes see the complete run or none."""
        temporary = self._temporary(key)
        with suppress(FileNotFoundError):
            (self.runs / key).rename(temporary)
        shutil.rmtree(temporary, ignore_errors=True)

    def _temporary(self, key: str) -> Path:
        """Return a new temporary path for a run. Its name contains the number and the start time of this process."""
        return self.runs / f".{key}.{_tag()}.{os.getpid()}-{began(os.getpid())}.{next(_number)}"


def _code_and_plan(content: Mapping[str, Any]) -> object:
    """Return the parts of the file of a folder that name code, and the plan, whose number of trials may differ."""
    run = content["what"]
    return content.get("with"), content.get("plan"), None if run["kind"] == "network" else run


def sum_of(content: Mapping[str, Any], before: str = "") -> str:
    """Return the checksum of plain data.

    Args:
        content: the data.
        before: checksum of the preceding data; it is part of the data over which the checksum is computed.
    """
    return f"{zlib.crc32((before + json.dumps(content, separators=(',', ':'), sort_keys=True)).encode()):08x}"


@cache
def _tag() -> str:
    """Return a short hash of `machine`."""
    return hashlib.sha256(machine().encode()).hexdigest()[:8]


def _difference(value: Any, reference: Any) -> str:
    """Return a value as text, cut at 80 characters. Of a mapping, show only entries that `reference` does not have."""
    if isinstance(value, Mapping) and isinstance(reference, Mapping):
        value = {name: entry for name, entry in value.items() if reference.get(name) != entry}
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."
