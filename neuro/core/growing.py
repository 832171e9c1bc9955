"""HDF5 files that grow while they can be read: what is on the disk is whole, and that of the last `commit`.

HDF5 changes its tables in place, so a file whose process is killed can be unreadable, and on a full disk HDF5 brings
the process down. So it writes into `JournaledFile` instead. New bytes go behind all that was committed, where no table
leads to them yet; changes of older bytes are held back, in pages. A commit writes these pages behind the end, then a
mark that they are whole, then puts each in its place, and cuts the end off. A reader that finds the mark reads the
pages from there, so a kill at any moment leaves the state before a commit or after it. The front of the file, with its
digest, is on the first page, so it is always of the same commit as the rest; see `neuro.core.hdf5`.
"""

from __future__ import annotations

import errno
import fcntl
import io
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from neuro.core.hdf5 import BLOCK, FRONT, Front, damaged, not_ours, update

PAGE = 4096
_MARK = struct.Struct("<8sQQI")  # word, where the pages begin, their length, their checksum
_WORD = b"neuro\0\r\n"
_HEAD = struct.Struct("<QI")  # of a page: where it belongs, its length


class _Paged(io.RawIOBase):
    """A file that is read with pages put over it."""

    def __init__(self, disk: int) -> None:
        super().__init__()
        self._disk = disk
        self._at = self._size = 0
        self._pages: Mapping[int, bytes | bytearray] = {}

    def readable(self) -> bool:
        """It can be read."""
        return True

    def seekable(self) -> bool:
        """It can."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        """The present place."""
        return self._at

    def readinto(self, buffer: Any) -> int:
        """Read, with the pages in their places."""
        view = memoryview(buffer).cast("B")
        found = self.at(self._at, view.nbytes)
        view[: len(found)] = found
        self._at += len(found)
        return len(found)

    def at(self, place: int, n: int) -> bytes | bytearray:
        """Bytes at a place, with the pages in theirs; fewer at the end."""
        found = _read(self._disk, place, max(0, min(n, self._size - place)))
        if not self._pages:
            return found
        patched = bytearray(found)
        _patch(memoryview(patched), place, self._pages)
        return patched


class JournaledFile(_Paged):
    """A file for `h5py.File(..., "w", userblock_size=FRONT)` that is whole on the disk after each commit.

    Args:
        path: of the file, which is emptied; no other process may write it until it is closed.
        format: of the file, e.g. "neuro results 3".

    Attributes:
        error: of the first failure; what comes after it stays in memory and is never committed.

    Raises:
        BlockingIOError: another process writes it.
        OSError: it cannot be written.
    """

    def __init__(self, path: Path, format: str) -> None:
        disk = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(disk, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(disk)
            raise
        super().__init__(disk)
        self._path, self._format, self._sums = path, format, bytearray()
        self._committed = 0
        self._pages: dict[int, bytearray] = {}
        self.error: OSError | None = None
        try:
            os.ftruncate(disk, 0)
            # Of a process that is killed before the first commit: the next one knows the file, and may replace it.
            _write(disk, 0, memoryview(Front(format, 0, "").written()))
        except OSError:
            self.close()
            raise

    def writable(self) -> bool:
        """It can."""
        return True

    def write(self, data: Any) -> int:
        """Write all of it, or keep the first failure."""
        view = memoryview(data).cast("B")
        old = min(view.nbytes, max(0, self._committed - self._at))
        if self.error is None:
            try:
                _write(self._disk, self._at + old, view[old:])
            except OSError as error:
                self.error = error
        # HDF5 reads back what it wrote, also what did not reach the disk: a wrong table ends in other errors.
        self._hold(view[:old] if self.error is None else view, self._at)
        self._at += view.nbytes
        self._size = max(self._size, self._at)
        return view.nbytes

    def truncate(self, size: int | None = None) -> int:
        """Make it as long; the disk follows at a commit."""
        self._size = self._at if size is None else size
        return self._size

    def _hold(self, data: memoryview, at: int) -> None:
        """Keep a change of what is committed, or after a failure any change."""
        while data.nbytes:
            number, begin = divmod(at, PAGE)
            n, first, page = min(data.nbytes, PAGE - begin), number * PAGE, self._pages.setdefault(number, bytearray())
            if len(page) < begin + n:
                size = min(PAGE, self._committed - first) if self.error is None else PAGE
                page += _read(self._disk, first + len(page), size - len(page))
            page[begin : begin + n] = data[:n]
            data, at = data[n:], at + n

    def flush(self) -> None:
        """Nothing is to be done before a commit."""

    def commit(self) -> None:
        """Let all that was written be what a reader sees; HDF5 has been flushed before.

        Raises:
            OSError: something could not be written, or the file is there no longer; what was committed before stays.
        """
        if self.error is None:
            try:
                self._commit()
            except OSError as error:
                self.error = error
        if self.error is not None:
            raise self.error

    def _commit(self) -> None:
        if os.fstat(self._disk).st_nlink == 0:
            raise FileNotFoundError(errno.ENOENT, "it was removed", str(self._path))
        if not self._committed:
            os.ftruncate(self._disk, self._size)
        self._seal()
        if self._pages:
            end = max(self._committed, self._size)  # a file that becomes shorter keeps its end until the mark is there
            pages = b"".join(_HEAD.pack(n * PAGE, len(page)) + page for n, page in sorted(self._pages.items()))
            mark = _MARK.pack(_WORD, end, len(pages), zlib.crc32(pages))
            _write(self._disk, end, memoryview(pages))
            _write(self._disk, end + len(pages), memoryview(mark))
            for number, page in self._pages.items():
                _write(self._disk, number * PAGE, memoryview(page))
        os.ftruncate(self._disk, self._size)
        self._pages, self._committed = {}, self._size

    def _seal(self) -> None:
        """Write the front of what is to be committed."""
        changed = {number * PAGE // BLOCK for number in self._pages}
        changed.update(range(min(self._committed, self._size) // BLOCK, -(-self._size // BLOCK)))
        update(self._sums, sorted(k for k in changed if k * BLOCK < self._size), self.at, self._size)
        front = memoryview(Front.over(self._format, self._size, bytes(self._sums)).written())
        if self._committed:
            self._hold(front, 0)
        else:
            _write(self._disk, 0, front)

    def close(self) -> None:
        """Close the file; what was not committed is lost, and a file without a commit is removed."""
        if not self.closed:
            if not self._committed and os.fstat(self._disk).st_nlink:
                with suppress(OSError):
                    self._path.unlink()
            os.close(self._disk)
        super().close()


class JournalReader:
    """A file of ours to read, of `JournaledFile` or any other; where another takes its name it stays this one.

    Args:
        path: of the file.
        what: it is to be, for messages, e.g. "a file of results".
        formats: that it may have.

    Raises:
        ModelError: it is something else.
        OSError: it cannot be read.
    """

    def __init__(self, path: Path, what: str, *formats: str) -> None:
        self._disk = os.open(path, os.O_RDONLY)
        self._path, self._what, self._formats = path, what, formats
        self._whole = b""

    def __del__(self) -> None:
        if hasattr(self, "_disk"):
            os.close(self._disk)

    @contextmanager
    def reading(self) -> Iterator[Any]:
        """What is in it as of the last commit.

        Raises:
            ModelError: it is something else, or damaged.
            OSError: it cannot be read.
        """
        import h5py

        with self._checked() as disk, h5py.File(disk, "r") as file:
            yield file

    def _checked(self) -> _Committed:
        """The file after its check; a run may commit meanwhile, then it is checked once more."""
        before = None
        while True:
            disk = _Committed(self._disk)
            front = disk.front
            if front is None or front.format not in self._formats:
                raise not_ours(self._path, self._what)
            if front.written() == self._whole or front.fits(disk.at):
                self._whole = front.written()
                return disk
            status = os.fstat(self._disk)
            now = status.st_size, status.st_mtime_ns
            if now == before:
                raise damaged(self._path, front)
            before = now


class _Committed(_Paged):
    """A file to read; where its last commit was cut short, with the pages that were to be put in their places."""

    def __init__(self, disk: int) -> None:
        super().__init__(disk)
        self._pages, self._size = _held_pages(disk)
        self.front = Front.of(bytes(self.at(0, FRONT)))
        if self.front is not None:
            self._size = min(self._size, self.front.size)


def _held_pages(disk: int) -> tuple[dict[int, bytes], int]:
    """The pages of a commit that was cut short, by number, and where they begin; else none, and the end of the file."""
    end = os.fstat(disk).st_size
    tail = os.pread(disk, _MARK.size, max(0, end - _MARK.size))
    if len(tail) < _MARK.size or not tail.startswith(_WORD):
        return {}, end
    _, begin, length, checksum = _MARK.unpack(tail)
    if begin + length > end:
        return {}, end
    data = _read(disk, begin, length)
    if zlib.crc32(data) != checksum:
        return {}, end
    pages, at = {}, 0
    while at < length:
        place, n = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        pages[place // PAGE] = data[at : at + n]
        at += n
    return pages, begin


def _patch(view: memoryview, at: int, pages: Any) -> None:
    """Put pages over what was read from place `at` on."""
    if not pages or not view.nbytes:
        return
    for number in range(at // PAGE, (at + view.nbytes - 1) // PAGE + 1):
        page = pages.get(number)
        if page is not None:
            begin, end = max(at, number * PAGE), min(at + view.nbytes, number * PAGE + len(page))
            if begin < end:
                view[begin - at : end - at] = page[begin - number * PAGE : end - number * PAGE]


def _read(disk: int, at: int, n: int) -> bytes:
    """Bytes of a file; behind its end zeros."""
    parts, left = [], n
    while left:
        part = os.pread(disk, left, at + n - left)
        if not part:
            break
        parts.append(part)
        left -= len(part)
    return b"".join(parts) + bytes(left)


def _write(disk: int, at: int, data: memoryview) -> None:
    while data.nbytes:
        n = os.pwrite(disk, data, at)
        data, at = data[n:], at + n
