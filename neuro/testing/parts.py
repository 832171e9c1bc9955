"""Tests of a neuron, generator, synapse model or connection rule on a backend against the reference."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from neuro.core.errors import ModelError
from neuro.core.hints import nearest
from neuro.model.distributions import uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    MODELS,
    Generator,
    Model,
    Neuron,
    iaf_psc_delta,
    iaf_psc_exp,
    parrot_neuron,
    poisson_generator,
    spike_generator,
)
from neuro.model.parts import winner_take_all
from neuro.model.rules import RULES, Rule, all_to_all, fixed_indegree, grid, one_to_one, pairwise_bernoulli
from neuro.model.synapses import SYNAPSES, Modulated, Synapse, static
from neuro.program.backend import Backend
from neuro.program.program import Floats
from neuro.run.compiled import compile
from neuro.run.simulation import Simulation
from neuro.testing.case import Found, differences, observe, run_on
from neuro.testing.trials import batch, trial_results

Part = Model | Synapse | Rule

_N = 70  # more than a block of neurons, and not a multiple of the block size
_SHEET = (7, 10)  # also 70 neurons
_RATES = (5.0, 80.0)
_DRIVES = ((1.0, 80.0), (20.0, 5.0), (400.0, 80.0))  # weights and rates in Hz; a neuron's unit of weight is unknown
_LEVELS = np.linspace(-1.0, 1.0, _N)  # values of a signal, different for each neuron


_USUAL = 40.0
"""Default duration of each network's run, ms."""


def check_part(part: str | Part, backend: str | Backend = "event", *, ms: float = _USUAL) -> None:
    """Run networks with a part on a backend and on the reference, and compare everything that can be read.

    Some networks are nearly silent, others are active. The runs are divided and reset, all settable parameters are
    changed, and each network runs with one and with two threads. Neurons are also compared at each step of increasingly
    long silences. A rule for trials learns from a batch of trials. A modulated rule is modulated by a signal, and also
    by spikes if it has the parameter `tau_n`.

    Args:
        part: name of a registered part, which is tested with its defaults, or an instance.
        backend: name of the backend, or the backend itself.
        ms: duration of each network's run; a shorter one suits a part that is slow in plain Python.

    Raises:
        AssertionError: the backend and the reference differ; the message has the network and the values.
        ModelError: the part does not exist, or cannot be tested in these networks.
    """
    chosen = _default_part(part) if isinstance(part, str) else part
    if isinstance(chosen, Neuron):
        check_silences(chosen, backend, ms)
    for net in _networks(chosen):
        expected = _outcome(compile(net, "reference", seed=1), chosen, ms)
        for threads in (1, 2):
            outcome = _outcome(compile(net, backend, seed=1, threads=threads), chosen, ms)
            messages = differences(expected, outcome, exact=False)
            assert not messages, f"{chosen.name} in '{net.name}', {threads} threads\n  " + "\n  ".join(messages)


def _default_part(name: str) -> Part:
    for registry in (MODELS, SYNAPSES, RULES):
        if name in registry:
            try:
                part: Part = registry[name]()
            except TypeError as error:
                raise ModelError(f"'{name}' has no defaults: {error}", hint="pass an instance of it") from None
            return part
    names = [*MODELS, *SYNAPSES, *RULES]
    raise ModelError(f"there is no model, synapse model or connection rule '{name}'", hint=nearest(name, names))


def _outcome(sim: Simulation, part: Part, ms: float) -> Found:
    """Return all values after a run, during its repetition in two pieces, and after a change of the parameters."""
    if sim.program.trials is not None:
        return _outcome_of_trials(sim)
    _signal(sim, _LEVELS)
    sim.run(ms)
    first = observe(sim)
    sim.reset(weights=True)
    _signal(sim, _LEVELS)
    sim.run(0.3 * ms)
    middle = observe(sim)
    sim.run(0.7 * ms)
    messages = differences(first, observe(sim), exact=True)
    assert not messages, f"{sim.program.name}: a run that is cut differs\n  " + "\n  ".join(messages)
    _change(sim, part)
    _signal(sim, -_LEVELS)
    sim.run(ms)
    later = {f"at {0.3 * ms:g} ms": middle, "after sim.set": observe(sim)}
    return first | {f"{name}, {when}": value for when, values in later.items() for name, value in values.items()}


def _signal(sim: Simulation, levels: Floats) -> None:
    """Set all signals of a network to these values."""
    for signal in sim.program.signals:
        sim.signal(signal.name, levels)


def _change(sim: Simulation, part: Part) -> None:
    """Change each parameter of the part that can be set during a run."""
    program = sim.program
    owners = [p.name for p in program.populations if p.model.name == part.name]
    owners += [p.name for p in program.projections if p.synapse.name == part.name]
    for word, value in part.parameters().items():
        if isinstance(value, float) and value != 0.0 and np.isfinite(value):
            for owner in owners:
                changed: dict[str, Any] = {word: 1.05 * value}
                with suppress(ModelError):  # every backend refuses fixed parameters, times off the grid and bounds
                    sim.set(owner, **changed)


def _networks(part: Part) -> Iterator[Network]:
    if isinstance(part, Generator):
        yield _of_generator(part)
    elif isinstance(part, Neuron):
        for weight, rate in _DRIVES:
            yield _of_neuron(part, weight, rate)
    elif isinstance(part, Synapse) and part.learns == "trials":
        yield from _trial_networks(part)
    elif isinstance(part, Synapse):
        yield from (_of_synapse(variant, rate) for variant in _sources_of_n(part) for rate in _RATES)
    elif isinstance(part, Rule):
        yield from (_of_rule(part, rate) for rate in _RATES)


def _of_neuron(model: Neuron, weight: float, rate: float) -> Network:
    net = Network(f"noise_{rate}_Hz_weights_{weight}")
    net.population("noise", 20, poisson_generator(rate=rate))
    net.population("cells", _N, model)
    if model.receptors > 2:
        _connect_by_name(net, model, weight)
        _probe(net, model)
        return net
    net.connect("noise", "cells", pairwise_bernoulli(p=0.5), weight=uniform(low=-0.5 * weight, high=weight), delay=1.0)
    if model.states:
        net.connect("cells", "cells", pairwise_bernoulli(p=0.1), weight=-0.5 * weight, delay=1.5)
    _probe(net, model)
    return net


_SILENCES = (1, 20, 24, 60, 150, 600)
"""Steps between spikes for the default `ms` of `check_part`. The event backend lets neurons sleep after 16 steps."""
_WEIGHTS = np.array([0.3, 20.0, 500.0, -60.0])
"""Weights for neurons of unknown units; in most units some of them make a neuron fire and others do not."""


def check_silences(model: Neuron, backend: str | Backend = "event", ms: float = _USUAL) -> None:
    """Compare all states at each step of increasingly long silences.

    Args:
        model: the neuron.
        backend: name of the backend, or the backend itself.
        ms: duration as in `check_part`; with the default the longest silence has 600 steps.

    Raises:
        AssertionError: the backend and the reference differ.
    """
    net = Network("silences", resolution=0.1)
    times = np.cumsum([max(1, round(steps * ms / _USUAL)) for steps in _SILENCES]) * net.resolution
    net.population("source", 1, spike_generator(spike_times=[times.tolist()]))
    net.population("cells", _WEIGHTS.size, model)
    names = model.named_receptors() if model.receptors > 2 or not model.signed else ()
    for name in names:
        weight = np.abs(_WEIGHTS) if name in model.conductances else _WEIGHTS
        net.connect("source", "cells", all_to_all(), static(receptor=name), weight=weight[None], delay=0.1, name=name)
    if not names:
        net.connect("source", "cells", all_to_all(), weight=_WEIGHTS[None], delay=0.1)
    for state in model.states:
        if not state.hidden:
            net.probe(f"{state.name}_of_cells", "cells", state.name, every=net.resolution)
    runs = []
    for simulator in ("reference", backend):
        sim = compile(net, simulator, seed=1)
        run_on(sim, float(times[-1]))
        runs.append(observe(sim))
    messages = differences(runs[0], runs[1], exact=False)
    assert not messages, f"{model.name} in '{net.name}'\n  " + "\n  ".join(messages)


def _connect_by_name(net: Network, model: Neuron, weight: float) -> None:
    """Connect noise to each named receptor of the neurons."""
    for name in model.named_receptors():
        low = 0.0 if name in model.conductances else -0.5 * weight
        half = pairwise_bernoulli(p=0.5)
        net.connect(
            "noise", "cells", half, static(receptor=name), weight=uniform(low=low, high=weight), delay=1.0, name=name
        )


def _of_generator(model: Model) -> Network:
    net = Network("generator")
    net.population("source", 20, model)
    net.population("cells", _N, iaf_psc_exp())
    net.connect("source", "cells", pairwise_bernoulli(p=0.5), weight=300.0, delay=1.0)
    _probe(net, iaf_psc_exp())
    return net


def _sources_of_n(synapse: Synapse) -> Iterator[Synapse]:
    """Yield a modulated rule once for each possible modulator, and any other rule unchanged."""
    if not isinstance(synapse, Modulated):
        yield synapse
        return
    yield replace(synapse, signal="level", dopamine=None)
    if "tau_n" in synapse.numbers():
        yield replace(synapse, signal=None, dopamine="noise", dopamine_rule="all_to_all")


def _of_synapse(synapse: Synapse, rate: float) -> Network:
    modulator = getattr(synapse, "signal", None) or getattr(synapse, "dopamine", None)
    net = Network(f"noise_{rate}_Hz" + (f"_modulated_by_{modulator}" if modulator else ""))
    net.population("noise", 20, poisson_generator(rate=rate))
    net.population("relay", 20, parrot_neuron())
    net.population("cells", _N, iaf_psc_exp(I_e=200.0))
    if modulator == "level":
        net.signal("level", to="cells")
    net.connect("noise", "relay", one_to_one(), delay=0.1)
    largest = float(getattr(synapse, "Wmax", 400.0))
    middle = uniform(low=min(0.2 * largest, 0.8 * largest), high=max(0.2 * largest, 0.8 * largest))
    for source in ("relay", "cells"):
        delay = uniform(low=max(0.1, getattr(synapse, "d_min", 0.0)), high=min(4.0, getattr(synapse, "d_max", 4.0)))
        net.connect(source, "cells", pairwise_bernoulli(p=0.3), synapse, weight=middle, delay=delay)
    _probe(net, iaf_psc_exp())
    return net


def _of_rule(rule: Rule, rate: float) -> Network:
    net = Network(f"noise_{rate}_Hz")
    net.population("noise", _SHEET, poisson_generator(rate=rate))
    net.population("cells", _SHEET, iaf_psc_exp())
    net.connect("noise", "cells", rule, weight=300.0, delay=1.0)
    net.connect("cells", "cells", all_to_all(), weight=-5.0, delay=1.0)
    _probe(net, iaf_psc_exp())
    return net


def _probe(net: Network, model: Model) -> None:
    for state in model.states:
        if not state.hidden:
            net.probe(f"{state.name}_of_cells", "cells", state.name, every=1.0)


_TRIALS = 12
_WIRES = {
    "shared_kernel": (grid(kernel=(4, 4)), 10.0),
    "pairs": (all_to_all(), 20.0),
    "drawn": (fixed_indegree(n=30), 9.0),
}
"""Connection rules from the sheet, and the approximate number of spikes for a decision."""


def _trial_networks(rule: Synapse) -> Iterator[Network]:
    """Yield a network for each connection rule, and one whose trials continue after the decision.

    Some trials end without a decision.
    """
    low, high = _usual_weights(rule)
    for name, (wires, spikes) in _WIRES.items():
        if rule.delays and name == "shared_kernel":
            continue
        for stop in ("at_decision", "full") if name == "pairs" else ("at_decision",):
            net = Network(f"{name}_{stop}", resolution=0.5)
            net.population("sheet", (2, 6, 6), spike_generator())
            threshold = spikes * 0.5 * (low + high)
            model = iaf_psc_delta(tau_m=30.0, E_L=0.0, V_reset=0.0, V_th=threshold)
            net.population("maps", (6, "auto", "auto") if name == "shared_kernel" else (6, 2), model)
            delay = 2.0 if name == "shared_kernel" else uniform(low=max(0.5, getattr(rule, "d_min", 0.0)), high=6.0)
            net.connect("sheet", "maps", wires, rule, weight=uniform(low=low, high=high), delay=delay, name="learnt")
            net.group("choice", winner_take_all(of="maps"))
            labels, dropout = {"of": "maps", "maps_per_label": 2}, {"of": "maps", "p": 0.2}
            net.trials(input="sheet", duration=18.0, stop=stop, labels=labels, dropout=dropout)
            yield net


def _usual_weights(rule: Synapse) -> tuple[float, float]:
    """Return the 20 % and 80 % points of the rule's range of positive weights."""
    bounds = rule.parameters()
    low, high = max(0.0, float(bounds.get("Wmin", 0.0))), float(bounds.get("Wmax", 1.0))
    if not np.isfinite(high):
        high = low + 1.0
    return low + 0.2 * (high - low), low + 0.8 * (high - low)


def _outcome_of_trials(sim: Simulation) -> Found:
    """Return the outcome of a batch with learning, and check that the batch in two parts gives the same."""
    times, ids, offsets, labels = batch(_TRIALS)
    undivided = trial_results(sim.trials(times, ids, offsets, labels, learn=True)) | observe(sim)
    sim.reset(weights=True)
    cut, index = _TRIALS // 3, int(offsets[_TRIALS // 3])
    sim.trials(times[:index], ids[:index], offsets[: cut + 1], labels[:cut], learn=True)
    sim.trials(times[index:], ids[index:], offsets[cut:] - index, labels[cut:], learn=True)
    messages = differences({name: undivided[name] for name in observe(sim)}, observe(sim), exact=True)
    assert not messages, f"{sim.program.name}: a batch that is cut differs\n  " + "\n  ".join(messages)
    return undivided | trial_results(sim.trials(times, ids, offsets), "test")
