"""The file of results of a run that is under way, written here or by another process.

The other process lets a run in real time wait for no disk:
`python -m neuro.run.results_file SOCKET FILE` does what it is sent, one call of a `ResultsFile` after the other.
Where the other end is gone, killed say, it does what it was sent and ends.
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
    """A file of results that grows, and takes its name when it ends.

    Args:
        part: where it is written.

    Raises:
        Unwritable: the file cannot be written, or another run writes it.
    """

    def __init__(self, part: Path) -> None:
        self._part = part
        with self._writing():
            self._disk = JournaledFile(part, FORMAT)
        self._file = h5py.File(self._disk, "w", userblock_size=FRONT)

    def begin(self, about: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        """Write what the run is of."""
        with self._writing():
            write_head(self._file, about, files)

    def add(self, place: str, part: Any, growing: tuple[str, ...], gzip: bool = False) -> None:
        """Make room for a part; `growing` are its arrays to which more is appended."""
        with self._writing():
            group = self._file.create_group(place)
            for word in growing:
                _growing(group, word, getattr(part, word), gzip)
            write_part(group, part)

    def append(self, place: str, arrays: Arrays) -> None:
        """Append to arrays of a part; those that are not there yet begin."""
        with self._writing():
            group = self._file.require_group(place)
            for word, array in arrays.items():
                if word not in group:
                    _growing(group, word, array[:0])
                if len(array):
                    data = group[word]
                    n = data.shape[0]
                    data.resize(n + len(array), axis=0)
                    data[n:] = array

    def update(self, attributes: Mapping[str, Mapping[str, Any]], arrays: Mapping[str, Arrays]) -> None:
        """Write attributes and whole arrays of parts anew."""
        with self._writing():
            for place, named in attributes.items():
                self._file.require_group(place).attrs.update(named)
            for place, each in arrays.items():
                for word, array in each.items():
                    self._file[place][word][...] = array

    def complete(self, place: str, part: Any) -> None:
        """Write what a part has got since `add`."""
        with self._writing():
            write_part(self._file.require_group(place), part)

    def commit(self) -> None:
        """Let all this be on the disk, where it stays whatever happens to this process.

        Raises:
            Unwritable: it cannot be written.
        """
        with self._writing():
            self._file.flush()
            self._disk.commit()

    @property
    def results(self) -> Results:
        """All that has been written."""
        return read_file(self._file, lambda: nullcontext(self._file))

    def finish(self, path: Path) -> None:
        """Commit, and give the file its name.

        Raises:
            Unwritable: it cannot be written.
        """
        self.commit()
        with self._writing():
            self._file.close()
            self._disk.commit()
            self._part.replace(path)

    def close(self) -> None:
        """Close the file; one that did not end stays as it was committed."""
        with suppress(OSError, RuntimeError):
            self._file.close()
        self._disk.close()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Report the first failure as soon as HDF5 is done with a call."""
        try:
            yield
            if self._disk.error is not None:
                raise self._disk.error
        except BlockingIOError:
            raise Unwritable(self._part, "another run writes it: expected another name") from None
        except OSError as error:
            what = f"cannot be written: {error.strerror or error}"
            raise Unwritable(self._part, what, recorded_in(self._part)) from None


def _growing(group: h5py.Group, word: str, empty: NDArray[Any], gzip: bool = False) -> None:
    chunk = (max(1, _CHUNK // max(1, int(np.prod(empty.shape[1:])))), *empty.shape[1:])
    packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if gzip else {}
    group.create_dataset(
        word, shape=empty.shape, maxshape=(None, *empty.shape[1:]), chunks=chunk, dtype=empty.dtype, **packing
    )


_LENGTH = struct.Struct("<Q")
_BUFFER = 1 << 22
_MOST = 1 << 28
"""Bytes that wait for the other process; where there are more the run does, too, so that memory does not grow."""


class RemoteFile:
    """A `ResultsFile` of another process: calls are sent as far as the socket takes them, and the rest with later ones.

    Args:
        part: where it is written.

    Raises:
        Unwritable: it cannot be written, or another run writes it.
    """

    def __init__(self, part: Path) -> None:
        self._part = part
        self._here, there = socket.socketpair()
        for end in (self._here, there):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(os.path.abspath(each) for each in sys.path)}
        with there:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "neuro.run.results_file", str(there.fileno()), str(part)],
                pass_fds=(there.fileno(),),
                stdin=subprocess.DEVNULL,
                env=env,
                start_new_session=True,  # Ctrl-C is for the run
            )
        self._waiting: deque[memoryview] = deque()
        self._here.setblocking(False)
        try:
            self.wait()
        except BaseException:
            self.close()
            raise

    def wait(self) -> None:
        """Wait until all calls are done."""
        self._ask("wait")

    def begin(self, about: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        """Write what the run is of."""
        self._send("begin", about, files)

    def add(self, place: str, part: Any, growing: tuple[str, ...], gzip: bool = False) -> None:
        """Make room for a part; nothing is packed, as the processor has other work."""
        self._send("add", place, part, growing)

    def append(self, place: str, arrays: Arrays) -> None:
        """Append to arrays of a part."""
        self._send("append", place, arrays)

    def update(self, attributes: Mapping[str, Mapping[str, Any]], arrays: Mapping[str, Arrays]) -> None:
        """Write attributes and whole arrays of parts anew."""
        self._send("update", attributes, arrays)

    def complete(self, place: str, part: Any) -> None:
        """Write what a part has got since `add`."""
        self._send("complete", place, part)

    def commit(self) -> None:
        """Let all this be on the disk soon."""
        self._send("commit")

    @property
    def results(self) -> Results:
        """All that has been written."""
        self._ask("commit")
        return read(self._part)

    def finish(self, path: Path) -> None:
        """Commit, and give the file its name.

        Raises:
            Unwritable: it cannot be written.
        """
        self._ask("finish", path)

    def close(self) -> None:
        """Let the process do what it was sent, and end."""
        with suppress(OSError, ModelError):
            self._flush()
        self._here.close()
        self._process.wait()

    def _send(self, call: str, *words: Any, answer: bool = False) -> None:
        message = pickle.dumps((call, words, answer), protocol=5)
        self._waiting.append(memoryview(_LENGTH.pack(len(message)) + message))
        self.push()
        if sum(each.nbytes for each in self._waiting) > _MOST:
            self._flush()

    def push(self) -> None:
        """Send what the socket takes at once.

        Raises:
            Unwritable: the other process could not write.
        """
        while self._waiting:
            try:
                sent = self._here.send(self._waiting[0])
            except BlockingIOError:
                return
            except OSError:
                raise self._failure() from None
            rest = self._waiting.popleft()[sent:]
            if rest:
                self._waiting.appendleft(rest)

    def _flush(self) -> None:
        self._here.setblocking(True)
        try:
            self.push()
        finally:
            self._here.setblocking(False)

    def _ask(self, call: str, *words: Any) -> None:
        """Call, and wait until it is done."""
        self._send(call, *words, answer=True)
        self._flush()
        self._here.setblocking(True)
        answer = self._here.recv(1)
        self._here.setblocking(False)
        if answer != b"+":
            raise self._failure()

    def _failure(self) -> Unwritable:
        """What kept the other process from writing; it has ended."""
        what = b""
        self._here.setblocking(True)
        with suppress(OSError):
            while block := self._here.recv(1 << 16):
                what += block
        self._here.setblocking(False)
        what = what.removeprefix(b"-")
        reason, _, hint = what.decode("utf-8", "replace").partition("\0")
        if not reason:
            reason, hint = "the process that writes it has ended", recorded_in(self._part)
        return Unwritable(self._part, reason, hint)


def main(number: str, part: str) -> None:
    """Do what comes, until no more does."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends with the run, after what the run has sent
    with socket.socket(fileno=int(number)) as pipe, pipe.makefile("rb", buffering=_BUFFER) as calls:
        file = None
        try:
            file = ResultsFile(Path(part))
            while len(head := calls.read(_LENGTH.size)) == _LENGTH.size:
                message = calls.read(*_LENGTH.unpack(head))
                if len(message) < _LENGTH.unpack(head)[0]:
                    break
                call, words, answer = pickle.loads(message)
                if call != "wait":
                    getattr(file, call)(*words)
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
