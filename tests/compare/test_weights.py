import numpy as np
import pytest

import neuro
from neuro.chips import chip, quantise
from neuro.compare.differences import difference, histograms, learnt, rounding


@pytest.fixture(scope="module")
def program(driven):
    return neuro.compile(driven, backend="reference", seed=3).program


def test_difference_by_hand():
    found = difference(np.array([3.0, 4.0]), np.array([3.0, 4.5]))
    assert (found.largest, found.rms, found.relative) == (0.5, pytest.approx(np.sqrt(0.125)), pytest.approx(0.1))
    found = difference(np.zeros(2), np.array([0.0, 2.0]))
    assert (found.largest, found.relative) == (2.0, 0.0)


@pytest.mark.parametrize(("first", "other"), [([], []), ([0.0], [0.0]), ([0.1 + 0.2], [0.3])])
def test_nothing_differs(first, other):
    found = difference(np.array(first), np.array(other))
    assert (found.largest, found.rms, found.relative) == (0.0, 0.0, 0.0)


def test_histograms(program):
    fixed = quantise(program, chip("loihi"))
    told = rounding(fixed)
    assert "bias_exc" not in told  # a current
    for part in fixed.projections:
        if part is not None:
            assert told[part.name].relative == pytest.approx(part.rounding.rms, abs=1e-9)
            half = 0.5 * part.grain * float(part.step.max())
            assert told[part.name].largest <= half * (1 + 1e-9)
    chips = {name: quantise(program, chip(name)) for name in ("loihi", "spinnaker")}
    found = {part.projection: part for part in histograms(program, chips)}
    assert list(found) == ["noise_exc", "list_out", "exc_out", "bias_exc"]
    for name in ("noise_exc", "exc_out"):
        part = found[name]
        assert list(part.counts) == ["described", "loihi", "spinnaker"]
        assert ({int(counts.sum()) for counts in part.counts.values()}, part.unit) == ({part.synapses}, "pA")
        assert part.distinct["loihi"] < part.distinct["described"] == part.synapses
    one = found["list_out"]
    assert (one.counts, one.distinct["described"], one.extent["described"]) == ({}, 1, (900.0, 900.0))
    assert (found["bias_exc"].unit, list(found["bias_exc"].extent)) == ("", ["described"])
    fixed = quantise(program, chip("loihi"))
    part = next(part for part in histograms(program, {"loihi": fixed}) if part.projection == "exc_out")
    wires = next(part for part in fixed.projections if part is not None and part.name == "exc_out")
    grain = float(wires.step.max()) * wires.grain
    widths = np.diff(part.edges) / grain
    assert np.allclose(widths, np.rint(widths[0]))
    assert np.allclose((part.edges / grain) % 1.0, 0.5)  # between two values, never on one
    part = histograms(program, {})[0]
    assert (list(part.counts), part.edges[0]) == (["described"], part.extent["described"][0])
    assert part.edges[-1] == part.extent["described"][1]


def test_what_was_learnt_is_of_projections_that_learn():
    net = neuro.Network("learns")
    cells = net.population("cells", 4, neuro.iaf_psc_exp())
    net.connect(cells, cells, neuro.all_to_all(), neuro.stdp(Wmax=9.0), weight=1.0, name="plastic")
    net.connect(cells, cells, neuro.all_to_all(), weight=1.0, name="fixed")
    program = neuro.compile(net, backend="reference").program
    final = {"a": {"plastic": np.ones(16)}, "b": {"plastic": np.r_[np.zeros(4), np.full(12, 2.0)]}}
    (part,) = learnt(program, final)
    assert (part.projection, part.distinct, part.edges[0], part.edges[-1]) == ("plastic", {"a": 1, "b": 2}, 0.0, 2.0)
    assert [int(counts.sum()) for counts in part.counts.values()] == [16, 16]
    assert (part.counts["b"][0], part.counts["b"][-1]) == (4, 12)


RECEIVING = neuro.equations(
    "receiving",
    equations={"V_m": "(g_L*(E_L - V_m) + g*(E_ex - V_m) + J)/C_m"},
    receptors={"g": {"kernel": "exp", "tau": "tau_syn"}, "J": {"kernel": "exp", "tau": "tau_syn"}},
    parameters={"g_L": "10 nS", "E_L": "-70 mV", "E_ex": "0 mV", "C_m": "200 pF", "tau_syn": "2 ms"},
    integrator="rk4",
)


@pytest.mark.parametrize(
    ("model", "synapse", "expected"),
    [
        (neuro.iaf_cond_exp(), neuro.static(), "nS"),
        (neuro.iaf_cond_alpha(), neuro.static(receptor="in"), "nS"),
        (neuro.aeif_psc_exp(), neuro.static(), "pA"),
        (neuro.iaf_psc_delta(), neuro.static(), "mV"),
        (RECEIVING(), neuro.static(receptor="g"), "nS"),
        (RECEIVING(), neuro.static(receptor="J"), "pA"),
    ],
    ids=str,
)
def test_the_unit_is_that_of_the_receptor(model, synapse, expected):
    net = neuro.Network("units")
    net.population("source", 1, neuro.spike_generator())
    net.population("cells", 2, model)
    net.connect("source", "cells", neuro.all_to_all(), synapse, weight=1.0, name="in")
    assert histograms(neuro.compile(net, "reference").program, {})[0].unit == expected
