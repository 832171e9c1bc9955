"""The main function of a worker process, which `neuro.core.processes` starts.

`python -m neuro.core.worker_process PIPE` reads the settings from the pipe, then jobs in turn, and ends
when the pipe is closed.
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
    """Unpickler that runs the parent's script as a module when the first object of the script is loaded."""

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
    """The pipe to the parent. Jobs may send from several threads."""

    def __init__(self, pipe: connection.Connection) -> None:
        self._pipe, self._lock = pipe, Lock()

    def tell(self, kind: str, content: Any = None) -> None:
        message = pickle.dumps((kind, content))
        with self._lock:
            self._pipe.send_bytes(message)

    def raised(self, kind: str, error: BaseException) -> None:
        """Send an error with its traceback; an error that cannot be pickled is sent as a RuntimeError with its text."""
        picklable = error
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            picklable = RuntimeError(f"{type(error).__name__}: {error}")
        self.tell(kind, (picklable, "".join(traceback.format_exception(error))))


def main() -> None:
    """Run jobs until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = connection.Connection(int(sys.argv[1]))
    requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def receive() -> None:
        try:
            while True:
                requests.put(pipe.recv_bytes())
        except (EOFError, OSError):
            os.killpg(0, signal.SIGKILL)  # the parent has ended, so this process and its forks end, too

    Thread(target=receive, daemon=True).start()
    replies = _Pipe(pipe)
    settings = pickle.loads(requests.get())
    _prepare(settings)
    try:
        run_extensions(settings["extensions"])
        work = _read(settings["begin"])()
    except BaseException as error:
        replies.raised("refused", error)
        return
    replies.tell("ready")
    reported = len(settings["read"])
    while True:
        message = requests.get()
        try:
            attempt, job = _read(message)
            result = work(job, attempt, lambda content: replies.tell("said", content))
            input_files = inputs.recorded_inputs()
            if len(input_files) > reported:
                replies.tell("read", input_files[reported:])
                reported = len(input_files)
            replies.tell("done", result)
        except BaseException as error:
            replies.raised("raised", error)


def _prepare(settings: Mapping[str, Any]) -> None:
    """Set arguments, paths and environment to those of the parent."""
    os.environ.pop("PYTHONPATH", None)
    if settings["python_path"] is not None:
        os.environ["PYTHONPATH"] = settings["python_path"]
    sys.argv[:], sys.path[:] = settings["argv"], settings["paths"]
    _Unpickler.script = settings["script"]
    # The provenance of a file that this process writes names the inputs of the parent, too.
    for name in settings["read"]:
        inputs.record_input(name)


if __name__ == "__main__":
    main()
