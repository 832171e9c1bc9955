"""The cells and synapses of random networks that are steered, with what makes them fire and what may be set.

Needs the package hypothesis, which only tests install.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from neuro.model.distributions import uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    INTEGRATED,
    Model,
    ac_generator,
    aeif_cond_exp,
    aeif_psc_exp,
    dc_generator,
    hh_psc_alpha,
    iaf_cond_alpha,
    iaf_cond_exp,
    iaf_psc_alpha,
    iaf_psc_delta,
    iaf_psc_exp,
    izhikevich,
    mat2_psc_exp,
    noise_generator,
    parrot_neuron,
    step_current_generator,
)
from neuro.model.synapses import (
    Synapse,
    static,
    stdp,
    stdp_dopa,
    stdp_nn_pre_centered,
    stdp_nn_restr,
    stdp_nn_symm,
    stdp_pl_hom,
    stdp_triplet,
    tsodyks2,
    vogels_sprekeler,
)

PLAIN: tuple[type[Model], ...] = (iaf_psc_delta, iaf_psc_exp, iaf_psc_alpha, izhikevich, parrot_neuron, mat2_psc_exp)
"""Cells without an integrator, which the reference runs quickly."""

MUS = (0.0, 0.3, 1.0, 2.0)
ADAPTIVE = (aeif_cond_exp, aeif_psc_exp)
"""Of several spikes within a step NEST sends all and ours one, so they are refractory for a step at least."""

CONDUCTANCES = (iaf_cond_exp, iaf_cond_alpha, aeif_cond_exp)


@st.composite
def cells(draw: st.DrawFn, h: float, kinds: tuple[type[Model], ...]) -> Model:
    """A model of some kinds, for a network of resolution h."""
    kind = draw(st.sampled_from(kinds))
    tau_minus = draw(st.sampled_from([20.0, 1.0, uniform(low=5.0, high=40.0)]))
    if kind is parrot_neuron:
        return parrot_neuron(tau_minus=tau_minus)
    if kind is izhikevich:
        a, b, c, d = draw(st.sampled_from([(0.02, 0.2, -65.0, 8.0), (0.1, 0.2, -50.0, 2.0), (0.02, 0.25, -65.0, 0.05)]))
        return izhikevich(a=a, b=b, c=c, d=d, I_e=draw(st.sampled_from([0.0, 4.0, 10.0])), tau_minus=tau_minus)
    if kind is mat2_psc_exp:
        return draw(_two_thresholds(h, tau_minus))
    return draw(_integrated(h, kind, tau_minus) if kind in INTEGRATED else _leaky(h, kind, tau_minus))


@st.composite
def _leaky(draw: st.DrawFn, h: float, kind: type[Model], tau_minus: Any) -> Model:
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


@st.composite
def _two_thresholds(draw: st.DrawFn, h: float, tau_minus: Any) -> Model:
    """NEST wants a refractory step at least, and synapses that are not as fast as the membrane."""
    return mat2_psc_exp(
        tau_m=draw(st.sampled_from([5.0, 0.7, 100.0])),
        t_ref=draw(st.sampled_from([1, 3, 25])) * h,
        I_e=draw(st.sampled_from([0.0, 500.0, 1e4, uniform(low=0.0, high=800.0)])),
        tau_syn_ex=draw(st.sampled_from([1.0, 0.2, 60.0])),
        tau_syn_in=draw(st.sampled_from([3.0, 0.2, 60.0])),
        tau_1=draw(st.sampled_from([10.0, 0.5])),
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
    if kind in (iaf_cond_exp, iaf_cond_alpha):
        words["V_th"] = draw(st.sampled_from([-55.0, -69.0, uniform(low=-59.0, high=-50.0)]))
        words["V_reset"] = draw(st.sampled_from([-60.0, -75.0])) - 10.0 * (words["V_th"] == -69.0)
    if kind in ADAPTIVE:
        words["a"], words["b"] = draw(st.sampled_from([4.0, 0.0, -1.0])), draw(st.sampled_from([80.5, 0.0, 400.0]))
        words["Delta_T"] = draw(st.sampled_from([2.0, 0.0, 1.0]))
        words["tau_w"] = draw(st.sampled_from([144.0, 5.0]))
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
    if isinstance(model, aeif_psc_exp | hh_psc_alpha):  # NEST gives up where V_m leaves -1000 mV
        return 150.0 / shortest
    return 30.0 * float(words["C_m"]) / shortest


def changes_of_currents(model: Model) -> dict[str, list[float]]:
    """What may be set of a generator of currents while it runs, each with some values."""
    if isinstance(model, dc_generator):
        return {"amplitude": [0.0, 300.0, -2.0]}
    if isinstance(model, ac_generator):
        return {"amplitude": [0.0, 300.0], "offset": [-2.0], "frequency": [0.0, 30.0]}
    return {"mean": [-2.0, 100.0], "std": [2.0, 50.0]} if isinstance(model, noise_generator) else {}


def changes(model: Model, h: float) -> dict[str, list[float]]:
    """What may be set of cells while they run, each with some values."""
    if isinstance(model, parrot_neuron):
        return {}
    if isinstance(model, izhikevich):
        return {"I_e": [12.0], "V_m": [-60.0]}
    rest = float(model.parameters()["E_L"])
    found = {
        "I_e": [0.0, 450.0, -450.0],
        "V_m": [rest, rest + 0.4, rest - 30.0],
        "t_ref": [0.0, 2.0 * h, 30.0 * h],
        "C_m": [200.0],
    }
    if isinstance(model, mat2_psc_exp):
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
            return step_current_generator(amplitude_times=[k * h for k in steps], amplitude_values=values, **window)
        case 4:
            frequency = draw(st.sampled_from([5.0, 80.0])) / h
            return ac_generator(
                amplitude=uniform(low=0.5, high=2.0), offset=0.3, frequency=frequency, phase=40.0, **window
            )
        case 5:
            own, dt = draw(st.booleans()), draw(st.sampled_from([1, 3])) * h
            mod = {"std_mod": draw(st.sampled_from([0.0, 1.0])), "frequency": 10.0 / h}
            return noise_generator(mean=0.5, std=1.5, dt=dt, individual_noise=own, **mod, **window)
    return dc_generator(amplitude=1.0, **window)


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
            return static()
        case 1:
            mus = {word: _each(draw, draw(st.sampled_from(MUS))) for word in ("mu_plus", "mu_minus")}
            tau_plus, step = draw(st.sampled_from([20.0, 2.0])), _each(draw, draw(st.sampled_from([0.01, 0.5])))
            return stdp(lambda_=step, alpha=_each(draw, 1.1), tau_plus=tau_plus, Wmax=w_max, **mus)
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
    return stdp_dopa(
        A_plus=step,
        A_minus=draw(st.sampled_from([0.0, 1.5])) * step,
        tau_plus=draw(st.sampled_from([20.0, 2.0])),
        tau_c=draw(st.sampled_from([1000.0, 10.0])),
        tau_n=draw(st.sampled_from([200.0, 5.0])),
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
    tau = draw(st.sampled_from([20.0, 2.0]))
    mus = {word: _each(draw, draw(st.sampled_from(MUS))) for word in ("mu_plus", "mu_minus")}
    pairs: dict[str, Any] = {"lambda_": _each(draw, step), "alpha": _each(draw, 1.1), "tau_plus": tau, "Wmax": signed}
    pairs |= mus
    a = step * w_max
    match draw(st.integers(0, 6)):
        case 0:
            return stdp_nn_symm(**pairs, pre_at_start=True)
        case 1:
            return stdp_nn_restr(**pairs, pre_at_start=True)
        case 2:
            return stdp_nn_pre_centered(**pairs)
        case 3:
            return stdp_pl_hom(lambda_=step, alpha=0.1, tau_plus=tau, mu=draw(st.sampled_from([0.4, 1.0])))
        case 4:
            return vogels_sprekeler(tau=tau, eta=_each(draw, a), Wmax=signed)
        case 5:
            u, fac = draw(st.sampled_from([0.1, 0.8])), draw(st.sampled_from([0.0, 50.0]))
            return tsodyks2(U=_each(draw, u), tau_rec=draw(st.sampled_from([800.0, 10.0])), tau_fac=fac)
    slow = {"tau_plus": tau, "tau_plus_triplet": draw(st.sampled_from([100.0, 2.0]))}
    shares = {"Aplus": 0.5, "Aplus_triplet": 0.2, "Aminus": 0.6, "Aminus_triplet": 0.2}
    sizes = {word: _each(draw, share * a) for word, share in shares.items()}
    return stdp_triplet(**sizes, **slow, Wmax=signed)
