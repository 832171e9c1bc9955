"""How much memory this process may still take, and memory that it gives back."""

from __future__ import annotations

import ctypes
import mmap
import resource
from functools import cache
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

_MACHINE = Path("/proc/meminfo")
_GROUP = Path("/sys/fs/cgroup")
_OURS = Path("/proc/self/cgroup")
_HUGE = 1 << 21


def free_memory() -> int | None:
    """Bytes that this process may still take without swapping; None if unknown.

    They are the least of what the machine has, of what the limits of its control groups leave, and of what the limit of
    addresses leaves (`ulimit -v`).
    """
    known = [bytes_ for bytes_ in (_of_machine(), *map(_of_group, _groups()), _of_addresses()) if bytes_ is not None]
    return min(known, default=None)


def _of_machine() -> int | None:
    available = _table(_MACHINE).get("MemAvailable:")
    return None if available is None else 1024 * available


def _of_addresses() -> int | None:
    limit, pages = resource.getrlimit(resource.RLIMIT_AS)[0], Path("/proc/self/statm")
    if limit == resource.RLIM_INFINITY or not pages.exists():
        return None
    return max(0, limit - int(pages.read_text().split()[0]) * mmap.PAGESIZE)


def _groups() -> list[Path]:
    """The folders of the control groups of this process: that of a container, and those within."""
    try:
        lines = _OURS.read_text().splitlines()
    except OSError:
        lines = []
    inner = [line[4:] for line in lines if line.startswith("0::/")]
    own = [_GROUP / name for name in inner if ".." not in name]
    return list(
        dict.fromkeys([_GROUP, *(group for each in own for group in (each, *each.parents) if _GROUP in group.parents)])
    )


def _of_group(group: Path) -> int | None:
    """What the limit of a control group leaves; files that are only kept ready do not count."""
    try:
        most, taken = ((group / name).read_text().strip() for name in ("memory.max", "memory.current"))
    except OSError:
        return None
    kept = _table(group / "memory.stat").get("inactive_file", 0)
    return int(most) - int(taken) + kept if most.isdigit() and taken.isdigit() else None


def _table(path: Path) -> dict[str, int]:
    """The lines of a file that are a word and a whole number."""
    try:
        lines = [line.split() for line in path.read_text().splitlines()]
    except OSError:
        return {}
    return {line[0]: int(line[1]) for line in lines if len(line) > 1 and line[1].isdigit()}


def discard(array: NDArray[Any], first: int, last: int) -> None:
    """Give the system the pages on which items first:last of a flat array lie; what lies before was given before.

    The items are lost, and the array stays as large as it is; systems other than Linux may keep its pages until it is
    freed. Huge pages are given as a whole: of one that is given in parts the system keeps all until it lacks memory.
    """
    if not hasattr(mmap, "MADV_DONTNEED"):
        return
    data = array.ctypes.data
    least = -(-data // mmap.PAGESIZE) * mmap.PAGESIZE
    begin, end = (max(least, (data + k * array.itemsize) // _HUGE * _HUGE) for k in (first, last))
    if begin < end:
        _library().madvise(ctypes.c_void_p(begin), ctypes.c_size_t(end - begin), mmap.MADV_DONTNEED)


def give_back() -> None:
    """Give to the system what was freed and is kept ready for this process, where its C library can."""
    try:
        _library().malloc_trim(0)
    except (AttributeError, OSError, TypeError):  # another C library, or another system
        return


@cache
def _library() -> ctypes.CDLL:
    """The C library of this process."""
    return ctypes.CDLL(None)
