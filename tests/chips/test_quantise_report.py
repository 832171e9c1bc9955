"""What quantising tells: warnings above stated limits and not below, and the report."""

import gc
import json
import math
import weakref

import numpy as np
import pytest

import neuro
from neuro.chips import chip, quantise
from neuro.chips.fixed_program import report
from neuro.chips.quantising import LIMITS
from neuro.compiler import compile_network
from neuro.core.errors import Where
from neuro.run.compiled import ApproximationWarning


def one(model=None, h=1.0, weight=1.0, source=None, n=1, rule=None):
    """Sources onto one neuron."""
    net = neuro.Network("one", resolution=h)
    net.population("in", n, source or neuro.spike_generator())
    net.population("out", 1, model or exp())
    net.connect("in", "out", neuro.all_to_all(), rule or neuro.static(), weight=weight, delay=h, name="in_out")
    return compile_network(net, 0)


def exp(**values):
    return neuro.iaf_psc_exp(**{"E_L": 0.0, "V_reset": 0.0, "V_th": 16.0} | values)


def delta(**values):
    return neuro.iaf_psc_delta(**{"E_L": 0.0, "V_reset": 0.0, "V_th": 16.0, "t_ref": 0.0} | values)


def tau(decay):
    """The time constant of which a step of 1 ms loses decay / 4096."""
    return -1.0 / math.log1p(-decay / 4096)


def told(program, name, **options):
    """All warnings: what, why, way out."""
    problems = quantise(program, chip(name), **options).problems
    assert [p for p in problems if p.refused] == []
    return [f"{p.what}: {p.why}\n{p.way_out}" for p in problems if "binary" not in p.why]


def small_weights(share):
    """1000 weights of which a share is too small for a mantissa beside a large one."""
    weight = np.full(1000, 255.0)
    weight[: round(share * 1000)] = 0.4
    return one(delta(V_th=1.0), weight=weight, n=1000)


def poisson(rate):
    return one(source=neuro.poisson_generator(rate=rate))


def current(units):
    return one(exp(), source=neuro.dc_generator(amplitude=units / 32.768))


def reset(v_th):
    return one(exp(V_th=v_th, V_reset=1.5 / 32768))


# By limit the chip, a network by a value, and a value just below the limit and one just above.
WARNED = {
    "zeroed": ("loihi", small_weights, 0.010, 0.011),
    "rms": ("loihi", lambda weight: one(delta(), weight=weight), 25.49, 24.49),
    "tau_m": ("loihi", lambda decay: one(exp(tau_m=tau(decay))), 25.49, 24.49),
    "tau_syn_ex": ("loihi", lambda decay: one(exp(tau_syn_ex=tau(decay))), 25.49, 24.49),
    "tau_syn_in": ("loihi", lambda decay: one(exp(tau_syn_in=tau(decay)), weight=-1.0), 25.49, 24.49),
    "V_th": ("loihi", lambda v_th: one(delta(V_th=v_th), weight=0.0), 14.4032, 14.401),
    "V_reset": ("spinnaker", reset, 0.05, 0.01),
    "C_m": ("spinnaker", lambda units: one(exp(C_m=1e4 * 32768 / units)), 25.49, 24.48),
    "I_e": ("spinnaker", lambda units: one(exp(I_e=units / 32.768)), 25.49, 24.49),
    "dc": ("spinnaker", current, 25.49, 24.49),
    "merged": ("loihi", poisson, 20.1, 20.3),
}
HELD = {"rms": {"scales": {"out": 64.0}, "exponents": {"in_out": 0}}, "V_th": {"scales": {"out": 64.0 * 62.5}}}


def test_a_warning_just_above_its_limit_and_none_below(messages):
    assert set(WARNED) == set(LIMITS)
    answers = {}
    for limit, (name, net, below, above) in WARNED.items():
        options = HELD.get(limit, {})
        assert [text for text in told(net(below), name, **options) if LIMITS[limit].text in text] == []
        (answers[limit],) = (text for text in told(net(above), name, **options) if LIMITS[limit].text in text)
    messages(answers)


def test_what_a_rule_does_otherwise_is_a_list(messages):
    net = neuro.Network("plastic", resolution=1.0)
    net.place = Where("here")
    net.population("in", 1, neuro.spike_generator())
    net.population("out", 1, exp())
    net.connect("in", "out", neuro.one_to_one(), neuro.stdp(Wmax=100.0), weight=50.0, delay=2.0, name="in_out")
    with pytest.warns(ApproximationWarning) as found:
        neuro.compile(net, "loihi")
    assert len(found) == 1
    messages({"stdp": str(found[0].message)})


# the report


def example():
    net = neuro.Network("small", resolution=0.5)
    net.population("noise", 20, neuro.poisson_generator(rate=5.0))
    net.population("current", 1, neuro.dc_generator(amplitude=100.0))
    net.population("exc", (2, 4), neuro.iaf_psc_exp(I_e=150.0))
    net.population("relay", 8, neuro.parrot_neuron())
    net.population("out", 2, neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=8.0, tau_m=math.inf))
    net.connect("noise", "exc", neuro.all_to_all(), weight=300.0, delay=1.0, name="noise_exc")
    net.connect("current", "exc", neuro.all_to_all(), weight=1.0, delay=1.0, name="current_exc")
    net.connect("exc", "relay", neuro.one_to_one(), delay=1.0, name="exc_relay")
    weight = np.array([4.0, -2.0, 1.0, 0.3] * 4)
    delay = 0.5 * np.arange(1, 17)
    net.connect("relay", "out", neuro.all_to_all(), weight=weight, delay=delay, name="relay_out")
    return compile_network(net, 0)


def test_the_report(messages):
    messages({name: report(quantise(example(), chip(name))) for name in ("loihi", "spinnaker")})


@pytest.mark.parametrize("name", ["loihi", "spinnaker"])
def test_as_dict(name):
    found = quantise(example(), chip(name)).as_dict()
    assert json.loads(json.dumps(found)) == found
    assert list(found) == ["chip", "populations", "projections", "notes"]
    assert list(found["populations"]) == ["noise", "current", "exc", "relay", "out"]
    assert set(found["populations"]["exc"]) == {"kind", "units_per_mV", "rounding"}
    quantities = {"tau_m", "V_th", "t_ref", "I_e", "dc"} | ({"tau_syn_ex"} if name == "loihi" else {"V_reset", "C_m"})
    assert set(found["populations"]["exc"]["rounding"]) == quantities
    assert set(found["populations"]["exc"]["rounding"]["V_th"]) == {"unit", "wanted", "got", "error"}
    assert list(found["projections"]) == ["noise_exc", "exc_relay", "relay_out"]
    keys = {"exponent", "sign_mode", "bits", "step", "saturated", "zeroed", "largest_error", "rms_error"}
    assert keys <= set(found["projections"]["relay_out"])


@pytest.mark.parametrize(("delay", "needed"), [(16.0, False), (17.0, True)])
def test_delays_that_need_extensions(delay, needed):
    net = neuro.Network("late", resolution=1.0)
    net.population("in", 1, neuro.spike_generator())
    net.population("out", 1, delta())
    net.connect("in", "out", neuro.one_to_one(), weight=1.0, delay=delay)
    notes = quantise(compile_network(net, 0), chip("spinnaker")).notes
    assert ("delays above 16 ticks need delay extensions, whose cores are not placed" in notes) == needed


def test_what_is_kept_of_a_program_does_not_keep_it():
    net = neuro.Network("short_lived")
    net.population("cells", 4, neuro.iaf_psc_delta())
    net.connect("cells", "cells", neuro.all_to_all(), weight=1.0)
    gc.freeze()  # what was there before is not looked at
    program = compile_network(net, 0)
    for name in ("loihi", "spinnaker"):
        assert quantise(program, chip(name)).projections[0] is quantise(program, chip(name)).projections[0]
    seen = weakref.ref(program)
    del program
    gc.collect()
    gc.unfreeze()
    assert seen() is None
