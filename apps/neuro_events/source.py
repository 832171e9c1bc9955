"""Sources of a file's bytes: a path (memory-mapped), bytes, a pipe, or an open file such as standard input."""

from __future__ import annotations

import difflib
import io
import mmap
import os
import traceback
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Where, file_path

FileInput = str | os.PathLike[str] | bytes | bytearray | memoryview | BinaryIO
Bytes = npt.NDArray[np.uint8]
WHOLE = 1 << 62
"""Block size that exceeds any file, so that a file is read as one block."""


class Source:
    """The bytes of one file.

    Args:
        file: a path, bytes, or an open binary file, which is read from its current position.
        name: name for messages. Default: the path, or the file's own name.

    Attributes:
        name: name in messages; its ending may decide the format.
        path: path on disk, None for bytes, open files and pipes.

    Raises:
        OSError: the path cannot be opened.
    """

    def __init__(self, file: FileInput, name: str | None = None) -> None:
        self.path: Path | None = None
        self._file: BinaryIO | None = None
        self._pipe: BinaryIO | None = None
        self._bytes: Bytes = np.zeros(0, np.uint8)
        self._head = b""
        if isinstance(file, bytes | bytearray | memoryview):
            self.name = name or "<bytes>"
            self._bytes = np.frombuffer(file, np.uint8)
        elif isinstance(file, str | os.PathLike):
            self.name = name or os.fspath(file)
            path = Path(file)
            if path.is_file() or not path.exists():
                self.path, self._bytes = path, _mapped(path)
            else:
                self._file = self._pipe = path.open("rb")
        else:
            own_name = getattr(file, "name", None)
            self.name = name or (own_name if isinstance(own_name, str) else "<file>")
            self._file = file

    def __enter__(self) -> Source:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        """Close the source. The frames of a `ValueError` are cleared, so that a stored error keeps no file open."""
        if isinstance(error, ValueError):
            clear_frames(error)
        self.close()

    def close(self) -> None:
        """Release the bytes and close a mapped file. A file that the caller opened stays open."""
        if self._pipe is not None:
            self._pipe.close()
        self._bytes, self._head, self._file, self._pipe = np.zeros(0, np.uint8), b"", None, None

    @property
    def size(self) -> int | None:
        """Number of bytes, or None if the size is unknown until the end is read."""
        return None if self._file is not None else self._bytes.size

    def head(self, count: int) -> bytes:
        """Return up to `count` bytes from the beginning without consuming them."""
        if self._file is None:
            return self._bytes[:count].tobytes()
        while len(self._head) < count and (chunk := self._file.read(count - len(self._head))):
            self._head += chunk
        return self._head[:count]

    def all(self) -> Bytes:
        """Return all bytes, memory-mapped if the source is a path."""
        if self._file is not None:
            self._bytes = np.frombuffer(self._head + self._file.read(), np.uint8)
            self._file = None
        return self._bytes

    def blocks(self, start: int, size: int, unit: int = 1) -> Iterator[tuple[int, Bytes]]:
        """Yield the bytes from `start` on in blocks, each with its offset.

        Args:
            start: offset of the first byte.
            size: bytes per block, rounded up to a multiple of `unit`.
            unit: bytes per word. Only the last block may end within a word.
        """
        size = step(size, unit)
        if self.path is not None and size < self._bytes.size:
            yield from self._read_blocks(start, size)
            return
        if self._file is None:
            for at in range(start, self._bytes.size, size):
                yield at, self._bytes[at : at + size]
            return
        if size >= WHOLE:
            yield start, self.all()[start:]
            return
        self.head(start)
        unread, at = self._read(self._head[start:], size), start
        while unread:
            yield at, np.frombuffer(unread[:size], np.uint8)
            at += min(size, len(unread))
            unread = self._read(unread[size:], size)

    def samples(self, start: int, step: int, size: int) -> Iterator[tuple[int, Bytes]]:
        """Yield samples of the bytes at equal distances, each with its offset. The size of the file must be known.

        Args:
            start: offset of the first sample.
            step: distance between samples, bytes.
            size: bytes per sample, at most `step`. The sample at the end of the file may be shorter.
        """
        with ExitStack() as stack:
            file = stack.enter_context(self.path.open("rb", buffering=0)) if self.path is not None else None
            for at in range(start, self._bytes.size, step):
                if file is None:
                    yield at, self._bytes[at : at + size]
                else:
                    yield at, np.frombuffer(os.pread(file.fileno(), size, at), np.uint8)

    def _read_blocks(self, start: int, size: int) -> Iterator[tuple[int, Bytes]]:
        """Yield the bytes of a path in blocks by reading, since mapped pages would count as memory until the end."""
        assert self.path is not None
        with self.path.open("rb") as file:
            file.seek(start)
            at = start
            while (block := np.fromfile(file, np.uint8, size)).size:
                yield at, block
                at += block.size

    def _read(self, data: bytes, size: int) -> bytes:
        """Extend `data` to `size` bytes, or to the end of the file."""
        assert self._file is not None
        while len(data) < size and (chunk := self._file.read(size - len(data))):
            data += chunk
        return data


def step(size: int, unit: int) -> int:
    """Return the block size in bytes: `size` rounded up to a multiple of a word, at least one word."""
    return max(unit, -(-size // unit) * unit)


def _mapped(path: Path) -> Bytes:
    """Map a file into memory. An empty file cannot be mapped."""
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_size == 0:
            return np.zeros(0, np.uint8)
        return np.frombuffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), np.uint8)


def opened_source(source: FileInput, name: str | None) -> Source:
    """Open a source of bytes.

    Raises:
        EventFileError: no such file, or the file cannot be read.
        ModelError: `source` is neither a path, nor bytes, nor an open binary file.
    """
    check_input(source)
    try:
        return Source(source, name)
    except FileNotFoundError:
        path = os.fspath(source)  # type: ignore[arg-type]
        raise EventFileError(path, "no such file", hint=_similar_name_hint(path)) from None
    except IsADirectoryError:
        raise EventFileError(os.fspath(source), "is a folder, expected a file") from None  # type: ignore[arg-type]
    except OSError as error:
        raise EventFileError(os.fspath(source), f"cannot read: {error.strerror}") from None  # type: ignore[arg-type]


def _similar_name_hint(path: str) -> str:
    """Return a hint that names the file with the most similar name in the folder, or "" if no name is similar."""
    folder, name = os.path.split(path)
    try:
        matches = difflib.get_close_matches(name, os.listdir(folder or "."), n=1, cutoff=0.8)
    except OSError:
        return ""
    return f"did you mean '{matches[0]}'?" if matches else ""


def check_input(source: object) -> None:
    """Check that an argument can be a file.

    Raises:
        ModelError: the argument is neither a valid path, nor bytes, nor an open binary file.
    """
    if isinstance(source, io.TextIOBase):
        hint = "open it as binary: open(path, 'rb')"
        raise ModelError(f"source is an open text file, {type(source).__name__}, expected a binary one", hint=hint)
    if isinstance(source, str | os.PathLike):
        file_path(source, "source")
    elif not isinstance(source, bytes | bytearray | memoryview) and not callable(getattr(source, "read", None)):
        expected = "expected a path, the bytes of a file, or an open binary file"
        raise ModelError(f"source is {source!r:.60}, {expected}")


class EventFileWarning(UserWarning):
    """Warning that a damaged event file was read only in part, or that events were dropped."""


class EventFileError(ModelError):
    """Error about an event file that is damaged, missing or of an unknown format, or that cannot store an event.

    The message reads ``PATH: byte OFFSET: what was found, and what was expected``.

    Attributes:
        path: the file as the user named it, or ``<bytes>`` for data without a name.
        what: the message without the path and the offset.
        offset: offset of the fault in bytes, None if no single byte is at fault.
    """

    path: str  # type: ignore[assignment]  # the path of a file, while `ModelError.path` is a position in a network file

    def __init__(self, path: str, what: str, offset: int | None = None, hint: str = "") -> None:
        place = path if offset is None else f"{path}: byte {offset}"
        super().__init__(f"{place}: {what}", hint=hint)
        self.path = path
        self.what = what
        self.offset = offset

    def at(self, where: Where | None, context: str = "") -> EventFileError:
        """Return the error unchanged, because its message already names the file."""
        return self

    def __reduce__(self) -> tuple[type[EventFileError], tuple[str, str, int | None, str]]:
        return (EventFileError, (self.path, self.what, self.offset, self.hint))


def clear_frames(error: BaseException) -> None:
    """Clear the frames of an error and of the errors in its context.

    A stored error would otherwise keep mapped and open files alive through the variables of its frames.
    """
    chained: BaseException | None = error
    while chained is not None:
        traceback.clear_frames(chained.__traceback__)
        chained = chained.__context__


def with_notes(error: EventFileError, original: BaseException) -> EventFileError:
    """Copy the notes of the original error to the error that replaces it."""
    for note in getattr(original, "__notes__", ()):
        error.add_note(note)
    return error
