"""Where arrays begin in memory.

A step reads many arrays at the same index. Numbers that lie across two cache lines are read twice; and arrays that all
begin at one place of a page compete for the same few places of the caches. Either costs a large network a fifth.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.program.program import Floats
from neuro_event import tables as t

LINE = 64
PAGE = 4096


def zeros(n: int, dtype: Any, line: int = 0) -> NDArray[Any]:
    """Zeros that begin at a cache line, which is counted within its page."""
    size = n * np.dtype(dtype).itemsize
    memory = np.zeros(size + PAGE, dtype=np.uint8)
    skip = (line * LINE - memory.ctypes.data) % PAGE
    return memory[skip : skip + size].view(dtype)


def rows(count: int, n: int, line: int) -> Floats:
    """Rows of at least n zeros, each of which begins elsewhere in its page than the one before.

    Populations fill whole pages, so a block more in each row is enough.
    """
    return zeros(count * (n + t.BLOCK), np.float64, line).reshape(count, n + t.BLOCK)
