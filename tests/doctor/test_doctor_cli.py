"""`neuro doctor`: its text, its JSON, its page and its exit status."""

import json
from pathlib import Path

from typer.testing import CliRunner

from neuro.cli.commands import app
from neuro.core.errors import ModelError

EXAMPLE = Path(__file__).parents[2] / "neuro" / "cli" / "examples" / "net.yaml"


def run(*words: str):
    return CliRunner().invoke(app, ["doctor", *words])


def test_a_network_without_fault_ends_well():
    found = run(str(EXAMPLE))
    assert found.exit_code == 0
    assert "warning neurons-alike" in found.stdout
    assert found.stdout.endswith("It ran 1000 ms on event, seed 0.\npair: 1 warning\n")


def test_a_fault_has_place_evidence_and_remedy():
    found = run(str(EXAMPLE), "--set", "w=30", "--for", "500", "--seed", "2")
    assert found.exit_code == 1
    assert f"fault silent: {EXAMPLE}:7:3: population 'exc'" in found.stdout
    assert "0 of 10 neurons fired in 500 ms, so nothing reaches 'inh'; the largest V_m was" in found.stdout
    assert "rheobase is 375 pA" in found.stdout
    assert "remedy: raise `weight` of 'noise_exc' to about" in found.stdout


def test_a_network_that_does_not_work_ends_with_an_error(tmp_path):
    file = tmp_path / "net.yaml"
    text = (
        "neuro: 1\npopulations:\n  noise: {model: {poisson_generator: {rate: 20.0}}, shape: 50}\n"
        "  cells: {model: iaf_psc_exp, shape: 10}\nprojections:\n"
        "  noise_cells: {from: noise, to: cells, rule: {fixed_indegree: {n: 30}}, weight: WEIGHT}\n"
        "probes: {v: {of: cells, record: V_m, every: 1.0}}\n"
    )
    # A probe of V_m is no excuse for noise that fires nothing; few spikes are enough.
    for weight, status in ((500.0, 0), (90.0, 1), (275.0, 0)):
        file.write_text(text.replace("WEIGHT", str(weight)))
        assert run(str(file)).exit_code == status


def test_wrong_words_are_refused():
    for words in (("--drive", "20 mV"), ("--drive", "-1"), ("--for", "0")):
        assert run(str(EXAMPLE), *words).exit_code == 2
    for words in (("nosuch.yaml",), (str(EXAMPLE), "--chip", "lohi")):
        assert isinstance(run(*words).exception, ModelError)


def test_json_and_a_page_that_can_be_made_again(tmp_path, monkeypatch, answer):
    monkeypatch.chdir(tmp_path)
    Path("net.yaml").write_bytes(EXAMPLE.read_bytes())
    status, out, _ = answer("doctor", "net.yaml", "--set", "w=30", "--for", "100", "--json", "--html", "page.html")
    told = json.loads(out)
    assert (status, told["faults"], [each["name"] for each in told["findings"]]) == (1, 1, ["silent"])
    page = Path("page.html").read_text("utf-8")
    assert "rheobase" in page
    assert "<canvas" in page
    assert answer("rerun", "page.html").out == "page.html: the same bits\n"


def test_all_mistakes_of_a_file_are_faults(tmp_path):
    file = tmp_path / "wrong.yaml"
    text = EXAMPLE.read_text("utf-8")
    file.write_text(text.replace("iaf_psc_exp", "iaf_psc_ex", 1).replace("fixed_indegree", "fixed_indegre"), "utf-8")
    found = run(str(file))
    assert found.exit_code == 1
    assert found.stdout.count("fault mistake") == 2
    assert "Nothing ran" in found.stdout


def test_many_findings_of_a_kind_are_folded(tmp_path):
    populations = "\n".join(f"  p{k}: {{model: {{iaf_psc_exp: {{E_L: -50.0}}}}, shape: 2}}" for k in range(9))
    file = tmp_path / "many.yaml"
    file.write_text(f"neuro: 1\nname: many\npopulations:\n{populations}\n", "utf-8")
    found = run(str(file), "--for", "5")
    assert found.stdout.count("warning fires-by-itself") == 4
    assert (
        "the same for population 'p4', population 'p5', population 'p6', population 'p7', ... (5 more)" in found.stdout
    )


def test_inputs_may_be_driven(tmp_path):
    text = (Path(__file__).parents[2] / "examples" / "follower.yaml").read_text()
    follower = tmp_path / "follower.yaml"
    follower.write_text(text[: text.index("world:")])
    assert "no-input" in run(str(follower), "--for", "100").stdout
    driven = run(str(follower), "--for", "100", "--drive", "0.02 kHz").stdout
    assert "no-input" not in driven
    assert "cells driven at 20 Hz" in driven
