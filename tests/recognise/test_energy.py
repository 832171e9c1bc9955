"""What a recording takes: the bill of what was shown, its sources, and what it leaves out."""

import json
from dataclasses import replace

import numpy as np
import pytest

from neuro.apps import evaluate
from neuro.events import Events
from neuro_recognise.energy import FRONT_END, bills, check_targets, counted, notes, show, words
from neuro_recognise.method import choose
from neuro_recognise.methods.descriptor import Hats
from neuro_recognise.methods.frame_networks import Remus
from neuro_recognise.methods.hfirst import HFirst
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.shown import unlabelled
from neuro_recognise.telling.report import Tried
from refused import refused

TARGETS = ("loihi", "spinnaker", "spinnaker2", "truenorth", "cpu", "gpu")
NEURONS = 6 * 2 * 2
MACS = NEURONS * 4 * 7 * 7
"""Of one step: six maps of 2 x 2 neurons, four orientations under a kernel of 7 x 7."""


@pytest.fixture(scope="module")
def model(letters, small, train):
    return train(letters, small, seed=1)


def tried_on(model, shown, backend="event"):
    answer = model.method.answer(model.learnt, shown, backend)
    votes = {name: evaluate(choose(scores), shown.labels, shown.classes) for name, scores in answer.votes.items()}
    return Tried(evaluate(choose(answer.scores), shown.labels, shown.classes), votes, answer)


@pytest.fixture(scope="module")
def tried(letters, model):
    return tried_on(model, letters)


def test_counts_of_a_recording(letters, model, tried):
    told, sim = counted(bills(tried, ())), model.method.simulation(model.learnt)
    model.method.present(sim, model.learnt, letters.take([0, 1]))
    results, frames = model.method.present(sim, model.learnt, letters)
    bill = sim.energy("loihi", of=results).per(26, "recording")
    assert bill == bills(tried, ["loihi"]).bills["loihi"], "without what was shown before"
    ticks = results.ticks
    in_time = frames.codes < np.repeat(ticks, np.diff(frames.offsets))
    assert (told["frames"] * 26, told["steps"] * 26, told["input_spikes"] * 26) == (72, ticks.sum(), in_time.sum())
    assert told["neuron_updates"] * 26 == pytest.approx(NEURONS * ticks.sum())
    part = letters.take(range(3))
    told = [bills(tried_on(model, part, backend), ["loihi"]).bills for backend in ("event", "reference")]
    assert told[0] == told[1]


def test_in_real_time_a_chip_is_on_as_long_as_the_recordings_last(letters, model):
    """Frames of 10 steps of 1 ms each, of recordings of 40 ms or, the empty ones, of 0 ms."""
    lasting = [one | {"lasts": np.array([40_000] if len(one["ends"]) else [], np.int64)} for one in letters.evidence]
    told = bills(tried_on(model, replace(letters, evidence=lasting)), ("loihi", "spinnaker", "truenorth"))
    mean, steps = 24 * 40e-3 / 26, counted(told)["steps"] * 1e-3
    assert told.bills["loihi"].duration_s == told.bills["loihi"].real_time.chip_time_s == pytest.approx(mean)
    assert told.bills["loihi"].real_time.static_j == pytest.approx(mean * 0.104)
    for name in ("spinnaker", "truenorth"):
        bill = told.bills[name]
        assert bill.chip_time_s == pytest.approx(steps)
        assert bill.real_time.chip_time_s == pytest.approx(max(steps, mean))
    brief = [one | {"lasts": np.array([1_000], np.int64)} for one in letters.evidence]
    late = bills(tried_on(model, replace(letters, evidence=brief)), ("spinnaker",)).bills["spinnaker"]
    assert late.late
    assert late.cells()[3].endswith(" of 1 ms")


@pytest.mark.parametrize("method", [Remus().changed({"size": [34, 34]}), HFirst().changed({"size": [34, 34]})])
def test_what_is_observed_says_how_long_a_recording_lasts(method):
    rng = np.random.default_rng(4)
    t = np.sort(rng.integers(7_000, 90_000, 900))
    events = Events(t, rng.integers(0, 34, 900), rng.integers(0, 34, 900), rng.integers(0, 2, 900), (34, 34))
    assert method.observe(events)["lasts"].tolist() == [t[-1] - t[0]]
    cut = int(t[0]) + 20_000
    (before,) = method.observe_until(events, [20_000])
    assert 19_000 < before["lasts"][0] <= cut - t[0]
    two = unlabelled([method.observe(events), method.observe(events[:500])], ("a",))
    assert two.duration_s() == pytest.approx(1e-6 * (t[-1] + t[499] - 2 * t[0]))


def test_a_bill_by_hand(tried):
    told, by_name = counted(bills(tried, ())), bills(tried, TARGETS).bills
    active = told["neuron_updates_active"]
    sleeping = told["neuron_updates"] - active
    on_prototype = told["synaptic_ops"] * 0.45e-9 + told["neuron_updates"] * 2.19e-9
    assert by_name["spinnaker2"].dynamic_j == pytest.approx(on_prototype)
    ways = sum(item.joules for item in by_name["loihi"].items if item.what.startswith(("hop", "spike")))
    on_cores = told["synaptic_ops"] * 23.6e-12 + active * 81e-12 + sleeping * 52e-12
    assert by_name["loihi"].dynamic_j == pytest.approx(on_cores + ways)
    assert by_name["loihi"].static_j == pytest.approx(by_name["loihi"].chip_time_s * 0.104)
    assert by_name["spinnaker"].chip_time_s == pytest.approx(told["steps"] * 1e-3)
    assert by_name["gpu"].total_j == pytest.approx(told["steps"] * MACS * 0.3e-9)
    assert all(bill.of == "recording" for bill in by_name.values())
    gpu, joules, steps = bills(tried, ["gpu"]), 72 / 26 * MACS * 0.3e-9, tried.answer.run()[1].counts.steps / 72
    assert notes(gpu) == [
        FRONT_END,
        f"dense layers run once per frame instead of in each of its {steps:.4g} steps: gpu {joules * 1e6:.4g} uJ",
    ]
    assert notes(bills(tried, ["loihi"])) == [FRONT_END]


def test_words_and_table(model, tried, capsys):
    told = json.loads(words(model, tried, bills(tried, ("loihi", "gpu"))))
    assert list(told) == [
        "format", "method", "backend", "accuracy", "interval", "recordings", "per_recording", "bills", "refused",
        "notes",
    ]  # fmt: skip
    assert (told["backend"], told["method"], told["recordings"]) == ("event", "remus", 26)
    assert told["accuracy"] == tried.own.accuracy == tried.votes["majority"].accuracy
    assert told["per_recording"] == counted(bills(tried, ()))
    assert [bill["target"] for bill in told["bills"]] == ["loihi", "gpu"]
    for bill in told["bills"]:
        assert {"dynamic_j", "static_j", "total_j", "chip_time_s", "items", "notes"} <= set(bill)
        assert all(item["source"] for item in bill["items"])
    assert told["notes"][0] == FRONT_END
    show(model, tried, bills(tried, TARGETS), sources=True)
    text, own = capsys.readouterr().out, tried.own
    low, high = own.interval
    assert (
        f"energy per recording; {own.accuracy:.1%} of 26 right (95 % interval {low:.1%} - {high:.1%}) "
        "by remus on event chip dynamic as fast as the chip can in real time "
    ) in " ".join(text.split())
    rows = {line.split()[0]: line for line in text.splitlines() if line.strip().startswith(TARGETS)}
    assert tuple(rows) == TARGETS
    joules = f"{counted(bills(tried, ()))['steps'] * MACS * 0.3e-9 * 1e6:.4g}"
    assert rows["gpu"].split()[1:6] == [joules, "uJ", ">", joules, "uJ"]
    lasts = f"{counted(bills(tried, ()))['steps']:.3g} ms"
    assert f"{lasts} of {lasts}" in rows["spinnaker"]
    assert f" us of {lasts}" in rows["loihi"]
    assert "(" in rows["loihi"], "its range"
    assert "- loihi: synaptic_op 23.6 pJ: Davies et al., IEEE Micro 38(1):82, 2018, Table 2 (minimum; " in text
    assert "- cpu, gpu: neuron updates, learning and static power are not in the sums\n" in text
    assert f"- {FRONT_END}\n" in text
    assert text.index(" gpu ") < text.index("- loihi: "), "caveats stand after their table"
    show(model, tried, bills(tried, TARGETS))
    assert "Davies" not in capsys.readouterr().out


def test_what_is_no_network_has_no_bill():
    told = "method 'hats' is no network: expected one that chips can run\n  hint: neuro recognise list"
    assert refused(check_targets, Recogniser(Hats(), ("a", "b"), {}), ["loihi"]) == told
