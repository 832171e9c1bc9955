import json
import re
from functools import partial
from pathlib import Path

import pytest
import yaml

import neuro as framework
from neuro.cli.compare import compare
from neuro.core.extras import install

NETWORK = """\
neuro: 1
name: small
resolution: 1.0
parameters: {w: 300.0}
populations:
  noise: {model: {poisson_generator: {rate: 100.0}}, shape: 20}
  exc: {model: iaf_psc_exp, shape: [2, 4]}
projections:
  noise_exc: {from: noise, to: exc, rule: all_to_all, weight: $w, delay: 1.0}
"""
RUN = ("net.yaml", "--for", "50")
FLOATS = (*RUN, "--backends", "event,reference")


@pytest.fixture
def run(alone, monkeypatch, tmp_path):
    """Run `compare` alone with some words; return exit status, output and error."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.yaml").write_text(NETWORK)
    return partial(alone, compare)


def cells(out):
    """Rows of a table as lists of cells."""
    return [re.split(r"  +", line.strip()) for line in out.splitlines() if line.strip()]


def test_tables(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    status, out, err = run(*RUN, "--backends", "event, reference ,loihi,spinnaker", "--seed", "3")
    assert (status, err) == (0, "")
    rows = cells(out)
    assert rows[0] == ["small: 50 ms, seed 3, compared with event"]
    names = "backend, spikes, synaptic ops, active updates, learning, distance, first difference"
    assert rows[1] == names.split(", ")
    assert [row[0] for row in rows[3:7]] == ["event", "reference", "loihi", "spinnaker"]
    assert rows[4][1:5] == rows[3][1:5]
    assert rows[4][-1] == "none"
    for heading in (
        "population, backend, neurons, spikes, rate Hz, first difference, distance",
        "projection, backend, largest, rms, relative rms, by rounding",
        "chip, counts of, dynamic, as fast as the chip can, in real time, chip time, chips",
    ):
        assert heading.split(", ") in rows
    dense = [row for row in rows if row[0] in ("cpu", "gpu")]
    assert [row[:2] for row in dense] == [["cpu", "event"], ["gpu", "event"]]
    assert [row[3:] for row in dense] == [[row[3], row[3], "-", "-"] for row in dense]
    assert all(row[3].startswith("> ") for row in dense)  # static energy is not priced


def test_json_goes_out_and_to_a_file(run, tmp_path):
    status, out, err = run(*FLOATS, "--json", "--out", "found.json", "--seed", "2", "--set", "w=500")
    assert (status, err) == (0, "")
    told = json.loads(out)
    kept = json.loads((tmp_path / "found.json").read_text("utf-8"))
    assert len(kept.pop("digest")) == 32
    assert kept.pop("provenance")["backend"] == "event, reference"
    assert told == kept
    expected = framework.compile(framework.load("net.yaml", params={"w": 500.0}), seed=2)
    expected.run(50.0)
    assert told["backends"]["event"]["counts"]["spikes"] == expected.counts().spikes
    assert told["backends"]["reference"]["populations"]["exc"]["same"] is True


def test_the_page_is_written_whole(run, tmp_path):
    status, out, _ = run(*RUN, "--backends", "event,loihi", "--html", "page.html")
    assert status == 0
    assert out.splitlines()[-1] == "page.html: written"
    assert (tmp_path / "page.html").read_text("utf-8").endswith("</html>\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["net.yaml", "page.html"]


REFUSED = NETWORK.replace("iaf_psc_exp", "izhikevich").replace("300.0", "5.0")


def test_a_refusal_is_a_row(run, tmp_path):
    (tmp_path / "net.yaml").write_text(REFUSED)
    status, out, err = run(*RUN, "--backends", "event,reference,spinnaker")
    assert (status, err) == (0, "")
    told = " ".join(out.split())
    assert "spinnaker - - - - - refused: net.yaml:7:3:" in told
    assert "refused: backend 'spinnaker' cannot run this network (1 problem) net.yaml:7:3: population 'exc': " in told


def test_too_few_backends_run(run, tmp_path):
    (tmp_path / "net.yaml").write_text(REFUSED)
    status, out, err = run(*RUN, "--html", "page.html", "--out", "found.json")
    assert (status, out) == (2, "")
    assert err.startswith("error: only 1 of the 3 backends runs this network: nothing to compare\nbackend 'loihi' ")
    assert [path.name for path in tmp_path.iterdir()] == ["net.yaml"]


def test_what_is_approximated_and_missing_is_told(run, tmp_path, monkeypatch):
    monkeypatch.setattr("neuro.compare.differences._library", lambda: None)
    (tmp_path / "net.yaml").write_text(NETWORK.replace("100.0", "400.0"))
    status, out, err = run(*RUN, "--backends", "event,loihi")
    assert (status, err) == (0, "")
    told = " ".join(out.split())
    assert "input of loihi: the same, several spikes in a step as one as on event" in told
    assert "warning: backend 'loihi': net.yaml:6:3: population 'noise': poisson_generator: " in told
    assert f"note: spike-train distances are left out: {install('compare')} installs the library for them" in told


def test_an_interrupted_comparison_leaves_nothing(run, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("neuro.core.progress.advance", interrupted)
    assert run(*FLOATS, "--html", "page.html") == (130, "", "interrupted: nothing is compared\n")
    assert [path.name for path in tmp_path.iterdir()] == ["net.yaml"]


MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))["compare"]


def test_mistakes_are_told_before_the_run(run, monkeypatch, tmp_path, messages):
    (tmp_path / "net.yaml").write_text(NETWORK.replace("all_to_all", "one_to_one"))
    net = run(*RUN)  # told once, as it is no refusal of a backend
    (tmp_path / "net.yaml").write_text(NETWORK)
    monkeypatch.setattr("neuro.compare.runs.compile", None)
    answers = {words: run(*RUN, *words.split()) for words in MISTAKES} | {"net": net}
    assert {answer[:2] for answer in answers.values()} == {(2, "")}
    messages({words: err for words, (_, _, err) in answers.items()})
