"""Random small networks that are run, steered and read on the way, for hypothesis: what NEST, too, can do.

Everything is drawn wider than a modeller would: time constants that nearly equal, thresholds that are met exactly,
silence of 10,000 steps, delays of 1 step and of 150, synapses of a neuron onto itself and several between two, weights
at their bounds; resets and returns to a saved state. Cells and synapses come first, with what makes them fire and what
may be set; then networks of them and what is done with these. Needs the package hypothesis, which only tests install.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence, Set
from copy import copy
from dataclasses import dataclass, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np
from hypothesis import strategies as st

import neuro
from built_in import INTEGRATED
from neuro.core.choice import Choice
from neuro.core.quantities import word_of
from neuro.model.distributions import uniform
from neuro.model.network import Network
from neuro.model.neurons import Model
from neuro.model.parts import Projection
from neuro.model.rules import Rule
from neuro.model.synapses import Synapse
from neuro.run.simulation import Simulation
from neuro.testing.case import Found, run_on

PLAIN: tuple[type[Model], ...] = (neuro.iaf_psc_delta, neuro.iaf_psc_exp, neuro.iaf_psc_alpha, neuro.izhikevich)
PLAIN += (neuro.parrot_neuron, neuro.mat2_psc_exp)
"""Cells without an integrator, which the reference runs quickly."""

MUS = (0.0, 0.3, 1.0, 2.0)

EXTREME = (1e-3, 1e6)
"""Time constants far from all steps, ms."""

ADAPTIVE = (neuro.aeif_cond_exp, neuro.aeif_psc_exp)
"""Of several spikes within a step NEST sends all and ours one, so they are refractory for a step at least."""

CONDUCTANCES = (neuro.iaf_cond_exp, neuro.iaf_cond_alpha, neuro.aeif_cond_exp)


@st.composite
def cells(draw: st.DrawFn, h: float, kinds: tuple[type[Model], ...]) -> Model:
    """A model of some kinds, for a network of resolution h."""
    kind = draw(st.sampled_from(kinds))
    tau_minus = draw(st.sampled_from([20.0, 1.0, uniform(low=5.0, high=40.0), *EXTREME]))
    if kind is neuro.parrot_neuron:
        return neuro.parrot_neuron(tau_minus=tau_minus)
    if kind is neuro.izhikevich:
        a, b, c, d = draw(st.sampled_from([(0.02, 0.2, -65.0, 8.0), (0.1, 0.2, -50.0, 2.0), (0.02, 0.25, -65.0, 0.05)]))
        return neuro.izhikevich(a=a, b=b, c=c, d=d, I_e=draw(st.sampled_from([0.0, 4.0, 10.0])), tau_minus=tau_minus)
    if kind is neuro.mat2_psc_exp:
        return draw(_two_thresholds(h, tau_minus))
    return draw(_integrated(h, kind, tau_minus) if kind in INTEGRATED else _leaky(h, kind, tau_minus))


@st.composite
def _leaky(draw: st.DrawFn, h: float, kind: type[Model], tau_minus: Any) -> Model:
    tau_m = draw(st.one_of(st.sampled_from([1.0, 10.0, 500.0]), st.floats(0.5, 100.0), st.sampled_from(EXTREME)))
    rest = draw(st.sampled_from([-70.0, 0.0]))
    words: dict[str, Any] = {
        "tau_m": draw(st.sampled_from([tau_m, tau_m, uniform(low=tau_m, high=2.0 * tau_m)])),
        "C_m": draw(st.sampled_from([250.0, 1.0, 1e4, 1e-6, 1e9])),
        "t_ref": draw(st.sampled_from([0, 0, 1, 3, 25])) * h,
        "E_L": rest,
        "V_reset": rest + draw(st.sampled_from([0.0, -5.0, 0.25])),
        "V_th": draw(st.sampled_from([rest + 15.0, rest + 1.0, uniform(low=rest + 0.5, high=rest + 20.0)])),
        "I_e": draw(st.sampled_from([0.0, 0.0, 400.0, 1e5, uniform(low=0.0, high=500.0)])),
        "tau_minus": tau_minus,
    }
    if kind is not neuro.iaf_psc_exp:
        words["V_min"] = draw(st.sampled_from([-np.inf, rest - 6.0]))
    if kind is neuro.iaf_psc_delta:
        return neuro.iaf_psc_delta(**words, refractory_input=draw(st.booleans()))
    near = tau_m * (1.0 + draw(st.sampled_from([0.0, 1e-13, -1e-11, 1e-9, -1e-7, 1e-5, -1e-3])))
    words["tau_syn_ex"] = draw(st.one_of(st.just(near), st.sampled_from([0.2, 2.0, 60.0, h / 600.0, 1e6])))
    words["tau_syn_in"] = draw(st.one_of(st.just(near), st.sampled_from([0.2, 2.0, 60.0, h / 600.0, 1e6])))
    return neuro.iaf_psc_exp(**words) if kind is neuro.iaf_psc_exp else neuro.iaf_psc_alpha(**words)


@st.composite
def _two_thresholds(draw: st.DrawFn, h: float, tau_minus: Any) -> Model:
    """NEST wants a refractory step at least, and synapses that are not as fast as the membrane."""
    return neuro.mat2_psc_exp(
        tau_m=draw(st.sampled_from([5.0, 0.7, 100.0])),
        t_ref=draw(st.sampled_from([1, 3, 25])) * h,
        I_e=draw(st.sampled_from([0.0, 500.0, 1e4, uniform(low=0.0, high=800.0)])),
        tau_syn_ex=draw(st.sampled_from([1.0, 0.2, 60.0, h / 600.0, 1e6])),
        tau_syn_in=draw(st.sampled_from([3.0, 0.2, 60.0])),
        tau_1=draw(st.sampled_from([10.0, 0.5, *EXTREME])),
        alpha_1=draw(st.sampled_from([37.0, 0.0, -3.0, uniform(low=1.0, high=40.0)])),
        alpha_2=draw(st.sampled_from([2.0, 0.0])),
        tau_minus=tau_minus,
    )


@st.composite
def _integrated(draw: st.DrawFn, h: float, kind: type[Model], tau_minus: Any) -> Model:
    words: dict[str, Any] = {
        "C_m": draw(st.sampled_from([100.0, 250.0, uniform(low=80.0, high=400.0)])),
        "t_ref": draw(st.sampled_from([0, 0, 1, 3, 25])) * h,
        "tau_syn_ex": draw(st.sampled_from([0.2, 2.0, 20.0])),
        "tau_syn_in": draw(st.sampled_from([0.5, 2.0, 20.0])),
        "I_e": draw(st.sampled_from([0.0, 0.0, 350.0, 900.0, uniform(low=0.0, high=700.0)])),
        "tau_minus": tau_minus,
    }
    if kind in (neuro.iaf_cond_exp, neuro.iaf_cond_alpha):
        words["V_th"] = draw(st.sampled_from([-55.0, -69.0, uniform(low=-59.0, high=-50.0)]))
        words["V_reset"] = draw(st.sampled_from([-60.0, -75.0])) - 10.0 * (words["V_th"] == -69.0)
    if kind in ADAPTIVE:
        words["a"], words["b"] = draw(st.sampled_from([4.0, 0.0, -1.0])), draw(st.sampled_from([80.5, 0.0, 400.0]))
        words["Delta_T"] = draw(st.sampled_from([2.0, 0.0, 1.0, 0.1]))
        words["tau_w"] = draw(st.sampled_from([144.0, 5.0, 1e6]))
    return kind(**words)


def kick(net: Network, post: str) -> float:
    """A weight of which one spike or two make a cell fire; of integrated ones as many as they can take."""
    model = net.populations[post].model
    words = model.parameters()
    if not model.states or "tau_syn_ex" not in words:
        return {"iaf_psc_delta": 12.0, "izhikevich": 30.0}.get(model.name, 1.0)
    shortest = min(float(words["tau_syn_ex"]), float(words["tau_syn_in"]))
    if isinstance(model, CONDUCTANCES):
        return 100.0 / shortest
    if isinstance(model, neuro.aeif_psc_exp | neuro.hh_psc_alpha):  # NEST gives up where V_m leaves -1000 mV
        return 150.0 / shortest
    return 30.0 * float(words["C_m"]) / shortest


def changes_of_currents(model: Model) -> dict[str, list[float]]:
    """What may be set of a generator of currents while it runs, each with some values."""
    if isinstance(model, neuro.dc_generator):
        return {"amplitude": [0.0, 300.0, -2.0]}
    if isinstance(model, neuro.ac_generator):
        return {"amplitude": [0.0, 300.0], "offset": [-2.0], "frequency": [0.0, 30.0]}
    return {"mean": [-2.0, 100.0], "std": [2.0, 50.0]} if isinstance(model, neuro.noise_generator) else {}


def changes(model: Model, h: float) -> dict[str, list[float]]:
    """What may be set of cells while they run, each with some values."""
    if isinstance(model, neuro.parrot_neuron):
        return {}
    if isinstance(model, neuro.izhikevich):
        return {"I_e": [12.0], "V_m": [-60.0]}
    rest = float(model.parameters()["E_L"])
    found = {
        "I_e": [0.0, 450.0, -450.0],
        "V_m": [rest, rest + 0.4, rest - 30.0],
        "t_ref": [0.0, 2.0 * h, 30.0 * h],
        "C_m": [200.0],
    }
    if isinstance(model, neuro.mat2_psc_exp):
        return found | {"omega": [-60.0, -45.0], "tau_m": [0.7, 10.0, 300.0], "V_th_alpha_1": [0.0, 5.0]}
    if isinstance(model, INTEGRATED):
        upper = [-52.0, -45.0] if "V_th" in model.parameters() else []
        return found | {"g_L": [10.0, 40.0]} | ({"V_th": upper} if upper else {})
    return found | {"V_th": [rest + 2.0, rest + 15.0], "tau_m": [0.7, 10.0, 300.0]}


@st.composite
def currents(draw: st.DrawFn, h: float) -> Model:
    """A generator of currents of two neurons, of about 1 pA, between two moments."""
    start, length = draw(st.integers(0, 20)), draw(st.integers(0, 200))
    window = {"start": start * h, "stop": (start + length) * h}
    match draw(st.integers(0, 5)):
        case 3:
            steps = sorted(draw(st.sets(st.integers(1, 150), min_size=1, max_size=4)))
            values = [draw(st.sampled_from([1.0, -2.0, 0.0, 0.5])) for _ in steps]
            return neuro.step_current_generator(
                amplitude_times=[k * h for k in steps], amplitude_values=values, **window
            )
        case 4:
            frequency = draw(st.sampled_from([5.0, 80.0])) / h
            return neuro.ac_generator(
                amplitude=uniform(low=0.5, high=2.0), offset=0.3, frequency=frequency, phase=40.0, **window
            )
        case 5:
            own, dt = draw(st.booleans()), draw(st.sampled_from([1, 3])) * h
            mod = {"std_mod": draw(st.sampled_from([0.0, 1.0])), "frequency": 10.0 / h}
            return neuro.noise_generator(mean=0.5, std=1.5, dt=dt, individual_noise=own, **mod, **window)
    return neuro.dc_generator(amplitude=1.0, **window)


def _each(draw: st.DrawFn, value: float) -> Any:
    """A number of a rule for all synapses, or one for each."""
    return draw(st.sampled_from([value, value, uniform(low=0.5 * value, high=value)])) if value else value


@st.composite
def synapses(draw: st.DrawFn, net: Network, ends: tuple[str, str], shortest: int, interval: int) -> Synapse:
    """A fixed synapse, one of spike pairs, or one under dopamine of a signal or of any neurons that spike."""
    post = ends[1]
    w_max = draw(st.sampled_from([1.0, 0.1])) * kick(net, post)
    match draw(st.integers(0, 4)):
        case 0:
            return neuro.static()
        case 1:
            mus = {word: _each(draw, draw(st.sampled_from(MUS))) for word in ("mu_plus", "mu_minus")}
            tau_plus, step = (
                draw(st.sampled_from([20.0, 2.0, *EXTREME])),
                _each(draw, draw(st.sampled_from([0.01, 0.5, 0.0]))),
            )
            return neuro.stdp(lambda_=step, alpha=_each(draw, 1.1), tau_plus=tau_plus, Wmax=w_max, **mus)
        case 2 | 3:
            return draw(_pair_rules(w_max))
    source: dict[str, Any] = {}
    if f"signal_{post}" in net.signals and draw(st.booleans()):
        source = {"signal": f"signal_{post}"}
    elif draw(st.integers(0, 3)):
        late = draw(st.sampled_from([shortest, shortest + 1, shortest + 20]))
        spiking = draw(st.sampled_from([name for name in net.populations if name != "current"]))
        source = {"dopamine": spiking, "dopamine_delay": late * net.resolution}
        if net.populations[spiking].shape == net.populations[post].shape and draw(st.booleans()):
            source["dopamine_rule"] = "one_to_one"
    step = draw(st.sampled_from([0.01, 0.3])) * w_max
    return neuro.stdp_dopa(
        A_plus=step,
        A_minus=draw(st.sampled_from([0.0, 1.5])) * step,
        tau_plus=draw(st.sampled_from([20.0, 2.0])),
        tau_c=draw(st.sampled_from([1000.0, 10.0, 1e6])),
        tau_n=draw(st.sampled_from([200.0, 5.0, 1e6])),
        b=draw(st.sampled_from([0.0, 0.02, -0.01] if source else [0.02, -0.01])),
        Wmin=draw(st.sampled_from([0.0, 0.0, -0.5, 0.3])) * w_max,
        Wmax=w_max,
        deliver_interval=interval,
        **source,
    )


@st.composite
def _pair_rules(draw: st.DrawFn, w_max: float) -> Synapse:
    """A rule of pairs or triplets, or of short-term plasticity; some inhibit."""
    signed, step = w_max * draw(st.sampled_from([1.0, -1.0])), draw(st.sampled_from([0.01, 0.5]))
    tau = draw(st.sampled_from([20.0, 2.0, *EXTREME]))
    mus = {word: _each(draw, draw(st.sampled_from(MUS))) for word in ("mu_plus", "mu_minus")}
    pairs: dict[str, Any] = {
        "lambda_": _each(draw, step),
        "alpha": _each(draw, 1.1),
        "tau_plus": tau,
        "Wmax": signed,
    }
    pairs |= mus
    a = step * w_max
    match draw(st.integers(0, 6)):
        case 0:
            return neuro.stdp_nn_symm(**pairs, pre_at_start=True)
        case 1:
            return neuro.stdp_nn_restr(**pairs, pre_at_start=True)
        case 2:
            return neuro.stdp_nn_pre_centered(**pairs)
        case 3:
            return neuro.stdp_pl_hom(lambda_=step, alpha=0.1, tau_plus=tau, mu=draw(st.sampled_from([0.4, 1.0])))
        case 4:
            return neuro.vogels_sprekeler(tau=tau, eta=_each(draw, a), Wmax=signed)
        case 5:
            u, fac = draw(st.sampled_from([0.1, 0.8, 0.0, 1.0])), draw(st.sampled_from([0.0, 50.0, 1e6]))
            return neuro.tsodyks2(U=_each(draw, u), tau_rec=draw(st.sampled_from([800.0, 10.0, *EXTREME])), tau_fac=fac)
    slow = {"tau_plus": tau, "tau_plus_triplet": draw(st.sampled_from([100.0, 2.0, *EXTREME]))}
    shares = {"Aplus": 0.5, "Aplus_triplet": 0.2, "Aminus": 0.6, "Aminus_triplet": 0.2}
    sizes = {word: _each(draw, share * a) for word, share in shares.items()}
    return neuro.stdp_triplet(**sizes, **slow, Wmax=signed)


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

FIXED = {"Wmin", "Wmax", "deliver_interval", "mu_plus", "mu_minus", "mu", "pre_at_start"}
"""Numbers of rules that stay as they are: weights begin at their bounds, and some exponents are ways of their own."""

STEEP = {"hh_psc_alpha": 1e-6, "aeif_cond_exp": 1e-4, "aeif_psc_exp": 1e-4}
"""What V_m may differ by, mV, where it rises steeply within an adaptive step, so that rounding grows."""

STEERED = ("lambda_", "A_plus", "A_minus", "tau_plus", "tau_c", "tau_n", "b", "U")
"""Numbers of rules that are set on the way."""

MANY = 400
"""The most synapses of an `all_to_all`."""

C = TypeVar("C", bound=Choice)

RESOLUTIONS = (0.05, 0.1, 0.2, 0.5, 1.0, 0.7, 0.35, 0.009)


@dataclass(frozen=True, slots=True)
class Act:
    """What is done at one moment: a method of a simulation and its arguments."""

    method: str
    arguments: tuple[Any, ...]
    values: tuple[tuple[str, Any], ...] = ()

    def on(self, sim: Simulation) -> None:
        """Do it; times of spikes are counted from the present."""
        method, arguments = self.method, list(self.arguments)
        if method == "inject":
            population, ahead, ids = arguments
            now = round(sim.time / sim.program.resolution)
            arguments = [population, (np.array(ahead) + now) * sim.program.resolution, list(ids)]
        elif method == "spread":
            projection, weight = arguments
            size = next(part.size for part in sim.program.projections if part.name == projection)
            method, arguments = "set_weights", [projection, weight * np.linspace(-0.5, 1.0, size)]
        elif method == "return":
            _return(sim, *arguments)
            return
        getattr(sim, method)(*arguments, **dict(self.values))


def _return(sim: Simulation, steps: int) -> None:
    """Save, run ahead, and return to what was saved; NEST, which cannot, stays where it is."""
    if sim.backend == "nest":
        return
    with TemporaryDirectory() as folder:
        sim.save(Path(folder) / "state.h5")
        run_on(sim, steps * sim.program.resolution)
        sim.restore(Path(folder) / "state.h5")


@dataclass(frozen=True, slots=True)
class Scenario:
    """A network and what is done with it: runs of some steps, each after some acts.

    Attributes:
        grain: steps of which all moments are a multiple: NEST updates synapses with dopamine on this grid.
        threads: of the backends that have some.
        refused: whether NEST refuses an act: then only the reference judges.
    """

    net: Network
    seed: int
    grain: int
    parts: tuple[tuple[tuple[Act, ...], int], ...]
    threads: int = 1
    refused: bool = False

    @property
    def judges(self) -> tuple[str, ...]:
        """The backends that tell what is right. The reference takes minutes where neurons are integrated."""
        integrated = any(isinstance(part.model, INTEGRATED) for part in self.net.populations.values())
        if self.refused:
            return ("reference",)
        return ("nest",) if integrated else ("reference", "nest")

    def play(self, sim: Simulation) -> Iterator[Simulation]:
        """Run part by part; yield the simulation after each."""
        for acts, steps in self.parts:
            for act in acts:
                act.on(sim)
            run_on(sim, steps * sim.program.resolution)
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
            kind = f", {population.model.name}" if population.model.name in STEEP else ""
            found[f"V_m of {name}{kind}"] = sim.get(name, "V_m")
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
    names, kinds = [f"cells{index}" for index in range(draw(st.integers(1, 3)))], PLAIN
    refused = draw(st.integers(0, 5)) == 4
    few = not refused and draw(st.booleans())
    if few:
        kinds += INTEGRATED
    for name in names:
        net.population(name, draw(_sizes(few)), draw(cells(h, kinds)))
    _drive(draw, net, names, shortest)
    for name in names:
        if draw(st.booleans()):
            net.signal(f"signal_{name}", to=name)
    for _ in range(draw(st.integers(1, 5))):
        _connect(draw, net, names, shortest, interval)
    grain = shortest * interval
    parts = [
        (_acts(draw, net, names, refused), grain * draw(st.integers(1, -(-90 // grain))))
        for _ in range(draw(st.integers(1, 4)))
    ]
    if draw(st.integers(0, 11)) == 7:  # the simplest draws, which come first, have none
        hush = Act("set", ("noise",), (("rate", 0.0),))
        rouse = Act("inject", ("listed", tuple(range(2, 30)), tuple(k % 3 for k in range(28))))
        parts += [((hush,), SILENCE // grain * grain), ((rouse,), grain * -(-60 // grain))]
    return Scenario(net, draw(st.integers(0, 99)), grain, tuple(parts), draw(st.integers(1, 2)), refused)


def _sizes(few: bool) -> st.SearchStrategy[int]:
    """Mostly a few neurons; some are more than a block of the event backend.

    Integrated neurons, and those that send to them, are few: under very strong input each neuron takes a million inner
    steps, in NEST without a bound.
    """
    if few:
        return st.integers(1, 5)
    return st.one_of(st.integers(1, 5), st.integers(1, 5), st.sampled_from([3, 9, 30, 70]))


def _add_sources(draw: st.DrawFn, net: Network) -> None:
    """Noise, listed spikes, a current, and parrots that say what the noise says."""
    h = net.resolution
    per_step = draw(st.sampled_from([0.002, 0.03, 0.2, 1.5]))
    net.population("noise", 3, neuro.poisson_generator(rate=per_step * 1000.0 / h))
    rows = draw(st.lists(st.lists(st.integers(1, 90), max_size=8), min_size=3, max_size=3))
    net.population("listed", 3, neuro.spike_generator(spike_times=[[k * h for k in sorted(row)] for row in rows]))
    net.population("current", 2, draw(currents(h)))
    net.population("relay", 3, neuro.parrot_neuron())


def _drive(draw: st.DrawFn, net: Network, names: list[str], shortest: int) -> None:
    """Every population hears something; one delay is the shortest, so that it is known."""
    h = net.resolution
    net.connect("noise", "relay", neuro.one_to_one(), delay=shortest * h, name="noise_relay")
    for name in names:
        heard = draw(st.sampled_from(["noise", "listed", "relay"]))
        unit = kick(net, name)
        weight: Any = draw(st.sampled_from([unit, 0.3 * unit, -0.5 * unit, uniform(low=-unit, high=1.5 * unit)]))
        net.connect(
            heard, name, neuro.all_to_all(), weight=weight, delay=draw(_delays(h, shortest)), name=f"drive_{name}"
        )
        wanted = draw(st.booleans())
        if wanted and net.populations[name].model.states:
            amount = draw(st.sampled_from([0.5, -2.0, 20.0]))
            net.connect("current", name, neuro.all_to_all(), weight=amount, delay=draw(_delays(h, shortest)))


@st.composite
def _delays(draw: st.DrawFn, h: float, shortest: int) -> Any:
    steps = draw(st.one_of(st.integers(shortest, shortest + 4), st.integers(shortest, 60), st.integers(61, 150)))
    return draw(st.sampled_from([steps * h, uniform(low=shortest * h, high=(steps + 1) * h)]))


@st.composite
def _rules(draw: st.DrawFn, n_pre: int, n_post: int) -> Rule:
    ids = st.tuples(st.integers(0, n_pre - 1), st.integers(0, n_post - 1))
    listed = draw(st.lists(ids, min_size=1, max_size=10))
    choices: list[Rule] = [neuro.fixed_indegree(n=draw(st.integers(1, 4)))]
    choices.append(neuro.pairs(pre=[pre for pre, _ in listed], post=[post for _, post in listed]))
    if n_pre * n_post <= MANY:  # the reference takes long
        choices.insert(0, neuro.all_to_all())
    return draw(st.sampled_from([*choices, neuro.one_to_one()] if n_pre == n_post else choices))


def _connect(draw: st.DrawFn, net: Network, names: list[str], shortest: int, interval: int) -> None:
    """One more projection onto cells: fixed, of spike pairs, or under dopamine of a signal or of spikes."""
    post, h = draw(st.sampled_from(names)), net.resolution
    parrots = [name for name, part in net.populations.items() if part.model.name == "parrot_neuron"]
    excluded = ["current", *(parrots if post in parrots else [])]
    pre = draw(st.sampled_from([name for name in net.populations if name not in excluded]))
    synapse = draw(synapses(net, (pre, post), shortest, interval))
    unit = 0.5 * kick(net, post)
    weight: Any = draw(st.sampled_from([unit, -unit, 0.0, uniform(low=-unit, high=unit)]))
    if synapse.learns:
        w_max = float(synapse.parameters().get("Wmax", unit))
        none = 0.0 if w_max > 0.0 else 1e-3 * w_max  # NEST refuses 0 where Wmax is below it
        none = float(synapse.parameters().get("Wmin", none))
        low, high = sorted((none, w_max))
        weight = draw(st.sampled_from([none, w_max, 0.5 * w_max, uniform(low=low, high=high)]))
    rule = draw(_rules(*(int(net.populations[name].shape[0]) for name in (pre, post))))
    net.connect(
        pre, post, rule, synapse, weight=weight, delay=draw(_delays(h, shortest)), name=f"wires{len(net.projections)}"
    )


def _acts(draw: st.DrawFn, net: Network, names: list[str], refused: bool) -> tuple[Act, ...]:
    """Up to four changes between two runs; of those that NEST refuses only if asked."""
    return tuple(_act(draw, net, names, refused) for _ in range(draw(st.integers(0, 4))))


def _act(draw: st.DrawFn, net: Network, names: list[str], refused: bool) -> Act:
    name = draw(st.sampled_from(names))
    match draw(st.integers(0, 8)):
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
            unit = 1.0 if chosen.source == "current" else kick(net, chosen.target)
            how = draw(st.sampled_from(["set_weights", "set_weights", "spread"]))
            return Act(how, (chosen.name, draw(st.sampled_from([0.0, 0.4, 1.0])) * unit))
        case 4 if choices := changes_of_currents(net.populations["current"].model):
            word = draw(st.sampled_from(list(choices)))
            return Act("set", ("current",), ((word, draw(st.sampled_from(choices[word]))),))
        case 5:
            return Act("return", (draw(st.integers(1, 30)),))
        case 6:
            return Act("reset", (draw(st.booleans()),))
        case 7 if learning := _learning(net, refused):
            return _other_synapses(draw, net.projections[draw(st.sampled_from(learning))])
    return _change(draw, net, name)


def _learning(net: Network, refused: bool) -> list[str]:
    """The projections whose weights and numbers may be set on the way: in NEST of those under dopamine only."""
    learning = [part for part in net.projections.values() if part.synapse.learns]
    return [part.name for part in learning if refused or part.synapse.modulated]


def _other_synapses(draw: st.DrawFn, part: Projection) -> Act:
    """Weights or a number of the rule of synapses that learn."""
    words = part.synapse.parameters()
    numbers: list[str] = [word for word in STEERED if word in words]
    if draw(st.booleans()) and numbers:
        word = draw(st.sampled_from(numbers))
        value = 0.5 * words[word] if isinstance(words[word], float) else 0.25
        return Act("set", (part.name,), ((word, value),))
    high = float(words.get("Wmax", 1.0))
    return Act("set_weights", (part.name, draw(st.sampled_from([0.5, 1.0])) * high))


def _change(draw: st.DrawFn, net: Network, name: str) -> Act:
    """A parameter or state of cells, or the noise where there is none."""
    choices = changes(net.populations[name].model, net.resolution)
    if not choices:
        return Act("set", ("noise",), (("rate", 100.0),))
    word = draw(st.sampled_from(list(choices)))
    return Act("set", (name,), ((word, draw(st.sampled_from(choices[word]))),))


def differences(expected: Found, found: Found) -> dict[str, float]:
    """How far two readings are apart in what differs.

    Spikes must be equal, all else within 1e-9, or 1e-12 of a large number; V_m of some neurons within `STEEP`.

    Returns:
        by quantity: the number of spikes that only one has, or the largest distance; infinite if it is NaN.
    """
    apart = {}
    for name, right in expected.items():
        value = found[name]
        if right.dtype.kind == "f":
            distance = np.abs(value - right)
            limit = STEEP.get(name.partition(", ")[2], LIMIT)
            if not np.all(distance <= limit + RELATIVE * np.abs(right)):
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
    learning = set(_learning(net, refused=True))  # what is set of these may be a bound
    parts = tuple((tuple(_moved_act(act, rng, learning) for act in acts), steps) for acts, steps in scenario.parts)
    return replace(scenario, net=net, parts=parts)


def _moved_projection(part: Projection, rng: np.random.Generator) -> Projection:
    if not part.synapse.learns:
        return replace(part, weight=_off(part.weight, rng))
    numbers = set(part.synapse.numbers()) - FIXED
    return replace(part, synapse=_moved(part.synapse, rng, numbers))


def _moved_act(act: Act, rng: np.random.Generator, fixed: Set[str]) -> Act:
    if act.arguments and act.arguments[0] in fixed:
        return act
    if act.method in ("set_weights", "spread", "signal"):
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
