"""Where the bytes of a file come from: a path (mapped, not read), bytes, a pipe, or an open file as standard input."""

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

Given = str | os.PathLike[str] | bytes | bytearray | memoryview | BinaryIO
Bytes = npt.NDArray[np.uint8]
WHOLE = 1 << 62
"""A block that holds any file."""


class Source:
    """The bytes of one file.

    Args:
        given: a path, bytes, or an open binary file, which is read from where it stands.
        name: what to call it; the path or the file's own name if not given.

    Attributes:
        name: for messages and the ending.
        path: where it lies on the disk, None for bytes, open files and pipes.

    Raises:
        OSError: the path cannot be opened.
    """

    def __init__(self, given: Given, name: str | None = None) -> None:
        self.path: Path | None = None
        self._file: BinaryIO | None = None
        self._pipe: BinaryIO | None = None
        self._bytes: Bytes = np.zeros(0, np.uint8)
        self._head = b""
        if isinstance(given, bytes | bytearray | memoryview):
            self.name = name or "<bytes>"
            self._bytes = np.frombuffer(given, np.uint8)
        elif isinstance(given, str | os.PathLike):
            self.name = name or os.fspath(given)
            path = Path(given)
            if path.is_file() or not path.exists():
                self.path, self._bytes = path, _mapped(path)
            else:
                self._file = self._pipe = path.open("rb")
        else:
            own = getattr(given, "name", None)
            self.name = name or (own if isinstance(own, str) else "<file>")
            self._file = given

    def __enter__(self) -> Source:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        """Close it; an error about what it holds, which is a `ValueError`, keeps nothing of it."""
        if isinstance(error, ValueError):
            let_go(error)
        self.close()

    def close(self) -> None:
        """Let go of the bytes, so that a mapped file is open no more; what was given open stays open."""
        if self._pipe is not None:
            self._pipe.close()
        self._bytes, self._head, self._file, self._pipe = np.zeros(0, np.uint8), b"", None, None

    @property
    def size(self) -> int | None:
        """Number of bytes, None where it is not known before the end."""
        return None if self._file is not None else self._bytes.size

    def head(self, count: int) -> bytes:
        """The first bytes, as many as there are; they are not used up."""
        if self._file is None:
            return self._bytes[:count].tobytes()
        while len(self._head) < count and (more := self._file.read(count - len(self._head))):
            self._head += more
        return self._head[:count]

    def all(self) -> Bytes:
        """All bytes; those of a path are mapped."""
        if self._file is not None:
            self._bytes = np.frombuffer(self._head + self._file.read(), np.uint8)
            self._file = None
        return self._bytes

    def blocks(self, start: int, size: int, unit: int = 1) -> Iterator[tuple[int, Bytes]]:
        """The bytes from `start` on in blocks, each with its place.

        Args:
            start: first byte.
            size: bytes of a block; rounded up to a multiple of `unit`.
            unit: bytes of a word; only the last block may end within one.
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
        rest, at = self._read(self._head[start:], size), start
        while rest:
            yield at, np.frombuffer(rest[:size], np.uint8)
            at += min(size, len(rest))
            rest = self._read(rest[size:], size)

    def samples(self, start: int, step: int, size: int) -> Iterator[tuple[int, Bytes]]:
        """Some bytes at equal distances, each with their place, of a file whose size is known.

        Args:
            start: first byte.
            step: bytes from one to the next.
            size: how many, up to `step`; at the end of the file fewer.
        """
        with ExitStack() as stack:
            file = stack.enter_context(self.path.open("rb", buffering=0)) if self.path is not None else None
            for at in range(start, self._bytes.size, step):
                if file is None:
                    yield at, self._bytes[at : at + size]
                else:
                    yield at, np.frombuffer(os.pread(file.fileno(), size, at), np.uint8)

    def _read_blocks(self, start: int, size: int) -> Iterator[tuple[int, Bytes]]:
        """The bytes of a path, read and not mapped: mapped pages would count as memory until the end."""
        assert self.path is not None
        with self.path.open("rb") as file:
            file.seek(start)
            at = start
            while (block := np.fromfile(file, np.uint8, size)).size:
                yield at, block
                at += block.size

    def _read(self, begun: bytes, size: int) -> bytes:
        """Read on until there are `size` bytes, or the end."""
        assert self._file is not None
        while len(begun) < size and (more := self._file.read(size - len(begun))):
            begun += more
        return begun


def step(size: int, unit: int) -> int:
    """Bytes of the blocks in which a file is read: a multiple of a word, at least one."""
    return max(unit, -(-size // unit) * unit)


def _mapped(path: Path) -> Bytes:
    """The bytes of a file in the page cache; an empty one cannot be mapped."""
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_size == 0:
            return np.zeros(0, np.uint8)
        return np.frombuffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), np.uint8)


def opened_source(source: Given, name: str | None) -> Source:
    """The bytes of a file.

    Raises:
        EventFileError: there is no such file.
        ModelError: `source` is neither a path, nor bytes, nor an open binary file.
    """
    check_given(source)
    try:
        return Source(source, name)
    except FileNotFoundError:
        path = os.fspath(source)  # type: ignore[arg-type]
        raise EventFileError(path, "no such file", hint=_beside(path)) from None
    except IsADirectoryError:
        raise EventFileError(os.fspath(source), "is a folder, expected a file") from None  # type: ignore[arg-type]
    except OSError as error:
        raise EventFileError(os.fspath(source), f"cannot read: {error.strerror}") from None  # type: ignore[arg-type]


def _beside(path: str) -> str:
    """A hint at the file of the nearest name in its folder, "" if none is near."""
    folder, name = os.path.split(path)
    try:
        found = difflib.get_close_matches(name, os.listdir(folder or "."), n=1, cutoff=0.8)
    except OSError:
        return ""
    return f"did you mean '{found[0]}'?" if found else ""


def check_given(source: object) -> None:
    """Refuse what cannot be a file.

    Raises:
        ModelError: it is neither a path that a file can have, nor bytes, nor an open binary file.
    """
    if isinstance(source, io.TextIOBase):
        hint = "open it as binary: open(path, 'rb')"
        raise ModelError(f"source is an open text file, {type(source).__name__}, expected a binary one", hint=hint)
    if isinstance(source, str | os.PathLike):
        file_path(source, "source")
    elif not isinstance(source, bytes | bytearray | memoryview) and not callable(getattr(source, "read", None)):
        what = "expected a path, the bytes of a file, or an open binary file"
        raise ModelError(f"source is {source!r:.60}, {what}")


class EventFileWarning(UserWarning):
    """A damaged event file was read as far as it is whole, or some of its events were left out."""


class EventFileError(ModelError):
    """An event file is damaged, unknown, missing, or cannot hold what should be saved.

    The message reads ``PATH: byte OFFSET: what is wrong, and what was expected``.

    Attributes:
        path: the file, as the user named it; ``<bytes>`` for data without a name.
        what: the message without the place.
        offset: the byte at which the fault was seen; None where no byte is to blame.
    """

    path: str  # type: ignore[assignment]  # of the file, not of words inside a part of a network

    def __init__(self, path: str, what: str, offset: int | None = None, hint: str = "") -> None:
        place = path if offset is None else f"{path}: byte {offset}"
        super().__init__(f"{place}: {what}", hint=hint)
        self.path = path
        self.what = what
        self.offset = offset

    def at(self, where: Where | None, context: str = "") -> EventFileError:
        """The same error: its file is the place."""
        return self

    def __reduce__(self) -> tuple[type[EventFileError], tuple[str, str, int | None, str]]:
        return (EventFileError, (self.path, self.what, self.offset, self.hint))


def let_go(error: BaseException) -> None:
    """Clear the frames of an error, and of those behind it: a kept error would keep mapped and open files."""
    behind: BaseException | None = error
    while behind is not None:
        traceback.clear_frames(behind.__traceback__)
        behind = behind.__context__


def with_notes(error: EventFileError, cause: BaseException) -> EventFileError:
    """Return an error with the notes of the one that it stands for."""
    for note in getattr(cause, "__notes__", ()):
        error.add_note(note)
    return error
