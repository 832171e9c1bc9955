"""The backend `nest`: networks run in NEST itself, whose models ours follow. So it is the judge of the other backends.

NEST is imported when a network is built, not before: that takes a second. It is GPL and optional.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from neuro.core.errors import ModelError, nearest
from neuro.program.backend import Problem
from neuro.program.program import Program, Share
from neuro_nest.problems import UNSUPPORTED, problems
from neuro_nest.tables import UNREADABLE

if TYPE_CHECKING:
    from neuro_nest.engine import NestEngine


class NestBackend:
    """NEST 3.10, which computes what the models of this language are taken from."""

    name = "nest"
    description = "NEST itself, if installed (pip install nest-simulator): the judge of the float backends"
    draws_synapses = True
    unreadable = UNREADABLE
    unsupported = UNSUPPORTED

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """What NEST cannot do, or does otherwise; nothing is approximated."""
        return problems(program)

    def share(self) -> Share:
        """What of a network this process has; several under MPI have some of the neurons each."""
        from neuro_nest.kernel import share

        return share()

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> NestEngine:
        """Make an engine at step 0; `threads` are NEST's."""
        from neuro_nest.engine import NestEngine

        for name in options.keys() - {"strict"}:
            raise ModelError(f"backend 'nest' has no option '{name}'", hint=nearest(name, ["strict", "threads"]))
        return NestEngine(program, threads)


backend = NestBackend()
__all__ = ["backend"]
