"""Memory that this process may still allocate, and the return of memory to the system."""

from __future__ import annotations

import ctypes
import mmap
import resource
from functools import cache
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

# Files of Linux with the memory of the machine, all control groups, and the group of this process.
_MACHINE = Path("/proc/meminfo")
_GROUP = Path("/sys/fs/cgroup")
_OURS = Path("/proc/self/cgroup")
_HUGE = 1 << 21


def free_memory() -> int | None:
    """Return the bytes that this process may allocate without swapping; None if unknown.

    The result is the smallest of three numbers: the free memory of the machine, the unused part of each control
    group's limit, and the unused part of the address space (`ulimit -v`).
    """
    limits = [bytes_ for bytes_ in (_of_machine(), *map(_of_group, _groups()), _of_addresses()) if bytes_ is not None]
    return min(limits, default=None)


def _of_machine() -> int | None:
    available = _table(_MACHINE).get("MemAvailable:")
    return None if available is None else 1024 * available


def _of_addresses() -> int | None:
    limit, pages = resource.getrlimit(resource.RLIMIT_AS)[0], Path("/proc/self/statm")
    if limit == resource.RLIM_INFINITY or not pages.exists():
        return None
    return max(0, limit - int(pages.read_text().split()[0]) * mmap.PAGESIZE)


def _groups() -> list[Path]:
    """Return the folders of this process's control groups, from the container's group down to the innermost."""
    try:
        lines = _OURS.read_text().splitlines()
    except OSError:
        lines = []
    paths = [line[4:] for line in lines if line.startswith("0::/")]
    own = [_GROUP / name for name in paths if ".." not in name]
    return list(dict.fromkeys([_GROUP, *(group for g in own for group in (g, *g.parents) if _GROUP in group.parents)]))


def _of_group(group: Path) -> int | None:
    """Return the unused part of a control group's limit. The cache of inactive files counts as unused."""
    try:
        limit, current = ((group / name).read_text().strip() for name in ("memory.max", "memory.current"))
    except OSError:
        return None
    cached = _table(group / "memory.stat").get("inactive_file", 0)
    return int(limit) - int(current) + cached if limit.isdigit() and current.isdigit() else None


def _table(path: Path) -> dict[str, int]:
    """Return the numbers in a file by word, from the lines with a word and a whole number."""
    try:
        lines = [line.split() for line in path.read_text().splitlines()]
    except OSError:
        return {}
    return {line[0]: int(line[1]) for line in lines if len(line) > 1 and line[1].isdigit()}


def discard(array: NDArray[Any], first: int, last: int) -> None:
    """Return the memory pages of items first:last of a flat array to the system. Discard earlier items first.

    The items are lost; the array keeps its size. Systems other than Linux may hold the pages until the array is
    freed. Huge pages are returned whole: the system holds a partly returned page until memory is short.
    """
    if not hasattr(mmap, "MADV_DONTNEED"):
        return
    data = array.ctypes.data
    first_page = -(-data // mmap.PAGESIZE) * mmap.PAGESIZE
    begin, end = (max(first_page, (data + k * array.itemsize) // _HUGE * _HUGE) for k in (first, last))
    if begin < end:
        _library().madvise(ctypes.c_void_p(begin), ctypes.c_size_t(end - begin), mmap.MADV_DONTNEED)


def give_back() -> None:
    """Return freed memory that the C library still holds to the system, if the library can."""
    try:
        _library().malloc_trim(0)
    except (AttributeError, OSError, TypeError):  # another C library, or another system
        return


@cache
def _library() -> ctypes.CDLL:
    """Return the C library of this process."""
    return ctypes.CDLL(None)
