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
    return [(p.what, p.why, p.way_out) for p in problems if "binary" not in p.why]


DECAY = "use a coarser resolution: a decay register has few steps where little decays in a step"
SCALE = "choose a larger scale; the largest V_th - E_L, current, V_m and weight of its population bound it"
WEIGHTS = "raise the small weights, or lower the largest one, which sets the scale"


def small_weights(share):
    """1000 weights of which a share is too small for a mantissa beside a large one."""
    weight = np.full(1000, 255.0)
    weight[: round(share * 1000)] = 0.4
    return one(delta(V_th=1.0), weight=weight, n=1000)


WARNED = {
    "zeroed": ("loihi", lambda: small_weights(0.010), lambda: small_weights(0.011), {}, (
        "projection 'in_out'", "1.1% of the weights other than 0 become 0", WEIGHTS,
    )),
    "rms": ("loihi", lambda: one(delta(), weight=25.49), lambda: one(delta(), weight=24.49), {
        "scales": {"out": 64.0}, "exponents": {"in_out": 0},
    }, ("projection 'in_out'", "2.0% is the rms error of the weights", WEIGHTS)),
    "tau_m": ("loihi", lambda: one(exp(tau_m=tau(25.49))), lambda: one(exp(tau_m=tau(24.49))), {}, (
        "population 'out': tau_m = 166.751 becomes 170.166 ms",
        "2.0% is the error of the membrane time constant", DECAY,
    )),
    "tau_syn_ex": ("loihi", lambda: one(exp(tau_syn_ex=tau(25.49))), lambda: one(exp(tau_syn_ex=tau(24.49))), {}, (
        "population 'out': tau_syn_ex = 166.751 becomes 170.166 ms",
        "2.0% is the error of the synaptic time constant", DECAY,
    )),
    "tau_syn_in": ("loihi", lambda: one(exp(tau_syn_in=tau(25.49)), weight=-1.0),
                   lambda: one(exp(tau_syn_in=tau(24.49)), weight=-1.0), {}, (
        "population 'out': tau_syn_in = 166.751 becomes 170.166 ms",
        "2.0% is the error of the synaptic time constant", DECAY,
    )),
    "V_th": ("loihi", lambda: one(delta(V_th=14.4032), weight=0.0), lambda: one(delta(V_th=14.401), weight=0.0), {
        "scales": {"out": 64.0 * 62.5},
    }, (
        "population 'out': V_th = 14.401 becomes 14.416 mV",
        "0.1% of the distance from E_L to V_th is the error of the threshold", SCALE,
    )),
    "V_reset": ("spinnaker", lambda: one(exp(E_L=0.0, V_th=0.05, V_reset=1.5 / 32768)),
                lambda: one(exp(E_L=0.0, V_th=0.01, V_reset=1.5 / 32768)), {}, (
        "population 'out': V_reset = 4.57764e-05 becomes 6.10352e-05 mV",
        "0.2% of the distance from E_L to V_th is the error of V_reset", "scale the potentials up",
    )),
    "C_m": ("spinnaker", lambda: one(exp(C_m=1e4 * 32768 / 25.49)), lambda: one(exp(C_m=1e4 * 32768 / 24.48)), {}, (
        "population 'out': C_m = 1.33856e+07 becomes 1.36533e+07 pF", "2.0% is the error of the membrane capacity",
        "lower C_m, and weights and currents with it",
    )),
    "I_e": ("spinnaker", lambda: one(exp(I_e=25.49 / 32.768)), lambda: one(exp(I_e=24.49 / 32.768)), {}, (
        "population 'out': I_e = 0.747375 becomes 0.732422 pA", "2.0% is the error of the constant current",
        "raise the current, or leave it out",
    )),
    "dc": ("spinnaker", lambda: one(exp(), source=neuro.dc_generator(amplitude=25.49 / 32.768)),
           lambda: one(exp(), source=neuro.dc_generator(amplitude=24.49 / 32.768)), {}, (
        "population 'out': dc = 0.747375 becomes 0.732422 pA", "2.0% is the error of the current of generators",
        "raise its amplitude, or leave it out",
    )),
    "merged": ("loihi", lambda: one(source=neuro.poisson_generator(rate=20.1)),
               lambda: one(source=neuro.poisson_generator(rate=20.3)), {}, (
        "population 'in': poisson_generator",
        "1.0% of the generator's spikes share a step with another of the same neuron and become one, "
        "since a spike on Loihi is one bit; counts().native has how many",
        "use a finer resolution or several generators of a lower rate",
    )),
}  # fmt: skip


def test_every_limit_is_tested():
    assert set(WARNED) == set(LIMITS)


@pytest.mark.parametrize("limit", WARNED)
def test_a_warning_just_above_its_limit_and_none_below(limit):
    name, below, above, options, text = WARNED[limit]
    assert text not in told(below(), name, **options)
    assert [why for _, why, _ in told(below(), name, **options) if LIMITS[limit].told in why] == []
    assert text in told(above(), name, **options)


RULE = """\
backend 'loihi': {place}: projection 'in_out': stdp: the chip's learning engine runs it otherwise:
    - """


def test_what_a_rule_does_otherwise_is_a_list():
    net = neuro.Network("plastic", resolution=1.0)
    net.population("in", 1, neuro.spike_generator())
    net.population("out", 1, exp())
    net.connect("in", "out", neuro.one_to_one(), neuro.stdp(Wmax=100.0), weight=50.0, delay=2.0, name="in_out")
    with pytest.warns(ApproximationWarning) as found:
        neuro.compile(net, "loihi")
    assert len(found) == 1
    text = str(found[0].message)
    assert text.startswith(RULE.format(place=net.projections["in_out"].origin))
    assert (
        "\n    - weights have 8 bits and change by whole steps, stochastically rounded from 2^-7 of a mantissa" in text
    )
    assert text.count("\n    - ") >= 5


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


REPORTS = {}
REPORTS["loihi"] = """\
network 'small' in the integers of Intel Loihi 1

population  neurons  is a       units per mV  quantity    described  on the chip  error
exc         8        loihi_lif  139559        tau_m       10 ms      9.98791 ms   -0.12%
                                              tau_syn_ex  2 ms       2.00008 ms   < 0.01%
                                              V_th        -55 mV     -54.9996 mV  < 0.01%
                                              I_e         150 pA     149.977 pA   -0.02%
                                              t_ref       2 ms       2 ms         0
                                              dc          100 pA     100.024 pA   +0.02%
relay       8        relay      -             -           -          -            -
out         2        loihi_lif  81920         tau_m       inf ms     inf ms       0
                                              V_th        8 mV       8 mV         0
                                              t_ref       2 ms       2 ms         0

projection  weights  bits  signs       scale       a step  delay           become 0  largest error  rms
noise_exc   160      8     excitatory  exponent 3  2.1277  2               0         0              0
exc_relay   8        8     excitatory  exponent 0  1       2 as 1          0         0              0
relay_out   16       8     mixed       exponent 5  0.025   1..16 as 0..15  0         0              0

notes
  - the host sends the spikes of generators
  - the host writes currents of dc_generators into the bias registers when they change
"""
REPORTS["spinnaker"] = """\
network 'small' in the integers of SpiNNaker 1

population  neurons  is a             units per mV  quantity  described  on the chip  error
exc         8        spinnaker_lif    32768         tau_m     10 ms      10.0007 ms   +0.01%
                                                    V_th      -55 mV     -55 mV       0
                                                    V_reset   -70 mV     -70 mV       0
                                                    t_ref     2 ms       2 ms         0
                                                    C_m       250 pF     250 pF       0
                                                    I_e       150 pA     149.994 pA   < 0.01%
                                                    dc        100 pA     100.006 pA   +0.01%
relay       8        relay            -             -         -          -            -
out         2        spinnaker_delta  32768         tau_m     inf ms     inf ms       0
                                                    V_th      8 mV       8 mV         0
                                                    V_reset   0 mV       0 mV         0
                                                    t_ref     2 ms       2 ms         0

projection  weights  bits  signs   scale        a step      delay   become 0  largest error  rms
noise_exc   160      16    either  shifts 2, 0  0.1222      2 as 3  0         < 0.01%        < 0.01%
exc_relay   8        16    either  -            1           2       0         0              0
relay_out   16       16    either  shifts 4, 3  0.00048828  1..16   0         0.07%          < 0.01%

notes
  - the host sends the spikes of generators
  - the host writes currents of dc_generators into the bias registers when they change
  - a step of 0.5 ms takes a tick of 1 ms on the machine
"""


@pytest.mark.parametrize("name", REPORTS)
def test_the_report(name):
    assert report(quantise(example(), chip(name))) + "\n" == REPORTS[name]


@pytest.mark.parametrize("name", REPORTS)
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


@pytest.mark.parametrize("name", ["loihi", "spinnaker"])
def test_what_is_kept_of_a_program_does_not_keep_it(name):
    net = neuro.Network("short_lived")
    net.population("cells", 4, neuro.iaf_psc_delta())
    net.connect("cells", "cells", neuro.all_to_all(), weight=1.0)
    program = compile_network(net, 0)
    assert quantise(program, chip(name)).projections[0] is quantise(program, chip(name)).projections[0]
    seen = weakref.ref(program)
    del program
    gc.collect()
    assert seen() is None
