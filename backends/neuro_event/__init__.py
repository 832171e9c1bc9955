"""The float simulator: event-driven, compiled by numba, which is imported only when a network is built.

Three rooms, and imports run one way: `host` (what Python holds and calls between steps) imports `building` (from a
program to the arrays and tables of the kernels), which imports `loop` (the compiled kernels).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from neuro.core.errors import ModelError, nearest
from neuro.program.backend import Engine, Problem, floats_only
from neuro.program.program import Program


class EventBackend:
    """Float64, event-driven, compiled; runs everything that the language can say."""

    name = "event"
    description = "float64, event-driven, compiled by numba; any number of threads gives the same result"
    unsupported: dict[str, str] = {}

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """Only parts in the registers of a chip are refused, and models that are not listed."""
        return floats_only(program)

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> Engine:
        """Make an engine at step 0.

        Args:
            program: what to run.
            threads: how many threads share the neurons.
            options: `strict` is accepted as by chips: nothing overflows here.

        Raises:
            ModelError: an option is unknown, `threads` is not a whole number >= 1, or numba must not compile.
        """
        for name in options.keys() - {"strict"}:
            raise ModelError(
                f"backend 'event' has no option '{name}'", hint=nearest(name, ["backend", "strict", "threads"])
            )
        if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
            raise ModelError(f"threads = {threads!r}: expected a whole number >= 1, e.g. {os.cpu_count()}")
        from neuro.kernels.jit import must_compile

        must_compile(self.name)
        from neuro_event.host.engine import EventEngine

        return EventEngine(program, threads)


backend = EventBackend()

__all__ = ["EventBackend", "backend"]
