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
        """Send an error with its traceback; an error that cannot be pickled is sent as a RuntimeError with its text."""
        picklable = error
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            picklable = RuntimeError(f"{type(error).__name__}: {error}")
        self.tell(is_, (picklable, "".join(traceback.format_exception(error))))


def main() -> None:
    """Do what is asked for until the pipe ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = connection.Connection(int(sys.argv[1]))
    requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def hear() -> None:
        try:
            while True:
                requests.put(pipe.recv_bytes())
        except (EOFError, OSError):
            os.killpg(0, signal.SIGKILL)  # the parent has ended, so this process and its forks end, too

    Thread(target=hear, daemon=True).start()
    back = _Pipe(pipe)
    words = pickle.loads(requests.get())
    _prepare(words)
    try:
        run_extensions(words["extensions"])
        work = _read(words["begin"])()
    except BaseException as error:
        back.raised("refused", error)
        return
    back.tell("ready")
    reported = len(words["read"])
    while True:
        message = requests.get()
        try:
            attempt, job = _read(message)
            result = work(job, attempt, lambda what: back.tell("said", what))
            read = inputs.recorded_inputs()
            if len(read) > reported:
                back.tell("read", read[reported:])
                reported = len(read)
            back.tell("done", result)
        except BaseException as error:
            back.raised("raised", error)


def _prepare(words: Mapping[str, Any]) -> None:
    """Set arguments, paths and environment to those of the parent."""
    os.environ.pop("PYTHONPATH", None)
    if words["python_path"] is not None:
        os.environ["PYTHONPATH"] = words["python_path"]
    sys.argv[:], sys.path[:] = words["argv"], words["paths"]
    _Unpickler.script = words["script"]
    for name in words["read"]:  # files that this process writes have the parent's inputs in their provenance
        inputs.record_input(name)


if __name__ == "__main__":
    main()
