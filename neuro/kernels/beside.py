"""Compilation of kernels in two processes: this process and a helper.

Numba compiles one function at a time in a process. This process takes kernels from the front of a queue, and the
helper gets kernels from the end. If the helper fails, this process compiles the missing kernels.
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
"""A function that returns the same entry at each call. It can be pickled if a helper can import its model."""


def addresses(makers: Sequence[Asked]) -> list[int]:
    """Return the addresses of entries. Missing machine code is compiled first.

    Raises:
        ModelError: see `Entry.address`.
    """
    to_compile = deque(maker for maker in makers if not maker().is_compiled)
    if len(to_compile) > 1 and _helper_pays():
        with _helper(to_compile):
            while to_compile:
                to_compile.popleft()().address()
    return [maker().address() for maker in makers]


def _helper_pays() -> bool:
    """Return True if a helper saves time: a core is free, the cache can be written, and both compile the same code."""
    is_alone = compile_report.REPORTED in os.environ and not compile_report.has_reported
    return usable_cores() > 1 and folder() is not None and not _config.BOUNDSCHECK and not is_alone


@contextmanager
def _helper(queue: deque[Asked]) -> Iterator[None]:
    """Let a helper compile kernels from the end of the queue during the block. Wait for the helper at the end."""
    began, paths = compile_report.begin(), [os.path.abspath(path) for path in sys.path]
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "neuro.kernels.beside"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        process_group=0,
    )
    compiled: list[Asked] = []
    thread = Thread(target=_hand_out, args=(process, queue, compiled), daemon=True)
    thread.start()
    try:
        yield
        thread.join()
    finally:
        process.kill()
        process.communicate()
        compile_report.end(began, len(compiled))


def _hand_out(process: subprocess.Popen[bytes], queue: deque[Asked], compiled: list[Asked]) -> None:
    """Send the helper one kernel after the other until the queue is empty or the helper has ended."""
    assert process.stdin is not None
    assert process.stdout is not None
    with suppress(IndexError, OSError, ValueError):
        while True:
            maker = queue.pop()
            try:
                job = pickle.dumps(maker)
            except Exception:  # the helper cannot import the model, so this process compiles the kernel at the end
                continue
            process.stdin.write(base64.b64encode(job) + b"\n")
            process.stdin.flush()
            answer = process.stdout.readline()
            if not answer:
                return
            if answer == _DONE:
                compiled.append(maker)


_DONE = b"done\n"


def main() -> None:
    """Compile the kernels that arrive on stdin, with an answer after each kernel."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # imported modules may print
    for line in sys.stdin.buffer:
        answer = b"not done\n"
        with suppress(Exception):
            pickle.loads(base64.b64decode(line))().address()
            answer = _DONE
        answers.write(answer)


if __name__ == "__main__":
    main()
