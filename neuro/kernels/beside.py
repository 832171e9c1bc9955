"""Kernels that compile side by side: a second process takes some of them, and what it compiles is kept.

Numba compiles one thing at a time in a process. The other process is handed one kernel after the other, the last of
those that are left, while this one takes the first; whatever becomes of it, this one compiles what is not kept then.
"""

# mypy: disable-error-code="no-untyped-call"
from __future__ import annotations

import base64
import os
import pickle
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from threading import Thread
from typing import Any, TypeAlias

import numba

from neuro.core.system import usable_cores
from neuro.kernels import compile_report
from neuro.kernels.address import Entry
from neuro.kernels.kept import folder

_config: Any = numba.config
Asked: TypeAlias = Callable[[], Entry]
"""Gives an entry, the same one each time; can be pickled where its model is of the package."""


def addresses(asked: Sequence[Asked]) -> list[int]:
    """Where the machine code of some entries lies; what is not kept is compiled.

    Raises:
        ModelError: see `Entry.address`.
    """
    left = deque(each for each in asked if not each().kept)
    if len(left) > 1 and _has_room():
        with _beside(left):
            while left:
                left.popleft()().address()
    return [each().address() for each in asked]


def _has_room() -> bool:
    """Whether another process would help: it has a core, what it compiles is found, and it would compile the same."""
    alone = compile_report.REPORTED in os.environ and not compile_report.here
    return usable_cores() > 1 and folder() is not None and not _config.BOUNDSCHECK and not alone


@contextmanager
def _beside(left: deque[Asked]) -> Iterator[None]:
    """Let another process compile the last of those that are left, too; at the end it is waited for."""
    began, paths = compile_report.begin(), [os.path.abspath(path) for path in sys.path]
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "neuro.kernels.beside"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        process_group=0,
    )
    done: list[Asked] = []
    thread = Thread(target=_hand_out, args=(process, left, done), daemon=True)
    thread.start()
    try:
        yield
        thread.join()
    finally:
        process.kill()
        process.communicate()
        compile_report.end(began, len(done))


def _hand_out(process: subprocess.Popen[bytes], left: deque[Asked], done: list[Asked]) -> None:
    """Hand out one after the other until none is left, or the process has ended."""
    assert process.stdin is not None
    assert process.stdout is not None
    with suppress(IndexError, OSError, ValueError):
        while True:
            each = left.pop()
            try:
                job = pickle.dumps(each)
            except Exception:  # a model that another process cannot import: this one compiles it at the end
                continue
            process.stdin.write(base64.b64encode(job) + b"\n")
            process.stdin.flush()
            answer = process.stdout.readline()
            if not answer:
                return
            if answer == _DONE:
                done.append(each)


_DONE = b"done\n"


def main() -> None:
    """Compile what is asked for, until there is nothing more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what is imported may print
    for line in sys.stdin.buffer:
        answer = b"not done\n"
        with suppress(Exception):
            pickle.loads(base64.b64decode(line))().address()
            answer = _DONE
        answers.write(answer)


if __name__ == "__main__":
    main()
