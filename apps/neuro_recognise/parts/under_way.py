"""What a training under way has reached, as arrays: how the frames of its epochs were decided, and its simulation."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

import neuro
from neuro_recognise.parts.layers import Shares
from neuro_recognise.shown import Array

__all__ = ["restore", "shares_of", "state_of", "told_of"]


def told_of(shares: Sequence[Shares]) -> dict[str, Array]:
    """Shares of frames by epoch: ``history`` of right decisions, ``mistakes`` of wrong ones."""
    return {
        "history": np.array([one.right for one in shares]),
        "mistakes": np.array([one.wrong for one in shares]),
    }


def shares_of(told: Mapping[str, Array]) -> list[Shares]:
    """What `told_of` was given."""
    return [Shares(*both) for both in zip(told["history"].tolist(), told["mistakes"].tolist(), strict=True)]


def state_of(sim: neuro.Simulation) -> Array:
    """The file that `Simulation.save` writes, as bytes."""
    with tempfile.TemporaryDirectory() as folder:
        sim.save(Path(folder) / "state.h5")
        return np.fromfile(Path(folder) / "state.h5", np.uint8)


def restore(sim: neuro.Simulation, state: Array) -> None:
    """Go on from what `state_of` gave."""
    with tempfile.TemporaryDirectory() as folder:
        state.tofile(Path(folder) / "state.h5")
        sim.restore(Path(folder) / "state.h5")
