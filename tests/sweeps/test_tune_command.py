"""`neuro tune` on networks and functions from YAML files."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import neuro

pytest.importorskip("optuna", reason="the extra tune is not installed")

NET = """\
neuro: 1
name: pair
parameters: {w: 300.0}
populations:
  noise: {model: {poisson_generator: {rate: 900.0}}, shape: 20}
  exc: {model: iaf_psc_exp, shape: 10}
projections:
  noise_exc: {from: noise, to: exc, rule: all_to_all, weight: $w, delay: 1.0}
"""
TUNE = """\
network: net.yaml
for: 20 ms
backend: reference
parameters:
  w: {from: 100.0, to: 500.0}
  exc.V_th: [-55.0, -50.0]
objectives: {rate.exc: maximise, energy.loihi: minimise}
seeds: 2
trials: 4
"""
STUDY = """\
import neuro


@neuro.register(kind="study")
def folded(x, fold, folds):
    return {"right": 50.0 + x if fold is None else x * (fold + 1) / folds}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch, registries):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.yaml").write_text(NET)
    (tmp_path / "tune.yaml").write_text(TUNE)
    (tmp_path / "my_study.py").write_text(STUDY)
    return tmp_path


def test_a_network_is_tuned(folder, run, capsys):
    run("tune", "run", "tune.yaml", "--on", "here")
    out = capsys.readouterr().out
    assert "tuned: 4 done, 0 failed, 0 left\nbest: rate.exc " in out
    assert "tuned/tune.html: written\nnext: neuro tune table tuned, or neuro tune plot tuned\n" in out
    table = neuro.tuned("tuned")
    for trial in table.trials():
        net = folder / "one.yaml"
        text = NET.replace("w: 300.0", f"w: {trial.point['w']}").replace(
            "model: iaf_psc_exp", f"model: {{iaf_psc_exp: {{V_th: {trial.point['exc.V_th']}}}}}"
        )
        net.write_text(text)
        rates = []
        for seed in (0, 1):
            sim = neuro.compile(neuro.load(net), backend="reference", seed=seed)
            sim.run(20.0)
            rates.append(sim.counts().populations["exc"].spikes / 10 / 0.02)
        assert trial.metrics["rate.exc"] == pytest.approx(sum(rates) / 2, rel=1e-12)
    run("tune", "status", "tuned")
    assert capsys.readouterr().out.startswith("tune: 4 trials by nsga2: 4 done, 0 failed, 0 pruned, 0 left\nbest: ")
    run("tune", "table", "tuned", "--out", "table.csv")
    assert (folder / "table.csv").read_text() == table.csv()
    run("tune", "table", "tuned", "--runs", "--out", "runs.csv")
    assert (folder / "runs.csv").read_text().count("\n") == 1 + 2 * 4
    run("tune", "table", "tuned", "--times", "--out", "table.csv")
    run("rerun", f"tuned/runs/{table.runs().keys[0]}")
    assert "the same bits" in capsys.readouterr().out


def test_pictures_and_the_page(folder, run, capsys):
    (folder / "tune.yaml").write_text(TUNE.replace("trials: 4", "trials: 8").replace("seeds: 2\n", ""))
    run("tune", "run", "tune.yaml", "--on", "here")
    run("tune", "plot", "tuned")
    run("tune", "plot", "tuned", "--kind", "front", "--format", "svg", "--out", "pictures")
    names = sorted(path.name for path in (folder / "tuned").glob("*.png"))
    assert names == ["energy.loihi-parallel.png", "front.png", "history.png", "importance.png", "rate.exc-parallel.png"]
    assert [path.name for path in (folder / "pictures").iterdir()] == ["front.svg"]
    page = (folder / "tuned" / "tune.html").read_text()
    assert "rate.exc maximised, energy.loihi minimised" in page
    assert page.count("<title>trial ") == 24
    assert set(re.findall(r">(yes|no|True|False)<", page)) <= {"yes", "no"}
    assert ">yes<" in page
    assert '<meta name="provenance"' in page
    run("tune", "page", "tuned", "--out", "other.html")
    assert (folder / "other.html").exists()


def test_a_network_is_pruned_at_times(folder, run, capsys):
    (folder / "tune.yaml").write_text(
        "network: net.yaml\nfor: 40 ms\nbackend: reference\nparameters: {w: {from: 0.0, to: 500.0}}\n"
        "objectives: {spikes.exc: maximise}\nsampler: random\ntrials: 12\n"
        "prune: {by: median, startup_trials: 2, at: [10 ms, 20 ms]}\n"
    )
    run("tune", "run", "tune.yaml", "--on", "here")
    assert "pruned" in capsys.readouterr().out
    trials = neuro.tuned("tuned").trials()
    pruned = [trial for trial in trials if trial.outcome == "pruned"]
    done = [trial for trial in trials if trial.outcome == "done"]
    assert pruned
    assert len(pruned) + len(done) == 12
    text = (folder / "tune.yaml").read_text()
    (folder / "tune.yaml").write_text(text[: text.index("prune:")])
    run("tune", "run", "tune.yaml", "--on", "here", "--out", "whole")
    whole = {trial.point["w"]: trial for trial in neuro.tuned("whole").trials()}
    for trial in done:
        assert whole[trial.point["w"]].metrics == trial.metrics, "a run that is looked at on the way is another run"


def test_what_is_held_out_is_seen_by_the_test_alone(folder, run, capsys):
    (folder / "tune.yaml").write_text(
        "study: folded\nparameters: {x: {from: 0, to: 4, whole: true}}\nobjectives: {right: max}\n"
        "trials: 8\nfolds: 3\nsampler: random\n"
    )
    run("tune", "run", "tune.yaml", "--on", "here", "--with", "my_study.py")
    assert "or neuro tune test tuned" in capsys.readouterr().out
    best = neuro.tuned("tuned").best()[0]
    assert best.values[0] < 50
    assert "test.right" not in neuro.tuned("tuned").rows()[0]
    run("tune", "test", "tuned", "--on", "here", "--with", "my_study.py")
    x = best.point["x"]
    inside = f"{best.values[0]:.6g}"
    assert capsys.readouterr().out == f"trial {best.number}: right {inside} in folds, {50 + x} held out\n"
    rows = neuro.tuned("tuned").rows()
    assert {row["test.right"] for row in rows if row["best"]} == {50.0 + x}
    assert {row["test.right"] for row in rows if not row["best"]} <= {None}
    assert neuro.tuned("tuned").strays() == 0
    run("tune", "plot", "tuned")


MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))["tune"]


def test_mistakes_are_told_and_nothing_is_written(folder, answer, messages):
    for text in MISTAKES:
        (folder / "tune.yaml").write_text(text)
        messages({text: answer("tune", "run", "tune.yaml").err})
    assert not (folder / "tuned").exists()
    (folder / "damaged").mkdir()
    (folder / "damaged" / "tune.json").write_text('{"format": "neuro tune 1", "plan": 3}')
    for command in ("status", "table", "plot", "page", "test"):
        for name in ("nothing", "damaged"):
            messages({f"{command} {name}": answer("tune", command, name).err})
    (folder / "tune.yaml").write_text(TUNE.replace("trials: 4", "trials: 1"))
    assert answer("tune", "run", "tune.yaml", "--on", "here").status == 0
    messages({"no folds": answer("tune", "test", "tuned").err})


def test_a_study_that_is_not_named_or_was_edited_is_refused(folder, run):
    (folder / "tune.yaml").write_text(
        "study: folded\nparameters: {x: {from: 0, to: 4}}\nobjectives: {right: max}\ntrials: 2\nfolds: 3\n"
    )
    run("tune", "run", "tune.yaml", "--on", "here", "--with", "my_study.py")
    command = [sys.executable, "-m", "neuro", "tune", "test", "tuned", "--on", "here"]
    told = subprocess.run(command, capture_output=True, text=True)
    assert told.returncode == 2
    file = folder / "my_study.py"
    assert told.stderr == f"error: it was made with {file}\n  hint: if you trust this file, add --with {file}\n"
    file.write_text(STUDY.replace("50.0", "60.0"))
    told = subprocess.run([*command, "--with", "my_study.py"], capture_output=True, text=True)
    assert f"error: {file}: was edited since the tuning began: expected the unchanged file\n" in told.stderr
