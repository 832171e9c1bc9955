"""A process that writes a file of results, so that a run in real time waits for no disk.

`python -m neuro.run.writer_process SOCKET FILE` does what it is sent, one call of a `ResultsFile` after the other.
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
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.outputs import Unwritable
from neuro.files.results import Results, read, recorded_in
from neuro.run.results_file import Arrays, ResultsFile

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
                [sys.executable, "-P", "-m", "neuro.run.writer_process", str(there.fileno()), str(part)],
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
