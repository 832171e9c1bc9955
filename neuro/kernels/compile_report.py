"""Reports of compilation on stderr: a line when it starts, and a line with kernels and time when the process ends."""

from __future__ import annotations

import atexit
import os
import sys
import time

REPORTED = "NEURO_COMPILING_REPORTED"
"""Environment variable set by the first process of a command that reports compilation."""

NO_BEGIN = (0.0, 0.0)
"""Placeholder for the start of a measurement, until `begin` is called."""

has_reported = False
"""Whether this process has reported that kernels are compiled."""

_latest = float("-inf")
_under_way = 0
_kernels = 0
_seconds = 0.0


def begin(cached: bool = True) -> tuple[float, float]:
    """Report once that kernels are compiled. Return the start of a measurement: now, and the seconds counted before.

    `cached` is False if there is no folder for machine code.
    """
    global has_reported, _under_way
    if REPORTED not in os.environ:
        if not has_reported:
            atexit.register(_sum_up)
        has_reported = True
        os.environ[REPORTED] = "1"
        way_out = "" if cached else "; found no writable cache folder: set XDG_CACHE_HOME to one, to compile only once"
        print(f"neuro: compiling kernels for this machine, once{way_out}", file=sys.stderr, flush=True)
    _under_way += 1
    return time.perf_counter(), _seconds


def end(began: tuple[float, float], kernels: int = 1) -> None:
    """Count kernels, and the time since `begin`. Times that overlap are counted once."""
    global _kernels, _seconds, _latest, _under_way
    _latest, _under_way = time.monotonic(), max(0, _under_way - 1)
    _kernels += kernels
    _seconds = began[1] + time.perf_counter() - began[0]


def latest() -> float:
    """Return the end of the latest compilation, in s of `time.monotonic`, or now if a compilation is under way."""
    return time.monotonic() if _under_way else _latest


def _sum_up() -> None:
    if _kernels:
        print(f"neuro: compiled {_kernels} kernel{'s' * (_kernels > 1)} in {_seconds:.1f} s", file=sys.stderr)
