"""The resolved network of a run that is over, compiled anew from its file."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

from neuro.compiler import compile_network
from neuro.model.network import Network
from neuro.model.neurons import event_camera, spike_generator
from neuro.program.program import Program


class Over(Protocol):
    """What is asked of results."""

    @property
    def about(self) -> dict[str, Any]:
        """Attributes of its file."""

    @property
    def populations(self) -> Mapping[str, Any]:
        """Spikes by population."""


def resolved(results: Over, net: Network) -> Program:
    """What ran; what a camera emitted is listed in it, so that no recording is needed.

    Args:
        results: of the run.
        net: what ran.
    """
    return compile_network(without_recordings(results, net), int(results.about["seed"]))


def without_recordings(results: Over, net: Network) -> Network:
    """The same network with a list of spikes, of which none are there, for each event camera."""
    listed = copy.copy(net)
    listed.populations = {
        name: replace(part, model=spike_generator(), shape=results.populations[name].shape)
        if isinstance(part.model, event_camera)
        else part
        for name, part in net.populations.items()
    }
    return listed
