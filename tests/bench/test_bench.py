"""Tasks, methods and results from end to end, also of a newcomer."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import neuro
from neuro.events.representations import hats
from neuro_bench import METHODS, TASKS, Costs, Examples, Method, Request, Spikes, Task, report, run
from neuro_bench.artificial import ensemble, members, train_classifier
from neuro_bench.costs import break_even, on_chips
from neuro_bench.features import surfaces
from neuro_bench.running import interval
from neuro_bench.sounds import SpokenDigits
from neuro_bench.task import grouped_folds, random_folds, tries
from refused import mistakes_of, refused

pytest.importorskip("sklearn", reason="the extra bench is not installed")


def examples(n=60, classes=3):
    """Bars at the row of their class, with noise."""
    rng, labels = np.random.default_rng(5), np.arange(n) % classes
    dense = rng.random((n, 12, 2, 4, 6)) < 0.02
    dense[np.arange(n), 2:8, 1, labels] = True
    return Examples(dense.sum(axis=1, dtype=np.float32), labels, tuple("abc"), Spikes.of_dense(dense, 5.0))


class Bars(Task):
    """Which row has a bar."""

    called_by, title, licence, source = "bars", "bars", "CC0", "made here"
    needs_data = False

    def folds(self):
        return random_folds(examples(), 3, self.seed)


class Majority(Method):
    """The most frequent class."""

    called_by, title = "majority", "the most frequent class"

    def fit(self, train, settings, seed):
        class Constant:
            def predict(self, shown):
                return np.full(len(shown), np.bincount(train.labels).argmax())

            def costs(self, shown):
                return Costs(parameters=1, footprint_bytes=8)

        return Constant()


@pytest.fixture(autouse=True)
def newcomer(monkeypatch):
    """A task and a method of a third party, for one test."""
    for registry, part in ((TASKS, Bars), (METHODS, Majority)):
        monkeypatch.setattr(registry, "_registered", {})
        monkeypatch.setattr(registry, "_parts", dict(registry._parts))
        neuro.register(part)


def test_folds_keep_parts_apart(sounds):
    made = random_folds(examples(), 3, 0)
    assert sum(len(fold.test) for fold in made) == 60
    for fold in made:
        parts = [{tuple(one.ravel()) for one in part.frames} for part in (fold.train, fold.validation, fold.test)]
        assert not parts[0] & parts[1] | parts[0] & parts[2] | parts[1] & parts[2]
        assert len(fold.both) == len(fold.train) + len(fold.validation)
    made = SpokenDigits(sounds, "speakers").folds()
    assert [fold.name for fold in made] == ["without a", "without b", "without c"]
    assert [part.recordings for part in (made[0].train, made[0].validation, made[0].test)] == [12, 12, 12]
    assert "found 2 groups: expected at least 3" in refused(grouped_folds, examples(4), "aabb")


def test_parts_of_examples():
    shown = examples()
    some = shown.take(np.array([7, 3]))
    assert some.labels.tolist() == [1, 0]
    own = shown.spikes.example == 3
    assert some.spikes.neuron[some.spikes.example == 1].tolist() == shown.spikes.neuron[own].tolist()
    shown = examples()
    twice = Examples(shown.frames, shown.labels, shown.classes, shown.spikes, versions=2)
    some = twice.take(np.array([7, 3]))
    assert (twice.recordings, len(some), some.recordings) == (30, 4, 2)
    assert np.array_equal(some.frames, shown.frames[[7, 3, 37, 33]])
    assert np.array_equal(twice.take(np.array([7]), 1).frames, shown.frames[[7]])
    pytest.importorskip("torch", reason="the extra torch is not installed")
    method = METHODS["dense"]()
    assert method.plan(twice, {**method.settings, "epochs": 5}, 0).epochs == 3  # each shows all versions once


@pytest.mark.parametrize(
    "method", ["logistic", "majority", "hats", "cnn", "cnn-int8", "gru", "recurrent", "delays", "converted-cnn"]
)
def test_a_newcomers_task_is_learnt_by_every_method(method):
    needs_torch = method not in ("logistic", "majority", "hats")
    if needs_torch:
        pytest.importorskip("torch", reason="the extra torch is not installed")
    changes = {"epochs": 4, "shift": 0} if needs_torch else {}
    with np.errstate(all="ignore"), pytest.warns() if method in ("recurrent", "delays") else _nothing():
        found = run(Request(task="bars", method=method, folds=1, changes=changes))
    assert len(found["folds"]) == 1
    assert found["costs"]["parameters"] > 0
    assert found["method"]["spiking"] == (method in ("recurrent", "delays", "converted-cnn"))
    json.dumps(found)
    if method == "logistic":
        assert found["mean"] == 100.0


def test_members_say_together_what_normalised_networks_say():
    torch = pytest.importorskip("torch", reason="the extra torch is not installed")
    shown, rng = examples(), np.random.default_rng(0)
    settings = {**METHODS["cnn"].settings, "epochs": 2, "members": 2}

    def make():
        layers = torch.nn.Conv2d(2, 3, 3), torch.nn.BatchNorm2d(3), torch.nn.ReLU()
        return torch.nn.Sequential(*layers, torch.nn.Flatten(), torch.nn.Linear(24, 3))

    frames = torch.from_numpy(rng.random((5, 2, 4, 6), np.float32))
    wanted = [train_classifier(make, shown, settings, seed) for seed in (4, 1004)]
    found = ensemble(members(make, shown, settings, 4))
    assert torch.allclose(found(frames), wanted[0](frames) + wanted[1](frames), atol=1e-5)
    assert not torch.allclose(wanted[0](frames), wanted[1](frames), atol=1e-2)
    sizes = []
    for norm, count in ((False, 1), (True, 2)):
        of = METHODS["cnn-int8"]().fit(shown, {**settings, "norm": norm, "members": count}, 0)
        sizes.append(of.costs(shown).parameters)
    assert sizes[1] == 2 * sizes[0]


def test_surfaces_are_of_the_spikes():
    shown, method = examples(4), METHODS["hats"]()
    made = method.fit(shown, {**method.settings, "cell": 3, "radius": 1}, 0)
    own = np.flatnonzero(shown.spikes.example == 2)
    polarity, y, x = np.unravel_index(shown.spikes.neuron[own], (2, 4, 6))
    events = neuro.events.Events(t=5000 * shown.spikes.at[own], x=x, y=y, p=polarity, sensor_size=(6, 4))
    wanted = hats(events, cell=3, radius=1, window_us=100_000, tau_us=1e5).ravel()
    assert np.array_equal(surfaces(shown, made.settings)[2], wanted)
    seen = np.count_nonzero(surfaces(shown, made.settings))
    assert made.costs(shown).effective_macs == pytest.approx(len(shown.spikes.at) * 9 / 4 + 3 * seen / 4)
    with pytest.raises(neuro.ModelError, match="method 'hats': the input has 3 sheets: expected the two polarities"):
        method.fit(replace(shown, spikes=Spikes.of_dense(np.ones((4, 1, 3, 2, 2)), 5.0)), method.settings, 0)


def _nothing():
    from contextlib import nullcontext

    return nullcontext()


def test_every_method_has_the_same_tries():
    method = METHODS["echo-state"]()
    drawn = tries(method, {}, 4, 0)
    assert (drawn[0], len({json.dumps(one) for one in drawn}), drawn) == (method.settings, 4, tries(method, {}, 4, 0))
    assert {one["units"] for one in tries(method, {"units": 300}, 4, 0)} == {300}


def test_tuning_never_sees_the_test_part():
    seen = []

    class Watched(Method):
        called_by, title, settings, space = "watched", "watches", {"x": 0}, {"x": (1, 2)}

        def fit(self, train, settings, seed):
            model = Majority().fit(train, settings, seed)
            predict = model.predict
            model.predict = lambda shown: seen.append(len(shown)) or predict(shown)
            return model

    neuro.register(Watched)
    found = run(Request(task="bars", method="watched", folds=1, tries=3))
    assert seen == [4, 4, 4, 20]  # a validation part of 4 for each try, the test part once
    assert len(found["folds"][0]["tries"]) == 3


@pytest.fixture
def failing():
    """Register a method that fails at its second fold; which values of its setting were fitted."""

    def of(error):
        fitted = []

        class Failing(Method):
            called_by, title, settings = "failing", "fails once", {"x": 0}

            def fit(self, train, settings, seed):
                fitted.append(settings["x"])
                if len(fitted) == 2:
                    raise error
                return Majority().fit(train, settings, seed)

        neuro.register(Failing)
        return fitted

    return of


def test_folds_that_are_done_are_kept(tmp_path, failing):
    """A run that ends early goes on behind its last fold; with other settings it begins anew."""
    fitted = failing(KeyboardInterrupt())
    kept, asked = tmp_path / "folds.json", Request(task="bars", method="failing")
    with pytest.raises(KeyboardInterrupt):
        run(asked, file=kept)
    found = run(asked, file=kept)
    assert (len(fitted), len(found["folds"])) == (4, 3)
    assert [one["score"] for one in found["folds"]] == [one["score"] for one in run(asked)["folds"]]
    fitted[:] = [0, 0]
    run(Request(task="bars", method="failing", changes={"x": 1}), file=kept)
    assert fitted[2:] == [1, 1, 1]


def test_an_unfinished_run_is_no_result_to_compare(bench, tmp_path, monkeypatch, failing):
    """What it leaves is not among `bars-random-*.json`, and the same command resumes behind it."""
    fitted = failing(neuro.ModelError("it fails"))
    monkeypatch.chdir(tmp_path)
    bench("run", "bars", "--method", "majority")
    assert bench("run", "bars", "--method", "failing")[0]
    assert [file.name for file in Path().glob("bars-random-*.json")] == ["bars-random-majority.json"]
    assert (bench("run", "bars", "--method", "failing")[::2], len(fitted)) == ((0, ""), 4)
    assert sorted(file.name for file in Path().iterdir()) == ["bars-random-failing.json", "bars-random-majority.json"]


def test_tasks_are_listed_with_all_splits_and_sources(bench):
    status, out, _ = bench("tasks")
    assert status == 0
    assert all(f"{task.called_by}: {task.source}; licence: {task.licence}\n" in out for task in TASKS.values())
    assert "tau30, all" in out
    for address in ("garrickorchard.com/datasets/n-mnist", "/POKERDVS.html", "/dvsgesture/"):
        assert address in out


def test_commands(bench, sounds):
    words = ("--data", sounds, "--first-folds", 2)
    status, out, err = bench("run", "spoken-digits", "--method", "logistic", *words)
    assert (status, err) == (0, "")
    assert "spoken-digits-random-logistic.json: written" in out
    bench("run", "spoken-digits", "--method", "majority", *words)
    status, out, err = bench("compare", "spoken-digits-random-majority.json", "spoken-digits-random-logistic.json")
    assert (status, err) == (0, "")
    assert out.splitlines()[0].startswith("logistic wins, a non-spiking network or method: ")
    found = report.read(Path("spoken-digits-random-logistic.json"))
    assert found["provenance"]["inputs"]
    assert found["asked"]["tries"] == 1


def test_what_cannot_be_is_refused(bench, messages):
    messages(mistakes_of(bench, messages.cases))


def test_verdicts():
    kinds = ({"name": "one", "spiking": True}, 0.7), ({"name": "two", "spiking": False}, 0.69)
    task = {"metric": "R2, mean of x and y", "higher": True}

    def results(half):
        return [{"method": kind, "task": task, "mean": m, "interval": [m - half, m + half]} for kind, m in kinds]

    assert report.verdict(results(0.02)).endswith(
        "0.700 [0.680, 0.720] (R2, mean of x and y); the best non-spiking is two, 0.010 behind; their intervals overlap"
    )
    assert report.verdict(results(0.001)).endswith("two, 0.010 behind")
    single = report.verdict(results(float("nan")))
    assert single.endswith("0.700 (R2, mean of x and y); the best non-spiking is two, 0.010 behind")
    assert break_even(10.0, 4.0, 14.0) == 2.0  # 6 whatever it says, and 8 for twice the spikes
    assert break_even(10.0, 4.0, 5.0) == 0.0
    costs = {"joules": {"a chip": 10.0}, "joules_of_spikes": {"a chip": 4.0}}
    spiking = {"method": {"name": "one", "spiking": True}, "costs": costs}
    other = {"method": {"name": "two", "spiking": False}, "costs": {"joules": {"a core": 14.0, "arithmetic": 1.0}}}
    assert report.sensitivity([other, spiking]) == [
        "one on a chip against two on a core: fewer joules up to 2 times its spikes",
        "one on a chip against two on arithmetic: more joules, even without spikes",
    ]
    assert report.sensitivity([spiking]) == []
    mean, low, high = interval([1.0, 2.0, 3.0])
    assert (mean, high - mean, low) == (2.0, pytest.approx(4.303 / 3**0.5, abs=1e-3), pytest.approx(2 * mean - high))


def test_results_of_other_tries_or_data_are_not_compared(bench, sounds, tmp_path):
    bench("run", "bars", "--method", "majority", "--first-folds", 1)
    bench("run", "bars", "--method", "logistic", "--first-folds", 1, "--tries", 2)
    status, _, err = bench("compare", "bars-random-majority.json", "bars-random-logistic.json")
    assert status
    assert "results differ in tries: 1 and 2: expected the same in one table" in err
    words = "run", "spoken-digits", "--method", "majority", "--first-folds", 1
    for name, left_out in (("same", 0), ("fewer", 1)):
        folder = tmp_path / name / sounds.name
        folder.mkdir(parents=True)
        for file in sorted(sounds.iterdir())[left_out:]:
            (folder / file.name).write_bytes(file.read_bytes())
        bench(*words, "--data", folder, "--out", f"{name}.json")
    bench(*words, "--data", sounds, "--out", "first.json")
    assert bench("compare", "first.json", "same.json")[0] == 0
    status, _, err = bench("compare", "first.json", "fewer.json")
    assert status
    assert "results differ in data" in err


def test_tables(capsys):
    found = run(Request(task="bars", method="boosting", folds=1, changes={"trees": 2}))
    report.show([found])
    assert found["costs"]["parameters"] is found["costs"]["effective_macs"] is None
    assert [line.split()[3:9] for line in capsys.readouterr().out.splitlines() if " boosting" in line] == [["-"] * 6]
    results = [run(Request(task="bars", method=name, folds=1)) for name in ("logistic", "majority")]
    report.show(results)
    printed = capsys.readouterr().out
    bills = printed[printed.index("uJ per example") :]
    assert "CPU core, float32" in bills
    assert [line.split()[-2:] for line in bills.splitlines() if "majority" in line] == [["-", "-"]]


def test_a_chip_without_room_has_no_bill():
    net = neuro.Network("wide", resolution=1.0)
    net.population("a", 5000, neuro.spike_generator())
    net.population("b", 1, neuro.iaf_psc_delta(V_th=1.0, E_L=0.0, V_reset=0.0))
    net.connect("a", "b", neuro.all_to_all(), weight=1.0, delay=1.0)
    sim = neuro.compile(net)
    sim.run(5.0)
    found = on_chips(sim, sim.taken(), 1)
    assert [name.split(",")[0] for name in found["joules"]] == ["SpiNNaker", "SpiNNaker"]
    assert "the spikes of 5,000 neurons reach it" in found["refused"]["Loihi"]


def test_the_task_of_the_page_is_trained_compared_and_priced(tmp_path, capsys):
    """Thirty lines from outside: no line of the package knows them."""
    page = (Path(__file__).parents[2] / "docs/how-to/benchmarks.md").read_text("utf-8")
    code = page.split("# tones.py\n")[1].split("```")[0]
    assert len([line for line in code.splitlines() if line.strip()]) <= 30
    file = tmp_path / "tones.py"
    file.write_text(code)
    exec(compile(code, str(file), "exec"), {"__name__": "tones"})
    pytest.importorskip("torch", reason="the extra torch is not installed")
    changes = {"hidden": 8, "epochs": 2}
    with np.errstate(all="ignore"):
        results = [
            run(Request(task="rows", method="dense", folds=1, changes=changes)),
            run(Request(task="rows", method="logistic", folds=1)),
        ]
    report.show(results)
    printed = capsys.readouterr().out
    assert printed.startswith("logistic wins, a non-spiking network or method")
    assert "dense on Loihi, as fast as it can against logistic on CPU core, float32: " in printed
    assert all(result["costs"]["joules"] for result in results)


def test_the_figures_of_the_page_are_json():
    folder = Path(__file__).parents[2] / "benchmarks/measured"
    found = json.loads((folder / "bench.json").read_text("utf-8"))
    assert all(row["interval"][0] <= row["mean"] <= row["interval"][1] for row in found.values())
    assert all(row["mean"] == pytest.approx(np.mean(row["scores"]), abs=0.011) for row in found.values())
