"""Output files: written atomically. Files of other programs are never replaced.

The rule for every file that this package and its apps write:

- A file gets the final name after the last byte is written. If the work fails or is interrupted, no file is left. The
  exception is work that cannot be repeated, such as events from the network: `FILE.part` is left, and no later run
  removes or replaces it.
- An existing file is replaced atomically at the end if a mark in the file shows that this package wrote a file of the
  same kind (see `Kind`), or if the user asks for it. Other files stay, also texts that a person has edited.
- If the name is a link, the file behind the link is replaced; the link stays.
- Pipes, character devices and descriptors such as /dev/stdout are written to directly. Folders, disks and sockets are
  refused.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import itertools
import json
import os
import platform
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from neuro.core.errors import ModelError
from neuro.core.inputs import file_path

__all__ = [
    "Kind",
    "Unwritable",
    "check_output",
    "free_part",
    "kept_json",
    "kept_parts",
    "make_folder",
    "marked",
    "output",
    "sealed",
    "write_text",
]

PART = ".part"
"""End of the name of an incomplete file."""
HEAD = 4096
"""Number of bytes at the beginning of a file that contain its mark."""

_HOST = re.sub(r"\W", "-", platform.node())[:24]
_PART = re.compile(rf"\..*\.{_HOST}\.(\d{{1,9}})\.\d+\.part", re.DOTALL)
_DESCRIPTOR = re.compile(
    rf"/dev/(stdin|stdout|stderr)|(?:/dev|/proc/(?:self|thread-self|{os.getpid()}))/fd/(\d{{1,9}})"
)
_NUMBERS = {"stdin": 0, "stdout": 1, "stderr": 2}
_DIGITS = 32
_number = itertools.count()
_swept: set[Path] = set()
"""Folders that `_sweep` has searched."""
_pipes: dict[tuple[int, int], int] = {}
"""Descriptors of open pipes by device and inode."""
_READER_S = 2.0
"""Seconds that the reader of a pipe has to open it."""


class Unwritable(ModelError):
    """Error for a file that cannot be written, or that must not be replaced.

    Attributes:
        what: the message without the name of the file.
    """

    def __init__(self, path: Path, what: str, hint: str = "") -> None:
        self.what = what
        super().__init__(f"{path}: {what}", hint=hint)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of output file.

    Attributes:
        what: noun for messages, e.g. "a page of 'neuro compare'".
        ours: function that returns whether this package wrote a file of this kind. For kinds without a mark, such as
            event files, it returns False; such files are replaced only if the user asks for it.
        ask: option that lets the user replace a file; "" for none.
        seal: function that adds a digest to a text before it is written, so that later edits are detected.
    """

    what: str
    ours: Callable[[Path], bool] = lambda path: False
    ask: str = ""
    seal: Callable[[str], str] = str


def marked(what: str, mark: str, ask: str = "", anywhere: bool = False) -> Kind:
    """Return a kind of file with a mark near the beginning, or anywhere in the text."""

    def ours(path: Path) -> bool:
        with path.open("rb") as file:
            return mark.encode() in file.read(-1 if anywhere else HEAD)

    return Kind(what, ours, ask)


def sealed(what: str, mark: str, digest: str, ask: str = "") -> Kind:
    """Return a kind of text with a mark near its beginning, followed by a digest of the rest.

    An edited text has a digest that does not match, and is never replaced.

    Args:
        what: see `Kind`.
        mark: a text that all files of this kind contain.
        digest: format of the digest, with "{}" for the digits.
        ask: see `Kind`.
    """
    prefix, suffix = (half.encode() for half in digest.split("{}"))
    pattern = re.compile(
        re.escape(mark.encode()) + b"(" + re.escape(prefix) + b"([0-9a-f]{32})" + re.escape(suffix) + b")"
    )

    def ours(path: Path) -> bool:
        content = path.read_bytes()
        match = pattern.search(content[:HEAD])
        return match is not None and _digest(content[: match.start(1)], content[match.end(1) :]) == match[2].decode()

    def seal(text: str) -> str:
        head, found_mark, tail = text.partition(mark)
        head += found_mark
        return head + digest.format(_digest(head.encode(), tail.encode())) + tail

    return Kind(what, ours, ask, seal)


def _digest(*parts: bytes) -> str:
    return hashlib.sha256(b"".join(parts)).hexdigest()[:_DIGITS]


@contextmanager
def output(path: str | os.PathLike[str], kind: Kind, replace: bool = False, keep: bool = False) -> Iterator[Path]:
    """Open a new empty file, which takes the name `path` when the block succeeds.

    If the file cannot be written, the error is raised at once, before the work of the block.

    Args:
        path: path of the file.
        kind: kind of the file.
        replace: whether to replace files of other kinds.
        keep: whether to write to `path` with ".part" appended. That file is left, unless it is empty, if the block
            fails or the process is killed. If such a file exists, the new one gets a number, e.g. walk.2.dat.part.

    Raises:
        Unwritable: the disk is full, or `check_output` fails.
    """
    path = file_path(path, "path")
    check_output(path, kind, replace)
    keep = keep and not _is_special(path)
    part = free_part(path) if keep else _part(path)
    try:
        with _telling(path, part):
            part.touch(exist_ok=False)
            yield part
            _take_place(part, path)
    finally:
        if not keep or (part.exists() and not part.stat().st_size):
            part.unlink(missing_ok=True)


def check_output(path: Path, kind: Kind, replace: bool = False) -> None:
    """Raise an error if a file cannot be written. Call it before long work; no file is left behind.

    Args:
        path: path of the file.
        kind: kind of the file.
        replace: whether to replace files of other kinds.

    Raises:
        Unwritable: the folder does not exist or cannot be written to, `path` is a folder, a disk or a socket, or
            `path` is a file of another kind.
    """
    with _telling(path):
        number = _descriptor(path)
        if number is not None:
            _check_descriptor(path, number)
            return
        mode = _mode(path)
        if mode is not None:
            _check_existing(path, mode)
            if stat.S_ISREG(mode) and not replace and not kind.ours(path):
                raise _in_the_way(path, kind)
        part = _part(path)
        if path.is_symlink() and not part.parent.is_dir():
            raise Unwritable(path, f"leads to {_leads_to(path)}: expected a link into an existing folder")
        _sweep(part.parent)
        part.touch(exist_ok=False)
        part.unlink()


def _check_existing(path: Path, mode: int) -> None:
    """Raise an error if an existing path cannot be written to."""
    if stat.S_ISDIR(mode):
        raise Unwritable(path, "is a folder, expected the name of a file")
    if stat.S_ISBLK(mode) or stat.S_ISSOCK(mode):
        raise Unwritable(path, f"is a {'disk' if stat.S_ISBLK(mode) else 'socket'}, expected the name of a file")
    if stat.S_ISFIFO(mode):
        _open_pipe(path)
    if not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def _open_pipe(path: Path) -> None:
    """Open a pipe that has a reader. The pipe stays open until the write, because a reader stops without a writer."""
    state = path.stat()
    deadline_s = time.monotonic() + _READER_S
    while (state.st_dev, state.st_ino) not in _pipes:
        try:
            _pipes[state.st_dev, state.st_ino] = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
        except OSError as error:
            if error.errno != errno.ENXIO:
                raise
            if time.monotonic() > deadline_s:
                raise Unwritable(
                    path, "is a pipe that nobody reads: expected a reader, or the name of a file"
                ) from None
            time.sleep(0.01)


def _descriptor(path: Path) -> int | None:
    """Return the descriptor that a name such as /dev/stdout means, also through a link; None for other names."""
    name = os.path.abspath(path)
    for _ in range(40):
        match = _DESCRIPTOR.fullmatch(name)
        if match:
            return _NUMBERS[match[1]] if match[1] else int(match[2])
        if not os.path.islink(name):
            return None
        name = os.path.abspath(os.path.join(os.path.dirname(name), os.readlink(name)))
    return None


def _check_descriptor(path: Path, number: int) -> None:
    if stat.S_ISDIR(os.fstat(number).st_mode):
        raise Unwritable(path, "is a folder, expected the name of a file")
    if fcntl.fcntl(number, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
        raise Unwritable(path, "is open for reading, expected a descriptor that can be written to")


def _in_the_way(path: Path, kind: Kind) -> Unwritable:
    if kind.ask:
        return Unwritable(path, f"exists: expected a new name, or {kind.ask} to replace it")
    return Unwritable(path, f"exists and is not {kind.what}: expected a new name")


def _mode(path: Path) -> int | None:
    """Return the mode of a file, or of the target of a link; None if it does not exist."""
    try:
        return path.stat().st_mode
    except FileNotFoundError:
        return None


def _is_special(path: Path) -> bool:
    mode = _mode(path)
    return _descriptor(path) is not None or (mode is not None and not stat.S_ISREG(mode))


def write_text(path: Path, text: str, kind: Kind, replace: bool = False) -> None:
    """Write a text with the seal of its kind; see `output` for arguments and errors."""
    with output(path, kind, replace) as part:
        part.write_text(kind.seal(text), "utf-8")


def kept_json(path: Path) -> dict[str, Any]:
    """Return the values in a JSON file of unfinished work; an empty dictionary if the file is missing or damaged."""
    try:
        content = json.loads(path.read_text("utf-8"))
    except (FileNotFoundError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def make_folder(path: Path) -> None:
    """Make a folder and all missing parents.

    Raises:
        Unwritable: a file has the name of the folder or of a parent, or the folder cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise Unwritable(path, "is no folder: expected the name of a folder, or a new name") from None
    except OSError as error:
        raise Unwritable(path, f"cannot be made: {error.strerror}") from None


@contextmanager
def _telling(path: Path, part: Path | None = None) -> Iterator[None]:
    """Convert errors of the system to `Unwritable` with the user's file. Errors about other files are passed on."""
    try:
        yield
    except OSError as error:
        if part and error.filename is not None and not str(error.filename).startswith(str(part)):
            raise
        missing = isinstance(error, FileNotFoundError) and not path.parent.is_dir()
        reason = f"there is no folder {path.parent}" if missing else f"cannot be written: {error.strerror or error}"
        raise Unwritable(path, reason) from None


def _part(path: Path) -> Path:
    """Return a temporary name: in the file's folder, or for pipes and devices in the system's temporary folder."""
    folder = Path(tempfile.gettempdir()) if _is_special(path) else _leads_to(path).parent
    return folder / f".{path.name[:50]}.{_HOST}.{os.getpid()}.{next(_number)}.part"


def kept_parts(path: Path) -> Iterator[Path]:
    """Yield the names for parts left by a failure: walk.dat.part, walk.2.dat.part, ... for walk.dat."""
    target = _leads_to(path)
    names = itertools.chain([target.name], (f"{target.stem}.{k}{target.suffix}" for k in itertools.count(2)))
    return (target.with_name(name + PART) for name in names)


def free_part(path: Path, is_kept: Callable[[Path], bool] = os.path.lexists) -> Path:
    """Return the first free name of `kept_parts`.

    Args:
        path: path of the complete file.
        is_kept: function that returns whether a part must stay; by default every existing part stays.
    """
    return next(part for part in kept_parts(path) if not is_kept(part))


def _leads_to(path: Path) -> Path:
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def _take_place(part: Path, path: Path) -> None:
    """Rename the written file to the final name, or copy the content to a pipe or device."""
    try:
        if _is_special(path):
            with part.open("rb") as source, _opened(path) as target:
                shutil.copyfileobj(source, target)
            return
        if _mode(path) is not None:
            shutil.copymode(path, part)
        part.replace(_leads_to(path))
    except OSError as error:
        raise OSError(error.errno, error.strerror) from None


def _opened(path: Path) -> IO[bytes]:
    """Open a pipe, device or descriptor for writing. A descriptor keeps its position, since others may write, too."""
    number = _descriptor(path)
    if number is None:
        state = path.stat()
        pipe = _pipes.pop((state.st_dev, state.st_ino), None)
        if pipe is None:
            return path.open("wb")
        os.set_blocking(pipe, True)
        return os.fdopen(pipe, "wb")
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    return os.fdopen(os.dup(number), "wb")


def _sweep(folder: Path) -> None:
    """Try to remove files that killed processes of this user and machine left in a folder.

    Each folder is searched once only, since it may have many files.
    """
    if folder in _swept:
        return
    _swept.add(folder)
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            match = _PART.fullmatch(entry.name)
            if match and not _runs(int(match[1])):
                with suppress(OSError):
                    state = entry.stat(follow_symlinks=False)
                    if stat.S_ISREG(state.st_mode) and state.st_uid == os.getuid():
                        os.unlink(entry.path)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        pass
    return True
