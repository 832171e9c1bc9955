"""Odd networks: all problems at once with their lines, extreme values without a traceback."""

import math
import warnings
from pathlib import Path

import numpy as np
import pytest

import neuro
from neuro.chips import chip, quantise
from neuro.run.compiled import ApproximationWarning
from one_projection import delta, exp, one
from refused import refused

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
    messages({"loihi": refused(neuro.compile, neuro.load("wrong.yaml"), "loihi")})


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
