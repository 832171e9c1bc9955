"""The reference backend, which defines the meaning of a `Program` and is written to be read.

The backend implements the section "What a program means" of `docs/explanation/programs.md` in plain Python and NumPy,
with the models' own functions. Every program runs, slowly. Every float backend is tested against this backend.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from neuro.core.errors import ModelError, nearest
from neuro.program.backend import Problem, floats_only
from neuro.program.program import Program
from neuro_reference.engine import ReferenceEngine


class ReferenceBackend:
    """The backend `reference`: plain NumPy, which defines the meaning of a program."""

    name = "reference"
    description = "plain NumPy, slow, written to be read: defines what a program means"

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """Return an error for each part that only exists on a chip."""
        return floats_only(program)

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> ReferenceEngine:
        """Build an engine at step 0. `threads` and `strict` are accepted and have no effect."""
        for name in options.keys() - {"strict"}:
            raise ModelError(f"backend 'reference' has no option '{name}'", hint=nearest(name, ["strict", "threads"]))
        return ReferenceEngine(program)


backend = ReferenceBackend()
__all__ = ["backend"]
