"""Claims: a file for each run under way, made only where there is none, says which process works on it.

A claim is given up when its run is kept, or when its process closes, as after an interrupt. One that is left by a
process that has ended is taken over: on the machine where it ran that shows at once, from another one when the file has
not been touched for a while.
"""

from __future__ import annotations

import fcntl
import json
import os
import platform
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from threading import Event, Thread
from typing import Any

from neuro.core.outputs import Unwritable
from neuro.core.system import only_on_linux

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
