"""Numbers with their units: converted exactly, wherever numbers stand; what does not fit is refused."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, strategies as st

import neuro
from beside import beside
from neuro.cli.options import milliseconds
from neuro.core.units import TENS, converted, is_measure

(EXACT,) = beside(__file__, "EXACT")


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    EXACT,
)
def test_exact(text: str, unit: str, expected: float):
    assert converted(text, unit) == expected


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(list(TENS)), st.sampled_from(list(TENS)))
def test_to_the_nearest_double(x: float, unit: str, to: str):
    (tens, dimension), (others, wanted) = TENS[unit], TENS[to]
    if dimension == wanted:
        try:
            expected = float(Fraction(repr(x)) * Fraction(10) ** (tens - others))
        except OverflowError:
            expected = math.copysign(math.inf, x)
        found = converted(f"{x!r} {unit}", to)
        assert found == expected


@pytest.mark.parametrize("text", ["10", "1e3", "0x10", "0b1", "ms", "10 %", "2*5", "", "1_000", "3 " + "m" * 200, 3.0])
def test_what_is_no_number_with_a_unit(text: object):
    assert not is_measure(text)


def test_wherever_numbers_stand():
    cells = neuro.iaf_psc_exp(
        tau_m=["0.01 s", 12.0], C_m=neuro.normal(mean="0.25 nF", std="1 pF", low=1.0), I_e="0.1 nA", t_ref="2 ms"
    )
    assert np.array_equal(cells.tau_m, [10.0, 12.0])
    assert cells.C_m == neuro.normal(mean=250.0, std=1.0, low=1.0)
    net = neuro.Network("units", resolution="100 us")
    net.population("cells", 2, cells, initial={"V_m": ["-65 mV", "-0.07 V"]})
    net.population("open", 1, neuro.iaf_cond_exp())
    net.population("drive", 2, neuro.spike_generator(spike_times=[["1 ms", 2.5], ["0.004 s"]]))
    net.connect("drive", "cells", neuro.all_to_all(), weight=[["1 nA", "2 pA"], [3.0, 4.0]], delay="1500 us")
    weight, delay = neuro.of_distance(neuro.linear(c="1 uS")), neuro.uniform(low="0.5 ms", high="0.002 s")
    net.connect("drive", "open", neuro.all_to_all(), weight=weight, delay=delay)
    net.probe("v", "cells", "V_m", every="1 ms")
    assert net.resolution == 0.1
    assert net.populations["cells"].initial["V_m"].tolist() == [-65.0, -70.0]
    assert [row.tolist() for row in net.populations["drive"].model.spike_times] == [[1.0, 2.5], [4.0]]
    first, second = net.projections.values()
    assert (first.weight.tolist(), first.delay) == ([[1000.0, 2.0], [3.0, 4.0]], 1.5)
    assert second.weight == neuro.of_distance(neuro.linear(c=1000.0))
    assert second.delay == neuro.uniform(low=0.5, high=2.0)
    assert net.probes["v"].every == 1.0


def test_in_a_file_and_when_it_runs(folder):
    text = "neuro: 1\nparameters: {tau: 10 ms}\npopulations:\n"
    text += "  a: {model: {iaf_psc_exp: {tau_m: $tau, C_m: {normal: {mean: 0.25 nF, std: 0}}, I_e: 1 nA}}, shape: 2}\n"
    (folder / "net.yaml").write_text(text)
    net = neuro.load("net.yaml", {"tau": "0.02 s"})
    assert net.populations["a"].model == neuro.iaf_psc_exp(tau_m=20.0, C_m=neuro.normal(mean=250.0, std=0.0), I_e=1e3)
    net.save("saved.yaml")
    assert "tau_m: 20.0" in (folder / "saved.yaml").read_text()
    sim = neuro.compile(net, "reference")
    sim.run("0.01 s")
    assert sim.time == 10.0
    sim.set("a", tau_m="15 ms", V_m="-0.06 V")
    assert sim.get("a", "V_m").tolist() == [-60.0, -60.0]
    assert len(sim.spikes("a", since="5 ms")[0]) == len(sim.spikes("a", since=5.0)[0])


def test_on_the_command_line():
    assert milliseconds("10 s") == 10_000.0
    with pytest.raises(Exception, match="'10 mV': expected a time in ms"):
        milliseconds("10 mV")
    with pytest.raises(Exception, match="'10 sec': unknown unit 'sec'"):
        milliseconds("10 sec")


def onto(target: str, **words):
    net = neuro.Network("n")
    for name, model in (("psc", neuro.iaf_psc_exp()), ("delta", neuro.iaf_psc_delta()), ("cond", neuro.iaf_cond_exp())):
        net.population(name, 1, model)
    net.population("parrot", 1, neuro.parrot_neuron())
    net.connect("psc", target, neuro.all_to_all(), name="p", **words)


def test_mistakes(messages):
    messages.calls(globals())


def test_a_mistake_in_a_file_has_its_place(message):
    text = "neuro: 1\npopulations:\n  a: {model: {iaf_psc_exp: {tau_m: {normal: {mean: 10 mV}}}}, shape: 2}\n"
    told = "population 'a': iaf_psc_exp.tau_m: normal.mean = 10 mV: expected a time in ms"
    assert message(text) == f"net.yaml:3:52: {told}"
