"""Copies of trained networks without learning."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import TypeVar

from neuro.model.parts import Description, Projection
from neuro.model.synapses import Synapse, loihi2_static, loihi_static, static, tsodyks2

D = TypeVar("D", bound=Description)


def frozen(net: D) -> D:
    """Return a copy of the network with the same weights, without learning rules and signals.

    Probes of learning synapses are removed. Synapses with short-term plasticity (tsodyks2) are not changed.
    """
    learning_names = {
        name for name, part in net.projections.items() if part.synapse.learns and not isinstance(part.synapse, tsodyks2)
    }
    copied = copy.copy(net)
    copied.projections = {n: _static(part, net) if n in learning_names else part for n, part in net.projections.items()}
    copied.probes = {name: part for name, part in net.probes.items() if part.of not in learning_names}
    copied.signals = {}
    if net.world_section is not None:
        copied.world_section = replace(net.world_section, reward=None)
    return copied


def _static(part: Projection, net: Description) -> Projection:
    models: dict[str, type[Synapse]] = {"loihi": loihi_static, "loihi2": loihi2_static}
    model = models.get(part.synapse.chip or net.populations[part.target].model.chip, static)
    parameters = part.synapse.parameters()
    words = {word: parameters[word] for word in model.quantities() if word in parameters}
    return replace(part, synapse=model(**words))
