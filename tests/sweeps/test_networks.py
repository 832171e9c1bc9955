"""Sweeps over networks from a YAML file, on the command line."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import neuro
from neuro_sweeps import folder as folders
from neuro_sweeps.definition import load_runs
from neuro_sweeps.table import table_of
from refused import refused

NET = """\
neuro: 1
name: pair
parameters: {w: 300.0, rule: {stdp: {Wmax: 600.0}}}
populations:
  noise: {model: {poisson_generator: {rate: 900.0}}, shape: 20}
  exc: {model: iaf_psc_exp, shape: 10}
  inh: {model: iaf_psc_exp, shape: 5}
projections:
  noise_exc: {from: noise, to: exc, rule: all_to_all, weight: $w, delay: 1.0}
  exc_inh: {from: exc, to: inh, rule: {fixed_indegree: {n: 3}}, weight: 300.0, delay: 1.0, synapse: $rule}
"""
SWEEP = """\
network: net.yaml
for: 30 ms
backend: reference
parameters:
  w: [200.0, 400.0]
  exc.V_th: [-55.0, -50.0]
  exc_inh.n: [5]
  exc_inh.lambda: [0.01]
seeds: 2
metrics: [rate.exc, spikes.inh, cv.exc, weight.exc_inh, weight_sd.exc_inh, spikes, energy.loihi, energy_real_time.loihi]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch, registries):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.yaml").write_text(NET)
    (tmp_path / "sweep.yaml").write_text(SWEEP)
    return tmp_path


def test_units_are_those_of_the_network(folder):
    sweep = load_runs(folder / "sweep.yaml", folders.SWEEP)
    units = (
        "exc.V_th mV, rate.exc Hz, weight.exc_inh pA, weight_sd.exc_inh pA, energy.loihi J, energy_real_time.loihi J"
    )
    assert sweep.as_dict()["units"] == dict(pair.split() for pair in units.split(", "))
    others = sweep.run.units(["for", "exc_inh.delay", "exc_inh.weight"])
    assert (others["exc_inh.delay"], others["exc_inh.weight"]) == ("ms", "pA")


@pytest.fixture
def swept(folder, run):
    """Run a sweep from the text of its file; its table."""

    def table(text, *words):
        (folder / "sweep.yaml").write_text(text)
        run("sweep", "run", "sweep.yaml", *(words or ("--on", "here")))
        return table_of("runs")

    return table


def test_a_sweep_gives_what_single_runs_give(folder, run, capsys):
    run("sweep", "run", "sweep.yaml", "--on", "here")
    out = capsys.readouterr().out.splitlines()
    assert out[0] == "runs: 8 done, 0 failed, 0 left"
    assert out[1] == "runs/sweep.html: written"
    rows = table_of("runs").rows()
    assert len(rows) == 8
    for row in rows[::3]:
        net = neuro.load("net.yaml", {"w": row["w"]})
        net.populations["exc"] = _with(net.populations["exc"], "model", V_th=row["exc.V_th"])
        synapses = _with(net.projections["exc_inh"], "synapse", lambda_=row["exc_inh.lambda"])
        net.projections["exc_inh"] = _with(synapses, "rule", n=row["exc_inh.n"])
        sim = neuro.compile(net, backend="reference", seed=row["seed"])
        sim.run(30.0)
        times, ids = sim.spikes("exc")
        assert row["rate.exc"] == times.size / 10 / 0.03
        assert row["spikes.inh"] == sim.counts().populations["inh"].spikes
        assert row["weight.exc_inh"] == sim.get("exc_inh", "weight").mean()
        assert row["weight_sd.exc_inh"] == sim.get("exc_inh", "weight").std()
        assert sim.get("exc_inh", "weight").size == 5 * row["exc_inh.n"]
        assert row["energy.loihi"] == sim.energy("loihi").total_j
        assert row["energy_real_time.loihi"] == sim.energy("loihi").real_time.total_j
        each = [np.diff(times[ids == k]) for k in range(10) if (ids == k).sum() >= 3]
        cv = float(np.mean([part.std() / part.mean() for part in each])) if each else float("nan")
        assert row["cv.exc"] == pytest.approx(cv, rel=1e-12, nan_ok=True)


def _with(part, field, **values):
    from dataclasses import replace

    return replace(part, **{field: replace(getattr(part, field), **values)})


def test_what_a_sweep_cannot_change_stays_as_it_is(folder):
    made = load_runs(folder / "sweep.yaml", folders.SWEEP)
    net, _ = made.run.at_point({"noise_exc.weight": 7.0, "noise_exc.delay": 2.0})
    assert (net.projections["noise_exc"].weight, net.projections["noise_exc"].delay) == (7.0, 2.0)
    same, _ = made.run.at_point({})
    assert same == neuro.load("net.yaml")


def test_status_and_table(folder, run, capsys):
    run("sweep", "run", "sweep.yaml", "--on", "here", "--share", "1/4")
    run("sweep", "status", "runs")
    assert capsys.readouterr().out.splitlines()[-1] == "sweep: 8 runs: 2 done, 0 failed, 0 under way, 6 left"
    run("sweep", "table", "runs")
    printed = capsys.readouterr().out
    assert printed == table_of("runs").csv()
    assert sum(",left," in line for line in printed.splitlines()) == 6
    run("sweep", "table", "runs", "--out", "t.csv", "--times")
    assert (folder / "t.csv").read_text().splitlines()[0].endswith(",seconds,attempts,error")


def test_backends_options_and_durations_are_parameters(swept):
    reference, event, loihi = swept(
        "network: net.yaml\nlist:\n"
        "  - {backend: reference, for: 20 ms}\n  - {backend: event, for: 20 ms}\n  - {backend: loihi, for: 20 ms}\n"
        "metrics: [spikes, neuron_updates]\n"
    ).rows()
    assert reference["spikes"] == event["spikes"] > 0
    assert {row["neuron_updates"] for row in (reference, event, loihi)} == {15 * 200}
    assert loihi["outcome"] == "done"


def test_figures_of_a_chip_are_parameters(swept):
    first, second = swept(
        "network: net.yaml\nbackend: loihi\nfor: 20 ms\nmetrics: [energy.loihi, synaptic_ops]\n"
        "parameters: {chip.costs.synaptic_op: [23.6e-12, 47.2e-12]}\n"
    ).rows()
    assert second["energy.loihi"] - first["energy.loihi"] == pytest.approx(23.6e-12 * first["synaptic_ops"], rel=1e-6)


def test_a_metric_of_a_file(folder, swept):
    (folder / "my_metric.py").write_text(
        "import neuro\n\n\n@neuro.register(kind='metric')\ndef last(sim):\n"
        "    times, _ = sim.spikes('exc')\n"
        "    return {'last_ms': times.max() if times.size else None, 'time': sim.time}\n"
    )
    text = "network: net.yaml\nfor: 50 ms\nbackend: reference\nseeds: 2\nmetrics: [last]\n"
    table = swept(text, "--workers", "1", "--with", "my_metric.py")
    assert table.column("time") == [50.0, 50.0]
    record = next(iter(table.outcomes().values())).provenance
    assert [name.rpartition("/")[2] for name in record["inputs"]] == ["net.yaml", "my_metric.py"]


def test_a_study_of_a_file(folder, swept):
    (folder / "my_study.py").write_text(
        "import neuro\n\n\n@neuro.register(kind='study')\ndef area(width, height=1):\n    return width * height\n"
    )
    text = "study: area\nset: {height: 2}\nparameters: {width: [1, 2]}\n"
    assert swept(text, "--on", "here", "--with", "my_study.py").column("value") == [2, 4]


def test_results_are_kept_where_that_is_asked_for(folder, swept):
    (key,) = swept("network: net.yaml\nfor: 20 ms\nbackend: reference\nseeds: [5]\nkeep: results\n").keys
    results = neuro.results.read(folder / "runs" / "runs" / key / "results.h5")
    assert (results.about["seed"], results.duration_ms) == (5, 20.0)


def test_a_file_that_was_edited_under_way_is_told(folder, run, capsys):
    made = load_runs(folder / "sweep.yaml", folders.SWEEP)
    (folder / "net.yaml").write_text(NET.replace("900", "901"))
    told = refused(made.run.check_inputs)
    assert told.startswith(f"{folder}/net.yaml: was edited since the sweep began: expected the unchanged file")
    run("sweep", "run", "sweep.yaml", "--on", "here", "--share", "1/8")
    (folder / "net.yaml").write_text(NET)
    run("sweep", "run", "sweep.yaml", "--on", "here", status=2)
    assert "runs: the folder of another sweep: network is" in capsys.readouterr().err


def test_a_point_that_the_network_refuses_fails_alone(swept):
    text = "network: net.yaml\nfor: 1 ms\nbackend: reference\nparameters: {exc.V_th: [-55.0, -90.0]}\n"
    good, bad = swept(text).rows()
    assert (good["outcome"], bad["outcome"]) == ("done", "failed")
    assert "V_th" in bad["error"]


MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))["sweep"]


def test_mistakes_are_told_and_nothing_is_written(folder, answer, messages):
    for text in MISTAKES:
        (folder / "sweep.yaml").write_text(f"{text}\n")
        messages({text: answer("sweep", "run", "sweep.yaml").err})
    assert not (folder / "runs").exists()
    (folder / "empty").mkdir()
    (folder / "empty" / "sweep.json").write_text("{}")
    for command in ("status", "table", "plot", "page"):
        for name in ("nothing", "empty"):
            messages({f"{command} {name}": answer("sweep", command, name).err})


def test_pictures_and_the_page(folder, run, capsys):
    (folder / "sweep.yaml").write_text(
        "network: net.yaml\nfor: 5 ms\nbackend: reference\nmetrics: [rate.exc, synaptic_ops]\nparameters:\n"
        "  {w: [1.0, 2.0, 4.0, 8.0, 16.0], exc.V_th: [-55.0, -54.0, -53.0, -52.0, -51.0]}\n"
    )
    run("sweep", "run", "sweep.yaml", "--on", "here", "--share", "1/2")
    run("sweep", "plot", "runs")
    run("sweep", "plot", "runs", "--metric", "synaptic_ops", "--kind", "lines", "--of", "w", "--format", "svg")
    run("sweep", "plot", "runs", "--metric", "synaptic_ops", "--kind", "parallel", "--out", "pictures")
    names = sorted(path.name for path in (folder / "runs").iterdir() if path.is_file())
    assert names == ["rate.exc-map.png", "sweep.json", "synaptic_ops-lines.svg", "synaptic_ops-map.png"]
    run("sweep", "plot", "runs", "--metric", "rat", status=2)
    assert "did you mean 'rate.exc'?" in capsys.readouterr().err
    run("sweep", "page", "runs")
    run("sweep", "run", "sweep.yaml", "--on", "here")
    page = (folder / "runs" / "sweep.html").read_text()
    assert page.count("<tr>") > 25
    for text in ("25 runs", "rate.exc (Hz)", "exc.V_th (mV)", '<meta name="provenance"'):
        assert text in page


def test_a_record_tells_all(folder, run):
    run("sweep", "run", "sweep.yaml", "--on", "here", "--share", "1/8")
    (outcome,) = table_of("runs").outcomes().values()
    record = outcome.provenance
    assert {"neuro", "commit", "versions", "backend", "threads", "seed", "network", "inputs", "command", "machine"} <= {
        *record
    }
    assert record["command"] == "neuro sweep run sweep.yaml --on here --share 1/8"
    assert json.loads((folder / "runs" / "sweep.json").read_text())["provenance"]["inputs"] == record["inputs"]
    assert folders.Folder(folder / "runs").outcome(outcome.key) == outcome
