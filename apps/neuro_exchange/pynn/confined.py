"""The process that runs a script of PyNN, started by `neuro_exchange.pynn.read`.

The script can read files, and write into a temporary folder, but cannot start programs, use the network or write
elsewhere. Hooks of Python refuse these actions and name the line. The kernel refuses them as well, see
`neuro_exchange.pynn.kernel`.
"""

from __future__ import annotations

import _posixsubprocess
import ctypes
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, NoReturn

from neuro_exchange.pynn.kernel import restrict

_PARENT_DEATH = 1
_PATHS = (
    *("os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.symlink", "os.link", "os.truncate", "os.chmod", "os.chown"),
    *("os.utime", "os.setxattr", "os.removexattr", "sqlite3.connect"),
)
"""Audit events of calls that change files. Paths are among the first two arguments."""
_WITHOUT_EFFECT = ("chmod", "utime", "setxattr")
"""Functions of `os` that the kernel refuses. They are replaced by functions that do nothing, so that a script can
still copy files, e.g. by `shutil.copy2`."""
_PROGRAMS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "os.forkpty", "pty.spawn")
_NETWORK = ("socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg", "socket.getaddrinfo")
_SIGNALS = ("os.kill", "os.killpg", "signal.pthread_kill")
_FILE_SIZE = 2**30


class Refused(PermissionError):
    """Raised if the script does something that a description of a network does not need."""


def main() -> None:
    """Read the job from stdin, run the script, and write the report."""
    job = json.load(sys.stdin)
    _end_with(job["parent"])
    folder = Path(job["folder"])
    from neuro_exchange.pynn import gathered, session, stand_in  # before the limits, which imports would violate

    script = Path(job["script"])
    outcome = session.SESSION
    outcome.begin(folder / "networks", script, folder / "files", gathered.NetworkBuilder)
    script_copy = folder / "files" / script.name
    code = _compile(script, outcome)
    if code is not None:
        stand_in.install()
        os.chdir(folder / "files")
        sys.argv, sys.path[0:0] = [script.name, *job["arguments"]], [str(folder / "files")]
        _limit(job["memory"], job["seconds"])
        _confine(folder)
        _run(code, script_copy, outcome)
    outcome.report().write(job["report"])
    os._exit(0)  # without waiting for threads and exit functions of the script


def _compile(script: Path, outcome: Any) -> CodeType | None:
    try:
        return compile(script.read_bytes(), str(script), "exec", dont_inherit=True)
    except (SyntaxError, ValueError) as error:
        outcome.fail(f"is not Python: {getattr(error, 'msg', error)}", getattr(error, "lineno", 0) or 0)
        return None


def _run(code: CodeType, script_copy: Path, outcome: Any) -> None:
    module = sys.modules["__main__"] = ModuleType("__main__")
    module.__file__ = script_copy.name
    try:
        exec(code, vars(module))
    except SystemExit as error:
        if error.code not in (None, 0, False):
            outcome.fail(f"exits with {error.code!r:.200}", _line(error, code.co_filename), kind="exit")
    except KeyboardInterrupt:
        outcome.fail("is interrupted", 0)
    except MemoryError as error:
        outcome.fail("exceeds the memory limit", _line(error, code.co_filename), kind="memory")
    except BaseException as error:
        text, is_refused = next(filter(str.strip, str(error).splitlines()), ""), isinstance(error, Refused)
        message = text if is_refused else f"{type(error).__name__}: {text}" if text else type(error).__name__
        outcome.fail(message[:400], _line(error, code.co_filename), kind="refused" if is_refused else "raised")


def _line(error: BaseException, script: str) -> int:
    """Return the last line of the script in the traceback of an error, or 0."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == script]
    return lines[-1] or 0 if lines else 0


def _end_with(parent: int) -> None:
    """Let the kernel end this process when its parent ends."""
    ctypes.CDLL(None).prctl(_PARENT_DEATH, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        sys.exit(1)


def _limit(memory: int, seconds: float) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
    resource.setrlimit(resource.RLIMIT_FSIZE, (_FILE_SIZE, _FILE_SIZE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)


def _confine(folder: Path) -> None:
    """Refuse from now on to start programs, to use the network, and to write outside the folder."""
    base = os.path.realpath(folder)
    sys.dont_write_bytecode = True
    restrict(base)

    def refuse(*args: Any, **options: Any) -> NoReturn:
        raise Refused("a script may not start programs")

    _posixsubprocess.fork_exec = refuse
    subprocess._fork_exec = refuse  # type: ignore[attr-defined]

    def is_inside(path: Any, follow: bool = True) -> bool:
        if isinstance(path, int):
            return True
        name = os.path.abspath(os.fsdecode(path))
        name = os.path.realpath(name) if follow else os.path.join(os.path.realpath(os.path.dirname(name)), "_")
        return name.startswith(base + os.sep) or name == os.devnull

    def check(event: str, args: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = args
            if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND):
                _replace_link(path, flags)
                if not is_inside(path):
                    raise Refused(f"a script may not write {os.fsdecode(path)!r:.200}")
                if not isinstance(path, int):
                    os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
        elif event in _PATHS:
            paths = args[:2] if event in ("os.rename", "os.link") else args[1:2] if event == "os.symlink" else args[:1]
            names = (path for path in paths if isinstance(path, str | bytes))
            outside_path = next((name for name in names if not is_inside(name, False)), None)
            if outside_path is not None:
                raise Refused(f"a script may not change {os.fsdecode(outside_path)!r:.200}")
            if isinstance(args[0], int) and event != "os.truncate":
                raise Refused("a script may not change the mode, owner or times of an open file")
        elif event in _PROGRAMS:
            raise Refused("a script may not start programs")
        elif event in _NETWORK:
            raise Refused("a script may not use the network")
        elif event in _SIGNALS:
            raise Refused("a script may not signal processes")
        elif event == "ctypes.dlopen" or (event == "ctypes.dlsym" and not str(args[1]).startswith("Py")):
            raise Refused("a script may not call libraries by ctypes")

    sys.addaudithook(check)
    for name in _WITHOUT_EFFECT:
        setattr(os, name, _without_effect(name))


def _without_effect(name: str) -> Callable[..., None]:
    """Return a replacement for a function of `os` that raises the audit event and does nothing else."""

    def call(path: Any, *args: Any, **options: Any) -> None:
        sys.audit(f"os.{name}", path)

    return call


def _replace_link(path: Any, flags: int) -> None:
    """Replace a link to a file beside the script by a copy of the file, so that the script writes the copy."""
    if isinstance(path, int) or not os.path.islink(path):
        return
    original = os.path.realpath(path)
    os.unlink(path)
    if not flags & os.O_TRUNC and os.path.isfile(original):
        shutil.copyfile(original, path)


if __name__ == "__main__":
    main()
