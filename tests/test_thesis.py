"""The printed equations of the thesis against the code, with numbers worked by hand; and the ledger that names them.

A misprint that the code corrects has both numbers here. docs/reference/thesis.yaml has a row for each test.
"""

import math
import re
import shutil
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import neuro
from benchmark_scripts import script
from neuro.coding import world_decoders as decoders
from neuro.events import DVS, DVSParameters

BACKENDS = pytest.mark.parametrize("backend", ["reference", "event"])
LATER = ["deviates", "not built"]


def ordered(backend, label, weight=0.5, ties_after=False, **words):
    """Weights onto the map that decides, and onto the other, after one trial.

    Inputs 0 to 3 arrive before the decision, with it, after it and never; the rates are those of table 3.
    """
    net = neuro.Network("orders", resolution=1.0)
    net.population("input", 4, neuro.spike_generator())
    net.population("maps", (2, 1), neuro.iaf_psc_delta(tau_m=math.inf, E_L=0.0, V_reset=0.0, V_th=0.8))
    rule = neuro.r_stdp(Ar_plus=0.075, Ar_minus=-0.025, Ap_plus=0.005, Ap_minus=-0.04, epsilon=0.004)
    rule = replace(rule, ties_after=ties_after)
    weights = np.array([[weight, 0.2]] * 4)
    net.connect("input", "maps", neuro.all_to_all(), rule, weight=weights, delay=1.0, name="w")
    net.group("choice", neuro.winner_take_all(of="maps"))
    net.trials(input="input", duration=20.0, labels={"of": "maps"}, **words)
    sim = neuro.compile(net, backend)
    sim.trials([0.0, 4.0, 8.0], [0, 1, 2], [0, 3], labels=[label], learn=True)
    return sim.weights("w")[2].reshape(4, 2).T


@BACKENDS
def test_eq_126_reward(backend):
    """0.5 x 0.5 x 0.075 = 0.01875 before the decision, 0.5 x 0.5 x -0.025 = -0.00625 elsewhere."""
    decided, other = ordered(backend, 0)
    assert decided[[0, 2, 3]] == pytest.approx([0.51875, 0.49375, 0.49375], abs=1e-14)
    assert other.tolist() == [0.2] * 4


@BACKENDS
def test_eq_126_tie(backend):
    """An input that arrives with the decision: Ar- and 0.49375 as printed, Ar+ and 0.51875 by default."""
    assert ordered(backend, 0, ties_after=True)[0][1] == pytest.approx(0.49375, abs=1e-14)
    assert ordered(backend, 0)[0][1] == pytest.approx(0.51875, abs=1e-14)


@BACKENDS
def test_eq_127_punishment(backend):
    """0.25 x -0.04 = -0.01 before the decision and with it, 0.25 x 0.005 = 0.00125 elsewhere.

    With j as the winner, as line 3756 says, the printed cases would give 0.50125, 0.49, 0.49, 0.49.
    """
    assert ordered(backend, 1)[0] == pytest.approx([0.49, 0.49, 0.50125, 0.50125], abs=1e-14)


@BACKENDS
def test_eq_128_growth(backend):
    """Every weight of the right label's map grows by 0.004 after a mistake and after silence, by 0 after a hit."""
    assert ordered(backend, 1)[1] == pytest.approx([0.204] * 4, abs=1e-14)
    silent = ordered(backend, 1, weight=0.1)
    assert silent[0].tolist() == [0.1] * 4
    assert silent[1] == pytest.approx([0.204] * 4, abs=1e-14)


@BACKENDS
def test_eq_128_stays_below_1(backend):
    """0.998 + 0.004 = 1.002 as printed; here the weight ends at 1."""
    net = neuro.Network("bound", resolution=1.0)
    net.population("input", 1, neuro.spike_generator())
    net.population("maps", (1, 1), neuro.iaf_psc_delta(tau_m=math.inf, E_L=0.0, V_reset=0.0, V_th=2.0))
    net.connect("input", "maps", neuro.all_to_all(), neuro.r_stdp(epsilon=0.004), weight=0.998, delay=1.0, name="w")
    net.group("choice", neuro.winner_take_all(of="maps"))
    net.trials(input="input", duration=20.0, labels={"of": "maps"})
    sim = neuro.compile(net, backend)
    sim.trials([0.0], [0], [0, 1], labels=[0], learn=True)
    assert sim.weights("w")[2].tolist() == [1.0]


def decided_by(backend, weights, times, ids):
    """The label that ReMuS decides for, -1 for none, and when; two grids a label, one weight in each grid."""
    from neuro_recognise.methods.framewise import Inputs, to_text
    from neuro_recognise.recogniser import method_of

    method = method_of("remus", "thesis")
    net = method.layer.network(Inputs((4, 12, 12), 64.0, 1.0), len(weights) // 2)
    kernels = np.broadcast_to(np.reshape(weights, (-1, 1, 1, 1)), (len(weights), 4, 11, 11))
    sim = method.simulation({"network": to_text(net), "c1_s2": kernels, "seed": np.array(1)}, backend)
    results = sim.trials(times, ids, [0, len(ids)])
    return results.label.item(), results.step.item()


@BACKENDS
def test_eq_125_first_to_fire(backend):
    """Preset `thesis`, threshold 30, a spike every ms: the 38th reaches it by 38 x 0.8, the 43rd by 43 x 0.7.

    Without 43 spikes of 0.7 nothing is decided.
    """
    times, ids = np.arange(60.0), np.arange(60) + np.arange(60) // 11
    assert decided_by(backend, [0.7, 0.1, 0.1, 0.8], times, ids) == (1, 38)
    assert decided_by(backend, [0.1, 0.8, 0.7, 0.7], times, ids) == (0, 38)
    assert decided_by(backend, [0.7, 0.1, 0.1, 0.1], times, ids) == (0, 43)
    assert decided_by(backend, [0.7, 0.1, 0.1, 0.1], times[:42], ids[:42]) == (-1, -1)


def test_eq_129_action():
    """(12 - 5) / 25 = 0.28, 25 being 50 ms over a refractory period of 2 ms. The drone doubles that."""
    box = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float64)
    act = decoders.difference(of="motors").made(box, [4], [50.0 / 2.0])
    assert act({"motors": np.array([[12, 5, 0, 25]])}).tolist() == [[0.28, -1.0]]
    doubled = decoders.difference(of="motors", gain=2.0).made(box, [4], [25.0])
    assert doubled({"motors": np.array([[12, 5, 0, 25]])}).tolist() == [[0.56, -1.0]]


def test_eq_131_delays():
    """A d of 10 ms: shares of it are added, within a floor of 1 ms and a cap of 20 ms that eq. 131 lacks."""
    rule = neuro.r_stddp(Ar_plus=-0.05, Ar_minus=0.05, Ap_plus=-0.02, Ap_minus=0.1)
    c = np.zeros(rule.width)
    rule.arithmetic.constants(rule.vector(), 1.0, c)
    moved = [rule.arithmetic.teach(10.0, since, lesson, c) for lesson in (1.0, -1.0) for since in (3.0, -3.0)]
    assert moved == pytest.approx([9.5, 10.5, 11.0, 9.8], abs=1e-14)
    assert rule.arithmetic.teach(1.01, 3.0, 1.0, c) == 1.0
    assert rule.arithmetic.teach(19.9, 3.0, -1.0, c) == 20.0


def paired(backend, rule, *pre, post=14.0):
    """The weight of 0.5 at 300 ms, after pre spikes, a post spike and a spike of dopamine at 100 ms."""
    net = neuro.Network("pair", resolution=1.0)
    net.population("pre", 1, neuro.spike_generator(spike_times=[list(pre)]))
    net.population("drive", 1, neuro.spike_generator(spike_times=[[post - 1.0]]))
    net.population("da", 1, neuro.spike_generator(spike_times=[[99.0]]))
    net.population("post", 1, neuro.iaf_psc_delta())
    net.connect("pre", "post", neuro.all_to_all(), rule, weight=0.5, delay=1.0, name="w")
    net.connect("drive", "post", neuro.all_to_all(), weight=50.0, delay=1.0)
    sim = neuro.compile(net, backend, seed=1)
    sim.run(300.0)
    assert sim.spikes("post")[0].tolist() == [post]
    return sim.weights("w")[2].item()


def dopamine(amount, **words):
    return neuro.stdp_dopa(dopamine="da", A_plus=amount, tau_plus=20.0, tau_c=1000.0, tau_n=200.0, **words)


@BACKENDS
def test_eqs_107_to_109_dopamine(backend):
    """c = exp(-5/20) at 15 ms, d = 1/200 at 100 ms: c(100) tau_c / (tau_c + tau_n) (1 - exp(-200 (1/1000 + 1/200)))."""
    left = math.exp(-5.0 / 20.0) * math.exp(-85.0 / 1000.0)
    expected = left * (1000.0 / 1200.0) * (1.0 - math.exp(-1.2))
    assert expected == pytest.approx(0.41657, abs=5e-6)
    assert paired(backend, dopamine(1.0), 10.0) == pytest.approx(0.5 + expected, rel=1e-9)


@BACKENDS
def test_line_2025_deviates(backend):
    """With c < 0 the printed equation lowers the weight, the text leaves it; c_min = 0 is nearest to the text."""
    assert paired(backend, dopamine(-1.0), 10.0) == pytest.approx(0.5 - 0.41657, abs=5e-6)
    assert paired(backend, dopamine(-1.0, c_min=0.0), 10.0) == 0.5


def test_eqs_110_to_114_stochastic_synapse():
    """q = ln 3 and z = 0: p = 1 / (1 + 1/3) = 3/4; release adds 1/4 to c, failure takes 3/4; z jumps and decays."""
    rule = neuro.hedonistic(q_0=math.log(3.0), Delta_z=0.5, tau_z=50.0, tau_c=20.0, tau_r=10.0, eta=0.01)
    on_pre, c = rule.arithmetic.on_pre, np.zeros(rule.width)
    rule.arithmetic.constants(rule.vector(), 1.0, c)
    jumps = []
    for u, jump in ((0.7499, 0.25), (0.7501, -0.75)):
        y = np.zeros((6, 1))
        y[:, 0] = [7.0, *rule.first_states()[:, 0]]
        on_pre(y, 0, c, (math.inf,), (), u)
        assert y[[2, 3], 0] == pytest.approx([jump, 0.5])
        jumps.append(float(y[2, 0]))
        rule.arithmetic.advance(y, 0, c, 0, 20, 2.0, 1.0)  # 20 ms of a reward of 2
        assert y[1, 0] == pytest.approx(0.01 * 2.0 * jump * 20.0 * (1.0 - math.exp(-1.0)))
        assert y[[2, 3], 0] == pytest.approx([jump * math.exp(-1.0), 0.5 * math.exp(-0.4)])
    assert 0.75 * jumps[0] + 0.25 * jumps[1] == pytest.approx(0.0)  # the mean of eq. 113


@BACKENDS
def test_eqs_16_to_19_pairs(backend):
    """5 ms from pre to post and tau 20 ms: exp(-5/20) = 0.7788, added (eq. 18) or as a share (eq. 19)."""
    for rule, after in (
        (neuro.stdp(lambda_=0.01, mu_plus=0.0, mu_minus=0.0, alpha=0.0, Wmax=1.0), 0.5 + 0.01 * 0.7788008),
        (neuro.stdp_literal(lambda_=0.01, alpha=0.0), 0.5 * (1.0 + 0.01 * 0.7788008)),
    ):
        assert paired(backend, rule, 10.0, 290.0) == pytest.approx(after, abs=1e-9)


def test_eqs_115_and_116_offset_reinforcement():
    """R - b = 1 - 0.25, and b follows by a tenth of that."""
    assert neuro.reward_error(1.0, 0.25, 0.1) == pytest.approx((0.75, 0.325))


def test_eq_14_misprinted():
    """25 of 0 to 100 in 64 ms: printed 64 x 0.25 = 16 ms, which is early for a low value; here 64 x 0.75 = 48 ms."""
    assert neuro.coding.intensity_to_latency([25.0, 100.0, 0.0], 0.0, 100.0, 64.0).tolist() == [48.0, 0.0, 64.0]


def test_eq_15_log_latency():
    """10 of 1 to 100 in 64 ms: (ln 100 - ln 10) / (ln 100 - ln 1) = 1/2."""
    times = neuro.coding.log_intensity_to_latency([10.0, 100.0, 1.0], 1.0, 100.0, 64.0)
    assert times == pytest.approx([32.0, 0.0, 64.0])


def test_eqs_12_and_13_rates():
    """12 spikes in 0.1 s are 120 Hz; 40 Hz in 50 ms are Poisson of mean 2, of which e^-2 = 0.1353 have no spike."""
    assert neuro.coding.rate([0.3], 0.0, 1.0, 400.0).tolist() == [12 / 0.1]
    trains = neuro.coding.poisson(np.full(20_000, 40.0), 50.0, seed=1)
    counts = np.isfinite(trains).sum(axis=1)
    assert counts.mean() == pytest.approx(2.0, abs=0.05)
    assert (counts == 0).mean() == pytest.approx(math.exp(-2.0), abs=0.01)


def test_eqs_20_and_21_events():
    """ln 2 - ln 1 = 0.69 holds 0.25 twice; then ln 0.95 is 0.55 below the level 0.5 of the second event."""
    camera = DVS((1, 1), DVSParameters.ideal(pos_thres=0.25, neg_thres=0.25))
    seen = [camera.see(np.array([[light]]), t) for t, light in ((0, 0.4), (1000, 0.8), (2000, 0.38), (3000, 0.38))]
    assert [one.p.tolist() for one in seen] == [[], [1, 1], [0, 0], []]


def test_eq_22_policy():
    """The same counts give the same action: the neurons with most spikes, the first of equal ones."""
    act = decoders.winner(of="motors").made(gymnasium.spaces.Discrete(3), [3], [25.0])
    assert [int(np.ravel(act({"motors": np.array([[2, 7, 7]])}))[0]) for _ in range(3)] == [1, 1, 1]


def test_eqs_122_to_124_gabor():
    """At (1, 0) px, 0 degrees, scale 3: exp(-1 / 2.88) cos(2 pi / 1.5) = -0.35332; then zero mean and unit norm."""
    from neuro_recognise.parts.banks import gabor_bank

    table = ((3,), (1.2,), (1.5,), 0.3, (0.0,))
    printed = gabor_bank(*table, literal=True)[0, 0]
    assert printed[1] == pytest.approx([-0.353324, 1.0, -0.353324], abs=1e-6)
    ours = gabor_bank(*table)[0, 0]
    assert ours == pytest.approx((printed - printed.mean()) / np.linalg.norm(printed - printed.mean()))


def test_eq_118_speciality():
    """Pixels of 4, 2 and 1 of 4 segments have log(4 / n_i) = 0, log 2 and log 4, up to a factor; printed negative."""
    from neuro_recognise.method import Course
    from neuro_recognise.recogniser import method_of
    from neuro_recognise.shown import Features

    pixels = ([0, 1, 2], [0, 1], [0], [0])
    evidence = [{"pixels": np.array(one, np.uint32), "lengths": np.array([len(one)])} for one in pixels]
    shown = Features(evidence, np.array([0, 1, 0, 1]), ("a", "b", "c", "d"), ("x", "y"))
    special = method_of("boe").fitting((3, 1)).fit(shown, Course())["speciality"]
    assert special / special[1] == pytest.approx([0.0, 1.0, 2.0])
    assert special[1] > 0.0


def test_eq_130_error():
    """The error of a lap is the mean of sqrt(dx^2 + dy^2); the signed means cancel to less than that."""
    from neuro_drone.evaluate import grid, try_out
    from neuro_drone.scenario import load
    from neuro_drone.train import train

    world = load("A60", **{"task": {"ball": {"lap": 1.5, "speed": 0.15}}})
    lap = try_out(train(world, "centroid", steps=1, seed=1), starts=grid(world, 1)).each[0]
    assert lap.error_px == pytest.approx(np.hypot(*lap.track.T).mean())
    assert np.hypot(*lap.signed) < 0.5 * lap.error_px


THESIS = script("thesis")


def test_every_row_has_a_verdict_and_its_lines():
    names = [row["name"] for row in THESIS.rows()]
    assert len(names) == len(set(names)) >= 90
    for row in THESIS.rows():
        assert row["verdict"] in THESIS.VERDICTS, row["name"]
        assert ("why" in row) >= (row["verdict"] in LATER), f"{row['name']}: a deviation without its reason"
        assert re.fullmatch(r"\d+(-\d+)?(, \d+(-\d+)?)*", str(row["lines"])), row["name"]
        assert "test" in row or ("run" in row) == ("range" in row), row["name"]
        assert not row.get("quick") or THESIS.commands(row), row["name"]
    assert sum(bool(row.get("quick")) for row in THESIS.rows()) >= 45


def test_the_page_is_that_of_the_ledger():
    files = {THESIS.PAGE, *THESIS.PAGE.with_suffix("").glob("*.md")}
    kept = {file: file.read_text("utf-8") for file in files}
    assert kept == THESIS.pages(), "python benchmarks/thesis.py --page writes them anew"


def test_tests_that_rows_name_are_there():
    for row in THESIS.rows():
        if "test" in row:
            file, *names = row["test"].split("[")[0].split("::")
            text = (THESIS.ROOT / file).read_text("utf-8")
            assert not names or f"def {names[0]}(" in text, row["name"]


def test_a_number_that_left_its_range_fails(capsys):
    inside = {"name": "in", "verdict": "as printed", "run": "python -c 'print(1, 2.5e1)'", "range": [25, 25]}
    outside = {"name": "out", "verdict": "as printed", "run": "python -c 'print(3)'", "range": [1, 2]}
    broken = {"name": "broken", "verdict": "as printed", "run": "python -c 'raise SystemExit(2)'", "range": [0, 9]}
    absent = {"name": "absent", "verdict": "as printed", "run": "python -c ''", "range": [0, 0], "needs": ["none.zip"]}
    assert THESIS.compare([inside, outside, broken, absent]) == 2
    printed = capsys.readouterr().out
    assert "2 left their range: out, broken" in printed
    assert "1 skipped" in printed


@pytest.mark.parametrize(
    ("name", "package", "module", "old", "new"),
    [
        (
            "reward", "neuro", "model/synapses/trials.py",
            "c[AR_PLUS] if since >= 0.0 else c[AR_MINUS]", "c[AR_MINUS] if since >= 0.0 else c[AR_PLUS]",
        ),
        (
            "table-3", "apps/neuro_recognise", "methods/frame_networks.py",
            '"theta": 30.0, "epsilon"', '"theta": 31.0, "epsilon"',
        ),
    ],
    ids=["rule", "preset"],
)  # fmt: skip
def test_a_planted_change_leaves_the_range(name, package, module, old, new, tmp_path, monkeypatch, capsys):
    """The comparison is green with a copy of the package, and red with a rule or a preset of the copy changed."""
    row = next(row for row in THESIS.rows() if row["name"] == name)
    row |= {"test": f"{row['test']}[reference]"} if "test" in row else {}
    copy = tmp_path / Path(package).name
    shutil.copytree(THESIS.ROOT / package, copy, ignore=shutil.ignore_patterns("__pycache__"))
    # Without the safe path the folder of the project, in which commands run, would come before the copy.
    for word, value in (("PYTHONPATH", str(tmp_path)), ("PYTHONSAFEPATH", "1"), ("PYTHONDONTWRITEBYTECODE", "1")):
        monkeypatch.setenv(word, value)
    text = (copy / module).read_text("utf-8")
    assert text.count(old) == 1
    for change, left in ((old, "all are in their range"), (new, f"1 left their range: {name}")):
        (copy / module).write_text(text.replace(old, change), "utf-8")
        THESIS.ran.cache_clear()
        assert THESIS.compare([row]) == (change == new)
        assert left in capsys.readouterr().out
