"""Random small networks that are run, steered and read on the way, for hypothesis: what NEST, too, can do.

Everything is drawn wider than a modeller would: time constants that nearly equal, thresholds that are met exactly,
silence of 10,000 steps, delays of 1 step and of 60, synapses of a neuron onto itself and several between two, weights
at their bounds. Needs the package hypothesis, which only tests install.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence, Set
from copy import copy
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from hypothesis import strategies as st

from neuro.core.choice import Choice
from neuro.core.quantities import word_of
from neuro.model.distributions import uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    Model,
    dc_generator,
    iaf_psc_alpha,
    iaf_psc_delta,
    iaf_psc_exp,
    izhikevich,
    parrot_neuron,
    poisson_generator,
    spike_generator,
)
from neuro.model.parts import Projection
from neuro.model.rules import Rule, all_to_all, fixed_indegree, one_to_one, pairs
from neuro.model.synapses import Synapse, static, stdp, stdp_dopa
from neuro.run.simulation import Simulation
from neuro.testing.case import Found

SILENCE = 10_000
"""Steps of a long silence."""

LIMIT, RELATIVE = 1e-9, 1e-12
"""What may differ between two backends that round in another order."""

TWINS, UNITS = 12, 8
"""Runs with other last places, and how many units in the last place they move."""

SHARE = 0.1
"""The share of a difference that rounding must make, too, to be its cause."""

ELECTRIC = {"V_m", "V_th", "V_reset", "V_min", "E_L", "C_m", "I_e", "amplitude"}
"""Words of cells and currents whose last places are moved; others decide when something is sent or drawn."""

FIXED = {"Wmin", "Wmax", "deliver_interval", "mu_plus", "mu_minus"}
"""Numbers of rules that stay as they are: weights begin at their bounds, and some exponents are ways of their own."""

C = TypeVar("C", bound=Choice)

RESOLUTIONS = (0.05, 0.1, 0.2, 0.5, 1.0)
MUS = (0.0, 0.3, 1.0, 2.0)


@dataclass(frozen=True, slots=True)
class Act:
    """What is done at one moment: a method of a simulation and its arguments."""

    method: str
    arguments: tuple[Any, ...]
    values: tuple[tuple[str, Any], ...] = ()

    def on(self, sim: Simulation) -> None:
        """Do it; times of spikes are counted from the present."""
        arguments = list(self.arguments)
        if self.method == "inject":
            population, ahead, ids = arguments
            now = round(sim.time / sim.program.resolution)
            arguments = [population, (np.array(ahead) + now) * sim.program.resolution, list(ids)]
        getattr(sim, self.method)(*arguments, **dict(self.values))


@dataclass(frozen=True, slots=True)
class Scenario:
    """A network and what is done with it: runs of some steps, each after some acts.

    Attributes:
        grain: steps of which all moments are a multiple: NEST brings synapses under dopamine up to date on this grid.
    """

    net: Network
    seed: int
    grain: int
    parts: tuple[tuple[tuple[Act, ...], int], ...]

    def play(self, sim: Simulation) -> Iterator[Simulation]:
        """Run part by part; yield the simulation after each."""
        for acts, steps in self.parts:
            for act in acts:
                act.on(sim)
            sim.run(steps * sim.program.resolution)
            yield sim


def read(sim: Simulation) -> Found:
    """What every backend shows of a simulation at one moment: all spikes so far, potentials, states of synapses.

    Weights and eligibilities of a rule are in shares of its Wmax, since their unit is whatever the target takes.
    """
    found: Found = {}
    for population in sim.program.populations:
        name = population.name
        if population.records:
            times, ids = sim.spikes(name)
            found[f"spikes of {name}"] = np.stack((np.rint(times / sim.program.resolution).astype(np.int64), ids))
        if any(state.name == "V_m" for state in population.model.states):
            found[f"V_m of {name}"] = sim.get(name, "V_m")
    for projection in sim.program.projections:
        for word in ["weight", *(state.name for state in projection.synapse.states if not state.hidden)]:
            unit = projection.synapse.parameters().get("Wmax", 1.0)
            found[f"{word} of {projection.name}"] = sim.get(projection.name, word) / unit
    return found


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    """A network of up to three populations of cells, and what is done with it."""
    h, shortest = draw(st.sampled_from(RESOLUTIONS)), draw(st.sampled_from([1, 1, 2, 5]))
    interval = draw(st.sampled_from([1, 1, 3, 10]))
    net = Network("random", resolution=h)
    _add_sources(draw, net)
    cells = [f"cells{index}" for index in range(draw(st.integers(1, 3)))]
    for name in cells:
        net.population(name, draw(st.integers(1, 5)), draw(_cells(h)))
    _drive(draw, net, cells, shortest)
    for name in cells:
        if draw(st.booleans()):
            net.signal(f"signal_{name}", to=name)
    for _ in range(draw(st.integers(1, 5))):
        _connect(draw, net, cells, shortest, interval)
    grain = shortest * interval
    parts = [
        (_acts(draw, net, cells), grain * draw(st.integers(1, -(-90 // grain)))) for _ in range(draw(st.integers(1, 4)))
    ]
    if draw(st.integers(0, 11)) == 7:  # the simplest draws, which come first, have none
        hush = Act("set", ("noise",), (("rate", 0.0),))
        rouse = Act("inject", ("listed", tuple(range(2, 30)), tuple(k % 3 for k in range(28))))
        parts += [((hush,), SILENCE // grain * grain), ((rouse,), grain * -(-60 // grain))]
    return Scenario(net, draw(st.integers(0, 99)), grain, tuple(parts))


def _add_sources(draw: st.DrawFn, net: Network) -> None:
    """Noise, listed spikes, a current, and parrots that say what the noise says."""
    h = net.resolution
    per_step = draw(st.sampled_from([0.002, 0.03, 0.2, 1.5]))
    net.population("noise", 3, poisson_generator(rate=per_step * 1000.0 / h))
    rows = draw(st.lists(st.lists(st.integers(1, 90), max_size=8), min_size=3, max_size=3))
    net.population("listed", 3, spike_generator(spike_times=[[k * h for k in sorted(row)] for row in rows]))
    start, length = draw(st.integers(0, 20)), draw(st.integers(0, 200))
    net.population("current", 2, dc_generator(amplitude=1.0, start=start * h, stop=(start + length) * h))
    net.population("relay", 3, parrot_neuron())


@st.composite
def _cells(draw: st.DrawFn, h: float) -> Model:
    kind = draw(st.sampled_from([iaf_psc_delta, iaf_psc_exp, iaf_psc_alpha, izhikevich, parrot_neuron]))
    tau_minus = draw(st.sampled_from([20.0, 1.0, uniform(low=5.0, high=40.0)]))
    if kind is parrot_neuron:
        return parrot_neuron(tau_minus=tau_minus)
    if kind is izhikevich:
        a, b, c, d = draw(st.sampled_from([(0.02, 0.2, -65.0, 8.0), (0.1, 0.2, -50.0, 2.0), (0.02, 0.25, -65.0, 0.05)]))
        return izhikevich(a=a, b=b, c=c, d=d, I_e=draw(st.sampled_from([0.0, 4.0, 10.0])), tau_minus=tau_minus)
    tau_m = draw(st.one_of(st.sampled_from([1.0, 10.0, 500.0]), st.floats(0.5, 100.0)))
    rest = draw(st.sampled_from([-70.0, 0.0]))
    words: dict[str, Any] = {
        "tau_m": draw(st.sampled_from([tau_m, tau_m, uniform(low=tau_m, high=2.0 * tau_m)])),
        "C_m": draw(st.sampled_from([250.0, 1.0, 1e4])),
        "t_ref": draw(st.sampled_from([0, 0, 1, 3, 25])) * h,
        "E_L": rest,
        "V_reset": rest + draw(st.sampled_from([0.0, -5.0, 0.25])),
        "V_th": draw(st.sampled_from([rest + 15.0, rest + 1.0, uniform(low=rest + 0.5, high=rest + 20.0)])),
        "I_e": draw(st.sampled_from([0.0, 0.0, 400.0, 1e5, uniform(low=0.0, high=500.0)])),
        "tau_minus": tau_minus,
    }
    if kind is not iaf_psc_exp:
        words["V_min"] = draw(st.sampled_from([-np.inf, rest - 6.0]))
    if kind is iaf_psc_delta:
        return iaf_psc_delta(**words, refractory_input=draw(st.booleans()))
    near = tau_m * (1.0 + draw(st.sampled_from([0.0, 1e-13, -1e-11, 1e-9, -1e-7, 1e-5, -1e-3])))
    words["tau_syn_ex"] = draw(st.one_of(st.just(near), st.sampled_from([0.2, 2.0, 60.0])))
    words["tau_syn_in"] = draw(st.one_of(st.just(near), st.sampled_from([0.2, 2.0, 60.0])))
    return iaf_psc_exp(**words) if kind is iaf_psc_exp else iaf_psc_alpha(**words)


def _kick(net: Network, post: str) -> float:
    """A weight of which one spike or two make a cell fire."""
    model = net.populations[post].model
    if not isinstance(model, iaf_psc_exp | iaf_psc_alpha):
        return {"iaf_psc_delta": 12.0, "izhikevich": 30.0}.get(model.name, 1.0)
    words = model.parameters()
    shortest = min(float(words["tau_syn_ex"]), float(words["tau_syn_in"]))
    return 30.0 * float(words["C_m"]) / shortest


def _drive(draw: st.DrawFn, net: Network, cells: list[str], shortest: int) -> None:
    """Every population hears something; one delay is the shortest, so that it is known."""
    h = net.resolution
    net.connect("noise", "relay", one_to_one(), delay=shortest * h, name="noise_relay")
    for name in cells:
        heard = draw(st.sampled_from(["noise", "listed", "relay"]))
        unit = _kick(net, name)
        weight: Any = draw(st.sampled_from([unit, 0.3 * unit, -0.5 * unit, uniform(low=-unit, high=1.5 * unit)]))
        net.connect(heard, name, all_to_all(), weight=weight, delay=draw(_delays(h, shortest)), name=f"drive_{name}")
        wanted = draw(st.booleans())
        if wanted and net.populations[name].model.states:
            amount = draw(st.sampled_from([0.5, -2.0, 20.0]))
            net.connect("current", name, all_to_all(), weight=amount, delay=draw(_delays(h, shortest)))


@st.composite
def _delays(draw: st.DrawFn, h: float, shortest: int) -> Any:
    steps = draw(st.one_of(st.integers(shortest, shortest + 4), st.integers(shortest, 60)))
    return draw(st.sampled_from([steps * h, uniform(low=shortest * h, high=(steps + 1) * h)]))


@st.composite
def _rules(draw: st.DrawFn, n_pre: int, n_post: int) -> Rule:
    ids = st.tuples(st.integers(0, n_pre - 1), st.integers(0, n_post - 1))
    listed = draw(st.lists(ids, min_size=1, max_size=10))
    choices = [all_to_all(), fixed_indegree(n=draw(st.integers(1, 4)))]
    choices.append(pairs(pre=[pre for pre, _ in listed], post=[post for _, post in listed]))
    return draw(st.sampled_from([*choices, one_to_one()] if n_pre == n_post else choices))


def _connect(draw: st.DrawFn, net: Network, cells: list[str], shortest: int, interval: int) -> None:
    """One more projection onto cells: fixed, of spike pairs, or under dopamine of a signal or of any who spike."""
    post, h = draw(st.sampled_from(cells)), net.resolution
    parrots = [name for name, part in net.populations.items() if part.model.name == "parrot_neuron"]
    deaf = ["current", *(parrots if post in parrots else [])]
    pre = draw(st.sampled_from([name for name in net.populations if name not in deaf]))
    synapse = draw(_synapses(net, post, shortest, interval))
    unit = 0.5 * _kick(net, post)
    weight: Any = draw(st.sampled_from([unit, -unit, 0.0, uniform(low=-unit, high=unit)]))
    if synapse.learns:
        w_max = synapse.parameters()["Wmax"]
        weight = draw(st.sampled_from([0.0, w_max, 0.5 * w_max, uniform(low=0.0, high=w_max)]))
    rule = draw(_rules(*(int(net.populations[name].shape[0]) for name in (pre, post))))
    net.connect(
        pre, post, rule, synapse, weight=weight, delay=draw(_delays(h, shortest)), name=f"wires{len(net.projections)}"
    )


@st.composite
def _synapses(draw: st.DrawFn, net: Network, post: str, shortest: int, interval: int) -> Synapse:
    w_max = draw(st.sampled_from([1.0, 0.1])) * _kick(net, post)
    tau_plus = draw(st.sampled_from([20.0, 2.0]))
    match draw(st.integers(0, 3)):
        case 0:
            return static()
        case 1:
            mus = {"mu_plus": draw(st.sampled_from(MUS)), "mu_minus": draw(st.sampled_from(MUS))}
            return stdp(lambda_=draw(st.sampled_from([0.01, 0.5])), alpha=1.1, tau_plus=tau_plus, Wmax=w_max, **mus)
    source: dict[str, Any] = {}
    if f"signal_{post}" in net.signals and draw(st.booleans()):
        source = {"signal": f"signal_{post}"}
    elif draw(st.integers(0, 3)):
        late = draw(st.sampled_from([shortest, shortest + 1, shortest + 20]))
        spiking = draw(st.sampled_from([name for name in net.populations if name != "current"]))
        source = {"dopamine": spiking, "dopamine_delay": late * net.resolution}
    step = draw(st.sampled_from([0.01, 0.3])) * w_max
    return stdp_dopa(
        A_plus=step,
        A_minus=draw(st.sampled_from([0.0, 1.5])) * step,
        tau_plus=tau_plus,
        tau_c=draw(st.sampled_from([1000.0, 10.0])),
        tau_n=draw(st.sampled_from([200.0, 5.0])),
        b=draw(st.sampled_from([0.0, 0.02, -0.01])),
        Wmax=w_max,
        deliver_interval=interval,
        **source,
    )


def _acts(draw: st.DrawFn, net: Network, cells: list[str]) -> tuple[Act, ...]:
    """Up to four changes between two runs."""
    return tuple(_act(draw, net, cells) for _ in range(draw(st.integers(0, 4))))


def _act(draw: st.DrawFn, net: Network, cells: list[str]) -> Act:
    name = draw(st.sampled_from(cells))
    match draw(st.integers(0, 5)):
        case 0:
            ahead = draw(st.lists(st.integers(1, 100), min_size=1, max_size=6))
            return Act("inject", ("listed", tuple(ahead), tuple(k % 3 for k in ahead)))
        case 1:
            return Act("set", ("noise",), (("rate", draw(st.sampled_from([0.0, 30.0, 400.0])) / net.resolution),))
        case 2 if f"signal_{name}" in net.signals:
            return Act("signal", (f"signal_{name}", draw(st.sampled_from([0.0, 0.05, -0.05, 1.0]))))
        case 3:
            fixed = [p.name for p in net.projections.values() if not p.synapse.learns]
            chosen = net.projections[draw(st.sampled_from(fixed))]
            unit = 1.0 if chosen.source == "current" else _kick(net, chosen.target)
            return Act("set_weights", (chosen.name, draw(st.sampled_from([0.0, 0.4, 1.0])) * unit))
        case 4:
            return Act("set", ("current",), (("amplitude", draw(st.sampled_from([0.0, 300.0, -2.0]))),))
    return _change(draw, net, name)


def _change(draw: st.DrawFn, net: Network, name: str) -> Act:
    """A parameter or potential of cells; nothing where there is none."""
    model, h = net.populations[name].model, net.resolution
    if model.name == "parrot_neuron":
        return Act("set", ("noise",), (("rate", 100.0),))
    if model.name == "izhikevich":
        word = draw(st.sampled_from(["I_e", "V_m"]))
        return Act("set", (name,), ((word, {"I_e": 12.0, "V_m": -60.0}[word]),))
    rest = float(model.parameters()["E_L"])
    choices = {
        "I_e": [0.0, 450.0, -450.0],
        "V_m": [rest, rest + 0.4, rest - 30.0],
        "t_ref": [0.0, 2.0 * h, 30.0 * h],
        "V_th": [rest + 2.0, rest + 15.0],
        "tau_m": [0.7, 10.0, 300.0],
        "C_m": [200.0],
    }
    word = draw(st.sampled_from(list(choices)))
    return Act("set", (name,), ((word, draw(st.sampled_from(choices[word]))),))


def differences(expected: Found, found: Found) -> dict[str, float]:
    """How far two readings are apart in what differs.

    Spikes must be equal, all else within 1e-9, or 1e-12 of a large number.

    Returns:
        by quantity: the number of spikes that only one has, or the largest distance; infinite if it is no number.
    """
    apart = {}
    for name, right in expected.items():
        value = found[name]
        if right.dtype.kind == "f":
            distance = np.abs(value - right)
            if not np.all(distance <= LIMIT + RELATIVE * np.abs(right)):
                apart[name] = float(np.max(np.nan_to_num(distance, nan=np.inf, posinf=np.inf)))
        elif value.shape != right.shape or np.any(value != right):
            ours, theirs = (Counter(zip(*rows.tolist(), strict=True)) for rows in (value, right))
            apart[name] = float(((ours - theirs) + (theirs - ours)).total())
    return apart


def nudged(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """The same network and acts with numbers moved by a few units in the last place, as other orders of sums might.

    Moved are potentials, thresholds, capacities, currents, fixed weights and numbers of rules, before anything runs: it
    takes the same way through a backend.
    """
    net = copy(scenario.net)
    net.populations = {
        name: replace(part, model=_moved(part.model, rng, ELECTRIC)) for name, part in net.populations.items()
    }
    net.projections = {name: _moved_projection(part, rng) for name, part in net.projections.items()}
    parts = tuple((tuple(_moved_act(act, rng) for act in acts), steps) for acts, steps in scenario.parts)
    return replace(scenario, net=net, parts=parts)


def _moved_projection(part: Projection, rng: np.random.Generator) -> Projection:
    if not part.synapse.learns:
        return replace(part, weight=_off(part.weight, rng))
    numbers = set(part.synapse.numbers()) - FIXED
    return replace(part, synapse=_moved(part.synapse, rng, numbers))


def _moved_act(act: Act, rng: np.random.Generator) -> Act:
    if act.method in ("set_weights", "signal"):
        name, value = act.arguments
        return replace(act, arguments=(name, _off(value, rng)))
    values = tuple((word, _off(value, rng) if word in ELECTRIC else value) for word, value in act.values)
    return replace(act, values=values)


def _moved(choice: C, rng: np.random.Generator, words: Set[str]) -> C:
    own = {field.name: getattr(choice, field.name) for field in fields(choice) if word_of(field.name) in words}
    return replace(choice, **{name: _off(value, rng) for name, value in own.items()})


def _off(value: Any, rng: np.random.Generator) -> Any:
    if isinstance(value, uniform):
        return uniform(low=_off(value.low, rng), high=_off(value.high, rng))
    return float(value) * (1.0 + int(rng.integers(-UNITS, UNITS + 1)) * np.finfo(np.float64).eps)


def amplifies_rounding(
    scenario: Scenario, play: Callable[[Scenario], Sequence[Found]], readings: Sequence[Found], apart: dict[str, float]
) -> bool:
    """Whether a last place that changes in a scenario moves all that differs, about as far or farther.

    Args:
        scenario: what was run.
        play: runs another on the backend that gave the readings.
        readings: what that backend gave after each part, up to the one in question.
        apart: what is to be explained of the last reading, as of `differences`.
    """
    left = {name: SHARE * distance for name, distance in apart.items()}
    for twin in range(TWINS):
        moved = differences(readings[-1], play(nudged(scenario, np.random.default_rng(twin)))[len(readings) - 1])
        left = {name: distance for name, distance in left.items() if not moved.get(name, 0.0) >= distance}
        if not left:
            return True
    return False
