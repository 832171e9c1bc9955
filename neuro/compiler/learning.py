"""Checks of the signals, dopamine and states for rules with teaching signals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from neuro.compiler.shapes import Shape, size
from neuro.core.errors import a, unknown
from neuro.model.network import Network
from neuro.model.neurons import CurrentGenerator, Neuron
from neuro.model.parts import Projection, refuse
from neuro.model.synapses import Modulated, MoveRule


def _check_signal(net: Network, part: Projection, word: str, signal: str) -> None:
    """Check that a signal named by a rule exists and goes to the target."""
    name = part.synapse.name
    if signal not in net.signals:
        error = unknown("signal", signal, net.signals, path=(name, word))
        raise error.at(part.origin, f"projection '{part.name}': {name}.{word}")
    signal_target = net.signals[signal].to
    if signal_target != part.target:
        message = f"{name}.{word} '{signal}' goes to '{signal_target}': expected a signal to '{part.target}'"
        refuse(part, message, word=f"{name}.{word}")


def check_moves(net: Network, part: Projection, synapse: MoveRule) -> None:
    """Check a rule that learns by moves: it must have a signal, and the target the state that the rule reads."""
    if synapse.signal is None:
        message = f"{synapse.name} without 'signal': its weights never change: expected a signal"
        refuse(part, message, f"name a signal to '{part.target}'; static has fixed weights", synapse.name)
    for word, signal in (("signal", synapse.signal), ("gate", synapse.gate)):
        if signal is not None:
            _check_signal(net, part, word, signal)
    model = net.populations[part.target].model
    if synapse.sees and synapse.sees not in [state.name for state in model.states]:
        message = (
            f"{synapse.name} onto '{part.target}', {a(model.name)}: expected neurons with a state '{synapse.sees}'"
        )
        refuse(part, message, "soft_wta and pp_psc_delta have the probability p" * (synapse.sees == "p"), synapse.name)
    if isinstance(model, Neuron) and model.relay:
        message = f"{synapse.name} onto '{part.target}', {a(model.name)}: expected neurons with weighted input"
        refuse(part, message, word=synapse.name)


def check_dopamine(net: Network, part: Projection, synapse: Modulated, shapes: Mapping[str, Shape]) -> None:
    """Check that a modulated rule has a source of dopamine n that fits the target."""
    if synapse.signal is not None:
        _check_signal(net, part, "signal", synapse.signal)
    if synapse.dopamine is None:
        if synapse.signal is None and synapse.learns == "pairs" and _needs_dopamine(synapse):
            fades = "tau_n" in synapse.numbers()
            sources = "'signal' and 'dopamine'" if fades else "'signal'"
            message = f"{synapse.name} without {sources}: n stays 0, and its weights never change"
            way_out = f"name a signal to '{part.target}'" + ", or the population that releases dopamine" * fades
            refuse(part, f"{message}: expected a source of n", f"{way_out}; static has fixed weights", synapse.name)
        return
    if synapse.dopamine not in net.populations:
        error = unknown("population", synapse.dopamine, net.populations, path=(synapse.name, "dopamine"))
        raise error.at(part.origin, f"projection '{part.name}': {synapse.name}.dopamine")
    if isinstance(model := net.populations[synapse.dopamine].model, CurrentGenerator):
        message = f"{synapse.name}.dopamine '{synapse.dopamine}' is {a(model.name)}"
        refuse(part, f"{message}: expected a population that spikes", word=f"{synapse.name}.dopamine")
    n, m = size(shapes[synapse.dopamine]), size(shapes[part.target])
    if synapse.dopamine_rule == "one_to_one" and n != m:
        text = (
            f"{synapse.name}.dopamine_rule one_to_one from '{synapse.dopamine}' of {n} neurons "
            f"to '{part.target}' of {m}: expected equal sizes"
        )
        refuse(part, text, word=f"{synapse.name}.dopamine_rule")


def _needs_dopamine(rule: Modulated) -> bool:
    """Run a rule's arithmetic to find whether weights never change while n is 0.

    The test uses states that spikes of either order may leave, and a weight within the bounds. A rule whose states
    determine the transmitted weight has an effect without n, too.
    """
    kernels: Any = rule.arithmetic
    if hasattr(kernels, "sent"):
        return False
    constants = rule.constants_of(rule.vector(), 0.1)
    low, high = (min(max(float(end), -1e6), 1e6) for end in rule.bounds())
    traces = [np.full(max(1, len(side)), 0.5) for side in (rule.pre, rule.post)]
    for sign in (1.0, -1.0):
        y = np.full((1 + len(rule.states), 1), sign)
        y[0] = before = 0.25 * low + 0.75 * high
        for steps in (1, 1000):
            kernels.on_pre(y, 0, constants, *traces, *([0.5] if rule.draws else []))
            kernels.advance(y, 0, constants, 0, steps, 0.0, 1)
            kernels.on_post(y, 0, constants, *traces)
            kernels.advance(y, 0, constants, steps, 2 * steps, 0.0, 1)
        if y[0, 0] != before:
            return False
    return True
