"""The reference backend: what a `Program` means, written to be read.

It is `docs/explanation/programs.md`, section "What a program means", as plain Python and NumPy, with the models' own
functions. It is slow, runs everything, and every float backend is tested against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from neuro.core.errors import ModelError, nearest
from neuro.program.backend import Problem, floats_only
from neuro.program.program import Program
from neuro_reference.engine import ReferenceEngine


class ReferenceBackend:
    """Plain NumPy; defines the meaning."""

    name = "reference"
    description = "plain NumPy, slow, written to be read: defines what a program means"

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """Only parts in the registers of a chip are refused."""
        return floats_only(program)

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> ReferenceEngine:
        """Make an engine at step 0; `threads` is accepted and ignored."""
        for name in options.keys() - {"strict"}:
            raise ModelError(f"backend 'reference' has no option '{name}'", hint=nearest(name, ["strict", "threads"]))
        return ReferenceEngine(program)


backend = ReferenceBackend()
__all__ = ["backend"]
