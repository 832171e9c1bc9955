"""The float simulator: event-driven and compiled by numba, which is imported only when a network is built.

There are three packages. `host` is the Python side, which acts between steps. `building` turns a program into the
arrays and tables of the kernels. `loop` has the compiled kernels. Imports have one direction: `host` imports
`building`, and `building` imports `loop`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from neuro.core.errors import ModelError, nearest
from neuro.program.backend import Engine, Problem, floats_only
from neuro.program.program import Program


class EventBackend:
    """The backend `event`: float64, event-driven, compiled. Every network of the language runs on it."""

    name = "event"
    description = "float64, event-driven, compiled by numba; any number of threads gives the same result"
    unsupported: dict[str, str] = {}

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """Return an error for each part of the program that only exists on a chip. Everything else runs."""
        return floats_only(program)

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> Engine:
        """Build an engine at step 0.

        Args:
            program: the program to run.
            threads: number of threads, among which the neurons are divided.
            options: only `strict` is accepted. It has a meaning for chips, but no effect here, since floats do not
                overflow.

        Raises:
            ModelError: an option is unknown, `threads` is not a whole number >= 1, or numba is configured not to
                compile.
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
