"""The backend `nest`, which runs networks in NEST. Our models follow NEST's, so NEST verifies the other backends.

NEST is optional, has the GPL licence, and is imported when a network is built, because the import takes a second.
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
    """The backend `nest`: NEST 3.10, the source of most models of this language."""

    name = "nest"
    description = "NEST itself, if installed (pip install nest-simulator): verifies the float backends"
    draws_synapses = True
    unreadable = UNREADABLE
    unsupported = UNSUPPORTED

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """Return an error for each part that NEST does not have or computes differently. Nothing is approximated."""
        return problems(program)

    def share(self) -> Share:
        """Return the share of the neurons that this process has. Under MPI several processes have a share each."""
        from neuro_nest.kernel import share

        return share()

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> NestEngine:
        """Build an engine at step 0. NEST uses this number of threads."""
        from neuro_nest.engine import NestEngine

        for name in options.keys() - {"strict"}:
            raise ModelError(f"backend 'nest' has no option '{name}'", hint=nearest(name, ["strict", "threads"]))
        return NestEngine(program, threads)


backend = NestBackend()
__all__ = ["backend"]
