"""Registers of the chips at both ends of their ranges, and convolutions whose rows and columns differ.

| register | range | driven to both ends by |
| --- | --- | --- |
| Loihi: mantissas | mixed -256..254, else 0..255, -255..0 | `test_what_a_spike_adds_on_loihi`, test_twins |
| Loihi: what a spike adds | +-(2^21 - 64) | `test_what_a_spike_adds_on_loihi` |
| Loihi: weights that learn | as mantissas | `test_what_is_learnt_stops_at_both_ends` |
| Loihi: tags | -256..255 | `test_what_is_learnt_stops_at_both_ends` |
| Loihi: traces | 0..127 | `test_traces_stop_at_127`; r1, r2: test_learning_rules |
| Loihi: accumulator | -32768..32767 | `test_the_accumulator_holds_16_bits` |
| Loihi: input, u, drive | 22, 24, 24 bits, wrap | test_overflows |
| Loihi: v | +-(2^23 - 1) | `test_voltages_of_loihi`; upwards a spike comes first, as no vth is as high |
| Loihi: vth, bias | 0..131071, -4096..4095 x 2^0..7 | `test_voltages_of_loihi`, test_twins |
| Loihi: du, dv | 0..4095 | `test_voltages_of_loihi`, test_twins |
| Loihi: delays, refractory | 0..62, 1..64 | test_twins |
| Loihi 2: mantissas | mixed -256..255, else as Loihi | golden `dense_ends_*` |
| Loihi 2: exponents, bits | -8..7, 1..8 | golden `dense_ends_*` |
| Loihi 2: delays | 0..62 in lava | golden `delaydense_ends` |
| Loihi 2: sums of a convolution | 24 bits, wrap | golden `conv_wraps` |
| Loihi 2: u | (-2^23, 2^23], wraps | golden `lif_*`, `ternary_ends_*` |
| Loihi 2: v, vth, bias | as Loihi | golden `lif_*`, `ternary_ends_*` |
| Loihi 2: resonators | +-(2^23 - 1) | `test_resonators_are_clipped_at_both_ends` |
| Loihi 2: weights that learn, traces | as mantissas; 0..127 | golden `learning_ends_*` |
| Loihi 2: tags | -257..255 as in lava; -257 takes one draw in 128 | golden `learning_ends_*` |
| SpiNNaker: slots | 0..65535 | test_twins |
| SpiNNaker: drive and v | s16.15, wrap | `test_states_of_spinnaker_wrap_at_both_ends` |
| SpiNNaker: delays | 1..144 ticks | test_twins |

Golden cases are outputs of lava-nc 0.10.0: `tests/helpers/make_loihi2_golden.py` makes them. A spike of Loihi is 0 or
1, several of a neuron in one step are one: test_twins.
"""

from pathlib import Path

import numpy as np
import pytest

import neuro
from beside import beside
from neuro.testing.verify import verify

GOLDEN = Path(__file__).parent / "loihi2_ends"


def test_golden_cases_of_lava_at_the_ends():
    results = verify(GOLDEN)
    assert {r.case: r.message for r in results if not r.ok} == {}
    assert len({r.case for r in results}) == 46
    with np.load(GOLDEN / "lava_0_10_0.npz") as arrays:
        ends = {name: (arrays[name].min(), arrays[name].max()) for name in arrays.files}
    assert ends["conv_wraps__a"] == (-(2**23), 2**23 - 1)
    assert ends["lif_u_ends__u"] == (64 - 2**23 + 0, 2**23)
    assert ends["learning_ends_mixed_up__tag_1"][1] == 255
    assert ends["learning_ends_mixed_down__tag_1"][0] == -256


(SENT,) = beside(__file__, "sent")
"""Sign mode, weight bits, exponent, mantissa, and what a spike adds to u."""


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning", "ignore::neuro.OverflowWarning")
@pytest.mark.parametrize(("mode", "bits", "exponent", "mantissa", "added"), SENT)
def test_what_a_spike_adds_on_loihi(mode, bits, exponent, mantissa, added):
    net = neuro.Network("one", resolution=1.0)
    net.population("in", 1, neuro.spike_generator(spike_times=[1.0]))
    net.population("out", 1, neuro.loihi_lif(du=0, vth=131071))
    synapse = neuro.loihi_static(weight_exp=exponent, num_weight_bits=bits, sign_mode=mode)
    net.connect("in", "out", neuro.all_to_all(), synapse, weight=float(mantissa), delay=1.0)
    net.probe("u", "out", "u")
    sim = neuro.compile(net, "loihi")
    sim.run(3.0)
    assert sim.trace("u")[1][1, 0] == added


def learnt(steps, mode="mixed", weight=0.0, targets=1, **rule):
    """A synapse onto each of some targets; all neurons fire in every step."""
    net = neuro.Network("learning", resolution=1.0)
    net.population("in", 1, neuro.spike_generator(spike_times=[np.arange(1.0, steps + 1.0)]))
    net.population("out", targets, neuro.loihi_lif(vth=0, bias_mant=4095, bias_exp=7))
    synapse = neuro.loihi_learning(sign_mode=mode, **rule)
    net.connect("in", "out", neuro.all_to_all(), synapse, weight=weight, delay=1.0, name="rule")
    for state in ("weight", "t"):
        net.probe(state, "rule", state)
    sim = neuro.compile(net, "loihi")
    sim.run(float(steps))
    return sim


def reached(by, low, high, steps):
    """Sums of equal changes that stop at both ends."""
    return [int(np.clip(k * by, low, high)) for k in range(1, steps + 1)]


@pytest.mark.filterwarnings("ignore::neuro.OverflowWarning")
@pytest.mark.parametrize("by", [17, -17, 51, -51, 15, -16])
def test_what_is_learnt_stops_at_both_ends(by):
    """15 x 17 is 255: -255 is passed by one to -256, and 255 is not."""
    sim = learnt(20, dt=products(by, "x0"))
    assert sim.trace("t")[1][:, 0].tolist()[-20:] == reached(by, -256, 255, 20)
    for mode, (low, high) in {"mixed": (-256, 254), "excitatory": (0, 255), "inhibitory": (-255, 0)}.items():
        sim = learnt(20, mode, dw=products(2 * by, "x0"))
        assert sim.trace("weight")[1][:, 0].tolist()[-20:] == reached(2 * by, low, high, 20), mode


def products(by, gate):
    """Products of mantissas of at most 7 whose sum is a number, such as 17 = 2^4 + 2^0."""
    sign = "-" if by < 0 else "+"
    powers = [k for k in range(9) if abs(by) >> k & 1]
    return " ".join(f"{sign} 2^{k}*{gate}" for k in powers).removeprefix("+ ").replace("- 2", "-2", 1)


@pytest.mark.filterwarnings("ignore::neuro.OverflowWarning")
def test_traces_stop_at_127():
    for trace in ("x1", "x2", "y1", "y2", "y3"):
        impulse = {f"{trace}_impulse": 120, f"{trace}_tau": 100}
        sim = learnt(2, dt=f"{trace}*x0", **impulse)
        assert sim.trace("t")[1][-2:, 0].tolist() == [120, 247], trace


@pytest.mark.filterwarnings("ignore::neuro.OverflowWarning")
@pytest.mark.parametrize(("rule", "tag", "overflows"), [("-2^8*x0", {-256}, 0), ("2^8*x0", {255}, 1)])
def test_the_accumulator_holds_16_bits(rule, tag, overflows):
    """-256 x 2^7 is its lowest value and no overflow; 256 x 2^7 is one above its largest."""
    sim = learnt(1, dt=rule, targets=2000)
    assert set(sim.trace("t")[1][-1].tolist()) == tag
    assert sim.counts().native.get("accumulator overflows in rule", 0) == overflows * 2000


@pytest.mark.filterwarnings("ignore::neuro.OverflowWarning")
def test_voltages_of_loihi():
    """By an own sum: v + bias, cut at -(2^23 - 1); a threshold of 131071 is passed by one unit of v and no less."""
    net = neuro.Network("ends", resolution=1.0)
    rows = {
        "falls": {"bias_mant": -4096, "bias_exp": 7, "dv": 0},
        "falls_slowly": {"bias_mant": -4096, "bias_exp": 0, "dv": 0},
        "rises": {"bias_mant": 4095, "bias_exp": 7, "dv": 0},
        "keeps_nothing": {"bias_mant": 4095, "bias_exp": 7, "dv": 4095},
    }
    for name, words in rows.items():
        net.population(name, 1, neuro.loihi_lif(vth=131071, **words))
        net.probe(f"v.{name}", name, "v")
    sim = neuro.compile(net, "loihi")
    sim.run(20.0)
    for name, words in rows.items():
        v, expected = 0, []
        for _ in range(20):
            v = (v >> 12 if words["dv"] else v) + words["bias_mant"] * 2 ** words["bias_exp"]
            v = int(np.clip(v, -(2**23 - 1), 2**23 - 1))
            v = 0 if v > 131071 * 64 else v
            expected.append(v)
        assert sim.trace(f"v.{name}")[1][:, 0].tolist()[-20:] == expected, name
    assert min(sim.trace("v.falls")[1]) == -(2**23 - 1)


@pytest.mark.filterwarnings("ignore::neuro.OverflowWarning")
@pytest.mark.parametrize("sign", [1, -1])
def test_resonators_are_clipped_at_both_ends(sign):
    net = neuro.Network("ends", resolution=1.0)
    rows = [[float(k), 0.0, sign * 131071.0] for k in range(1, 6)]
    net.population("in", 1, neuro.graded_spike_train(spikes=rows))
    net.population("out", 1, neuro.loihi2_rf(cos_decay=4096, sin_decay=0, state_exp=6, vth=2**16))
    for receptor in ("real", "imag"):
        net.connect(
            "in", "out", neuro.all_to_all(), neuro.static(receptor=receptor), weight=1.0, delay=1.0, name=receptor
        )
        net.probe(f"out.{receptor}", "out", receptor)
    sim = neuro.compile(net, "loihi2")
    sim.run(6.0)
    for receptor in ("real", "imag"):
        assert sim.trace(f"out.{receptor}")[1][-5:, 0].tolist() == [sign * 131071 * 64, *4 * [sign * (2**23 - 1)]]


@pytest.mark.filterwarnings("ignore::neuro.OverflowWarning")
@pytest.mark.parametrize("sign", [1, -1])
def test_states_of_spinnaker_wrap_at_both_ends(sign):
    """v_rest + I is 2^31 + 2, or less than -2^31 by 2: of 32 bits -2^31 + 2 and 2^31 - 2 are left."""
    net = neuro.Network("ends", resolution=1.0)
    cells = neuro.spinnaker_lif(
        r_m=32768, exp_tc=0, i_offset=sign * (2**30 + 1), v_rest=sign * (2**30 + 1), v_init=0, v_thresh=2**31 - 1
    )
    net.population("out", 1, cells)
    net.probe("v", "out", "v")
    sim = neuro.compile(net, "spinnaker")
    sim.run(2.0)
    assert sim.trace("v")[1][-1, 0] == sign * (2 - 2**31)
    assert sim.counts().native == {"current wraps of out": 2}
