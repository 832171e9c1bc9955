"""Cases that compare two runs on one backend: divided runs, saved states, threads, seeds and resets."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from neuro.model.distributions import normal, uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    Generator,
    dc_generator,
    iaf_psc_alpha,
    iaf_psc_delta,
    iaf_psc_exp,
    izhikevich,
    parrot_neuron,
    poisson_generator,
    spike_generator,
)
from neuro.model.parts import winner_take_all
from neuro.model.rules import all_to_all, fixed_indegree, one_to_one, pairwise_bernoulli
from neuro.model.synapses import stdp, stdp_dopa
from neuro.program.backend import OverflowWarning
from neuro.run.simulation import Simulation
from neuro.testing.case import (
    CASES,
    Case,
    Found,
    Start,
    about,
    counted,
    expected_counts,
    integers_too,
    law,
    network,
    observe,
)
from neuro.testing.trials import recogniser, simulation_after_trials


@dataclass(frozen=True, slots=True)
class Subject:
    """A network on which laws are tested; its populations "relay" and "exp" spike at random.

    Attributes:
        suffix: suffix of the names of its cases.
        about: description of the network.
        make: function that returns the network.
        steer: function that changes parameters and states; called with 0 at the start of a run, with 1 in the middle.
        floats: whether the network needs floats, so that a backend with integer arithmetic skips it.
    """

    suffix: str
    about: str
    make: Callable[[], Network]
    steer: Callable[[Simulation, int], None]
    floats: bool = False


def rich() -> Network:
    """Return a recurrent network of all models and rules, with noise, dopamine and a signal."""
    net = network()
    net.population("noise", 12, poisson_generator(rate=700.0))
    net.population("relay", 12, parrot_neuron())
    net.population("exp", 12, iaf_psc_exp(tau_m=uniform(low=8.0, high=15.0)), initial={"V_m": -60.0})
    net.population("delta", 9, iaf_psc_delta(V_th=-60.0))
    net.population("alpha", 6, iaf_psc_alpha(I_e=300.0))
    net.population("izhi", 5, izhikevich(I_e=6.0))
    net.signal("reward", to="delta")
    net.connect("noise", "relay", one_to_one(), delay=0.1)
    net.connect("relay", "exp", one_to_one(), weight=350.0, delay=0.4)
    net.connect("exp", "exp", pairwise_bernoulli(p=0.3), weight=normal(mean=50, std=90), delay=uniform(low=0.1, high=4))
    net.connect("exp", "delta", all_to_all(), stdp(Wmax=6.0, lambda_=0.1), weight=3.0, delay=1.5)
    rule = stdp_dopa(signal="reward", Wmax=9.0, A_plus=0.1, A_minus=0.08, tau_n=30.0)
    net.connect("relay", "delta", fixed_indegree(n=5), rule, weight=2.0, delay=uniform(low=0.1, high=2))
    dopamine = stdp_dopa(dopamine="izhi", Wmax=400.0, A_plus=2.0, b=0.01, tau_n=20.0, deliver_interval=7)
    net.connect("delta", "alpha", all_to_all(), dopamine, weight=200.0, delay=0.8)
    net.connect("alpha", "izhi", fixed_indegree(n=3), weight=5.0, delay=2.0)
    return net


def steer_rich(sim: Simulation, half: int) -> None:
    """Change a rate, a learning rate and a signal."""
    sim.set("noise", rate=(500.0, 900.0)[half])
    sim.set("exp_delta", lambda_=(0.1, 0.02)[half])
    sim.signal("reward", 0.05 * half)


def wired() -> Network:
    """Return a recurrent network for chips, with fixed weights, noise, listed spikes, currents and a group."""
    net = network(1.0)
    net.population("noise", 12, poisson_generator(rate=50.0))
    times = [np.arange(3.0 + k, 200.0, 17.0 + k) for k in range(3)]
    net.population("listed", 3, spike_generator(spike_times=times))
    net.population("current", 1, dc_generator(amplitude=150.0, start=20.0, stop=300.0))
    net.population("relay", 12, parrot_neuron())
    net.population("exp", 12, iaf_psc_exp(tau_m=uniform(low=8.0, high=15.0)), initial={"V_m": -60.0})
    net.population("delta", 9, iaf_psc_delta(V_th=-60.0, t_ref=1.0))
    net.connect("noise", "relay", one_to_one(), delay=1.0)
    net.connect("relay", "exp", one_to_one(), weight=900.0, delay=4.0)
    net.connect("exp", "exp", pairwise_bernoulli(p=0.3), weight=normal(mean=80, std=150), delay=uniform(low=1, high=9))
    net.connect("exp", "delta", all_to_all(), weight=np.tile([4.0, 3.0, -1.0], (12, 3)), delay=2.0)
    net.connect("relay", "delta", fixed_indegree(n=5), weight=normal(mean=2.0, std=2.0), delay=3.0)
    net.connect("listed", "exp", all_to_all(), weight=uniform(low=0.0, high=500.0), delay=2.0)
    net.connect("current", "exp", all_to_all())
    net.group("choice", winner_take_all(of="delta", first_to_fire=False))
    return net


def steer_wired(sim: Simulation, half: int) -> None:
    """Change rates, currents, parameters, states and weights, and inject spikes."""
    sim.set("noise", rate=(40.0, np.linspace(0.0, 90.0, 12))[half])
    sim.set("current", amplitude=(150.0, 60.0)[half])
    sim.set("exp", V_th=(-55.0, -56.5)[half], tau_m=(10.0, np.linspace(8.0, 14.0, 12))[half])
    sim.set("exp", V_m=np.linspace(-70.0, -58.0, 12))
    sim.set_weights("exp_delta", (3.0, np.linspace(-1.0, 4.0, 108))[half])
    sim.inject("listed", sim.time + np.array([1.0, 1.0, 30.0]), [0, 2, 1])


def learning() -> Network:
    """Return a network that learns by stdp, and by stdp_dopa with a signal and with dopamine spikes."""
    net = network(1.0)
    net.population("noise", 12, poisson_generator(rate=40.0))
    net.population("relay", 12, parrot_neuron())
    net.population("exp", 6, iaf_psc_exp(), initial={"V_m": -60.0})
    net.population("delta", 4, iaf_psc_delta(V_th=-60.0, t_ref=1.0))
    net.population("reached", 5, iaf_psc_delta(V_th=-64.0, tau_m=20.0))
    net.population("taught", 4, iaf_psc_delta(V_th=-60.0, t_ref=1.0))
    net.signal("reward", to="delta")
    net.connect("noise", "relay", one_to_one(), delay=1.0)
    rule = stdp(Wmax=900.0, lambda_=0.1)
    net.connect("relay", "exp", all_to_all(), rule, weight=uniform(low=200.0, high=800.0), delay=2.0)
    # SpiNNaker accepts only eligibilities without a sign, and only one rule for each target population.
    taught: dict[str, Any] = {"Wmax": 9.0, "A_plus": 0.1, "A_minus": 0.0, "tau_n": 30.0, "tau_c": 100.0}
    net.connect("relay", "delta", fixed_indegree(n=5), stdp_dopa(signal="reward", **taught), weight=4.0, delay=3.0)
    by_spikes = stdp_dopa(dopamine="exp", dopamine_delay=4, **taught)
    net.connect("exp", "taught", all_to_all(), by_spikes, weight=6.0, delay=1.0)
    net.connect("exp", "reached", fixed_indegree(n=3), stdp(Wmax=8.0, lambda_=0.1), weight=4.0, delay=5.0)
    return net


def steer_learning(sim: Simulation, half: int) -> None:
    """Change a rate, a threshold, weights and a signal."""
    sim.set("noise", rate=(40.0, 60.0)[half])
    sim.set("exp", V_th=(-55.0, -57.0)[half])
    if half:
        sim.set_weights("relay_exp", np.linspace(200.0, 700.0, 72))
    sim.signal("reward", (0.02, -0.01)[half])


SUBJECTS = (
    Subject("", "all models and rules", rich, steer_rich, floats=True),
    Subject("_of_fixed_weights", "fixed weights, for chips", wired, steer_wired),
    Subject("_of_learning", "pairwise learning, for chips", learning, steer_learning),
)


CUTS = (1, 33, 5, 121, 1, 1, 238)
"""Lengths in steps of the pieces of a divided run."""

HALVES = (200, 200)
"""Lengths in steps of a run whose parameters change in the middle."""
Law = Callable[[Start, Subject], tuple[Found, Found]]
"""Function that runs a network in two ways, and returns both outcomes. The law holds if they are equal."""


def networks_law(function: Law) -> Law:
    """Register a law as a case for each network of `SUBJECTS`."""
    for subject in SUBJECTS:
        name = function.__name__ + subject.suffix
        text = f"{about(function).removesuffix('.')}: {subject.about}."
        CASES[name] = Case(name, text, partial(_without_warnings, function, subject), exact=True, floats=subject.floats)
    return function


def _without_warnings(function: Law, subject: Subject, start: Start) -> tuple[Found, Found]:
    """Evaluate a law, and ignore warnings about overflows, since both runs must overflow equally."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OverflowWarning)
        return function(start, subject)


def steps(sim: Simulation, n: int) -> None:
    """Run for n steps."""
    sim.run(n * sim.program.resolution)


def steered(sim: Simulation, subject: Subject, cuts: tuple[int, ...] = HALVES) -> Found:
    """Run in pieces with changes at the start and in the middle, and return everything that can be read."""
    for half, pieces in enumerate((cuts[: len(cuts) // 2], cuts[len(cuts) // 2 :])):
        subject.steer(sim, half)
        for n in pieces:
            steps(sim, n)
    return observe(sim)


@networks_law
def cutting_does_not_matter(start: Start, subject: Subject) -> tuple[Found, Found]:
    """A run in pieces, with reads between them, gives the same bits as an undivided run."""

    def cut(sim: Simulation, cuts: tuple[int, ...]) -> Found:
        for n in cuts:
            steps(sim, n)
            outcome = observe(sim)
        return outcome

    return cut(start(subject.make()), (sum(CUTS),)), cut(start(subject.make()), CUTS)


@networks_law
def cutting_does_not_matter_when_steered(start: Start, subject: Subject) -> tuple[Found, Found]:
    """A run in pieces gives the same bits also when parameters and states are changed during the run."""
    pieces = (40, 1, 159, 100, 99, 1)
    return steered(start(subject.make()), subject), steered(start(subject.make()), subject, pieces)


@networks_law
def probes_do_not_matter(start: Start, subject: Subject) -> tuple[Found, Found]:
    """A probe divides the run at its steps and changes no bit."""

    def run(sim: Simulation) -> Found:
        steps(sim, 300)
        return {k: v for k, v in observe(sim).items() if not k.startswith("trace")}

    return run(start(subject.make())), run(start(_probed(subject)))


def _probed(subject: Subject) -> Network:
    net = subject.make()
    net.probe("V_m", "exp", "V_m", every=7 * net.resolution)
    return net


@networks_law
def a_seed_repeats(start: Start, subject: Subject) -> tuple[Found, Found]:
    """The same seed gives the same run."""
    run, repetition = (steered(start(subject.make(), seed=7), subject) for _ in range(2))
    return run, repetition


@networks_law
def seeds_differ(start: Start, subject: Subject) -> tuple[Found, Found]:
    """Another seed gives another run."""
    a, b = (steered(start(subject.make(), seed=seed), subject) for seed in (7, 8))
    message = "spikes of {}: steps"
    equal = [name for name in ("relay", "exp") if np.array_equal(a[message.format(name)], b[message.format(name)])]
    return {"populations with equal spikes": np.array(0)}, {"populations with equal spikes": np.array(len(equal))}


@networks_law
def threads_do_not_matter(start: Start, subject: Subject) -> tuple[Found, Found]:
    """Two threads give the same bits as one."""
    return steered(start(subject.make()), subject), steered(start(subject.make(), threads=2), subject)


@networks_law
def a_reset_repeats(start: Start, subject: Subject) -> tuple[Found, Found]:
    """After a reset with weights the run is the same again."""
    sim = start(subject.make())
    first = steered(sim, subject)
    sim.reset(weights=True)
    return first, steered(sim, subject)


@networks_law
def a_reset_keeps_weights(start: Start, subject: Subject) -> tuple[Found, Found]:
    """A reset without weights keeps learnt weights and weights that were set."""
    sim = start(subject.make())
    steered(sim, subject)
    names = [part.name for part in sim.program.projections]
    weights = {name: sim.get(name, "weight") for name in names}
    sim.reset()
    return weights | {"time": np.array(0.0)}, {n: sim.get(n, "weight") for n in names} | {"time": np.array(sim.time)}


@networks_law
def another_population_does_not_matter(start: Start, subject: Subject) -> tuple[Found, Found]:
    """An additional population changes no random number of the others."""
    plain = subject.make()
    more = network(plain.resolution)
    more.population("unrelated", 3, poisson_generator(rate=100.0))
    more.populations.update(plain.populations)
    more.signals.update(plain.signals)
    more.groups.update(plain.groups)
    more.projections.update(plain.projections)
    outcome = steered(start(more), subject)
    return steered(start(plain), subject), {name: v for name, v in outcome.items() if "unrelated" not in name}


@networks_law
def counts_follow_from_spikes(start: Start, subject: Subject) -> tuple[Found, Found]:
    """The counts that all backends share agree with the recorded spikes and the connections."""
    net = subject.make()
    for part in subject.make().populations.values():
        if isinstance(part.model, Generator) and not isinstance(part.model, dc_generator):
            net.probe(f"spikes_{part.name}", part.name)
    sim = start(net)
    steered(sim, subject)
    return expected_counts(sim), counted(sim)


def _resumed(start: Start, net: Callable[[], Network], use: Callable[[Simulation], Found]) -> tuple[Found, Found]:
    """Use a simulation twice, and compare it with a simulation that is restored between both uses.

    Return the values after the first use and after the second use ("later: ..."), of the uninterrupted and of the
    restored simulation.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "state.h5"
        uninterrupted, saved, resumed = start(net()), start(net()), start(net())
        use(uninterrupted)
        use(saved)
        saved.save(file)
        resumed.run(5.0)
        resumed.restore(file)
        return {**observe(saved), **_later(use(uninterrupted))}, {**observe(resumed), **_later(use(resumed))}


def _later(outcome: Found) -> Found:
    return {f"later: {name}": values for name, values in outcome.items()}


@networks_law
def a_saved_state_continues(start: Start, subject: Subject) -> tuple[Found, Found]:
    """A state restored in another simulation reads the same and continues bit for bit, including probes."""
    return _resumed(start, lambda: _probed(subject), lambda sim: steered(sim, subject))


@networks_law
def a_state_saved_after_a_change_continues(start: Start, subject: Subject) -> tuple[Found, Found]:
    """A state that is saved directly after changes, before their effect, continues bit for bit when restored."""

    def use(sim: Simulation) -> Found:
        steps(sim, 57)
        subject.steer(sim, 1)
        return observe(sim)

    return _resumed(start, subject.make, use)


@integers_too
@law
def saved_trials_continue(start: Start) -> tuple[Found, Found]:
    """Trials continue bit for bit from a saved state, including dropout."""
    return _resumed(start, lambda: recogniser(dropout={"of": "maps", "p": 0.4}), simulation_after_trials)


@integers_too
@law
def cutting_a_batch_does_not_matter(start: Start) -> tuple[Found, Found]:
    """Trials in two batches give the same bits as in one batch."""
    from neuro.testing.trials import batch

    times, ids, offsets, labels = batch(12)
    samples, middle = np.arange(12) // 4, offsets[6]
    whole, parts = (start(recogniser(dropout={"of": "maps", "p": 0.4})) for _ in range(2))
    whole.trials(times, ids, offsets, labels, learn=True, samples=samples)
    parts.trials(times[:middle], ids[:middle], offsets[:7], labels[:6], learn=True, samples=samples[:6])
    parts.trials(times[middle:], ids[middle:], offsets[6:] - middle, labels[6:], learn=True, samples=samples[6:])
    return observe(whole), observe(parts)
