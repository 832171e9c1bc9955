import json
import warnings

import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.chips.pricing import RULES_APPLIED
from neuro.compare import compare, differences
from neuro.compare.cells import bills
from neuro.compare.runs import _against, _gather, _recording
from neuro.core.extras import install
from refused import refusals_of

CHIPS = ["event", "loihi", "spinnaker"]


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 12), st.floats(100.0, 900.0), st.booleans())
def test_float_backends_are_equal(seed, neurons, weight, plastic):
    net = neuro.Network("same", resolution=0.5)
    noise = net.population("noise", 10, neuro.poisson_generator(rate=400.0))
    cells = net.population("cells", neurons, neuro.iaf_psc_exp())
    synapse = neuro.stdp(Wmax=2000.0) if plastic else neuro.static()
    net.connect(noise, cells, neuro.all_to_all(), synapse, weight=weight, delay=1.0)
    found = compare(net, ["reference", "event"], 60.0, seed)
    other = found.runs[1]
    assert other.inputs == "same"
    assert all(part.same and part.first is None for part in other.populations.values())
    assert other.per_spike in (0.0, None)
    assert other.first is None
    assert all(part.largest < 1e-9 for part in other.weights.values())
    assert other.counts == found.first.counts


def test_what_is_told_of_each_backend(three, net):
    assert three.first.backend == "event"
    assert three.first.populations["noise"].spikes > 300
    loihi, spinnaker = three.runs[1:]
    assert (loihi.inputs, spinnaker.inputs) == ("merged", "same")
    merged = three.first.populations["noise"].spikes - loihi.populations["noise"].spikes
    assert loihi.counts.native["merged spikes of noise"] == merged > 0
    assert not net.probes  # the user's network stays as it is
    event, loihi, _ = three.runs
    sim_counts = {name: part.spikes for name, part in event.populations.items()}
    assert sim_counts == {name: part.spikes for name, part in event.counts.populations.items()}
    part = event.populations["exc"]
    assert part.rate_hz == pytest.approx(part.spikes / 24 / 0.2)
    assert (part.generator, event.populations["noise"].generator) == (False, True)
    assert (event.fixed, event.placement, event.rounding, event.own) == (None, None, None, None)
    assert loihi.fixed.chip.name == loihi.placement.target == "loihi"
    assert loihi.own.target == "loihi"
    assert 0.0 < loihi.weights["exc_out"].relative < 0.01
    assert loihi.weights["exc_out"].relative == pytest.approx(loihi.rounding["exc_out"].relative)  # nothing learns
    told = [(bill.target, bill.counted_on) for bill in three.bills]
    others = [(name, "event") for name in ("loihi", "spinnaker", "cpu", "gpu")]
    assert told == [("loihi", "loihi"), ("spinnaker", "spinnaker"), *others]
    assert all(bill.energy.total_j > 0 for bill in three.bills)
    text = "\n".join(three.runs[1].warnings)
    assert text.startswith("backend 'loihi': ")
    assert "share a step with another of the same neuron and become one" in text
    assert three.runs[0].warnings == ()
    told = json.loads(json.dumps(three.as_dict(), allow_nan=False))
    assert told["format"] == "neuro comparison 1"
    about = {"network": "relay", "ms": 200.0, "resolution_ms": 1.0, "seed": 1, "compared_with": "event"}
    assert about.items() <= told.items()
    assert list(told["backends"]) == CHIPS
    loihi = told["backends"]["loihi"]
    assert list(loihi) == [*KEYS, "weight_rounding", "rounding", "placement"]
    counts = three.runs[1].counts
    assert (loihi["counts"]["synaptic_ops"], loihi["native_counts"]) == (counts.synaptic_ops, counts.native)
    assert loihi["populations"]["exc"]["first"].keys() == {"ms", "neuron", "only_in_first"}
    assert [bill["target"] for bill in told["energy"]][:2] == ["loihi", "spinnaker"]
    assert told["energy"][0]["total_j"] == three.bills[0].energy.total_j


def test_other_input_orders_and_currents(net, driven):
    """No backend does this; should one, it would be seen."""
    first, other = (neuro.compile(_recording(net), backend="reference", seed=seed) for seed in (1, 2))
    for sim in (first, other):
        sim.run(50.0)
    found = _against(_gather(other, "reference", False), _gather(first, "reference", True), 50.0)
    assert found.inputs == "other"
    assert not found.populations["noise"].same
    assert found.populations["list"].same
    found = compare(net, ["spinnaker", "event"], 20.0)
    assert [bill.target for bill in found.bills] == ["spinnaker", "loihi", "cpu", "gpu"]
    assert {bill.counted_on for bill in found.bills} == {"spinnaker"}
    found = compare(driven, ["event", "reference"], 20.0)
    assert "bias" not in found.first.populations
    assert "bias_exc" in found.runs[1].weights


KEYS = ["ran", "reason", "warnings", "inputs", "counts", "native_counts", "populations", "weights", "delays"]


def test_other_warnings_go_on(net):
    def noisy(sim, steps):
        warnings.warn("look here", RuntimeWarning, stacklevel=1)
        sim.run(float(steps))

    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        compare(net, ["event", "reference"], 5.0, advance=noisy)
    assert {str(w.message) for w in told} == {"look here"}


def unfit():
    """A network that SpiNNaker has no neurons for and Loihi too few delays."""
    net = neuro.Network("unfit", resolution=1.0)
    noise = net.population("noise", 4, neuro.poisson_generator(rate=100.0))
    net.connect(noise, net.population("cells", 4, neuro.izhikevich()), neuro.all_to_all(), weight=5.0, delay=1.0)
    return net


def test_refusals_are_results():
    found = compare(unfit(), ["event", "reference", "spinnaker"], 20.0)
    refused = found.runs[2]
    assert refused.refused.startswith("backend 'spinnaker' cannot run this network (1 problem)\n")
    assert refused.as_dict() == {"ran": False, "reason": refused.refused, "warnings": []}
    assert [run.backend for run in found.ran] == ["event", "reference"]
    found = compare(unfit(), ["event", "reference"], 20.0)
    why = "izhikevich: {} has no such neuron: it has iaf_psc_exp, iaf_psc_delta and parrot_neuron"
    assert [note for note in found.notes if "no total" in note] == [
        f"no total for {name}, which refuses the network: population 'cells': {why.format(name)}"
        for name in ("loihi", "spinnaker")
    ]
    assert [row[3:5] for row in bills(found)][:2] == [("refused", "refused")] * 2
    assert [bill.as_dict()["total_j"] is None for bill in found.bills] == [True, True, False, False]
    found = compare(unfit(), ["loihi", "reference", "event"], 20.0)
    assert found.first.backend == "reference"
    assert found.runs[2].populations["cells"].same
    assert found.notes[0] == "'loihi' did not run: others are compared with 'reference'"
    assert set({bill.target: bill.reason for bill in found.bills}) == {"loihi", "spinnaker", "cpu", "gpu"}


def test_why_loihis_own_count_of_learning_differs_is_said_once():
    net = neuro.Network("learning", resolution=1.0)
    net.population("in", 2, neuro.spike_generator(spike_times=[[1.0, 4.0], [2.0]]))
    net.population("out", 3, neuro.iaf_psc_delta(t_ref=1.0))
    net.connect("in", "out", neuro.all_to_all(), neuro.stdp(Wmax=20.0), weight=10.0, delay=1.0, name="learns")
    assert list(compare(net, ["event", "loihi"], 10.0).notes).count(RULES_APPLIED) == 1
    assert RULES_APPLIED not in compare(net, ["event", "reference"], 10.0).notes


def test_mistakes(net, messages):
    messages(refusals_of(messages.cases, globals() | locals()))


def test_notes(net, monkeypatch):
    silent = neuro.Network("silent", resolution=1.0)
    silent.population("cells", 150, neuro.iaf_psc_exp())
    monkeypatch.setattr(differences, "_library", lambda: None)
    found = compare(silent, ["event", "reference"], 5.0)
    assert found.notes == (
        "no neuron fired on 'event': there is little to compare",
        f"spike-train distances are left out: {install('compare')} installs the library for them",
    )
    assert found.runs[1].per_spike is None


def test_a_sampled_distance_says_so(monkeypatch):
    pytest.importorskip("elephant", reason="the extra 'compare' is not installed")
    net = neuro.Network("many", resolution=1.0)
    net.population("cells", 150, neuro.iaf_psc_exp(I_e=500.0))
    found = compare(net, ["event", "reference"], 50.0)
    assert found.notes == ("the distance of 'cells' covers 100 of 150 neurons, evenly chosen",)
    assert found.first.populations["cells"].spikes > 0
    monkeypatch.setattr(differences, "MOST_SPIKES", 1)
    monkeypatch.setattr(differences, "MOST_NEURONS", 200)
    found = compare(net, ["event", "reference"], 50.0)
    second = found.first.trains["cells"].times_ms[150]  # all 150 spike at once
    assert found.notes == (f"the distance of 'cells' covers all neurons, up to {second:g} ms",)
