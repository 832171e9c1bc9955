"""The file of results of a running simulation, written by this process or another one.

If another process writes the file, a run in real time never waits for the disk. The process `python -m
neuro.run.results_file SOCKET FILE` receives calls of a `ResultsFile` and executes them. When the sender ends or is
killed, the process executes the calls received so far and ends.
"""

from __future__ import annotations

import os
import pickle
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.growing import JournaledFile
from neuro.core.hdf5 import FRONT
from neuro.core.outputs import Unwritable
from neuro.files.parts import Train
from neuro.files.results import FORMAT, PACKED, Results, read, read_file, recorded_in, write_results, write_values

_CHUNK = 1 << 16


class ResultsFile:
    """A file of results that grows, and gets its final name at the end.

    Args:
        part: path of the unfinished file.

    Raises:
        Unwritable: the file cannot be written, or another run writes it.
    """

    def __init__(self, part: Path) -> None:
        self._part = part
        with self._reporting():
            self._disk = JournaledFile(part, FORMAT)
        self._file = h5py.File(self._disk, "w", userblock_size=FRONT)

    def do(self, call: str, *arguments: Any, wait: bool = True) -> None:
        """Execute one of the calls below.

        Args:
            call: name of the method.
            arguments: its arguments.
            wait: whether to wait until the call is executed; a `RemoteFile` may execute it later.

        Raises:
            Unwritable: the file cannot be written.
        """
        with self._reporting():
            getattr(self, call)(*arguments)

    def begin(self, results: Results, gzip: bool) -> None:
        """Write results whose arrays of spikes and traces are empty and grow later; `gzip` compresses the spikes."""
        write_results(self._file, results, partial(_make_extensible, gzip=gzip))

    def append(self, place: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Append to arrays of a part; create missing arrays."""
        group = self._file.require_group(place)
        for word, array in arrays.items():
            if word not in group:
                _create_extensible(group, word, array)
            data = group[word]
            n = data.shape[0]
            data.resize(n + len(array), axis=0)
            data[n:] = array

    def update(self, values: Mapping[str, Mapping[str, Any]]) -> None:
        """Overwrite attributes and whole arrays, by place and name; create missing ones."""
        for place, by_name in values.items():
            write_values(self._file.require_group(place), by_name)

    def commit(self) -> None:
        """Write everything to disk, where it survives a crash of this process."""
        self._file.flush()
        self._disk.commit()

    def finish(self, path: Path) -> None:
        """Commit, and give the file its final name."""
        self.commit()
        self._file.close()
        self._disk.commit()
        self._part.replace(path)

    @property
    def results(self) -> Results:
        """Results so far."""
        return read_file(self._file, lambda: nullcontext(self._file))

    def close(self) -> None:
        """Close the file. An unfinished file stays as last committed."""
        with suppress(OSError, RuntimeError):
            self._file.close()
        self._disk.close()

    @contextmanager
    def _reporting(self) -> Iterator[None]:
        """Raise the first error of the disk as soon as HDF5 has finished a call."""
        try:
            yield
            if self._disk.error is not None:
                raise self._disk.error
        except BlockingIOError:
            raise Unwritable(self._part, "another run writes it: expected another name") from None
        except OSError as error:
            problem = f"cannot be written: {error.strerror or error}"
            raise Unwritable(self._part, problem, recorded_in(self._part)) from None


def _make_extensible(group: h5py.Group, part: Any, gzip: bool) -> None:
    """Create the arrays of a part that grow while the network runs."""
    for word in part.growing:
        if (empty := getattr(part, word)) is not None:
            _create_extensible(group, word, empty, gzip and isinstance(part, Train) and part.recorded)


def _create_extensible(group: h5py.Group, word: str, like: NDArray[Any], gzip: bool = False) -> None:
    """Create an empty array of this type and these columns."""
    columns = like.shape[1:]
    chunks = (max(1, _CHUNK // max(1, int(np.prod(columns)))), *columns)
    shapes: dict[str, Any] = {"shape": (0, *columns), "maxshape": (None, *columns), "chunks": chunks}
    group.create_dataset(word, dtype=like.dtype, **shapes, **(PACKED if gzip else {}))


_BUFFER = 1 << 22
_MOST = 1 << 28
"""Largest number of bytes in the queue to the other process. Above it the run waits, so that memory does not grow."""


class RemoteFile:
    """A `ResultsFile` in another process. Calls that do not fit into the socket are queued and sent with later ones.

    Args:
        part: path of the file.

    Raises:
        Unwritable: the file cannot be written, or another run writes it.
    """

    def __init__(self, part: Path) -> None:
        self._part = part
        self._here, there = socket.socketpair()
        for end in (self._here, there):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(os.path.abspath(entry) for entry in sys.path)}
        with there:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "neuro.run.results_file", str(there.fileno()), str(part)],
                pass_fds=(there.fileno(),),
                stdin=subprocess.DEVNULL,
                env=env,
                start_new_session=True,  # Ctrl-C is for the run
            )
        self._queue = bytearray()
        try:
            self._wait()
        except BaseException:
            self.close()
            raise

    def do(self, call: str, *arguments: Any, wait: bool = False) -> None:
        """Send one of the calls of `ResultsFile`; see there."""
        self._queue += pickle.dumps((call, arguments, wait), protocol=5)
        self._push(blocking=wait or len(self._queue) > _MOST)
        if wait:
            self._wait()

    @property
    def results(self) -> Results:
        """Results so far."""
        self.do("commit", wait=True)
        return read(self._part)

    def close(self) -> None:
        """Let the process execute all calls, and end it."""
        with suppress(OSError, ModelError):
            self._push(blocking=True)
        self._here.close()
        self._process.wait()

    def _push(self, blocking: bool) -> None:
        """Send the calls in the queue; without `blocking` as many as the socket accepts at once.

        Raises:
            Unwritable: the other process could not write.
        """
        self._here.setblocking(blocking)
        while self._queue:
            try:
                n_sent = self._here.send(self._queue)
            except BlockingIOError:
                return
            except OSError:
                raise self._failure() from None
            del self._queue[:n_sent]

    def _wait(self) -> None:
        """Wait until the other process has executed all calls that were sent."""
        self._here.setblocking(True)
        if self._here.recv(1) != b"+":
            raise self._failure()

    def _failure(self) -> Unwritable:
        """Return the error of the other process, which has ended."""
        report = b""
        self._here.setblocking(True)
        with suppress(OSError):
            while block := self._here.recv(1 << 16):
                report += block
        reason, _, hint = report.removeprefix(b"-").decode("utf-8", "replace").partition("\0")
        if not reason:
            reason, hint = "the process that writes it has ended", recorded_in(self._part)
        return Unwritable(self._part, reason, hint)


def main(number: str, part: str) -> None:
    """Execute the calls from the socket with the file descriptor `number` until the socket closes."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the process ends after the last call of the run
    with socket.socket(fileno=int(number)) as pipe, pipe.makefile("rb", buffering=_BUFFER) as calls:
        file = None
        try:
            file = ResultsFile(Path(part))
            pipe.sendall(b"+")
            while True:
                call, arguments, answer = pickle.load(calls)
                file.do(call, *arguments)
                if answer:
                    pipe.sendall(b"+")
        except (EOFError, ConnectionError, pickle.UnpicklingError):  # the run has ended, or was killed within a call
            pass
        except Unwritable as error:
            with suppress(OSError):
                pipe.sendall(f"-{error.what}\0{error.hint}".encode())
        finally:
            if file is not None:
                file.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
