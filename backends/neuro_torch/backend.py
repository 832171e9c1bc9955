"""The backend's two questions: what is refused, and how is it built."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from neuro.core.errors import ModelError, nearest
from neuro.program.backend import Problem
from neuro.program.program import Program
from neuro_torch.problems import problems
from neuro_torch.unsupported import UNSUPPORTED

if TYPE_CHECKING:
    from neuro_torch.engine import TorchEngine


class TorchBackend:
    """Networks as tensors, in doubles, on a processor or a GPU: what gradients are taken of."""

    name = "torch"
    description = "networks as tensors of torch, if installed, also on a GPU: what neuro_torch trains"
    unsupported = UNSUPPORTED

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """What cannot be stepped as tensors; nothing is approximated."""
        return problems(program)

    def build(self, program: Program, *, threads: int = 1, device: str = "cpu", **options: Any) -> TorchEngine:
        """Make an engine at step 0.

        Args:
            program: the network, of which nothing is refused.
            threads: of torch, while it runs.
            device: "cpu", "cuda" or "cuda:1".
            options: none are known.

        Raises:
            ModelError: torch is not installed, or the device is not there.
        """
        for name in options.keys() - {"strict"}:
            known = ["device", "strict", "threads"]
            raise ModelError(f"backend 'torch' has no option '{name}'", hint=nearest(name, known))
        from neuro_torch.devices import device_of

        found = device_of(device)
        from neuro_torch.engine import TorchEngine

        return TorchEngine(program, threads, found)
