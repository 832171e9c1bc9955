"""HDF5 files that grow and can be read at any time: the disk always holds the state of the last `commit`.

HDF5 changes its tables in place, so a file whose process is killed can be unreadable, and on a full disk HDF5 ends the
process. `JournaledFile` stands between HDF5 and the disk. New bytes are written behind all committed bytes, where no
table refers to them yet; changes of older bytes are kept in memory, as pages. A commit writes the pages behind the end
of the file and then a mark that all pages are complete. After the mark the commit copies each page to its place and
truncates the file. A reader that finds the mark uses the pages behind the end, so a kill at any moment leaves the
state before or after a commit. The first page holds the front of the file with its digest, so front and content belong
to the same commit; see `neuro.core.hdf5`.
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
_MARK = struct.Struct("<8sQQI")  # word, offset, length and checksum of the pages
_WORD = b"neuro\0\r\n"
_HEAD = struct.Struct("<QI")  # header of a page: offset in the file, length


class _Paged(io.RawIOBase):
    """A file with pages that replace parts of the content."""

    def __init__(self, disk: int) -> None:
        super().__init__()
        self._disk = disk
        self._at = self._size = 0
        self._pages: Mapping[int, bytes | bytearray] = {}

    def readable(self) -> bool:
        """Return True: the file can be read."""
        return True

    def seekable(self) -> bool:
        """Return True: the file has positions."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Set the position."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        """Return the position."""
        return self._at

    def readinto(self, buffer: Any) -> int:
        """Read bytes, with the pages applied."""
        view = memoryview(buffer).cast("B")
        data = self.at(self._at, view.nbytes)
        view[: len(data)] = data
        self._at += len(data)
        return len(data)

    def at(self, offset: int, n: int) -> bytes | bytearray:
        """Return the bytes at an offset, with the pages applied; fewer bytes at the end of the file."""
        data = _read(self._disk, offset, max(0, min(n, self._size - offset)))
        if not self._pages:
            return data
        patched, end = bytearray(data), offset + len(data)
        for number in range(offset // PAGE, -(-end // PAGE)):
            start, page = number * PAGE, self._pages.get(number, b"")
            first, last = max(offset, start), min(end, start + len(page))
            if first < last:
                patched[first - offset : last - offset] = page[first - start : last - start]
        return patched


class JournaledFile(_Paged):
    """A file for `h5py.File(..., "w", userblock_size=FRONT)` that is complete on the disk after each commit.

    Args:
        path: path of the file, which is emptied. No other process can write the file until it is closed.
        format: format of the file, e.g. "neuro results 3".

    Attributes:
        error: error of the first failure. Later changes stay in memory and are never committed.

    Raises:
        BlockingIOError: another process writes the file.
        OSError: the file cannot be written.
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
            # If the process is killed before the first commit, the next process recognises the file and may replace it.
            _write(disk, 0, memoryview(Front(format, 0, "").written()))
        except OSError:
            self.close()
            raise

    def writable(self) -> bool:
        """Return True: the file can be written."""
        return True

    def write(self, data: Any) -> int:
        """Write all data, or store the first failure."""
        view = memoryview(data).cast("B")
        n_committed = min(view.nbytes, max(0, self._committed - self._at))
        if self.error is None:
            try:
                _write(self._disk, self._at + n_committed, view[n_committed:])
            except OSError as error:
                self.error = error
        # HDF5 reads its own data back, also data that did not reach the disk: a wrong table would cause other errors.
        self._hold(view[:n_committed] if self.error is None else view, self._at)
        self._at += view.nbytes
        self._size = max(self._size, self._at)
        return view.nbytes

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file. The length on the disk changes at a commit."""
        self._size = self._at if size is None else size
        return self._size

    def _hold(self, data: memoryview, offset: int) -> None:
        """Store changes of committed data, or after a failure all changes."""
        while data.nbytes:
            number, begin = divmod(offset, PAGE)
            n, start, page = min(data.nbytes, PAGE - begin), number * PAGE, self._pages.setdefault(number, bytearray())
            if len(page) < begin + n:
                size = min(PAGE, self._committed - start) if self.error is None else PAGE
                page += _read(self._disk, start + len(page), size - len(page))
            page[begin : begin + n] = data[:n]
            data, offset = data[n:], offset + n

    def flush(self) -> None:
        """Do nothing: data are written at a commit."""

    def commit(self) -> None:
        """Make all written data visible to readers. HDF5 must be flushed before.

        Raises:
            OSError: data could not be written, or the file was removed. Data of earlier commits stay.
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
            # A file that becomes shorter keeps its end until the mark is written.
            end = max(self._committed, self._size)
            pages = b"".join(_HEAD.pack(n * PAGE, len(page)) + page for n, page in sorted(self._pages.items()))
            mark = _MARK.pack(_WORD, end, len(pages), zlib.crc32(pages))
            _write(self._disk, end, memoryview(pages))
            _write(self._disk, end + len(pages), memoryview(mark))
            for number, page in self._pages.items():
                _write(self._disk, number * PAGE, memoryview(page))
        os.ftruncate(self._disk, self._size)
        self._pages, self._committed = {}, self._size

    def _seal(self) -> None:
        """Write the front of the next commit."""
        changed = {number * PAGE // BLOCK for number in self._pages}
        changed.update(range(min(self._committed, self._size) // BLOCK, -(-self._size // BLOCK)))
        update(self._sums, sorted(k for k in changed if k * BLOCK < self._size), self.at, self._size)
        front = memoryview(Front.over(self._format, self._size, bytes(self._sums)).written())
        if self._committed:
            self._hold(front, 0)
        else:
            _write(self._disk, 0, front)

    def close(self) -> None:
        """Close the file. Uncommitted data are lost, and a file without a commit is removed."""
        if not self.closed:
            if not self._committed and os.fstat(self._disk).st_nlink:
                with suppress(OSError):
                    self._path.unlink()
            os.close(self._disk)
        super().close()


class JournalReader:
    """A reader of a file in this package's format; the open file stays valid if another file takes the name.

    Args:
        path: path of the file.
        what: noun for messages, e.g. "a file of results".
        formats: accepted formats.

    Raises:
        ModelError: the file has another format.
        OSError: the file cannot be read.
    """

    def __init__(self, path: Path, what: str, *formats: str) -> None:
        self._disk = os.open(path, os.O_RDONLY)
        self._path, self._what, self._formats = path, what, formats
        self._checked_front = b""

    def __del__(self) -> None:
        if hasattr(self, "_disk"):
            os.close(self._disk)

    @contextmanager
    def reading(self) -> Iterator[Any]:
        """Open the content of the last commit.

        Raises:
            ModelError: the file has another format, or is damaged.
            OSError: the file cannot be read.
        """
        import h5py

        with self._checked() as disk, h5py.File(disk, "r") as file:
            yield file

    def _checked(self) -> _Committed:
        """Return the file after a check. If a run commits during the check, the check is repeated."""
        previous = None
        while True:
            disk = _Committed(self._disk)
            front = disk.front
            if front is None or front.format not in self._formats:
                raise not_ours(self._path, self._what)
            if front.written() == self._checked_front or front.fits(disk.at):
                self._checked_front = front.written()
                return disk
            status = os.fstat(self._disk)
            state = status.st_size, status.st_mtime_ns
            if state == previous:
                raise damaged(self._path, front)
            previous = state


class _Committed(_Paged):
    """A file opened for reading; if its last commit was interrupted, the pages of that commit are applied."""

    def __init__(self, disk: int) -> None:
        super().__init__(disk)
        self._pages, self._size = _held_pages(disk)
        self.front = Front.of(bytes(self.at(0, FRONT)))
        if self.front is not None:
            self._size = min(self._size, self.front.size)


def _held_pages(disk: int) -> tuple[dict[int, bytes], int]:
    """Return the pages of an interrupted commit by number, and their offset; {} and the end of the file if none."""
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
    pages, position = {}, 0
    while position < length:
        offset, n = _HEAD.unpack_from(data, position)
        position += _HEAD.size
        pages[offset // PAGE] = data[position : position + n]
        position += n
    return pages, begin


def _read(disk: int, at: int, n: int) -> bytes:
    """Return bytes of a file; zeros behind its end."""
    parts, remaining = [], n
    while remaining:
        part = os.pread(disk, remaining, at + n - remaining)
        if not part:
            break
        parts.append(part)
        remaining -= len(part)
    return b"".join(parts) + bytes(remaining)


def _write(disk: int, offset: int, data: memoryview) -> None:
    while data.nbytes:
        n = os.pwrite(disk, data, offset)
        data, offset = data[n:], offset + n
