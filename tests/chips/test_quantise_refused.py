"""What a chip lacks and every limit of it: what is just inside runs, what is just beyond is refused with a way out."""

import math
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml

import neuro
from neuro.chips import chip, quantise
from neuro.run.compiled import ApproximationWarning
from one_projection import delta, exp, one, refusals
from refused import refusals_of, refused as refused_by

CASES = yaml.safe_load((Path(__file__).with_name("refusals.yaml")).read_text())

OWN = {"exp": exp, "delta": delta}

HELD = ("scales", "exponents", "shifts")


def put(words, value):
    """Words with a value in place of X."""
    if isinstance(words, dict):
        return {name: put(each, value) for name, each in words.items()}
    return value if words == "X" else words


def made(name, words):
    return OWN.get(name, getattr(neuro, name, None))(**words)


def refused(on, options, **words):
    """What a chip refuses of the network that a case describes."""
    parts = {each: made(*words.pop(each).popitem()) for each in ("synapse", "generator") if each in words}
    model = next(name for name in words if name in OWN or hasattr(neuro, name))
    return refusals(one(made(model, words.pop(model)), **parts, **words), on, **options)


def test_what_is_refused(messages):
    answers = {}
    for case, described in CASES.items():
        net = {**described}
        on, *inside, beyond = net.pop("chip"), *net.pop("X", [None])
        for value in (*inside, beyond):
            words = put(net, value)
            options = {name: words.pop(name) for name in HELD if name in words}
            found = refused(on, options, **words)
            assert len(found) == (value is beyond), (case, value)
        answers[case] = "{}: {}\n{}".format(*found[0])
    messages(answers)


def test_a_threshold_that_is_not_above_rest(messages):
    for v_th in (0.0, -5.0):
        program = one(delta(V_reset=-20.0, V_th=v_th), weight=0.0)
        assert refusals(program, "spinnaker") == []
        messages({str(v_th): "\n".join(map(": ".join, refusals(program, "loihi")))})


def test_weights_that_are_registers(messages):
    lif = neuro.loihi_lif()
    modes = (("mixed", -256, 254), ("excitatory", 0, 255), ("inhibitory", -255, 0))
    ranges = [(lif, neuro.loihi_static(sign_mode=mode), low, high) for mode, low, high in modes]
    answers = {}
    for model, synapse, low, high in (*ranges, (neuro.spinnaker_lif(), neuro.static(), -65535, 65535)):
        for weight in (low, high, low - 1, high + 1, 0.5 * (low + high) + 0.25):
            found = refusals(one(model, weight=float(weight), synapse=synapse), model.chip)
            assert len(found) == (weight not in (low, high))
            answers |= {f"{weight:g} of {low} to {high}": ": ".join(each) for each in found}
    messages(answers)


def test_a_kernel_onto_neurons_that_differ(messages):
    net = neuro.Network("grid", resolution=1.0)
    net.population("in", (1, 4, 4), neuro.spike_generator(spike_times=[[]] * 16))
    net.population("out", (2, 3, 3), exp(tau_m=np.linspace(5.0, 20.0, 18).reshape(2, 3, 3)))
    net.connect("in", "out", neuro.grid((2, 2)), weight=np.arange(8.0).reshape(2, 1, 2, 2), delay=1.0, name="k")
    program = neuro.compile(net, "reference").program
    messages({name: "\n".join(map(": ".join, refusals(program, name))) for name in ("loihi", "spinnaker")})


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
    ((what, _, way),) = refusals(neuro.compile(net(adapting)).program, "loihi")
    assert what == "population 'cells': iaf_psc_exp_adaptive_threshold"
    assert way == "adapt on event, then use iaf_psc_exp here, with V_th + theta of each neuron as its V_th"
    sim = neuro.compile(net(adapting), seed=1)
    sim.run(200.0)
    raised = sim.get("cells", "V_th") + sim.get("cells", "theta")
    assert (raised > adapting.V_th).all()
    on_chip = neuro.compile(net(neuro.iaf_psc_exp(V_th=raised, **shared)), "loihi", seed=1)
    assert on_chip.get("cells", "V_th").tolist() == raised.tolist()


# options
def test_options(messages):
    program, loihi, spinnaker = one(delta()), chip("loihi"), chip("spinnaker")
    messages(refusals_of(messages.cases, globals() | locals()))


def test_options_at_their_bounds():
    program = one(delta(), weight=0.001)
    for exponent in (-8, 7, np.int64(0)):
        assert quantise(program, chip("loihi"), exponents={"in_out": exponent}).projections[0].exponent == exponent
    for shifts in ((0, 15), [15, 0]):
        registers = quantise(program, chip("spinnaker"), shifts={"out": shifts}).populations[1].registers
        assert [registers["exc_shift"][0], registers["inh_shift"][0]] == list(shifts)


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


def test_all_problems_are_told_at_once_with_their_lines(tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)
    Path("wrong.yaml").write_text(YAML)
    messages({"loihi": refused_by(neuro.compile, neuro.load("wrong.yaml"), "loihi")})


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
    from neuro.chips.fixed_program import report

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
