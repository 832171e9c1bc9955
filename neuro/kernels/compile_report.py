"""Reports compiling on stderr: when it begins, and, when the process ends, how many kernels and how long."""

from __future__ import annotations

import atexit
import os
import sys
import time

REPORTED = "NEURO_COMPILING_REPORTED"
"""Environment variable: a process of the same command has reported, or will, that kernels are compiled."""

NOW = (0.0, 0.0)
"""A beginning that is not reported."""

here = False
"""Whether this process has reported it."""

_kernels = 0
_seconds = 0.0


def begin(cached: bool = True) -> tuple[float, float]:
    """Report once that kernels are compiled; return the start of the measurement."""
    global here
    if REPORTED not in os.environ:
        if not here:
            atexit.register(_sum_up)
        here = True
        os.environ[REPORTED] = "1"
        way_out = (
            "" if cached else "; they cannot be kept, as no cache folder can be written: set XDG_CACHE_HOME to one"
        )
        print(f"neuro: compiling kernels for this machine, once{way_out}", file=sys.stderr, flush=True)
    return time.perf_counter(), _seconds


def end(began: tuple[float, float], kernels: int = 1) -> None:
    """Add the time since `begin`. Compilation by others in the meantime is not counted twice."""
    global _kernels, _seconds
    _kernels += kernels
    _seconds = began[1] + time.perf_counter() - began[0]


def _sum_up() -> None:
    if _kernels:
        print(f"neuro: compiled {_kernels} kernel{'s' * (_kernels > 1)} in {_seconds:.1f} s", file=sys.stderr)
