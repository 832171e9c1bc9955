"""A process that does jobs, one after the other, started by `neuro.core.processes`.

`python -m neuro.core.worker_process PIPE` reads first how to begin, then one job after the other, and ends when the
pipe does.
"""

from __future__ import annotations

import io
import os
import pickle
import queue
import signal
import sys
import traceback
from collections.abc import Mapping
from multiprocessing import connection, spawn
from threading import Lock, Thread
from typing import Any

from neuro.core import inputs, processes
from neuro.core.extension import run_extensions


class _Unpickler(pickle.Unpickler):
    """Finds what a script defines, which is run for that as a module, once."""

    script: Mapping[str, Any] = {}

    def find_class(self, module: str, name: str) -> Any:
        if module in ("__main__", "__mp_main__") and _Unpickler.script:
            script, _Unpickler.script = _Unpickler.script, {}
            processes.loading_script = True
            try:
                spawn.prepare(dict(script))
            finally:
                processes.loading_script = False
        return super().find_class(module, name)


def _read(message: bytes) -> Any:
    return _Unpickler(io.BytesIO(message)).load()


class _Pipe:
    """The way back; jobs may tell from several threads."""

    def __init__(self, pipe: connection.Connection) -> None:
        self._pipe, self._one = pipe, Lock()

    def tell(self, is_: str, what: Any = None) -> None:
        message = pickle.dumps((is_, what))
        with self._one:
            self._pipe.send_bytes(message)

    def raised(self, is_: str, error: BaseException) -> None:
        """Tell an error with where it was raised; one that cannot be sent as what it says."""
        sent = error
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            sent = RuntimeError(f"{type(error).__name__}: {error}")
        self.tell(is_, (sent, "".join(traceback.format_exception(error))))


def main() -> None:
    """Do what is asked for until the pipe ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = connection.Connection(int(sys.argv[1]))
    asked: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def hear() -> None:
        try:
            while True:
                asked.put(pipe.recv_bytes())
        except (EOFError, OSError):
            os.killpg(0, signal.SIGKILL)  # the one that asked has ended: so does this one, and its forks

    Thread(target=hear, daemon=True).start()
    back = _Pipe(pipe)
    words = pickle.loads(asked.get())
    _prepare(words)
    try:
        run_extensions(words["extensions"])
        work = _read(words["begin"])()
    except BaseException as error:
        back.raised("refused", error)
        return
    back.tell("ready")
    known = len(words["read"])
    while True:
        message = asked.get()
        try:
            attempt, job = _read(message)
            found = work(job, attempt, lambda what: back.tell("said", what))
            read = inputs.recorded_inputs()
            if len(read) > known:
                back.tell("read", read[known:])
                known = len(read)
            back.tell("done", found)
        except BaseException as error:
            back.raised("raised", error)


def _prepare(words: Mapping[str, Any]) -> None:
    """Be as the process that asked: its arguments, its paths, its environment."""
    os.environ.pop("PYTHONPATH", None)
    if words["python_path"] is not None:
        os.environ["PYTHONPATH"] = words["python_path"]
    sys.argv[:], sys.path[:] = words["argv"], words["paths"]
    _Unpickler.script = words["script"]
    for name in words["read"]:  # what is made of them tells of them, wherever it is made
        inputs.record_input(name)


if __name__ == "__main__":
    main()
