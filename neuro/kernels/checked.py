"""Kernels that look at every index, to prove that none leaves its array; several times slower."""

from __future__ import annotations

from typing import Any

import numba
from numba import types
from numba.np import arrayobj

_config: Any = numba.config
_STRICT = 2
"""What numba's own check, 1, is not: part of the key under which kernels are kept."""


def check_bounds() -> None:
    """Compile with checks from now on: an index beyond an array's end, or below 0, raises IndexError.

    Call it before any kernel compiles. Numba's own check lets -1 stand for the last item; no kernel here means that.
    """
    _config.BOUNDSCHECK = _STRICT
    arrayobj.fix_integer_index = _as_it_is


def _as_it_is(context: Any, builder: Any, kind: Any, index: Any, size: Any) -> Any:
    """The index as a signed word, whatever the size of the array; huge unsigned ones are below 0, too."""
    return context.cast(builder, index, kind, types.intp)
