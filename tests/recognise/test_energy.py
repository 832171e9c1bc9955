"""What a recording takes: the bill of what was shown, its sources, and what it leaves out."""

import json
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest

from neuro.apps import evaluate
from neuro.events import Events
from neuro_recognise.energy import CAMERA, bills, check_targets, counted, notes, show, words
from neuro_recognise.method import Course, FrameSize, choose
from neuro_recognise.methods.descriptor import Hats
from neuro_recognise.methods.frame_networks import EdhmaxTempotron, MasquelierThorpe, Must, Remus
from neuro_recognise.methods.gradients import Dense
from neuro_recognise.methods.hfirst import HFirst
from neuro_recognise.parts import banks, frames, readouts, segmenters
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.shown import unlabelled
from neuro_recognise.telling.report import Tried
from refused import refused

TARGETS = ("loihi", "spinnaker", "spinnaker2", "truenorth", "cpu", "gpu")
NEURONS = 6 * 2 * 2
MACS = NEURONS * 4 * 7 * 7
"""Of one step: six maps of 2 x 2 neurons, four orientations under a kernel of 7 x 7."""
TAPS = 4 * (3 * 3 + 5 * 5 + 7 * 7 + 9 * 9)
"""Values of the filters of four orientations in four sizes."""


def of_bank(pixels, frames):
    """A product with each value of all filters for a pixel with events; 16 x 16 px of 16 filters are compared."""
    return pixels * TAPS + frames * 16 * 16 * 16


def of_code(frames):
    """Of 4 x 8 x 8 responses in 4 scales the strongest; 10 operations each, a sort by 8 comparisons, and a time."""
    return frames * (3 * 256 + 256 * (10 + 8 + 1))


def of_votes(frames, recordings):
    """6 potentials and 3 sums in a frame, and a win; the choice of 3 classes, and ties by a sort and 4 operations."""
    return frames * (6 + 3 + 1) + recordings * (2 * 3 + 3 * (2 + 4))


EVENTS = 24 * 307 + 2 * 7
HOST = EVENTS * (5 + 2) + of_bank(72 * 20, 72) + of_code(72) + of_votes(72, 26)
"""Multiply-accumulates outside of the network: 24 recordings of 307 events and three frames of 20 pixels, and 2 of 7.

An event takes 5 operations of the motion detector, and 2 to find its pixel and to add it.
"""


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
    bill = sim.energy("loihi", of=results, host=tried.answer.host).per(26, "recording")
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
    assert {item.of: 26 * item.count for item in by_name["loihi"].items if item.kind == "host"} == pytest.approx(
        {
            "segmenter msd, cpu": EVENTS * 5,
            "representation counts, cpu": EVENTS * 2,
            "bank gabors, cpu": of_bank(72 * 20, 72),
            "encoder log_latency, cpu": of_code(72),
            "vote majority, cpu": of_votes(72, 26),
        }
    )
    host = HOST * 8.6e-9 / 26
    assert by_name["loihi"].by_cost()["host"] == by_name["cpu"].by_cost()["host"] == pytest.approx(host)
    on_prototype = told["synaptic_ops"] * 0.45e-9 + told["neuron_updates"] * 2.19e-9 + host
    assert by_name["spinnaker2"].dynamic_j == pytest.approx(on_prototype)
    ways = sum(item.joules for item in by_name["loihi"].items if item.what.startswith(("hop", "spike")))
    on_cores = told["synaptic_ops"] * 23.6e-12 + active * 81e-12 + sleeping * 52e-12
    assert by_name["loihi"].dynamic_j == pytest.approx(on_cores + ways + host)
    assert by_name["loihi"].static_j == pytest.approx(by_name["loihi"].chip_time_s * 0.104)
    assert by_name["spinnaker"].chip_time_s == pytest.approx(told["steps"] * 1e-3)
    assert by_name["gpu"].total_j == pytest.approx((told["steps"] * MACS + HOST / 26) * 0.3e-9)
    arm = bills(tried, ["arm"]).bills["arm"]
    assert arm.by_cost()["host"] == pytest.approx(HOST / 26 * 0.9e-9)
    assert all(bill.of == "recording" for bill in by_name.values())
    gpu, joules, steps = bills(tried, ["gpu"]), 72 / 26 * MACS * 0.3e-9, tried.answer.run()[1].counts.steps / 72
    assert notes(gpu) == [
        CAMERA,
        f"dense layers run once per frame instead of in each of its {steps:.4g} steps: gpu {joules * 1e6:.4g} uJ",
    ]
    assert notes(bills(tried, ["loihi"])) == [CAMERA]


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
    assert told["notes"][0] == CAMERA
    show(model, tried, bills(tried, TARGETS), sources=True)
    text, own = capsys.readouterr().out, tried.own
    low, high = own.interval
    assert (
        f"energy per recording; {own.accuracy:.1%} of 26 right (95 % interval {low:.1%} - {high:.1%}) "
        "by remus on event chip dynamic as fast as the chip can in real time "
    ) in " ".join(text.split())
    rows = {line.split()[0]: line for line in text.splitlines() if line.strip().startswith(TARGETS)}
    assert tuple(rows) == TARGETS
    joules = f"{(counted(bills(tried, ()))['steps'] * MACS + HOST / 26) * 0.3e-9 * 1e6:.4g}"
    assert rows["gpu"].split()[1:6] == [joules, "uJ", ">", joules, "uJ"]
    lasts = f"{counted(bills(tried, ()))['steps']:.3g} ms"
    assert f"{lasts} of {lasts}" in rows["spinnaker"]
    assert f" us of {lasts}" in rows["loihi"]
    assert "(" in rows["loihi"], "its range"
    assert "- loihi: synaptic_op 23.6 pJ: Davies et al., IEEE Micro 38(1):82, 2018, Table 2 (minimum; " in text
    assert "- cpu, gpu: neuron updates, learning and static power are not in the sums\n" in text
    assert f"- {CAMERA}\n" in text
    (votes, each) = of_votes(72, 26) / 26, HOST / 26
    (line,) = [line for line in text.splitlines() if ", cpu: host: " in line]
    assert line.startswith(f"- loihi, spinnaker, spinnaker2, truenorth, cpu: host: {each:,.0f} mac, ")
    assert f" bytes, {each * 8.6e-3:.4g} uJ a recording: segmenter msd " in line
    assert line.endswith(f", vote majority {votes * 8.6:.4g} nJ")
    assert f"- gpu: host: {each:,.0f} mac, " in text
    assert text.count("vote majority") == 2, "without a note on each use"
    assert text.index(" gpu ") < text.index("- loihi: "), "caveats stand after their table"
    show(model, tried, bills(tried, TARGETS))
    assert "Davies" not in capsys.readouterr().out


def moving(n=900, seed=4):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(7_000, 90_000, n))
    return Events(t, rng.integers(0, 34, n), rng.integers(0, 34, n), rng.integers(0, 2, n), (34, 34))


def test_the_front_end_counts_its_events_and_pixels():
    method, events = Remus().changed({"size": [34, 34]}), moving()
    seen, bounds = method.observe(events), method.segmenter.bounds(events.t)
    places = list(zip(events.x.tolist(), events.y.tolist(), strict=True))
    pixels = [len(set(places[a:b])) for a, b in pairwise(bounds.tolist())]
    assert (seen["events"].tolist(), seen["pixels"].tolist()) == ([900], pixels)
    assert any(n < b - a for n, (a, b) in zip(pixels, pairwise(bounds.tolist()), strict=True)), "some share a pixel"
    (early,) = method.observe_until(events, [int(events.t[600] - events.t[0])])
    assert early["events"].tolist() == [np.searchsorted(events.t, events.t[600], "right")]
    n = len(early["lengths"])
    assert early["pixels"].tolist() == pixels[:n]
    leaky = method.changed({"representation": "leaky"}).observe(events)
    assert leaky["pixels"][-1] == len(set(places[: bounds[-1]])), "pixels that had an event before"


@dataclass(frozen=True)
class Unknown(banks.Max):
    """A pool of a user, without a count."""

    work = banks.FrontEndPart.work


SIZE = FrameSize(pixels=16 * 16, sides=(3, 5), orientations=2, side=2, cells=64)
FILTERED = 2 * 2 * 16 * 16
"""Responses of two orientations in two sizes at 16 x 16 px."""


@pytest.mark.parametrize(
    ("part", "by_hand"),
    [
        (segmenters.Hes(), {"event": 1}),
        (segmenters.Counts(), {"event": 2}),
        (segmenters.Whole(), {}),
        # Two potentials leak; a peak and the first and last of the queue are compared.
        (segmenters.Ses(), {"event": 1 + 2 * 3 + 1 + 2 + 2 + 2 + 2}),
        (banks.Leaky(), {"event": 5, "frame": 5 * 256}),
        (banks.Surface(), {"event": 0, "frame": 4 * 256}),
        (banks.Sobels(), {"pixel": 2 * (9 + 25), "frame": FILTERED}),
        (banks.LeakyGabors(), {"event": (9 + 25) * (2 + 4 * 2), "frame": 7 * FILTERED}),
        (banks.Max(), {}),
        # 3 px are a cell to either side, 2 comparisons along rows and columns; 5 px as well.
        (banks.LocalMaximum(side=2), {"frame": 2 * 64 * ((0 + 2) + (4 + 2))}),
        (frames.LogLatency(scales="all"), {"frame": 256 * (10 + 8 + 1)}),
        (frames.LogLatency(first=50), {"frame": 128 + 128 * (10 + 7) + 50}),
        (frames.Latency(first=50), {"frame": 256 * (1 + 8) + 8 * 50}),
        (Unknown(), {"frame": None}),
    ],
    ids=lambda value: type(value).__name__,
)
def test_operations_of_parts_by_hand(part, by_hand):
    assert {unit: work and work.macs for unit, work in part.work(SIZE).items()} == by_hand
    assert all(work is None or work.bytes > 0 for work in part.work(SIZE).values())


def test_a_part_without_a_count_leaves_the_total_open(letters, model, tried):
    host = tried.answer.host
    unknown = replace(letters, evidence=[{k: v for k, v in one.items() if k != "events"} for one in letters.evidence])
    bill = bills(tried_on(model, unknown), ["spinnaker2"]).bills["spinnaker2"]
    assert "host" in bill.missing
    assert "host: no count of operations: segmenter msd, representation counts" in bill.notes
    assert [part.work is None for part in host] == [False] * 6


def test_the_host_of_readouts_by_hand():
    rng = np.random.default_rng(0)
    x, labels = rng.random((30, 5)), np.arange(30) % 3
    course = Course()
    assert readouts.Ridge().work({}, 5, 3).macs == 3 * (5 + 1)
    assert readouts.Svm(scale="length").work({}, 5, 3).macs == 3 * (5 + 1) + 5 + 1 + 5
    rbf = readouts.Rbf()
    vectors = len(rbf.fit(x, labels, 3, course)["vectors"])
    macs = 5 * 2 + 5 + vectors * (5 + 5 + 6) + 3 * (vectors + 1)
    assert rbf.work(rbf.fit(x, labels, 3, course), 5, 3).macs == macs
    assert readouts.Nearest().work({}, 5, 3) is None


@pytest.mark.parametrize(("vote", "of_frame", "of_recording"), [("rate", 1, 9), ("potentials", 40 + 3, 6)])
def test_the_host_of_must_by_hand(vote, of_frame, of_recording):
    works = Must(vote=vote).vote_work({}, 40, 3)
    assert {unit: work.macs for unit, work in works.items()} == {"frame": of_frame, "recording": of_recording}


def test_the_host_of_tempotrons_and_features_by_hand():
    works = EdhmaxTempotron().vote_work({}, 40, 4)
    assert works["frame"].macs == 40 + 4 + 4, "sums of each class, a division, and the sum over frames"
    works = MasquelierThorpe().vote_work({}, 40, 4)
    assert (works["frame"].macs, works["recording"].macs) == (40, 4 * (40 + 1) + 40 + 4)


def test_the_host_of_hfirst_and_of_pixels_by_hand():
    method = HFirst().changed({"size": [34, 34]})
    seen = [method.observe(moving(seed=k)) for k in range(2)]
    shown = unlabelled(seen, ("a", "b"))
    host = method.host(shown, 7)
    c1 = sum(len(one["ids"]) for one in seen)
    counts = {part.name: part.work.macs * part.times for part in host}
    assert counts == {"noise filter": 1800 * (7 + 2 + 3), "reading potentials": pytest.approx(2 * c1 + 2 * 2)}
    counts = [part.work.macs * part.times for part in method.changed({"reading": "hard"}).host(shown, 7)]
    assert counts[1] == pytest.approx(2 * c1 + 7 + 2 * (2 + 2 * (2 + 1)))
    dense = Dense(size=(34, 34), hidden=4, duration=50.0)
    net = dense.before(2)
    events = moving()
    answer = dense.answer(dense.learnt_of(net), unlabelled([dense.observe(events)], ("a", "b")))
    n = np.count_nonzero(events.t - events.t[0] < 50_000)
    assert 0 < n < 900
    spikes = answer.run()[1].counts.populations["out"].spikes
    assert {part.name: part.work.macs for part in answer.host} == {"pixels": 6 * n, "counts": 2 * spikes + 6 * 2}


def test_what_is_no_network_has_no_bill():
    told = "method 'hats' has no network: expected one that chips can run\n  hint: neuro recognise list"
    assert refused(check_targets, Recogniser(Hats(), ("a", "b"), {}), ["loihi"]) == told
