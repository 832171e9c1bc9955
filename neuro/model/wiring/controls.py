"""Networks whose wiring diagrams are shuffled."""

from __future__ import annotations

import copy
from dataclasses import replace

from neuro.core.checks import argument
from neuro.core.errors import ModelError
from neuro.model.network import Network
from neuro.model.rules import from_file


def shuffled(net: Network, what: str, *, seed: int = 0) -> Network:
    """A control: the same network, in which one property of each wiring diagram is drawn anew.

    Args:
        net: the network; it is not changed.
        what: "edges": edges exchange targets, and every neuron keeps its numbers of inputs and outputs, the sizes and
            signs of its outputs; "signs": neurons exchange their transmitters (with `dale`; else edges exchange signs);
            "weights": edges exchange the sizes of their weights and keep their signs.
        seed: of the draws; another one gives another control.

    Returns:
        A network that differs in `shuffle` and `shuffle_seed` of its rules `from_file`, so that it can be saved.

    Raises:
        ModelError: the network has no edges from a file.
    """
    if not isinstance(net, Network):
        raise ModelError(f"shuffled: found {net!r:.60}: expected a Network", hint="neuro.load reads one from YAML")
    argument("shuffled: what", what, words=("edges", "signs", "weights"))
    argument("shuffled: seed", seed, kind="integer", at_least=0)
    if not any(isinstance(part.rule, from_file) for part in net.projections.values()):
        hint = "net.wiring(neurons=..., edges=...), or the rule neuro.from_file(...)"
        raise ModelError(
            f"shuffled: network '{net.name}' has no edges from a file: expected a rule from_file", hint=hint
        )
    control = copy.copy(net)
    control.projections = {
        name: replace(part, rule=replace(part.rule, shuffle=what, shuffle_seed=seed))
        if isinstance(part.rule, from_file)
        else part
        for name, part in net.projections.items()
    }
    return control
