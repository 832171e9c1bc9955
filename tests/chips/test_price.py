"""Bills worked out by hand."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from bills import AB_OPS, ACTIVE, IN_OPS, INACTIVE, LEARNT, STEPS, Moves, Placed, counted, ints, lines, pair, placed
from neuro.chips import chip, dense, neurobench, place, price, quantising
from neuro.chips.energy import quantity
from neuro.chips.pricing import RULES_APPLIED
from neuro.chips.spinnaker_rule import SIGNAL_SPIKES
from neuro.core.errors import ModelError, Where
from neuro.program.backend import EngineCounts, Problem
from neuro.program.counts import Tally
from refused import refusals_of, refused


@pytest.fixture(scope="module")
def run():
    return counted()


def test_loihi_by_hand(run):
    energy = price(*run, placed(), chip("loihi"))
    # the barrier of two tiles lies 1/31 of the way from that of one to that of 32
    barrier = STEPS * (113e-9 + (465e-9 - 113e-9) / 31)
    all_of_a = ACTIVE * 8.4e-9 + INACTIVE * 5.3e-9 + IN_OPS * 3.5e-9
    all_of_b = ACTIVE * 8.4e-9 + INACTIVE * 5.3e-9 + AB_OPS * 3.5e-9 + LEARNT * 6.1e-9
    seconds = barrier + all_of_a + all_of_b * 2 / 3
    expected = {
        ("neuron_update_active", "a"): (12, 12 * 81e-12),
        ("neuron_update_inactive", "a"): (18, 18 * 52e-12),
        ("neuron_update_active", "b"): (12, 12 * 81e-12),
        ("neuron_update_inactive", "b"): (18, 18 * 52e-12),
        ("synaptic_op", "in"): (12, 12 * 23.6e-12),
        ("spike_in_tile", "in"): (4, 4 * 1.7e-12),
        ("synaptic_op", "ab"): (12, 12 * 23.6e-12),
        ("spike_in_tile", "ab"): (8, 8 * 1.7e-12),
        ("hop_east_west", "ab"): (4, 4 * 3.0e-12),
        ("hop_north_south", "ab"): (8, 8 * 4.0e-12),
        ("learning_update", "ab"): (24, 24 * 120e-12),
        ("static_per_chip", "loihi"): (seconds, seconds * 0.104),
    }
    found = lines(energy)
    assert list(found) == list(expected)
    for key, (count, joules) in expected.items():
        assert found[key] == (pytest.approx(count, rel=1e-12), pytest.approx(joules, rel=1e-12)), key
    dynamic = 24 * 81e-12 + 36 * 52e-12 + 24 * 23.6e-12 + 12 * 1.7e-12 + 4 * 3e-12 + 8 * 4e-12 + 24 * 120e-12
    assert dynamic == pytest.approx((1944 + 1872 + 566.4 + 20.4 + 12 + 32 + 2880) * 1e-12, rel=1e-12)
    assert energy.dynamic_j == pytest.approx(dynamic, rel=1e-12)
    assert energy.static_j == pytest.approx(seconds * 0.104, rel=1e-12)
    assert energy.total_j == energy.dynamic_j + energy.static_j
    assert energy.chip_time_s == pytest.approx(seconds, rel=1e-12)
    assert energy.chips == 1
    neurons = 12 * 81e-12 + 18 * 52e-12
    assert energy.by_population() == {"a": pytest.approx(neurons), "b": pytest.approx(neurons)}
    assert energy.by_projection() == {
        "in": pytest.approx(12 * 23.6e-12 + 4 * 1.7e-12),
        "ab": pytest.approx(12 * 23.6e-12 + 8 * 1.7e-12 + 4 * 3e-12 + 8 * 4e-12 + 24 * 120e-12),
    }


def test_spinnaker_by_hand(run):
    far = {1: Moves(ints(0, 0, 0), ints(0, 0, 0), ints(0, 0, 0), ints(0, 2, 0))}
    program, counts = run
    energy = price(program, counts, Placed({**placed().moves, **far}, (), chips_used=3), chip("spinnaker"))
    expected = {
        ("neuron_update_active", "a"): 12 * 26e-9,
        ("neuron_update_inactive", "a"): 18 * 26e-9,
        ("neuron_update_active", "b"): 12 * 26e-9,
        ("neuron_update_inactive", "b"): 18 * 26e-9,
        ("packet", "input"): 4 * 0.8e-9,  # each spike passes the router of its own chip
        ("packet", "a"): 12 * 0.8e-9,
        ("packet", "ab"): 4 * 2 * 0.8e-9,  # one of three sources goes two chips far
        ("synaptic_op", "in"): 12 * 13.3e-9,
        ("synaptic_op", "ab"): 12 * 13.3e-9,
        ("static_per_chip", "spinnaker"): 3 * 10e-3 * 0.36,
    }
    found = {key: joules for key, (_, joules) in lines(energy).items()}
    assert found.pop(("learning_update", "ab")) is None
    assert found == {key: pytest.approx(joules, rel=1e-12) for key, joules in expected.items()}
    assert (energy.chip_time_s, energy.chips) == (pytest.approx(0.01), 3)
    assert "not priced, as no figure is published: learning_update" in energy.notes


def test_targets_that_are_not_placed(run):
    two = price(*run, None, chip("spinnaker2"))
    assert two.total_j == pytest.approx(60 * 2.19e-9 + 24 * 0.45e-9, rel=1e-12)
    assert two.static_j == 0.0
    assert "static power is not in the sums: no figure is published" in two.notes
    north = price(*run, None, chip("truenorth"))
    assert north.dynamic_j == pytest.approx(24 * 2.3e-12, rel=1e-12)
    assert north.static_j == pytest.approx(10e-3 * 64.4e-3, rel=1e-12)
    assert north.chip_time_s == pytest.approx(10e-3)
    assert "nothing is placed: one chip is assumed" in north.notes


def test_dense_by_hand(run):
    for target, mac in {"cpu": 8.6e-9, "gpu": 0.3e-9, "arm": 0.9e-9}.items():
        energy = price(*run, None, chip(target))
        assert lines(energy) == {
            ("mac", "in"): (10 * 2 * 3, pytest.approx(60 * mac, rel=1e-12)),
            ("mac", "ab"): (10 * 3, pytest.approx(30 * mac, rel=1e-12)),
        }
        assert energy.chip_time_s is None
        assert energy.notes[-1] == "neuron updates, learning and static power are not in the sums"


def test_weights_that_the_host_writes():
    net = neuro.Network("trials", resolution=1.0)
    net.population("input", 2, neuro.spike_generator())
    maps = neuro.iaf_psc_delta(tau_m=math.inf, E_L=0.0, V_reset=0.0, V_th=0.8)
    net.population("maps", (2, 1), maps)
    net.connect("input", "maps", neuro.all_to_all(), neuro.r_stdp(), weight=0.9, delay=1.0, name="w")
    net.group("choice", neuro.winner_take_all(of="maps"))
    net.trials(input="input", duration=10.0, labels={"of": "maps"})
    sim = neuro.compile(net, "reference")
    sim.trials([0.0, 5.0], [0, 1], [0, 2], labels=[0], learn=True)
    energy = price(sim.program, sim._engine.counts(), Placed({0: Moves(*[ints(0, 0)] * 4)}, ()), chip("loihi"))
    written = sim.counts().learning_updates
    assert written > 0
    by_host, macs = dict(list(lines(energy).items())[-3:-1]), 4 * written
    assert by_host == {("weight_write", "w"): (written, None), ("mac", "cpu"): (macs, pytest.approx(macs * 8.6e-9))}
    assert "the host applies the rule for trials and writes each weight that changes" in energy.notes


@pytest.mark.parametrize(
    "rule", [neuro.stdp_dopa(signal="reward"), neuro.td_lambda(signal="reward")], ids=["dopa", "td"]
)
def test_what_a_signal_teaches(rule):
    net = neuro.Network("taught", resolution=1.0)
    net.population("input", 2, neuro.spike_generator(spike_times=((1.0, 4.0), (2.0,))))
    net.population("out", 3, neuro.iaf_psc_delta(tau_m=10.0, E_L=0.0, V_reset=0.0, V_th=1.0, t_ref=0.0, I_e=200.0))
    net.signal("reward", to="out")
    net.connect("input", "out", neuro.all_to_all(), rule, weight=0.5, delay=1.0, name="w")
    sim = neuro.compile(net, "reference")
    sim.run(10.0)
    post = sim.counts().populations["out"].spikes
    assert post > 0
    counts = replace(sim._engine.counts(), native={f"{SIGNAL_SPIKES} in w": 4})
    loihi = price(sim.program, counts, Placed({0: Moves(*[ints(0, 0)] * 4)}, ()), chip("loihi"), ran_on="loihi")
    assert lines(loihi)["learning_update", "w"][0] == 3 * 3 + post * 2
    assert lines(loihi)["signal_update", "w"] == (6 * 10, None)
    assert (loihi.missing, loihi.total()[:2]) == (("signal_update",), "> ")
    assert ("synaptic_op", "reward") not in lines(loihi)  # only SpiNNaker's signals come as spikes
    note = "spikes that carry a signal are only counted in a run on the chip: they are not priced"
    placement = Placed({0: Moves(*[ints(0, 0)] * 4)}, ())
    spinnaker = price(sim.program, counts, placement, chip("spinnaker"))
    assert lines(spinnaker)["packet", "reward"] == (4, pytest.approx(4 * 0.8e-9))
    assert note not in spinnaker.notes
    assert note in price(sim.program, sim._engine.counts(), placement, chip("spinnaker")).notes


def test_dense_layers_of_a_program_of_a_users_own():
    bill = dense({"forward": 100.0, "backward": 200.0}, "cpu", steps=5, of="training", notes=("counted by hand",))
    assert lines(bill) == {
        ("mac", name): (n, pytest.approx(n * 8.6e-9)) for name, n in (("forward", 100), ("backward", 200))
    }
    assert (bill.low_j, bill.high_j) == (pytest.approx(300 * 8.6e-9), pytest.approx(300 * 36.5e-9))
    assert (bill.missing, bill.notes[0], bill.of) == (("static_per_chip",), "counted by hand", "training")
    with pytest.raises(neuro.ModelError, match=r"'loihi' has no cost of a multiply-accumulate"):
        dense({}, "loihi")


def test_several_spikes_in_a_step_are_told():
    net = neuro.Network("several", resolution=1.0)
    net.population("input", 1, neuro.spike_generator(spike_times=((1.0, 1.0),)))
    net.population("out", 1, neuro.parrot_neuron())
    net.connect("input", "out", neuro.one_to_one(), weight=1.0, delay=1.0)
    sim = neuro.compile(net, "reference")
    sim.run(3.0)
    zero = Placed({0: Moves(*[ints(0)] * 4)}, ())
    energy = price(sim.program, sim._engine.counts(), zero, chip("loihi"))
    assert lines(energy)["synaptic_op", "input_out"][0] == 2
    told = "4 spikes in 2 events: each of several spikes of a neuron in one step is priced, but the chip would send one"
    assert told in energy.notes
    assert told not in price(sim.program, sim._engine.counts(), zero, chip("spinnaker")).notes


def test_what_does_not_fit_has_no_price(run, messages):
    where = Where("net.yaml", 4)
    problems = (
        Problem(True, "population 'a': neuron 1", "it is too large", "a smaller one would fit", where),
        Problem(False, "population 'a'", "it is rounded"),
        Problem(True, "population 'b': 3 neurons", "a core holds 2"),
    )
    messages({"too large": refused(price, *run, placed(problems=problems), chip("loihi"))})
    assert price(*run, placed(problems=problems[1:2]), chip("loihi")) == price(*run, placed(), chip("loihi"))


def test_a_chip_that_refuses_the_network_has_no_total(run):
    net = neuro.Network("odd", resolution=1.0)
    net.population("one", 1, neuro.izhikevich())
    net.population("two", 1, neuro.iaf_psc_exp(tau_m=math.inf))
    sim = neuro.compile(net, "reference")
    sim.run(5.0)
    why = "population 'one': izhikevich: {} has no such neuron: it has iaf_psc_exp, iaf_psc_delta and parrot_neuron"
    for target, more in (("loihi", ""), ("spinnaker", " (and 1 more, see neuro fit)")):
        bill, reason = sim.energy(target).per(5, "step"), why.format(target) + more
        assert bill.refused == bill.real_time.refused == reason
        assert bill.notes[0] == f"{target} refuses the network, so there is no total: {reason}"
        assert bill.dynamic_j > 0.0
        assert np.isnan([bill.total_j, bill.low_j, bill.high_j, bill.real_time.total_j]).all()
        assert bill.total() == "refused"
        assert bill.totals() == f"refused: {reason}"
        assert bill.cells()[1:3] == ("refused", "refused")
        (total,) = (line.split() for line in str(bill).splitlines() if line.startswith("total"))
        assert total == ["total", "refused", "refused"]
        told = json.loads(json.dumps(bill.as_dict(), allow_nan=False))
        assert told["refused"] == reason
        assert {told[f"total{end}_j"] for end in ("", "_low", "_high")} == {None}
        assert told["real_time"]["total_j"] is None
        counts = sim._engine.counts()
        placement = None if target == "spinnaker" else place(sim.program, chip(target))
        metrics = neurobench(sim.program, counts, samples=1, placement=placement, energy=sim.energy(target))
        assert (metrics["energy_j"]["total"], metrics["energy_j"]["real_time"]["high"]) == (None, None)
    for target in ("cpu", "truenorth", "spinnaker2"):
        assert sim.energy(target).refused == ""
    for target in ("loihi", "spinnaker"):
        assert price(*run, placed(), chip(target)).refused == ""
    late = pair()
    late.projections["ab"] = replace(late.projections["ab"], delay=40.0)
    sim = neuro.compile(late, "reference")
    sim.run(5.0)
    assert sim.energy("truenorth").total() == "refused"


@pytest.mark.parametrize("target", ["spinnaker2", "truenorth", "loihi", "cpu"])
def test_a_total_without_a_price_for_learning_or_static_power_says_so(run, target):
    bill = price(*run, placed() if target == "loihi" else None, chip(target)).per(2, "half")
    learns = {"spinnaker2": ("learning_update", "static_per_chip"), "truenorth": ("learning_update",), "loihi": ()}
    expected = learns.get(target, ("static_per_chip",))
    assert bill.missing == bill.real_time.missing == expected
    mark = "> " if expected else ""
    assert bill.total(3) == mark + quantity(bill.total_j, "J", 3)
    assert [cell.startswith("> ") for cell in bill.cells()[1:3]] == [bool(expected)] * 2
    assert bill.totals().startswith("> ") == bool(expected)
    assert bill.as_dict()["missing"] == bill.as_dict()["real_time"]["missing"] == list(expected)
    (total,) = (line for line in str(bill).splitlines() if line.startswith("total"))
    assert total.count(">") == 2 * bool(expected)


def test_loihis_own_count_of_learning_is_told_apart_from_the_priced_one():
    """u0 visits all of a rule's synapses in every step; a bill prices those of each spike."""
    net = neuro.Network("learning", resolution=1.0)
    net.population("in", 2, neuro.spike_generator(spike_times=[[1.0, 4.0], [2.0]]))
    net.population("out", 3, neuro.loihi_lif(vth=1000))
    rule = neuro.loihi_learning(dw="2^-2*x1*y0", dt="- 2^-4*t*u0", x1_impulse=10, x1_tau=5)
    net.connect("in", "out", neuro.all_to_all(), rule, weight=10.0, delay=1.0, name="rule")
    sim = neuro.compile(net, "loihi")
    sim.run(10.0)
    assert sim.counts().learning_updates == 3 * 3
    assert sim.counts().native["rules applied in rule"] == 10 * 6
    assert RULES_APPLIED in sim.energy("loihi").notes
    assert RULES_APPLIED in str(sim.energy("loihi"))
    assert RULES_APPLIED not in price(*counted(), placed(), chip("loihi")).notes


def test_a_run_may_last_as_long_as_its_recordings_and_not_as_its_steps(run):
    """10 steps of 1 ms that show 4 ms of events: in real time the chip is on for 4 ms, and one tick a step is late."""
    fast = price(*run, placed(), chip("loihi"), duration_s=4e-3)
    assert (fast.duration_s, fast.late, fast.real_time.chip_time_s) == (4e-3, False, 4e-3)
    assert fast.real_time.static_j == pytest.approx(4e-3 * 0.104)
    late = price(*run, None, chip("truenorth"), duration_s=4e-3)
    assert (late.late, late.real_time.chip_time_s) == (True, 10e-3)
    assert "late: slower than real time, the chip needs 10 ms for 4 ms" in late.notes
    assert late.cells()[3] == "10 ms of 4 ms"
    with pytest.raises(ModelError, match=r"^duration_s = -1: expected a number >= 0 in s$"):
        price(*run, None, chip("truenorth"), duration_s=-1)


def test_the_real_placement(run):
    """All on one core of the tile at which the host's spikes enter: nothing leaves the tile."""
    program, counts = run
    loihi = lines(price(program, counts, place(program, chip("loihi")), chip("loihi")))
    assert loihi["spike_in_tile", "in"][0] == 4
    assert loihi["spike_in_tile", "ab"][0] == 12
    assert not any(what.startswith("hop") for what, _ in loihi)
    work = 24 * 8.4e-9 + 36 * 5.3e-9 + 24 * 3.5e-9 + 24 * 6.1e-9
    assert loihi["static_per_chip", "loihi"][0] == pytest.approx(STEPS * 113e-9 + work, rel=1e-12)
    spinnaker = lines(price(program, counts, place(program, chip("spinnaker")), chip("spinnaker")))
    packets = {of: count for (what, of), (count, _) in spinnaker.items() if what == "packet"}
    assert packets == {"input": 4, "a": 12}
    assert spinnaker["static_per_chip", "spinnaker"][0] == pytest.approx(STEPS * 1e-3)


def test_a_table_of_a_user(run, tmp_path):
    table = tmp_path / "mine.yaml"
    table.write_text("like: truenorth\ncosts:\n  static_per_chip: {value: 2.0, source: me}\n")
    energy = price(*run, None, chip(table))
    assert energy.static_j == pytest.approx(2.0 * 10e-3)
    assert "nothing is placed: one chip is assumed" in energy.notes
    table.write_text("name: mine\ncosts:\n  weight_write: {value: 2.0, source: me}\n")
    energy = price(*run, None, chip(table))
    assert (energy.total_j, energy.chip_time_s) == (0.0, None)
    bare = "learning_update, neuron_update_active, neuron_update_inactive, synaptic_op"
    assert f"not priced, as no figure is published: {bare}" in energy.notes


def test_per_part(run):
    whole = price(*run, placed(), chip("loihi"))
    part = whole.per(4, "control step")
    assert part.of == "control step"
    assert part.total_j == pytest.approx(whole.total_j / 4, rel=1e-12)
    assert part.chip_time_s == pytest.approx(whole.chip_time_s / 4, rel=1e-12)
    assert lines(part)["synaptic_op", "in"] == (3, pytest.approx(3 * 23.6e-12))
    assert [item.joules_each for item in part.items] == [item.joules_each for item in whole.items]
    assert whole.per(1, "run") == whole


def test_mistakes(run, tmp_path, messages):
    (tmp_path / "bare.yaml").write_text("limits:\n  cores_per_chip: {value: 128, source: me}\n")
    bare, whole = chip(tmp_path / "bare.yaml"), price(*run, placed(), chip("loihi"))
    messages(refusals_of(messages.cases, globals() | locals()))


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 50),
    st.lists(st.integers(0, 9), min_size=8, max_size=8),
    st.lists(st.integers(0, 5), min_size=5, max_size=5),
)
def test_a_bill_is_the_counts_times_the_figures(run, steps, spikes, each):
    """Whatever the counts are, the bill holds them all, and its sums are those of its items."""
    program, _ = run
    parts = tuple(np.array(spikes[a:b]) for a, b in ((0, 2), (2, 5), (5, 8)))
    active = ints(0, min(3, spikes[0]) * steps // 2, 0)
    raw = EngineCounts(steps, parts, parts, active, ints(0, 0))
    counts = Tally(program).between(None, raw)
    moves = {0: Moves(*[ints(*each[:2])] * 4), 1: Moves(*[ints(*each[2:])] * 4)}
    energy = price(program, raw, Placed(moves, placed().cores), chip("loihi"))
    figures = {**chip("loihi").costs, "host": chip("cpu").costs["mac"]}
    sums = {}
    for item in energy.items:
        assert item.joules == item.count * figures[item.what].value
        sums[item.what] = sums.get(item.what, 0) + item.count
    assert sums["host"] == 0
    assert sums.get("synaptic_op", 0) == counts.synaptic_ops
    assert sums.get("learning_update", 0) == counts.learning_updates
    updates = sums.get("neuron_update_active", 0) + sums.get("neuron_update_inactive", 0)
    assert updates == counts.neuron_updates
    hops = int(parts[0] @ ints(*each[:2]) + parts[1] @ ints(*each[2:]))
    assert sums.get("hop_east_west", 0) == sums.get("spike_in_tile", 0) == hops
    assert energy.total_j == pytest.approx(math.fsum(item.joules for item in energy.items), rel=1e-12)
    assert energy.chip_time_s >= steps * 113e-9


@pytest.mark.parametrize("backend", ["event", "loihi"])
def test_bills_of_one_network_quantise_it_once(monkeypatch, backend):
    """What a chip refuses stands in each bill; it is found once, also where no engine has quantised the network."""
    made = []
    whole = quantising._population
    monkeypatch.setattr(quantising, "_population", lambda *rest: made.append(1) or whole(*rest))
    net = neuro.Network("net", resolution=1.0)
    net.population("in", 1, neuro.spike_generator(spike_times=[[1.0]]))
    net.population("out", 1, neuro.iaf_psc_exp())
    net.connect("in", "out", neuro.all_to_all(), weight=500.0, delay=1.0)
    sim = neuro.compile(net, backend)
    sim.run(5.0)
    bills = [sim.energy("loihi") for _ in range(3)]
    assert len(made) == 1
    assert bills[0] == bills[1] == bills[2]


def test_a_bill_in_json(run):
    energy = price(*counted(learns=False), placed(), chip("spinnaker"))
    told = json.loads(json.dumps(energy.as_dict()))
    assert told["total_j"] == energy.total_j == told["dynamic_j"] + told["static_j"]
    assert sum(item["joules"] or 0.0 for item in told["items"]) == pytest.approx(energy.total_j, rel=1e-12)
    assert (told["target"], told["of"], told["chips"], told["steps"]) == ("spinnaker", "run", 1, 10)
    assert told["items"][-1]["source"].startswith("Painkras")
    assert told["notes"] == list(energy.notes)


def test_what_is_not_known_is_null_in_json(run, tmp_path):
    dense = price(*run, None, chip("cpu"))
    assert (dense.static_j, dense.static_known) == (0.0, False)
    told = json.loads(json.dumps(dense.as_dict()))
    assert (told["static_j"], told["chip_time_s"], told["chips"]) == (None, None, None)
    assert told["total_j"] == told["dynamic_j"] == dense.total_j > 0.0
    (tmp_path / "free.yaml").write_text("like: truenorth\ncosts: {static_per_chip: {value: 0, source: me}}\n")
    free = price(*run, None, chip(tmp_path / "free.yaml"))  # its figure is 0 and published
    assert free.static_known
    assert (free.as_dict()["static_j"], free.as_dict()["chips"]) == (0.0, 1)
    assert [energy.cells()[-2:] for energy in (dense, free)] == [("-", "-"), ("10 ms of 10 ms", "1")]


def test_the_text(run, messages):
    energy = price(*run, None, chip("spinnaker2")).per(2, "half")
    messages({"plain": str(energy), "with sources": energy.told(sources=True)})
    hand = price(*run, placed(), chip("loihi"))
    messages({"times of loihi": "\n".join(hand.notes[:6])})


def test_prefixes():
    values = {23.6e-12: "23.6 pJ", 0.0: "0 J", 1.0: "1 J", 0.0009999999: "1 mJ", 1.7e-17: "0.017 fJ"}
    for value, text in (values | {12345.6: "1.235e+04 J", 999.94e-9: "999.9 nJ"}).items():
        assert quantity(value, "J") == text


REAL = STEPS * 1e-3

"""Seconds that the run lasts."""


def table(folder, text):
    path = folder / "mine.yaml"
    path.write_text(text)
    return chip(path)


def test_a_fast_chip_waits_in_real_time(run):
    bill = price(*run, placed(), chip("loihi"))
    real = bill.real_time
    assert (bill.clock, real.clock) == ("as fast as the chip can", "in real time")
    assert bill.duration_s == real.duration_s == real.chip_time_s == pytest.approx(REAL)
    assert bill.chip_time_s < 1e-5
    assert real.dynamic_j == bill.dynamic_j
    assert real.static_j == pytest.approx(REAL * 0.104)
    low, high = bill.as_dict()["dynamic_low_j"], bill.as_dict()["dynamic_high_j"]
    assert (real.low_j, real.high_j) == pytest.approx((low + REAL * 0.029, high + REAL * 0.171))
    assert real.real_time is real
    assert not bill.late


def test_a_chip_of_real_time_has_one_clock():
    bill = price(*counted(learns=False), placed(), chip("spinnaker"))
    assert bill.real_time is bill
    assert bill.totals() == "3.602 mJ (3.6 to 10 mJ) as fast as the chip can, the same in real time"


def test_a_late_chip_does_not_wait_and_says_so(run, tmp_path):
    slow = table(tmp_path, "like: truenorth\nstep_s: {value: 2.0e-3, low: 0.5e-3, high: 3.0e-3, source: x}\n")
    bill = price(*run, None, slow)
    assert bill.late
    assert bill.real_time.chip_time_range_s == pytest.approx((REAL, 3 * REAL))
    assert bill.real_time.static_j == bill.static_j == pytest.approx(2 * REAL * 0.0644)
    assert "late: slower than real time, the chip needs 20 ms for 10 ms" in bill.notes
    assert bill.cells()[2].endswith(" late")


def test_a_chip_without_times_is_priced_in_real_time_only(run, tmp_path):
    bill = price(*run, None, table(tmp_path, "costs: {static_per_chip: {value: 2, low: 1, high: 4, source: x}}"))
    assert (bill.static_known, bill.chip_time_s) == (False, None)
    assert (bill.real_time.low_j, bill.real_time.total_j, bill.real_time.high_j) == pytest.approx(
        (1 * REAL, 2 * REAL, 4 * REAL)
    )
    assert "static power is in the sums in real time only: no time of a step is published" in bill.notes


def test_all_that_is_told_has_both_with_their_range(run):
    whole = price(*run, placed(), chip("loihi"))
    bill = whole.per(4, "recording")
    assert bill.real_time.total_j == pytest.approx(whole.real_time.total_j / 4)
    assert bill.duration_s == whole.duration_s / 4
    told = json.loads(json.dumps(bill.as_dict()))
    for figures, clock in ((told, bill), (told["real_time"], bill.real_time)):
        assert [figures[f"total{end}_j"] for end in ("_low", "", "_high")] == [clock.low_j, clock.total_j, clock.high_j]
    lines = str(bill).splitlines()
    end = next(k for k, line in enumerate(lines) if line.startswith("total"))
    head, _, _, static, total = lines[end - 4 : end + 1]
    assert head.split() == ["as", "fast", "as", "the", "chip", "can", "in", "real", "time"]
    assert static.split()[3:] == ["260", "uJ"]
    assert total.endswith("260 uJ (72.5 to 428 uJ)")
    assert bill.cells()[2] == "260 uJ (72.5 to 428 uJ)"
    assert bill.cells()[3] == f"{bill.chip_time_s * 1e9:.3g} ns of 2.5 ms"
    joules = neurobench(*run, samples=2, energy=whole)["energy_j"]
    assert joules["clock"] == "as fast as the chip can"
    ends = (whole.real_time.total_j, whole.real_time.low_j, whole.real_time.high_j)
    assert tuple(joules["real_time"].values()) == pytest.approx([each / 2 for each in ends])
