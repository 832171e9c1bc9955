"""Scales, exponents and shifts by hand: what fills a register is taken, and no more; the messages of options."""

import math

import numpy as np
import pytest

from neuro.chips import chip, quantise
from neuro.core.errors import ModelError
from one_projection import delta, exp, one, refusals

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
