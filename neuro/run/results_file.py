"""The file of results of a running simulation, written by this process or another one.

If another process writes the file, a run in real time never waits for the disk: `python -m neuro.run.results_file
SOCKET FILE` executes the calls of a `ResultsFile` that it receives. When the sender ends or is killed, the process
executes the calls received so far and ends.
"""

from __future__ import annotations

import os
import pickle
import signal
import socket
import struct
import subprocess
import sys
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.growing import JournaledFile
from neuro.core.hdf5 import FRONT
from neuro.core.outputs import Unwritable
from neuro.files.results import FORMAT, Results, read, read_file, recorded_in, write_head, write_part

_CHUNK = 1 << 16

Arrays = Mapping[str, NDArray[Any]]


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

    def begin(self, about: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        """Write the attributes of the run and the files of the network."""
        with self._reporting():
            write_head(self._file, about, files)

    def add(self, place: str, part: Any, growing: tuple[str, ...], gzip: bool = False) -> None:
        """Create the group of a part; `growing` are the names of its extensible arrays."""
        with self._reporting():
            group = self._file.create_group(place)
            for word in growing:
                _create_extensible(group, word, getattr(part, word), gzip)
            write_part(group, part)

    def append(self, place: str, arrays: Arrays) -> None:
        """Append to arrays of a part; create missing arrays."""
        with self._reporting():
            group = self._file.require_group(place)
            for word, array in arrays.items():
                if word not in group:
                    _create_extensible(group, word, array[:0])
                if len(array):
                    data = group[word]
                    n = data.shape[0]
                    data.resize(n + len(array), axis=0)
                    data[n:] = array

    def update(self, attributes: Mapping[str, Mapping[str, Any]], arrays: Mapping[str, Arrays]) -> None:
        """Overwrite attributes and whole arrays of parts."""
        with self._reporting():
            for place, by_name in attributes.items():
                self._file.require_group(place).attrs.update(by_name)
            for place, arrays_of_part in arrays.items():
                for word, array in arrays_of_part.items():
                    self._file[place][word][...] = array

    def complete(self, place: str, part: Any) -> None:
        """Write the fields of a part that were missing at `add`."""
        with self._reporting():
            write_part(self._file.require_group(place), part)

    def commit(self) -> None:
        """Write everything to disk, where it survives a crash of this process.

        Raises:
            Unwritable: the file cannot be written.
        """
        with self._reporting():
            self._file.flush()
            self._disk.commit()

    @property
    def results(self) -> Results:
        """Results so far."""
        return read_file(self._file, lambda: nullcontext(self._file))

    def finish(self, path: Path) -> None:
        """Commit, and give the file its final name.

        Raises:
            Unwritable: the file cannot be written.
        """
        self.commit()
        with self._reporting():
            self._file.close()
            self._disk.commit()
            self._part.replace(path)

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


def _create_extensible(group: h5py.Group, word: str, empty: NDArray[Any], gzip: bool = False) -> None:
    chunk = (max(1, _CHUNK // max(1, int(np.prod(empty.shape[1:])))), *empty.shape[1:])
    packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if gzip else {}
    group.create_dataset(
        word, shape=empty.shape, maxshape=(None, *empty.shape[1:]), chunks=chunk, dtype=empty.dtype, **packing
    )


_LENGTH = struct.Struct("<Q")
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
        self._queue: deque[memoryview] = deque()
        self._here.setblocking(False)
        try:
            self.wait()
        except BaseException:
            self.close()
            raise

    def wait(self) -> None:
        """Wait until all calls are executed."""
        self._ask("wait")

    def begin(self, about: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        """Write the attributes of the run and the files of the network."""
        self._send("begin", about, files)

    def add(self, place: str, part: Any, growing: tuple[str, ...], gzip: bool = False) -> None:
        """Create the group of a part, without compression, which would take processor time from the run."""
        self._send("add", place, part, growing)

    def append(self, place: str, arrays: Arrays) -> None:
        """Append to arrays of a part."""
        self._send("append", place, arrays)

    def update(self, attributes: Mapping[str, Mapping[str, Any]], arrays: Mapping[str, Arrays]) -> None:
        """Overwrite attributes and whole arrays of parts."""
        self._send("update", attributes, arrays)

    def complete(self, place: str, part: Any) -> None:
        """Write the fields of a part that were missing at `add`."""
        self._send("complete", place, part)

    def commit(self) -> None:
        """Write everything to disk soon."""
        self._send("commit")

    @property
    def results(self) -> Results:
        """Results so far."""
        self._ask("commit")
        return read(self._part)

    def finish(self, path: Path) -> None:
        """Commit, and give the file its final name.

        Raises:
            Unwritable: the file cannot be written.
        """
        self._ask("finish", path)

    def close(self) -> None:
        """Let the process execute all calls, and end it."""
        with suppress(OSError, ModelError):
            self._flush()
        self._here.close()
        self._process.wait()

    def _send(self, call: str, *arguments: Any, answer: bool = False) -> None:
        message = pickle.dumps((call, arguments, answer), protocol=5)
        self._queue.append(memoryview(_LENGTH.pack(len(message)) + message))
        self.push()
        if sum(item.nbytes for item in self._queue) > _MOST:
            self._flush()

    def push(self) -> None:
        """Send as many calls as the socket accepts at once.

        Raises:
            Unwritable: the other process could not write.
        """
        while self._queue:
            try:
                n_sent = self._here.send(self._queue[0])
            except BlockingIOError:
                return
            except OSError:
                raise self._failure() from None
            remainder = self._queue.popleft()[n_sent:]
            if remainder:
                self._queue.appendleft(remainder)

    def _flush(self) -> None:
        self._here.setblocking(True)
        try:
            self.push()
        finally:
            self._here.setblocking(False)

    def _ask(self, call: str, *arguments: Any) -> None:
        """Send a call, and wait until it is executed."""
        self._send(call, *arguments, answer=True)
        self._flush()
        self._here.setblocking(True)
        answer = self._here.recv(1)
        self._here.setblocking(False)
        if answer != b"+":
            raise self._failure()

    def _failure(self) -> Unwritable:
        """Return the error of the other process, which has ended."""
        report = b""
        self._here.setblocking(True)
        with suppress(OSError):
            while block := self._here.recv(1 << 16):
                report += block
        self._here.setblocking(False)
        report = report.removeprefix(b"-")
        reason, _, hint = report.decode("utf-8", "replace").partition("\0")
        if not reason:
            reason, hint = "the process that writes it has ended", recorded_in(self._part)
        return Unwritable(self._part, reason, hint)


def main(number: str, part: str) -> None:
    """Execute the calls from a socket until it closes."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the process ends after the last call of the run
    with socket.socket(fileno=int(number)) as pipe, pipe.makefile("rb", buffering=_BUFFER) as calls:
        file = None
        try:
            file = ResultsFile(Path(part))
            while len(head := calls.read(_LENGTH.size)) == _LENGTH.size:
                message = calls.read(*_LENGTH.unpack(head))
                if len(message) < _LENGTH.unpack(head)[0]:
                    break
                call, arguments, answer = pickle.loads(message)
                if call != "wait":
                    getattr(file, call)(*arguments)
                if answer:
                    pipe.sendall(b"+")
        except Unwritable as error:
            with suppress(OSError):
                pipe.sendall(f"-{error.what}\0{error.hint}".encode())
        finally:
            if file is not None:
                file.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
