"""Every limit of a chip: what is just inside runs, what is just beyond is refused with the limit and a way out."""

import math
import warnings

import numpy as np
import pytest

import neuro
from neuro.chips import chip, quantise
from neuro.compiler import compile_network
from neuro.core.errors import ModelError
from neuro.run.compiled import ApproximationWarning

EXP = {"E_L": 0.0, "V_reset": 0.0, "V_th": 10.0}
DELTA = {**EXP, "t_ref": 0.0}


def one(model, h=1.0, weight=1.0, delay=None, synapse=None, n=1, initial=None, generator=None):
    """A generator onto one population."""
    net = neuro.Network("one", resolution=h)
    net.population("in", n, generator or neuro.spike_generator(spike_times=[[]] * n))
    net.population("out", n, model, initial=initial or {})
    net.connect(
        "in", "out", neuro.one_to_one(), synapse or neuro.static(), weight=weight, delay=delay or h, name="in_out"
    )
    return compile_network(net, 0)


def refusals(program, name, **options):
    """All that is refused: what, why, way out."""
    return [(p.what, p.why, p.way_out) for p in quantise(program, chip(name), **options).problems if p.refused]


def exp(**values):
    return neuro.iaf_psc_exp(**{**EXP, **values})


def delta(**values):
    return neuro.iaf_psc_delta(**{**DELTA, **values})


LIMITS = {
    "tau_m below a step": (
        "loihi",
        lambda tau: one(exp(tau_m=tau)),
        (1.0, 0.999),
        (
            "population 'out': tau_m = 0.999 ms",
            "it is below a step of 1 ms",
            "use a finer resolution or a longer time constant",
        ),
    ),
    "tau_syn below a step": (
        "spinnaker",
        lambda tau: one(exp(tau_syn_ex=tau)),
        (1.0, 0.999),
        (
            "population 'out': tau_syn_ex = 0.999 ms",
            "it is below a step of 1 ms",
            "use a finer resolution or a longer time constant",
        ),
    ),
    "tau_m beyond 12 bits": (
        "loihi",
        lambda tau: one(exp(tau_m=tau), h=0.1),
        (409.549, 409.551),
        (
            "population 'out': tau_m = 409.551 ms",
            "a 12-bit decay holds at most 409.55 ms at a resolution of 0.1 ms",
            "use at most 409.55 ms, a coarser resolution, or .inf for no leak",
        ),
    ),
    "tau_syn beyond 12 bits": (
        "loihi",
        lambda tau: one(exp(tau_syn_ex=tau)),
        (4095.4, 4095.6),
        (
            "population 'out': tau_syn_ex = 4095.6 ms",
            "a 12-bit decay holds at most 4095.5 ms at a resolution of 1 ms",
            "use at most 4095.5 ms or a coarser resolution",
        ),
    ),
    "tau_m beyond 15 bits": (
        "spinnaker",
        lambda tau: one(exp(tau_m=tau, C_m=1e4)),
        (32767.4, 32767.6),
        (
            "population 'out': tau_m = 32767.6 ms",
            "a decay of 15 bits holds at most 32767.5 ms at a resolution of 1 ms",
            "use at most 32767.5 ms or a coarser resolution",
        ),
    ),
    "refractory register": (
        "loihi",
        lambda t: one(delta(t_ref=t), h=0.5),
        (31.5, 32.0),
        (
            "population 'out': t_ref = 32 ms",
            "it is 64 steps, and the refractory register holds at most 63",
            "use at most 31.5 ms, or a coarser resolution",
        ),
    ),
    "V_reset off E_L": (
        "loihi",
        lambda v: one(delta(V_reset=v)),
        (0.0, -1e-9),
        (
            "population 'out': V_reset = -1e-09 mV",
            "a spike sets the voltage register to 0, which is E_L = 0 mV",
            "set V_reset to 0, or run on spinnaker",
        ),
    ),
    "V_min": (
        "loihi",
        lambda v: one(delta(V_min=v)),
        (-math.inf, -80.0),
        ("population 'out': V_min = -80 mV", "a compartment has no lowest potential", "leave V_min out"),
    ),
    "V_min on spinnaker": (
        "spinnaker",
        lambda v: one(delta(V_min=v)),
        (-math.inf, -80.0),
        ("population 'out': V_min = -80 mV", "the chip's programs have no lowest potential", "leave V_min out"),
    ),
    "refractory_input": (
        "loihi",
        lambda keep: one(delta(refractory_input=keep)),
        (False, True),
        ("population 'out': refractory_input", "a compartment loses input while it is refractory", "leave it out"),
    ),
    "refractory_input on spinnaker": (
        "spinnaker",
        lambda keep: one(delta(refractory_input=keep)),
        (False, True),
        (
            "population 'out': refractory_input",
            "the chip's programs lose input while a neuron is refractory",
            "leave it out",
        ),
    ),
    "two synaptic time constants": (
        "loihi",
        lambda tau: one(exp(tau_syn_ex=2.0, tau_syn_in=tau), n=2, weight=[5.0, -5.0]),
        (2.0, 3.0),
        (
            "population 'out': tau_syn_ex = 2 ms and tau_syn_in = 3 ms",
            "a compartment has one current and so one synaptic time constant",
            "use one time constant for both, or run on spinnaker",
        ),
    ),
    "two synaptic time constants by the current at step 0": (
        "loihi",
        lambda i: one(exp(tau_syn_ex=2.0, tau_syn_in=3.0), initial={"I_syn_in": i}),
        (0.0, -1.0),
        (
            "population 'out': tau_syn_ex = 2 ms and tau_syn_in = 3 ms",
            "a compartment has one current and so one synaptic time constant",
            "use one time constant for both, or run on spinnaker",
        ),
    ),
    "delay of a current synapse": (
        "loihi",
        lambda d: one(exp(), h=0.1, delay=d),
        (6.2, 6.3),
        (
            "projection 'in_out': a delay of 6.3 ms",
            "63 steps in the delay register, which holds at most 62 on loihi",
            "use at most 6.2 ms, a coarser resolution, or a chain of parrots",
        ),
    ),
    "delay of a delta synapse": (
        "loihi",
        lambda d: one(delta(), delay=d),
        (63.0, 64.0),
        (
            "projection 'in_out': a delay of 64 ms",
            "63 steps in the delay register, which holds at most 62 on loihi",
            "use at most 63 ms, a coarser resolution, or a chain of parrots",
        ),
    ),
    "delay on spinnaker": (
        "spinnaker",
        lambda d: one(exp(), delay=d),
        (143.0, 144.0),
        (
            "projection 'in_out': a delay of 144 ms",
            "145 steps in the delay register, which holds at most 144 on spinnaker",
            "use at most 143 ms, a coarser resolution, or a chain of parrots",
        ),
    ),
    "delay of a delta synapse on spinnaker": (
        "spinnaker",
        lambda d: one(delta(), delay=d),
        (144.0, 145.0),
        (
            "projection 'in_out': a delay of 145 ms",
            "145 steps in the delay register, which holds at most 144 on spinnaker",
            "use at most 144 ms, a coarser resolution, or a chain of parrots",
        ),
    ),
    "no leak on spinnaker": (
        "spinnaker",
        lambda tau: one(exp(tau_m=tau)),
        (100.0, math.inf),
        (
            "population 'out': tau_m = inf",
            "the membrane resistance tau_m / C_m would be infinite",
            "use a finite tau_m, or iaf_psc_delta",
        ),
    ),
    "s16.15 of a threshold": (
        "spinnaker",
        lambda v: one(exp(V_th=v)),
        (65535.9, 65536.0),
        (
            "population 'out': V_th = 65536 mV",
            "it takes 65536 in s16.15, which holds numbers below 65536",
            "scale the model down",
        ),
    ),
    "s16.15 of V_m": (
        "spinnaker",
        lambda v: one(exp(), initial={"V_m": v}),
        (-65535.9, -65537.0),
        (
            "population 'out': V_m = -65537 mV at step 0",
            "it takes 65537 in s16.15, which holds numbers below 65536",
            "scale the model down",
        ),
    ),
    "s16.15 of the resistance": (
        "spinnaker",
        lambda c: one(exp(tau_m=10.0, C_m=c)),
        (0.1526, 0.1525),
        (
            "population 'out': tau_m / C_m = 65573.8 MOhm",
            "it takes 65573.8 in s16.15, which holds numbers below 65536",
            "scale the model down",
        ),
    ),
    "s16.15 of a current": (
        "spinnaker",
        lambda i: one(exp(I_e=i)),
        (65.5e6, 66e6),
        (
            "population 'out': a constant current of 6.6e+07 pA",
            "it takes 66000 in s16.15, which holds numbers below 65536",
            "scale the model down",
        ),
    ),
    "s16.15 of a generator's current": (
        "spinnaker",
        lambda i: one(exp(I_e=1e6), weight=-1.0, generator=neuro.dc_generator(amplitude=i)),
        (64e6, 65e6),
        (
            "population 'out': a constant current of 6.6e+07 pA",
            "it takes 66000 in s16.15, which holds numbers below 65536",
            "scale the model down",
        ),
    ),
    "refractory ticks": (
        "spinnaker",
        lambda t: one(delta(t_ref=t)),
        (2147483647.0, 2147483648.0),
        (
            "population 'out': t_ref = 2.14748e+09 ms",
            "2.14748e+09 ticks, and t_refract holds at most 2147483647",
            "use at most 2.14748e+09 ms",
        ),
    ),
    "weight word": (
        "spinnaker",
        lambda w: one(delta(), weight=w),
        (65535.0, 65536.0),
        (
            "projection 'in_out': weight = 65536",
            "a word of 16 bits holds at most 65535 at exc_shift 15",
            "scale the weights down",
        ),
    ),
}


@pytest.mark.parametrize("case", LIMITS)
def test_a_limit(case):
    name, build, (inside, beyond), text = LIMITS[case]
    assert refusals(build(inside), name) == []
    assert refusals(build(beyond), name) == [text]


@pytest.mark.parametrize(
    ("mode", "low", "high"), [("mixed", -256, 254), ("excitatory", 0, 255), ("inhibitory", -255, 0)]
)
def test_mantissas(mode, low, high):
    def program(weight):
        return one(neuro.loihi_lif(), weight=weight, synapse=neuro.loihi_static(sign_mode=mode))

    assert refusals(program(float(low)), "loihi") == refusals(program(float(high)), "loihi") == []
    for beyond in (low - 1, high + 1, 0.5 * (low + high) + 0.25):
        assert refusals(program(float(beyond)), "loihi") == [
            (
                f"projection 'in_out': weight = {beyond:g}",
                f"a mantissa in sign mode {mode} is a whole number from {low} to {high}",
                "raise weight_exp and lower the mantissas",
            )
        ]


def test_words_of_a_spinnaker_lif():
    for word in (65535.0, -65535.0):
        assert refusals(one(neuro.spinnaker_lif(), weight=word), "spinnaker") == []
    for word in (65536.0, -65536.0, 1.5):
        assert refusals(one(neuro.spinnaker_lif(), weight=word), "spinnaker") == [
            (
                f"projection 'in_out': weight = {word:g}",
                "a word is a whole number from -65535 to 65535",
                "change exc_shift or inh_shift",
            )
        ]


def test_delays_of_a_loihi_lif():
    def program(delay):
        return one(neuro.loihi_lif(), weight=2.0, delay=delay, synapse=neuro.loihi_static())

    assert refusals(program(63.0), "loihi") == []
    assert refusals(program(64.0), "loihi") == [
        (
            "projection 'in_out': a delay of 64 ms",
            "63 steps in the delay register, which holds at most 62 on loihi",
            "use at most 63 ms, a coarser resolution, or a chain of parrots",
        )
    ]


# registers that a scale set by hand overflows

BY_HAND = {
    "threshold": (
        lambda: one(delta(V_th=8.0), weight=0.0),
        8.0 * 131071,
        8.0 * 131072,
        (
            "population 'out': V_th - E_L needs 131072 at 1.04858e+06 units per mV",
            "the 17-bit threshold register holds at most 131071",
            "set its scale to at most 1.04857e+06",
        ),
    ),
    "bias": (
        lambda: one(delta(tau_m=math.inf, C_m=1.0, I_e=-4095.0), weight=0.0),
        128.0,
        128.0 * 4096 / 4095,
        (
            "population 'out': the constant current needs 524288 at 128.031 units per mV",
            "the bias register, 4095 x 2^7, holds at most 524160",
            "set its scale to at most 128",
        ),
    ),
    "voltage": (
        lambda: one(delta(), weight=0.0, initial={"V_m": -(2.0**20)}),
        8.0 - 2.0**-20,
        8.0 + 2.0**-16,
        (
            "population 'out': V_m at step 0 needs 8.38862e+06 at 8.00002 units per mV",
            "the 24-bit voltage register holds at most 8388607",
            "set its scale to at most 8",
        ),
    ),
    "current": (
        lambda: one(
            exp(tau_m=math.inf, C_m=1.0, tau_syn_ex=1e3),
            weight=0.0,
            initial={"I_syn_ex": 2.0**20 / (1e3 * math.expm1(1e-3))},
        ),
        8.0 - 2.0**-20,
        8.0 + 2.0**-16,
        (
            "population 'out': I_syn at step 0 needs 8.38862e+06 at 8.00002 units per mV",
            "the 24-bit current register holds at most 8388607",
            "set its scale to at most 8",
        ),
    ),
}


@pytest.mark.parametrize("register", BY_HAND)
def test_a_scale_by_hand_fills_a_register_and_not_more(register):
    build, inside, beyond, text = BY_HAND[register]
    program = build()
    assert refusals(program, "loihi") == []
    assert refusals(program, "loihi", scales={"out": inside}) == []
    assert refusals(program, "loihi", scales={"out": beyond}) == [text]


@pytest.mark.parametrize(("weights", "mode", "limit"), [([5.0], "excitatory", 255), ([-5.0], "inhibitory", -255)])
def test_a_weight_beyond_the_mantissa_by_hand(weights, mode, limit):
    largest = 64.0 * 255.0 / 5.0
    program = one(delta(), weight=weights[0])
    fine = quantise(program, chip("loihi"), scales={"out": largest}, exponents={"in_out": 0})
    assert not [p for p in fine.problems if p.refused]
    assert fine.projections[0].mantissas.tolist() == [limit]
    assert refusals(program, "loihi", scales={"out": largest * 256 / 255}, exponents={"in_out": 0}) == [
        (
            f"projection 'in_out': weight = {weights[0]:g}",
            f"a mantissa in sign mode {mode} holds at most {limit}, which is {np.sign(limit) * 5 * 255 / 256:.6g} "
            "at exponent 0 and 3276.8 units per mV",
            "use a larger exponent or a smaller scale, or leave them to be chosen",
        )
    ]


def test_a_word_beyond_a_shift_by_hand():
    program = one(delta(), weight=-3.0)
    assert refusals(program, "spinnaker", shifts={"out": (0, 1)}) == []
    assert refusals(program, "spinnaker", shifts={"out": (1, 0)}) == [
        (
            "projection 'in_out': weight = -3",
            "a word of 16 bits holds at most 1.99997 at inh_shift 0",
            "use a larger shift, or leave it to be chosen",
        )
    ]


# models and rules that a chip lacks

LACKS = "use iaf_psc_exp, or run on event"


@pytest.mark.parametrize(
    ("name", "model", "way"),
    [
        ("loihi", neuro.izhikevich(), LACKS),
        ("loihi", neuro.iaf_psc_alpha(), LACKS),
        ("loihi", neuro.spinnaker_lif(), "backend 'spinnaker' runs it"),
        ("spinnaker", neuro.iaf_psc_alpha(), LACKS),
        ("spinnaker", neuro.loihi_lif(), "backend 'loihi' runs it"),
    ],
)
def test_models_that_a_chip_lacks(name, model, way):
    assert refusals(one(model), name) == [
        (
            f"population 'out': {model.name}",
            f"{name} has no such neuron: it has iaf_psc_exp, iaf_psc_delta and parrot_neuron",
            way,
        )
    ]


def test_rules_that_a_chip_lacks():
    way = "run it on loihi or event, or send static weights: sim.network() has what was learnt"
    assert refusals(one(exp(), weight=5.0, synapse=neuro.stdp(Wmax=10.0)), "spinnaker") == [
        ("projection 'in_out': stdp", "pairwise learning is not emulated on spinnaker", way)
    ]
    assert refusals(one(exp(), weight=5.0, synapse=neuro.stdp(Wmax=10.0, mu_plus=0.5)), "loihi") == [
        (
            "projection 'in_out': stdp",
            "stdp.mu_plus = 0.5: expected 0 or 1, which are sums of products on the chip",
            "mu_plus: 0 is nearest",
        )
    ]


@pytest.mark.parametrize(
    ("model", "synapse", "why", "way"),
    [
        (
            exp(),
            neuro.loihi_static(weight_exp=3),
            "its weights are mantissas, but iaf_psc_exp has mV and pA",
            "use static or stdp, or a loihi_lif",
        ),
        (
            neuro.loihi_lif(),
            neuro.stdp(Wmax=100.0),
            "its weights are in mV or pA, but loihi_lif has registers",
            "use loihi_learning",
        ),
        (
            neuro.parrot_neuron(),
            neuro.stdp(Wmax=100.0),
            "the host relays the spikes of parrots, so there is no weight to learn",
            "learn at the next projection",
        ),
    ],
)
def test_synapses_that_do_not_go_with_their_neurons(model, synapse, why, way):
    assert refusals(one(model, weight=5.0, synapse=synapse), "loihi") == [
        (f"projection 'in_out': {synapse.name}", why, way)
    ]


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
def test_thresholds_that_adapted_elsewhere_are_taken():
    def net(model):
        net = neuro.Network("adapted", resolution=1.0)
        net.population("noise", 20, neuro.poisson_generator(rate=150.0))
        net.population("cells", 4, model)
        net.connect("noise", "cells", neuro.all_to_all(), weight=300.0, delay=1.0)
        return net

    shared = {"tau_syn_ex": 5.0, "tau_syn_in": 5.0}
    adapting = neuro.iaf_psc_exp_adaptive_threshold(**shared)
    known = "iaf_psc_exp, iaf_psc_delta and parrot_neuron"
    assert refusals(neuro.compile(net(adapting)).program, "loihi") == [
        (
            "population 'cells': iaf_psc_exp_adaptive_threshold",
            f"loihi has no such neuron: it has {known}",
            "adapt on event, then give iaf_psc_exp the V_th of each neuron that is V_th + theta there",
        )
    ]
    sim = neuro.compile(net(adapting), seed=1)
    sim.run(200.0)
    raised = sim.get("cells", "V_th") + sim.get("cells", "theta")
    assert (raised > adapting.V_th).all()
    chip = neuro.compile(net(neuro.iaf_psc_exp(V_th=raised, **shared)), "loihi", seed=1)
    assert chip.get("cells", "V_th").tolist() == raised.tolist()


def test_a_kernel_onto_neurons_that_differ():
    net = neuro.Network("grid", resolution=1.0)
    net.population("in", (1, 4, 4), neuro.spike_generator(spike_times=[[]] * 16))
    net.population("out", (2, 3, 3), exp(tau_m=np.linspace(5.0, 20.0, 18).reshape(2, 3, 3)))
    net.connect("in", "out", neuro.grid((2, 2)), weight=np.arange(8.0).reshape(2, 1, 2, 2), delay=1.0, name="k")
    text = (
        "projection 'k': a shared kernel onto neurons that differ",
        "a kernel has one scale",
        "give the neurons the same time constants and C_m",
    )
    for name in ("loihi", "spinnaker"):
        assert refusals(compile_network(net, 0), name) == [text]


@pytest.mark.parametrize("v_th", [0.0, -5.0])
def test_a_threshold_that_is_not_above_rest(v_th):
    program = one(delta(V_reset=-20.0, V_th=v_th), weight=0.0)
    told = refusals(program, "loihi")
    assert [what for what, _, _ in told] == [
        "population 'out': V_reset = -20 mV",
        f"population 'out': V_th = {v_th:g} mV",
    ]
    assert told[1][1:] == (
        "the threshold register is unsigned, so V_th must be above E_L = 0 mV",
        "raise V_th or lower E_L, or run on spinnaker",
    )
    assert refusals(program, "spinnaker") == []


# options

OPTIONS = {
    "unknown": ("loihi", {"scale": {}}, "backend 'loihi' has no option 'scale'\n  hint: did you mean 'scales'?"),
    "of the other chip": (
        "loihi",
        {"shifts": {"out": (1, 1)}},
        "backend 'loihi' has no option 'shifts'\n"
        "  hint: known: exponents, neurons_per_core, order, scales, signals, strict",
    ),
    "exponents on spinnaker": (
        "spinnaker",
        {"exponents": {"in_out": 1}},
        "backend 'spinnaker' has no option 'exponents'\n  hint: known: neurons_per_core, order, shifts, strict",
    ),
    "no mapping": ("loihi", {"scales": 3.0}, "scales = 3.0: expected values by name, such as {'exc': ...}"),
    "unknown part": ("loihi", {"scales": {"aut": 1.0}}, "scales: unknown part 'aut'\n  hint: did you mean 'out'?"),
    "a generator": (
        "loihi",
        {"scales": {"in": 1.0}},
        "scales['in']: a spike_generator: expected populations of iaf_psc_exp or iaf_psc_delta",
    ),
    "scale 0": ("loihi", {"scales": {"out": 0.0}}, "scales['out'] = 0.0: expected units per mV, a number > 0"),
    "scale nan": ("loihi", {"scales": {"out": math.nan}}, "scales['out'] = nan: expected units per mV, a number > 0"),
    "scale inf": ("loihi", {"scales": {"out": math.inf}}, "scales['out'] = inf: expected units per mV, a number > 0"),
    "scale text": ("loihi", {"scales": {"out": "big"}}, "scales['out'] = 'big': expected units per mV, a number > 0"),
    "exponent 8": (
        "loihi",
        {"exponents": {"in_out": 8}},
        "exponents['in_out'] = 8: expected a weight exponent, a whole number from -8 to 7",
    ),
    "exponent -9": (
        "loihi",
        {"exponents": {"in_out": -9}},
        "exponents['in_out'] = -9: expected a weight exponent, a whole number from -8 to 7",
    ),
    "exponent 1.0": (
        "loihi",
        {"exponents": {"in_out": 1.0}},
        "exponents['in_out'] = 1.0: expected a weight exponent, a whole number from -8 to 7",
    ),
    "shift 16": (
        "spinnaker",
        {"shifts": {"out": (0, 16)}},
        "shifts['out'] = (0, 16): expected the shifts of excitatory and inhibitory slots, two whole numbers up to 15",
    ),
    "one shift": (
        "spinnaker",
        {"shifts": {"out": 3}},
        "shifts['out'] = 3: expected the shifts of excitatory and inhibitory slots, two whole numbers up to 15",
    ),
    "signal 0": (
        "loihi",
        {"signals": {"in_out": 0.0}},
        "signals['in_out'] = 0.0: expected the largest dopamine that the signal sets in 1/ms, a number > 0",
    ),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_options(case):
    name, options, text = OPTIONS[case]
    with pytest.raises(ModelError) as error:
        quantise(one(delta()), chip(name), **options)
    assert str(error.value) == text


def test_options_at_their_bounds():
    program = one(delta(), weight=0.001)
    for exponent in (-8, 7, np.int64(0)):
        assert quantise(program, chip("loihi"), exponents={"in_out": exponent}).projections[0].exponent == exponent
    for shifts in ((0, 15), [15, 0]):
        registers = quantise(program, chip("spinnaker"), shifts={"out": shifts}).populations[1].registers
        assert [registers["exc_shift"][0], registers["inh_shift"][0]] == list(shifts)


def test_a_chip_without_arithmetic():
    with pytest.raises(ModelError) as error:
        quantise(one(delta()), chip("loihi2"))
    assert str(error.value) == (
        "chip 'loihi2' has no arithmetic here: expected one of loihi, spinnaker\n"
        "  hint: its limits and costs serve placing and energy only"
    )


# all at once, with their places

YAML = """\
neuro: 1
name: wrong
resolution: 0.1
populations:
  in: {model: poisson_generator, shape: 3}
  a: {model: {iaf_psc_exp: {tau_m: 500.0, V_reset: -65.0, t_ref: 7.0}}, shape: 2}
  b: {model: izhikevich, shape: 1}
projections:
  in_a: {from: in, to: a, rule: all_to_all, weight: 10.0, delay: 9.0}
  in_b:
    {from: in, to: b, rule: all_to_all, weight: 10.0, delay: 1.0}
"""

ALL = """\
backend 'loihi' cannot run this network (5 problems)
{file}:6:3: population 'a': tau_m = 500 ms: a 12-bit decay holds at most 409.55 ms at a resolution of 0.1 ms
  hint: use at most 409.55 ms, a coarser resolution, or .inf for no leak
{file}:6:3: population 'a': t_ref = 7 ms: it is 70 steps, and the refractory register holds at most 63
  hint: use at most 6.3 ms, or a coarser resolution
{file}:6:3: population 'a': V_reset = -65 mV: a spike sets the voltage register to 0, which is E_L = -70 mV
  hint: set V_reset to -70, or run on spinnaker
{file}:7:3: population 'b': izhikevich: loihi has no such neuron: it has iaf_psc_exp, iaf_psc_delta and parrot_neuron
  hint: use iaf_psc_exp, or run on event
{file}:9:3: projection 'in_a': a delay of 9 ms: 90 steps in the delay register, which holds at most 62 on loihi
  hint: use at most 6.2 ms, a coarser resolution, or a chain of parrots"""


def test_all_problems_are_told_at_once_with_their_lines(tmp_path):
    file = tmp_path / "wrong.yaml"
    file.write_text(YAML)
    with pytest.raises(ModelError) as error:
        neuro.compile(neuro.load(file), "loihi")
    assert str(error.value) == ALL.format(file=file)


# nothing ends in a traceback

ODD = {
    "zero weights": lambda: one(exp(), weight=0.0),
    "tiny weights": lambda: one(exp(), weight=1e-300),
    "huge weights": lambda: one(exp(), weight=1e300),
    "huge and tiny weights": lambda: one(delta(), n=2, weight=[1e200, -1e-200]),
    "tiny capacity": lambda: one(exp(C_m=1e-300)),
    "huge capacity": lambda: one(exp(C_m=1e300, I_e=1.0)),
    "huge threshold": lambda: one(exp(V_th=1e300)),
    "tiny threshold": lambda: one(exp(V_th=1e-300)),
    "huge current": lambda: one(exp(I_e=-1e300)),
    "tiny current": lambda: one(exp(I_e=1e-300)),
    "huge time constants": lambda: one(exp(tau_m=1e300, tau_syn_ex=1e299, tau_syn_in=1e299)),
    "tiny time constants": lambda: one(exp(tau_m=1e-300, tau_syn_ex=1e-300, tau_syn_in=1e-300)),
    "huge states": lambda: one(exp(), initial={"V_m": 1e300, "I_syn_ex": 1e300, "I_syn_in": -1e300}),
    "wrong signs of states": lambda: one(exp(), initial={"I_syn_ex": -10.0, "I_syn_in": 10.0}),
    "a fine step": lambda: one(exp(), h=1e-3),
    "a long step": lambda: one(exp(t_ref=0.0), h=1e3),
    "long refractoriness": lambda: one(exp(t_ref=1e12)),
    "a huge generator": lambda: one(exp(), generator=neuro.dc_generator(amplitude=1e300)),
    "neurons that differ": lambda: one(
        exp(tau_m=[5.0, math.inf], C_m=[1e-3, 1e6], V_th=[1e-3, 1e3], I_e=[0.0, 1e6]), n=2, weight=[1.0, -1e6]
    ),
    "plastic from 0": lambda: one(exp(), weight=0.0, synapse=neuro.stdp(Wmax=1e-9)),
}


@pytest.mark.parametrize("name", ["loihi", "spinnaker"])
@pytest.mark.parametrize("case", ODD)
def test_no_traceback(case, name):
    from neuro.chips.quantising.fixed_program import report

    program = ODD[case]()
    fixed = quantise(program, chip(name))
    assert report(fixed)
    assert fixed.as_dict()["chip"] == name
    if not any(p.refused for p in fixed.problems):
        for cells in fixed.populations:
            for register, values in (*cells.registers.items(), *cells.initial.items()):
                assert np.abs(values).max(initial=0) < 2**32, register


@pytest.mark.parametrize("name", ["loihi", "spinnaker"])
def test_a_network_without_projections(name):
    net = neuro.Network("alone", resolution=1.0)
    net.population("out", 3, exp(I_e=600.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error", ApproximationWarning)
        sim = neuro.compile(net, name)
    sim.run(50.0)
    assert sim.spikes("out")[1].size > 0


@pytest.mark.parametrize(
    ("name", "model", "value", "limit"),
    [
        ("loihi", neuro.loihi_lif(), 2.0**23, 2**23 - 1),
        ("loihi", neuro.loihi_lif(), 0.5, 2**23 - 1),
        ("spinnaker", neuro.spinnaker_lif(), 2.0**33, 2**31 - 1),
    ],
)
def test_an_initial_state_that_no_register_holds_is_refused(name, model, value, limit):
    net = neuro.Network("begin", resolution=1.0)
    net.population("out", 1, model, initial={"v": value})
    told = f"population 'out': v = {value:.10g} at step 0: a state register holds whole numbers from -{limit} to "
    with pytest.raises(neuro.ModelError) as refused:
        neuro.compile(net, name)
    assert f"{told}{limit}" in str(refused.value)
