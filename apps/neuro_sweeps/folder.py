"""The folder of a sweep or of a tuning, in which each run is a folder named by the hash of its inputs.

```
sweep.json        what is run, its space, its limits and where it comes from; tune.json of a tuning
runs/HASH/        one run
    run.json      its point, seed, outcome, metrics or error, seconds, and where it comes from
    results.h5    what it recorded, where that is kept
    output.txt    what it printed, if anything
claims/HASH       which process works on it
```
A run is written aside and renamed when it is whole; of two that come to the same the first stays. A run that does not
fit its sum was damaged, counts as not there, and is done again.

A claim is a file for each run under way, made only where there is none. It is given up when its run is kept, or when
its process closes, as after an interrupt. One that is left by a process that has ended is taken over: on the machine
where it ran that shows at once, from another one when the file has not been touched for a while.
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
"""A claim from another machine that was touched longer ago, or that much in the future, is void."""

WRITING_S = 1.0
"""The same of an empty one: the process that makes it may be about to write it."""

BEAT_S = 10.0


@dataclass(frozen=True, slots=True)
class Holder:
    """The process that has a claim.

    Attributes:
        machine: as of `machine`.
        process: its number there.
        began: as of `began`.
    """

    machine: str
    process: int
    began: str

    def __str__(self) -> str:
        return f"process {self.process} on {self.machine.partition(' ')[0]}"


class Claims:
    """The claims of one process in a folder.

    Args:
        folder: of the claims.

    Raises:
        ModelError: the system is not Linux, so whether a process still works is not known.
    """

    def __init__(self, folder: Path) -> None:
        only_on_linux("a sweep")
        self._folder = folder
        self._mine = json.dumps(asdict(Holder(machine(), os.getpid(), began(os.getpid())))).encode()
        self._held: set[str] = set()
        self._stop = Event()

    def take(self, key: str) -> bool:
        """Claim a run, unless a living process has it.

        Raises:
            Unwritable: there can be no such file.
        """
        path = self._folder / key
        try:
            if self._make(path) or (not alive(path) and self._take_over(path)):
                self._held.add(key)
                return True
        except OSError as error:
            raise Unwritable(path, f"cannot be written: {error.strerror or error}") from None
        return False

    def give_up(self, key: str) -> None:
        """The run is kept, or was not begun."""
        self._held.discard(key)
        (self._folder / key).unlink(missing_ok=True)

    def close(self) -> None:
        """Give up all that is held: this process lives on, and another may want it."""
        self._stop.set()
        for key in tuple(self._held):
            self.give_up(key)

    def free(self, key: str) -> bool:
        """Whether no living process has a run."""
        return not alive(self._folder / key)

    def beat(self) -> None:
        """From now on touch what is held, in a thread, so that other machines see that it is worked on."""
        Thread(target=self._beat, daemon=True).start()

    def _beat(self) -> None:
        while not self._stop.wait(BEAT_S):
            for held in tuple(self._held):
                with suppress(OSError):
                    os.utime(self._folder / held)

    def _make(self, path: Path) -> bool:
        try:
            number = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
        except FileExistsError:
            return False
        try:
            with os.fdopen(number, "wb", buffering=0) as file:
                file.write(self._mine)
        except OSError:  # on a full disk: an empty claim would hold off who comes next
            path.unlink(missing_ok=True)
            raise
        return True

    def _take_over(self, path: Path) -> bool:
        """Replace a void claim; the lock lets one process do so at a time, which looks again."""
        with open(self._folder / ".lock", "ab") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if alive(path):
                return False
            path.unlink(missing_ok=True)
            return self._make(path)


def claimed(folder: Path) -> list[str]:
    """The runs that living processes work on."""
    return [name for name in os.listdir(folder) if not name.startswith(".") and alive(folder / name)]


def alive(path: Path) -> bool:
    """Whether the process that made a claim is still at work, as far as can be seen from here.

    The time of a file says so only near to now: it may be of a clock that was set, or of one that is wrong.
    """
    try:
        touched = path.stat().st_mtime
    except OSError:
        return False
    holder = holder_of(path)
    if holder is not None and holder.machine == machine():
        since = began(holder.process)
        return bool(since) and since == holder.began
    return abs(time.time() - touched) < (WRITING_S if holder is None else LEASE_S)


def holder_of(path: Path) -> Holder | None:
    """The process that made a claim; None if it does not say so."""
    try:
        content = parsed(path.read_bytes())
        holder = Holder(**content)
    except (OSError, ValueError, TypeError):
        return None
    kinds = (type(holder.machine), type(holder.process), type(holder.began))
    return holder if kinds == (str, int, str) else None


def waiting(folder: Path, keys: Sequence[str], what: str = "run") -> str:
    """For whom one waits, in words.

    Args:
        folder: of the claims.
        keys: of those that others work on.
        what: these are.
    """
    holder = holder_of(folder / keys[0]) or "one that does not say who it is"
    return f"waiting for {len(keys):,} {what}{'s' * (len(keys) != 1)} of others, first {holder} ({folder / keys[0]})"


def parsed(content: bytes | str) -> Any:
    """What JSON says.

    Raises:
        ValueError: it is none.
    """
    try:
        return json.loads(content)
    except RecursionError:
        raise ValueError("too deep") from None


@cache
def machine() -> str:
    """This machine since it was switched on, and the space of its processes: what makes a process number mean one."""
    parts = [platform.node()]
    with suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text().strip())
    with suppress(OSError):
        parts.append(os.readlink("/proc/self/ns/pid"))
    return " ".join(parts)


def began(process: int) -> str:
    """When a process began, in ticks since the machine did; "" if there is none, or it has ended.

    Source: proc(5), /proc/pid/stat, fields 3 and 22
    """
    try:
        words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if words[0] in "ZX" else words[19]


DONE, FAILED, PRUNED = "done", "failed", "pruned"
_RUN = "neuro run of a sweep 1"
_NAMED = {"network": ("file", "backend"), "function": ("name", "module", "file")}
"""Texts by which the file of a folder names what is run, by its kind."""
SUM = "sum"
"""Of runs, and of lines of a journal."""

_ASIDE = re.compile(r"\.[0-9a-f]+\.([0-9a-f]+)\.(\d+)-(\d+)\.\d+")
_number = count()


@dataclass(frozen=True, slots=True)
class Holding:
    """What a folder of runs is of.

    Attributes:
        what: "sweep", or "tuning".
        command: makes and reads it.
    """

    what: str
    command: str

    @property
    def file(self) -> str:
        """In which it is described."""
        return f"{self.command}.json"

    @property
    def format(self) -> str:
        """By which the file is known."""
        return f"neuro {self.command} 1"

    @property
    def kind(self) -> Kind:
        """Of the file."""
        return sealed(f"a {self.what}", f'"format": "{self.format}"', ', "digest": "{}"')


SWEEP = Holding("sweep", "sweep")
TUNING = Holding("tuning", "tune")


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """What has come of a run.

    Attributes:
        key: hash of its inputs.
        point: the values of the parameters.
        seed: of everything random; None where it gets none.
        outcome: "done", "failed" or "pruned".
        metrics: by name; of a run that is not done none.
        error: why it failed.
        trace: where, of an error of a program.
        seconds: that it took.
        attempts: how often it was begun.
        provenance: what it can be run again from.
        steps: what it reported on the way, by step.
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
        """Whether it has an error."""
        return self.outcome == FAILED


class Folder:
    """The folder of a sweep or of a tuning.

    Args:
        path: of the folder.
        holding: of which it is; what stands in it if not given.
    """

    def __init__(self, path: Path, holding: Holding | None = None) -> None:
        self.path = path
        self.holding = holding or (TUNING if (path / TUNING.file).exists() else SWEEP)
        self.runs, self.claims = path / "runs", path / "claims"

    def begin(self, content: Mapping[str, Any], same: str, what: str) -> None:
        """Make the folder, or go on in that of the same sweep.

        Args:
            content: what its file has.
            same: the word of `content` by which a sweep is the same.
            what: that which says what is run, of which messages tell what differs.

        Raises:
            ModelError: it is the folder of another sweep, or of something else, or cannot be written.
        """
        for link in (self.path / name for name in ("runs", "claims", "journal.log", self.holding.file)):
            if link.is_symlink():  # others may have made it, and what is written there would leave the folder
                raise ModelError(f"{link}: is a link: expected a folder that holds its own runs")
        foreign = self._foreign()  # first: what another process makes meanwhile is not foreign
        file = self.path / self.holding.file
        if file.exists():
            self._check_same(content, same, what)
        elif foreign:
            lack = f"{self.path}: is there and is no {self.holding.what}"
            raise ModelError(f"{lack}: expected a new name, or an empty folder")
        with self.telling(self.path):
            for each in (self.path, self.runs, self.claims):
                make_folder(each)
            # Remove what processes of this machine that were killed have left.
            for name in os.listdir(self.runs):
                found = _ASIDE.fullmatch(name)
                if found and found[1] == _tag() and began(int(found[2])) != found[3]:
                    shutil.rmtree(self.runs / name, ignore_errors=True)
            (self.claims / f".try-{os.getpid()}").touch()
            (self.claims / f".try-{os.getpid()}").unlink()
        if not file.exists():
            self.write(content)
            self._check_same(content, same, what)
        there = self.read()
        if _code(there) != _code(content):  # worker processes run what stands there, which anybody may have written
            kept = {word: value for word, value in there.items() if word not in ("format", "digest")}
            self.write(kept | {word: content[word] for word in ("what", "with")})

    def write(self, content: Mapping[str, Any]) -> None:
        """Write its file, in place of one that was written here."""
        text = json.dumps({"format": self.holding.format, **content}, indent=1, ensure_ascii=False)
        write_text(self.path / self.holding.file, text + "\n", self.holding.kind)

    def _foreign(self) -> bool:
        """Whether it holds more than what others that begin the same at this moment have made so far."""
        if not self.path.is_dir():
            return False
        names = {each.name for each in self.path.iterdir() if not each.name.startswith(f".{self.holding.file}.")}
        return not names <= {"runs", "claims"} or (self.runs.is_dir() and any(self.runs.iterdir()))

    def read(self) -> dict[str, Any]:
        """What its file has.

        Raises:
            ModelError: there is none, or it is damaged.
        """
        path = self.path / self.holding.file
        what = self.holding.what
        try:
            content = parsed(path.read_bytes())
        except FileNotFoundError:
            lack = f"{self.path}: holds no {what}: expected a folder with {path.name}"
            raise ModelError(lack, hint=self._other()) from None
        except (OSError, ValueError) as error:
            raise ModelError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or 'damaged'}") from None
        if not isinstance(content, dict) or content.get("format") != self.holding.format:
            raise ModelError(f"{path}: not a {what}, as 'neuro {self.holding.command} run' writes it")
        if not self.holding.kind.ours(path):
            hint = "a copy of it brings the folder back"
            lack = "damaged, or edited by hand" if "digest" in content else "damaged"
            wrote = f"expected what 'neuro {self.holding.command} run' wrote"
            raise ModelError(f"{path}: {lack}: {wrote}", hint=hint)
        run = content.get("what")
        run = run if isinstance(run, dict) else {}
        named = _NAMED.get(str(run.get("kind")), ())
        if not named or not all(isinstance(run.get(word), str) for word in named):
            raise ModelError(f"{path}: damaged: expected a network or a function under 'what'")
        return content

    def _other(self) -> str:
        for other in (SWEEP, TUNING):
            if other != self.holding and (self.path / other.file).exists():
                return f"it holds a {other.what}: neuro {other.command} status {shlex.quote(str(self.path))}"
        command = self.holding.command
        return f"neuro {command} run {command}.yaml --out FOLDER makes one"

    def _check_same(self, content: Mapping[str, Any], same: str, what: str) -> None:
        """Refuse the folder of another one."""
        there, kind = self.read(), self.holding.what
        if there.get(same) == content[same]:
            return
        hint = f"expected the same {kind}, or the name of a new folder"
        begin = f"{self.path}: the folder of another {kind}"
        before, now = there.get(what, {}), content[what]
        for word in now:
            if before.get(word) != now[word]:
                its, mine = _differing(before.get(word), now[word]), _differing(now[word], before.get(word))
                raise ModelError(f"{begin}: {word} is {its} there, {mine} now", hint=hint)
        runs = f"{len(there.get('runs', ())):,} runs there, {len(content.get('runs', ())):,} now"
        raise ModelError(f"{begin}: its space is not the same, {runs}", hint=hint)

    def outcome(self, key: str) -> RunOutcome | None:
        """What has come of a run; None if it is not there, not whole, or another one's."""
        try:
            content = parsed((self.runs / key / "run.json").read_bytes())
            if content.pop(SUM) != sum_of(content) or content["key"] != key:
                return None
            return RunOutcome(**{name: content[name] for name in RunOutcome.__dataclass_fields__ if name in content})
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            return None

    def outcomes(self, keys: Iterable[str]) -> dict[str, RunOutcome]:
        """What has come of those runs that are there."""
        there = set(os.listdir(self.runs)) if self.runs.is_dir() else set()
        found = ((key, self.outcome(key)) for key in keys if key in there)
        return {key: outcome for key, outcome in found if outcome is not None}

    def has(self, key: str) -> bool:
        """Whether a run is kept."""
        return (self.runs / key / "run.json").exists()

    def keep(self, outcome: RunOutcome, fill: Callable[[Path], None] | None = None) -> None:
        """Keep a run, if it is not kept already.

        Args:
            outcome: what has come of it.
            fill: writes more into the folder that it is given.

        Raises:
            Unwritable: the disk is full, or the folder cannot be written.
        """
        aside = self._aside(outcome.key)
        with self.telling(self.runs / outcome.key):
            try:
                aside.mkdir()
                if fill is not None:
                    fill(aside)
                content = {"format": _RUN, **asdict(outcome)}
                content[SUM] = sum_of(content)
                (aside / "run.json").write_text(json.dumps(content, ensure_ascii=False) + "\n", "utf-8")
                try:
                    aside.rename(self.runs / outcome.key)
                except OSError as error:
                    if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                        raise
                    if self.outcome(outcome.key) is None:  # what a machine that lost its power left
                        self.forget(outcome.key)
                        aside.rename(self.runs / outcome.key)
            finally:
                if aside.exists():
                    shutil.rmtree(aside, ignore_errors=True)

    def forget(self, key: str) -> None:
        """Take a run away, at once."""
        gone = self._aside(key)
        with suppress(FileNotFoundError):
            (self.runs / key).rename(gone)
        shutil.rmtree(gone, ignore_errors=True)

    def _aside(self, key: str) -> Path:
        """A new name beside a run, which tells whose it is."""
        return self.runs / f".{key}.{_tag()}.{os.getpid()}-{began(os.getpid())}.{next(_number)}"

    @contextmanager
    def telling(self, path: Path) -> Iterator[None]:
        """Tell that something cannot be written as users see it."""
        try:
            yield
        except OSError as error:
            raise Unwritable(path, f"cannot be written: {error.strerror or error}") from None


def _code(content: Mapping[str, Any]) -> object:
    """The words of the file of a folder that name code."""
    what = content.get("what", {})
    return content.get("with"), what if not isinstance(what, Mapping) or what.get("kind") != "network" else None


def sum_of(content: Mapping[str, Any], before: str = "") -> str:
    """By which damage of plain data shows, whichever bit it is.

    Args:
        content: the data.
        before: what it follows.
    """
    return f"{zlib.crc32((before + json.dumps(content, separators=(',', ':'), sort_keys=True)).encode()):08x}"


@cache
def _tag() -> str:
    """This machine since it was switched on, in a few letters."""
    return hashlib.sha256(machine().encode()).hexdigest()[:8]


def _differing(one: Any, other: Any) -> str:
    """What of one is not the same in the other, cut when it is long."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        one = {name: value for name, value in one.items() if other.get(name) != value}
    text = json.dumps(one)
    return text if len(text) <= 80 else text[:77] + "..."
