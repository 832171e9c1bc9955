"""HDF5 files with a format and a digest at their front, which is checked before HDF5 reads the content.

HDF5 does not check what it reads: a wrong bit changes numbers silently, or ends the process. So a file begins with a
user block, which HDF5 ignores, of 512 bytes of text:

```
neuro HDF5 1
FORMAT
LENGTH of the file in bytes
DIGEST
```

The content behind the front has a CRC-32 per 64 KiB. The digest is the BLAKE2b hash of the lines FORMAT and LENGTH and
of these checksums. CRC-32 runs at 4 GB/s, so that opening a file takes little longer than reading it. CRC-32 detects
every change within 32 adjacent bits. Of other changes CRC-32 misses one in 2^32. The list of checksums detects
truncation and blocks that changed places. A commit to a file that grows (`neuro.core.growing`) reads only the blocks
that the commit changes.

A write must not fail inside HDF5: an object that could not be written cannot be closed, and the second attempt to close
it ends the process with a segmentation fault. So every file is written through a Python file that records the first
failure and reports it afterwards (`disk`, and `neuro.core.growing`). HDF5 closes open files when the process exits.
Python has ended by then, but HDF5 would call the methods of the Python files. So `_close_python_files` closes the files
before Python ends.
"""

from __future__ import annotations

import atexit
import hashlib
import io
import json
import os
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from neuro.core.errors import ModelError
from neuro.core.inputs import existing
from neuro.core.outputs import Kind, output
from neuro.core.provenance import ATTRIBUTE

if TYPE_CHECKING:
    import numpy.typing as npt


__all__ = [
    "check",
    "check_tree",
    "disk",
    "has_format",
    "is_hdf5",
    "is_whole",
    "kind",
    "new_file",
    "put",
    "reading",
    "seal",
    "take",
    "writing",
]

FRONT = 512
"""Length of the front in bytes."""
BLOCK = 1 << 16
"""Length of a block with one checksum in bytes."""
WORD = b"neuro HDF5 1\n"
"""First bytes of a file of this package."""

MAGIC = b"\x89HDF\r\n\x1a\n"
"""First bytes of other HDF5 files."""

Read = Callable[[int, int], Any]
"""Function of an offset and a number of bytes that returns the bytes; fewer at the end of a file."""


class Front(NamedTuple):
    """Front of a file.

    Attributes:
        format: format of the file.
        size: length of the file in bytes.
        digest: digest of the file, see the module.
    """

    format: str
    size: int
    digest: str

    @classmethod
    def of(cls, head: bytes) -> Front | None:
        """Parse the front of a file; None without the front of this package."""
        if not head.startswith(WORD):
            return None
        format, size, digest, *_ = [*head[len(WORD) : FRONT].decode("utf-8", "replace").split("\n"), "", "", ""]
        return cls(format, int(size) if size.isdecimal() else 0, digest)

    @classmethod
    def over(cls, format: str, size: int, sums: bytes) -> Front:
        """Return the front for a file of `size` bytes; `sums` has the checksums of the file's blocks."""
        head = f"{format}\n{size}\n".encode()
        return cls(format, size, hashlib.blake2b(head + sums, digest_size=16).hexdigest())

    def written(self) -> bytes:
        """Return the front as bytes."""
        return (WORD + f"{self.format}\n{self.size}\n{self.digest}\n".encode()).ljust(FRONT, b"\0")

    def fits(self, read: Read) -> bool:
        """Return True if a file has the length and the digest of this front."""
        return self.size > FRONT and self == Front.over(self.format, self.size, _sums(read, self.size))


def _sums(read: Read, size: int) -> bytes:
    sums = bytearray()
    if len(read(size - 1, 1)) == 1:
        update(sums, range(-(-size // BLOCK)), read, size)
    return bytes(sums)


def update(sums: bytearray, blocks: Iterable[int], read: Read, size: int) -> None:
    """Compute the checksums of some blocks of a file again."""
    del sums[4 * -(-size // BLOCK) :]
    for k in blocks:
        begin = max(FRONT, k * BLOCK)
        sums[4 * k : 4 * k + 4] = zlib.crc32(read(begin, min((k + 1) * BLOCK, size) - begin)).to_bytes(4, "little")


def is_hdf5(head: bytes) -> bool:
    """Return True if the first bytes are those of an HDF5 file, with or without a front."""
    return head.startswith((WORD, MAGIC))


def kind(format: str, what: str = "") -> Kind:
    """Return the kind of output file for a format. Only a file of the same format may be replaced by a new file.

    Args:
        format: format of the file, e.g. "neuro drone model 1".
        what: noun for messages; by default "a" and the format.
    """
    return Kind(what or f"a {format}", lambda path: has_format(path, format))


def has_format(path: Path, *formats: str) -> bool:
    """Return True if the front of a file has one of the formats; the content may still be damaged."""
    front = _front(path)
    return front is not None and front.format in formats


def _front(path: Path) -> Front | None:
    try:
        with path.open("rb") as file:
            return Front.of(file.read(FRONT))
    except OSError:
        return None


def check(path: Path, format: str = "", what: str = "", hint: str = "") -> str:
    """Check an HDF5 file before it is opened.

    Args:
        path: the file.
        format: expected format; if "", third-party files without a digest are accepted, too.
        what: noun for messages; by default "a" and the format.
        hint: hint for a damaged file.

    Returns:
        the format of the file, "" for a third-party file.

    Raises:
        ModelError: the file has another format, or does not match its digest.
        OSError: the file cannot be read.
    """
    with path.open("rb", buffering=0) as file:
        disk = file.fileno()
        front = Front.of(file.read(FRONT))
        if front is None or (format and front.format != format):
            if front is not None and front.format.rpartition(" ")[0] == format.rpartition(" ")[0]:
                raise ModelError(f"{path}: a {front.format}, of another version: expected {what or f'a {format}'}")
            if format and front is not None:
                raise ModelError(f"{path}: found '{front.format}': expected {what or f'a {format}'}")
            if format:
                raise not_ours(path, what or f"a {format}")
            return ""
        if not front.fits(lambda at, n: os.pread(disk, n, at)):
            raise damaged(path, front, hint)
        return front.format


def is_whole(path: Path, format: str) -> bool:
    """Return True if the file exists, has this format, and is undamaged."""
    try:
        return check(path, format) == format
    except (ModelError, OSError):
        return False


def not_ours(path: Path, what: str) -> ModelError:
    """Return the error for a file of another kind; HDF5 without a front comes from another tool or an old version."""
    with path.open("rb") as file:
        has_no_front = file.read(len(MAGIC)) == MAGIC
    hint = "the file has no digest: other tools or an old version wrote it: make it again"
    return ModelError(f"{path}: not {what}", hint=hint if has_no_front else "")


def damaged(path: Path, front: Front, hint: str = "") -> ModelError:
    """Return the error for a file whose content and digest differ."""
    message = f"{path}: damaged {front.format}: the content does not match the digest"
    return ModelError(
        message, hint=hint or "write it again, or use a backup; after an edit of your own: neuro.apps.hdf5.seal(path)"
    )


def seal(path: Path) -> None:
    """Write a new digest into a file of this package, after an edit with h5py.

    Raises:
        ModelError: the file was not written by this package, so there is no room for a digest.
        OSError: the file cannot be written.
    """
    front = _front(path)
    if front is None:
        raise not_ours(path, "a file of neuro")
    with path.open("rb+", buffering=0) as file:
        disk, size = file.fileno(), os.fstat(file.fileno()).st_size
        file.write(Front.over(front.format, size, _sums(lambda at, n: os.pread(disk, n, at), size)).written())


@contextmanager
def writing(path: Path, format: str, replace: bool = False, record: Mapping[str, Any] | None = None) -> Iterator[Any]:
    """Open a new HDF5 file of a format, which takes the name `path` when the block succeeds.

    Args:
        path: path of the file.
        format: format, which becomes the attribute `format`.
        replace: whether to replace files of other kinds, too.
        record: provenance, see `neuro.core.provenance`; None for temporary files.

    Raises:
        Unwritable: see `neuro.core.outputs.output`.
    """
    with output(path, kind(format), replace) as part, new_file(part, format) as file:
        file.attrs["format"] = format
        if record is not None:
            file.attrs[ATTRIBUTE] = json.dumps(record)
        yield file


@contextmanager
def new_file(path: Path, format: str = "", **options: Any) -> Iterator[Any]:
    """Open a new HDF5 file, which replaces an existing file.

    Args:
        path: path of the file.
        format: format in the front, e.g. "neuro drone model 1"; "" for a file of another tool, without a front.
        options: options of `h5py.File`.

    Raises:
        OSError: the file cannot be written, e.g. on a full disk.
    """
    import h5py

    with disk(path) as opened:
        with h5py.File(opened, "w", userblock_size=FRONT if format else 0, **options) as file:
            yield file
        if format:
            opened.seal(format)


@contextmanager
def disk(path: Path, mode: str = "w+b") -> Iterator[_Disk]:
    """Open a Python file into which `h5py.File` writes, also for third-party packages; see the module for the reason.

    Args:
        path: path of the file.
        mode: "w+b" for a new file that replaces an existing one, "r+b" to change a file.

    Raises:
        OSError: the file cannot be written; raised when the block ends.
    """
    with _Disk(path, mode) as opened:
        try:
            yield opened
        finally:
            if opened.error is not None:
                raise opened.error from None


class _Disk(io.FileIO):
    """A file whose methods do not fail.

    Attributes:
        error: error of the first failure. Later data are discarded.
    """

    def __init__(self, path: Path, mode: str) -> None:
        super().__init__(path, mode)
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all data, or store the first failure."""
        remainder = memoryview(data)
        size = remainder.nbytes
        try:
            while self.error is None and remainder.nbytes:
                remainder = remainder[super().write(remainder) :]
        except OSError as error:
            self.error = error
        return size

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file, or store the first failure."""
        try:
            return super().truncate(size) if self.error is None else size or 0
        except OSError as error:
            self.error = error
            return size or 0

    def seal(self, format: str) -> None:
        """Write the front."""
        disk, size = self.fileno(), self.seek(0, os.SEEK_END)
        front = Front.over(format, size, _sums(lambda at, n: os.pread(disk, n, at), size))
        self.seek(0)
        self.write(front.written())


@atexit.register
def _close_python_files() -> None:
    """Close the HDF5 files that are still open over Python files, before Python ends."""
    if "h5py" not in sys.modules:
        return
    from h5py import File, h5f, h5fd

    with suppress(Exception):  # the process ends, and the files were incomplete
        for file in h5f.get_obj_ids(h5f.OBJ_ALL, h5f.OBJ_FILE):
            if file.get_access_plist().get_driver() == h5fd.fileobj_driver:
                File(file).close()


def check_tree(file: Any, several_names: bool = False) -> None:
    """Refuse an open file with links, external arrays or cycles, since strangers may have written it.

    A link or an array may lie in another file. A reader would then show the content of the other file, or wait forever
    if the other file is a pipe. A walk through groups that contain each other would never end.

    Args:
        file: file opened by h5py.
        several_names: whether parts may have more than one name, as in files of other tools.

    Raises:
        ValueError: a part lies in another file, or has more than one name although `several_names` is false.
    """
    from h5py import h5d, h5l, h5o, h5t

    links = (h5l.TYPE_HARD, h5l.TYPE_SOFT) if several_names else (h5l.TYPE_HARD,)

    def name_if_link(name: bytes, link: Any) -> bytes | None:
        return None if link.type in links else name

    def refused_name(name: bytes, part: Any) -> bytes | None:
        if part.type == h5o.TYPE_DATASET:
            array = h5o.open(file.id, name)
            options = array.get_create_plist()
            if options.get_layout() == h5d.VIRTUAL or options.get_external_count():
                return name
            if isinstance(array.get_type(), h5t.TypeReferenceID):
                return name
        return name if part.rc > 1 and not several_names else None

    try:
        name = file.id.links.visit(name_if_link, info=True) or h5o.visit(file.id, refused_name, info=True)
    except (KeyError, RuntimeError):
        raise ValueError("a name leads to no part of the file") from None
    if name:
        raise ValueError(f"{name.decode('utf-8', 'replace')[:60]!r} lies elsewhere: expected a part of the file")


@contextmanager
def reading(path: Path, format: str, hint: str = "", what: str = "") -> Iterator[Any]:
    """Open an HDF5 file of a format.

    Args:
        path: the file.
        format: expected format, e.g. "neuro drone model 1".
        hint: hint for a damaged file.
        what: noun for messages; by default "a" and the format.

    Raises:
        ModelError: the file does not exist, has another format, or is damaged.
    """
    import h5py

    path = existing(path, what or f"a {format}")
    try:
        check(path, format, what, hint)
        with h5py.File(path) as file:
            check_tree(file)
            yield file
    except ModelError:
        raise
    except (OSError, LookupError, TypeError, AttributeError, ValueError, RuntimeError, MemoryError) as error:
        raise ModelError(f"{path}: damaged {format}: {error}", hint=hint) from None  # h5py raises all of these


def put(file: Any, name: str, part: npt.NDArray[Any] | Mapping[str, npt.NDArray[Any]]) -> None:
    """Write an array, or a group of arrays, into an open file; plain bytes are packed."""
    import numpy as np

    if isinstance(part, Mapping):
        group = file.create_group(name)
        for inner, array in part.items():
            group[inner] = array
    elif part.dtype == np.uint8:
        file.create_dataset(name, data=part, compression="gzip", compression_opts=1)
    else:
        file[name] = part


def take(file: Any, name: str) -> Any:
    """Return the array, or the arrays by name, that `put` wrote."""
    part = file[name]
    return {inner: data[()] for inner, data in part.items()} if hasattr(part, "items") else part[()]


_REFERENCE = [("length", "<u4"), ("heap", "<u8"), ("index", "<u4")]
"""Fields by which a data set refers to a text in a heap."""


class Texts:
    """The heaps of texts of a third-party file.

    A damaged file may refer to a text that is not in the file. HDF5 would then read beyond the end of the heap.

    Source: HDF5 File Format Specification 3.0, III.E, "Disk Format: Level 1E - Global Heap".

    Args:
        content: content of the file.

    Attributes:
        whole: True if all heaps have the length that they declare.
    """

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._lengths: dict[tuple[int, int], int] = {}
        position, self.whole = content.find(b"GCOL"), True
        while position >= 0 and self.whole:
            self.whole = self._add(position)
            position = content.find(b"GCOL", position + 4)

    def _add(self, at: int) -> bool:
        """Add the heap at a position; return whether the heap is complete."""
        content = self._content
        end = at + int.from_bytes(content[at + 8 : at + 16], "little")
        position = at + 16
        while position + 16 <= end <= len(content):
            index = int.from_bytes(content[position : position + 2], "little")
            length = int.from_bytes(content[position + 8 : position + 16], "little")
            self._lengths[at, index] = length
            if index == 0:  # free space, including its header
                position += length if length else len(content)
            else:
                position += 16 + -(-length // 8) * 8
        return position <= end <= len(content)

    def has(self, data: Any) -> bool:
        """Return True if the strings of a data set are in the file; data sets stored in chunks are not checked."""
        import h5py
        import numpy as np

        if h5py.check_string_dtype(data.dtype) is None:
            return False
        begin = data.id.get_offset()
        if begin is None:
            return True
        reference = np.dtype(_REFERENCE)
        references = np.frombuffer(self._content[begin : begin + reference.itemsize * data.size], reference)
        lengths = ((self._lengths.get((heap, index), -1), n) for n, heap, index in references.tolist())
        return references.size == data.size and all(not n or length >= n for length, n in lengths)
