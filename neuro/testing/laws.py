"""Cases that hold on one backend by itself: cutting, saving, threads, seeds, reset."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from neuro.distributions import normal, uniform
from neuro.network import Network
from neuro.neurons import iaf_psc_alpha, iaf_psc_delta, iaf_psc_exp, izhikevich, parrot_neuron, poisson_generator
from neuro.rules import all_to_all, fixed_indegree, one_to_one, pairwise_bernoulli
from neuro.simulation import Simulation
from neuro.synapses import stdp, stdp_dopa
from neuro.testing.case import Found, Start, law, network, observe
from neuro.testing.trials import recogniser, simulation_after_trials

CUTS = (0.1, 3.3, 0.5, 12.1, 0.1, 0.1, 23.8)


def rich() -> Network:
    """A recurrent network of all models and rules, with noise, dopamine and a signal."""
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


def steered(sim: Simulation, cuts: tuple[float, ...] = (20.0, 20.0)) -> Found:
    """Run in pieces, 40 ms in all, with a signal at 20 ms, and read everything."""
    done = 0.0
    for half in (cuts[: len(cuts) // 2], cuts[len(cuts) // 2 :]):
        for ms in half:
            sim.run(ms)
            done = round(done + ms, 6)
        sim.signal("reward", 0.05)
    return observe(sim)


@law
def cutting_does_not_matter(start: Start) -> tuple[Found, Found]:
    """Running in pieces, with reads between them, gives the same bits as running at once."""
    whole, pieces = start(rich()), start(rich())
    whole.run(40.0)
    for ms in CUTS:
        pieces.run(ms)
        observe(pieces)
    return observe(whole), observe(pieces)


@law
def cutting_does_not_matter_when_steered(start: Start) -> tuple[Found, Found]:
    """The same with a signal on the way."""
    return steered(start(rich())), steered(start(rich()), (4.0, 0.1, 15.9, 10.0, 9.9, 0.1))


@law
def probes_do_not_matter(start: Start) -> tuple[Found, Found]:
    """A probe cuts the run at its steps and changes nothing."""
    probed = rich()
    probed.probe("V_m", "exp", "V_m", every=0.7)
    plain, other = start(rich()), start(probed)
    plain.run(30.0)
    other.run(30.0)
    return observe(plain), {k: v for k, v in observe(other).items() if not k.startswith("trace")}


@law
def a_seed_repeats(start: Start) -> tuple[Found, Found]:
    """The same seed gives the same run."""
    return steered(start(rich(), seed=7)), steered(start(rich(), seed=7))


@law
def seeds_differ(start: Start) -> tuple[Found, Found]:
    """Another seed gives another run."""
    a, b = steered(start(rich(), seed=7)), steered(start(rich(), seed=8))
    told = "spikes of {}: steps"
    alike = [name for name in ("relay", "exp") if np.array_equal(a[told.format(name)], b[told.format(name)])]
    return {"populations that spike alike": np.array(0)}, {"populations that spike alike": np.array(len(alike))}


@law
def threads_do_not_matter(start: Start) -> tuple[Found, Found]:
    """Two threads give the bits of one."""
    return steered(start(rich())), steered(start(rich(), threads=2))


@law
def a_reset_repeats(start: Start) -> tuple[Found, Found]:
    """After a reset with weights the run is the same again."""
    sim = start(rich())
    first = steered(sim)
    sim.reset(weights=True)
    return first, steered(sim)


@law
def a_reset_keeps_weights(start: Start) -> tuple[Found, Found]:
    """A reset without weights keeps what was learnt."""
    sim = start(rich())
    steered(sim)
    names = ("exp_delta", "relay_delta", "delta_alpha")
    before = {name: sim.get(name, "weight") for name in names}
    sim.reset()
    return before | {"time": np.array(0.0)}, {n: sim.get(n, "weight") for n in names} | {"time": np.array(sim.time)}


@law
def another_population_does_not_matter(start: Start) -> tuple[Found, Found]:
    """A population that is added changes no draw of the others."""
    more = network()
    more.population("unrelated", 3, poisson_generator(rate=100.0))
    for part in rich().populations.values():
        more.population(part.name, part.shape, part.model, initial=part.initial)
    more.signals.update(rich().signals)
    for wires in rich().projections.values():
        more.connect(
            wires.source,
            wires.target,
            wires.rule,
            wires.synapse,
            weight=wires.weight,
            delay=wires.delay,
            name=wires.name,
        )
    found = steered(start(more))
    return steered(start(rich())), {name: values for name, values in found.items() if "unrelated" not in name}


def _resumed(start: Start, net: Callable[[], Network], use: Callable[[Simulation], Found]) -> tuple[Found, Found]:
    """Use a simulation twice; and use it once, save, restore elsewhere, use that."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "state.h5"
        through, saved, resumed = start(net()), start(net()), start(net())
        use(through)
        use(saved)
        saved.save(file)
        resumed.run(5.0)
        resumed.restore(file)
        return use(through), use(resumed)


@law
def a_saved_state_continues(start: Start) -> tuple[Found, Found]:
    """A state saved and restored elsewhere continues bit for bit, with plastic synapses, rates and probes."""

    def net() -> Network:
        made = rich()
        made.probe("V_m", "exp", "V_m", every=0.7)
        return made

    def use(sim: Simulation) -> Found:
        sim.set("noise", rate=900.0 if sim.time else 500.0)
        sim.set("exp_delta", lambda_=0.02)
        return steered(sim)

    return _resumed(start, net, use)


@law
def saved_trials_continue(start: Start) -> tuple[Found, Found]:
    """Trials saved and restored continue bit for bit, dropout included."""
    return _resumed(start, lambda: recogniser(dropout={"of": "maps", "p": 0.4}), simulation_after_trials)


@law
def cutting_a_batch_does_not_matter(start: Start) -> tuple[Found, Found]:
    """Trials in two batches give the bits of one batch."""
    from neuro.testing.trials import batch

    times, ids, offsets, labels = batch(12)
    samples, middle = np.arange(12) // 4, offsets[6]
    whole, parts = (start(recogniser(dropout={"of": "maps", "p": 0.4})) for _ in range(2))
    whole.trials(times, ids, offsets, labels, learn=True, samples=samples)
    parts.trials(times[:middle], ids[:middle], offsets[:7], labels[:6], learn=True, samples=samples[:6])
    parts.trials(times[middle:], ids[middle:], offsets[6:] - middle, labels[6:], learn=True, samples=samples[6:])
    return observe(whole), observe(parts)
