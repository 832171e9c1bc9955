"""A trained deep network in NumPy: flying it needs neither stable-baselines3 nor PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_drone.controllers.simple import Fixed

__all__ = ["ACTIVATIONS", "Dense", "Flier", "observed"]

Arrays = Mapping[str, npt.NDArray[Any]]
Floats = npt.NDArray[np.float64]
Singles = npt.NDArray[np.float32]
MOST = np.float32(15.0)
"""Events in a field that are taken for 1; at as many the spiking network's cells have reached their largest rate."""


def observed(counts: npt.NDArray[Any], kind: str) -> Singles:
    """What a deep network sees of the fields.

    Args:
        counts: (8, 8) events.
        kind: binary (whether a field had events; thesis, section 7.2.1) or counts (15 and more are 1).

    Returns:
        (64,) in [0, 1].
    """
    flat = counts.ravel()
    if kind == "binary":
        return (flat > 0).astype(np.float32)
    seen: Singles = np.minimum(flat.astype(np.float32) / MOST, np.float32(1.0))
    return seen


ACTIVATIONS: dict[str, Callable[[Singles], Singles]] = {
    "relu": lambda x: np.maximum(x, np.float32(0.0)),
    "tanh": np.tanh,
}
"""Activations of hidden layers by name."""


class Dense:
    """Layers of weights with an activation between two.

    Args:
        arrays: weights (out, in) and biases (out,) by name.
        layers: names of the layers, from the first to the last; ".weight" and ".bias" follow.
        activation: of the hidden layers, one of `ACTIVATIONS`.

    Attributes:
        layers: weights and bias of each; not copied, so that a network that learns is seen as it is at any time.
    """

    def __init__(self, arrays: Arrays, layers: Sequence[str], activation: str = "relu") -> None:
        self.layers = [(arrays[f"{name}.weight"], arrays[f"{name}.bias"]) for name in layers]
        self._activation = ACTIVATIONS[activation]

    def __call__(self, seen: Singles) -> Singles:
        """What the last layer gives for an observation."""
        *hidden, (weight, bias) = self.layers
        for w, b in hidden:
            seen = self._activation(w @ seen + b)
        out: Singles = weight @ seen + bias
        return out


class Flier(Fixed):
    """A trained agent, which neither learns nor explores.

    Args:
        dense: the network that acts.
        command: the drone's action, (2,), of what the network gives.
        observation: binary or counts.

    Attributes:
        dense: as given.
    """

    def __init__(self, dense: Dense, command: Callable[[Singles], Floats], observation: str) -> None:
        self.dense, self._command, self._kind = dense, command, observation

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """The action that the network thinks best."""
        return self._command(self.dense(observed(counts, self._kind)))
