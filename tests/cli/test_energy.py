import json
from functools import partial
from pathlib import Path

import pytest
import yaml

import neuro as framework
import neuro_models
from neuro.chips import chip, price
from neuro.cli.chips import energy
from neuro.cli.run import run as simulate

RUN = ("net.yaml", "--backend", "reference", "--for", "50")


@pytest.fixture
def run(alone):
    """Run `energy` alone with some words; return exit status, output and error."""
    return partial(alone, energy)


@pytest.fixture
def bill(network):
    sim = framework.compile(framework.load(network), backend="reference", seed=0)
    sim.run(50.0)

    def of(name):
        return price(sim.program, sim._engine.counts(), None, chip(name))

    return of


def test_one_bill(run, bill):
    status, out, err = run(*RUN, "--chips", "spinnaker2")
    assert (status, err) == (0, "")
    assert out == f"{bill('spinnaker2')}\n\n"


def test_sources_if_asked_for(run, bill):
    plain, asked = (run(*RUN, "--chips", "loihi", *words)[1] for words in ((), ("--sources",)))
    assert "Davies" not in plain
    assert "[1] Davies et al., IEEE Micro 38(1):82, 2018, Table 2 (" in asked
    assert "- chip time: learning_update 6.1 ns: Davies et al." in asked
    for text in (asked, plain):
        words = [line.split()[0] for line in text.splitlines() if line]
        assert words.index("total") == words.index("dynamic") + 2 < words.index("-")
        assert set(words[words.index("-") :]) == {"-"}


def test_several_bills_and_a_row_of_each(run, bill):
    status, out, _ = run(*RUN, "--chips", "spinnaker2,cpu")
    assert status == 0
    bills = f"{bill('spinnaker2')}\n\n{bill('cpu')}\n\n"
    assert out.startswith(bills)
    rows = [line.split() for line in out.removeprefix(bills).splitlines() if line.strip()]
    assert rows[0] == ["energy", "per", "run"]
    assert " ".join(rows[1]) == "chip dynamic as fast as the chip can in real time chip time chips"
    assert rows[3] == ["spinnaker2", *" ".join(bill("spinnaker2").cells()).split()]
    assert " ".join(rows[3]).endswith("late 500 ms of 50 ms 1")  # 500 steps of 0.1 ms, each a tick
    assert rows[4][:4] == ["cpu", *bill("cpu").cells()[0].split(), *bill("cpu").cells()[1].split()[:1]]


def test_the_time_of_a_step_and_the_chips_that_are_on(run, bill):
    """Static energy is that of all of a board for as long as steps take there."""
    words = ("--chips", "spinnaker", "--step-time", "2", "--chips-on", "48", "--json")
    told = json.loads(run(*RUN, *words)[1])["bills"][0]
    assert (told["chip_time_s"], told["chips"]) == (pytest.approx(500 * 2e-3), 48)
    assert told["static_j"] == pytest.approx(48 * 500 * 2e-3 * 0.36)
    assert told["static_high_j"] == pytest.approx(48 * 500 * 2e-3 * 1.0)
    assert "the network uses 1 chip, 48 are on, as given" in told["notes"]
    assert "chip time: a step of 0.1 ms takes 2 ms on the chip, as given" in told["notes"]
    told = run(*RUN, "--chips", "spinnaker,cpu", "--step-time", "2")[1].splitlines()
    heads = [" ".join(line.split()) for line in told if "in real time" in line]
    clocks = "at the given steps in real time"
    assert heads == [clocks, clocks, f"chip dynamic {clocks} chip time chips"]


def test_json(run, bill, network):
    words = ("--chips", "spinnaker2,gpu", "--per", "3", "recording", "--json", "--seed", "0")
    status, out, _ = run(*RUN, *words)
    assert status == 0
    told = json.loads(out)
    assert (told["network"], told["backend"], told["seed"], told["ms"]) == ("small", "reference", 0, 50.0)
    assert told["bills"] == [bill(name).per(3, "recording").as_dict() for name in ("spinnaker2", "gpu")]
    metrics = told["neurobench"]
    assert (metrics["samples"], metrics["steps_per_sample"]) == (3, 166)
    assert metrics["energy_j"]["model"] == "spinnaker2"
    assert metrics["energy_j"]["total"] == pytest.approx(told["bills"][0]["total_j"], rel=1e-12)


def test_parameters_and_seed_are_used(run, network):
    few, many, other = (
        json.loads(run(*RUN, "--chips", "truenorth", "--json", *words)[1])["bills"][0]["dynamic_j"]
        for words in (("--set", "rate=10"), ("--set", "rate=1000"), ("--set", "rate=1000", "--seed", "1"))
    )
    assert few < many != other


def test_a_table_of_the_user(run, network, tmp_path):
    (tmp_path / "half.yaml").write_text("like: truenorth\ncosts: {synaptic_op: {value: 13.0e-12, source: me}}\n")
    status, out, _ = run(*RUN, "--chips", "half.yaml", "--sources")
    assert status == 0
    assert out.startswith("IBM TrueNorth (half), energy per run: ")
    assert "] me\n" in out


@pytest.mark.parametrize("target", ["loihi", "spinnaker"])
def test_chips_with_places(run, network, target):
    status, out, err = run(*RUN, "--chips", target)
    assert (status, err) == (0, "")
    assert f"{chip(target).title} ({target}), energy per run: 1 chip, 500 steps, " in out
    assert "static_per_chip" in out


def test_an_interrupted_run_prices_nothing(run, network, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("neuro.core.progress.advance", interrupted)
    assert run(*RUN, "--chips", "cpu") == (130, "", "interrupted: nothing is priced\n")


MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))["energy"]


def test_mistakes_are_told_before_the_run(run, network, monkeypatch, messages):
    monkeypatch.setattr("neuro.compile", None)
    answers = {words: run(*RUN, *words.split()) for words in MISTAKES}
    assert {answer[:2] for answer in answers.values()} == {(2, "")}
    messages({words: err for words, (_, _, err) in answers.items()})


def test_silent_input_is_told(run, network):
    text = Path(network).read_text()
    Path(network).write_text(text.replace("rate: 100.0}", "rate: 0.0}"))
    for command, words in ((energy, ("--chips", "loihi")), (simulate, ())):
        status, _, err = run.func(command, *RUN, *words)
        assert status == 0
        assert err.startswith(
            "warning: no input emitted a spike (noise): all figures are those of a network without input\n"
            "  hint: set spikes or rates of the generators, or inject spikes from a program\n"
        )


def test_a_training_costs_what_its_blocks_do(alone, tmp_path, monkeypatch):
    """The bill of a training to a return is that of the counts of all blocks, however they are cut."""
    monkeypatch.chdir(tmp_path)
    framework.load(neuro_models.path("cartpole"), {"critics": 5}).save("pole.yaml")
    Path("pole.yaml").write_text(Path("pole.yaml").read_text() + "  block: 300\n")
    status, out, err = alone(energy, "pole.yaml", "--until", "500", "--steps", "1000", "--chips", "cpu", "--json")
    assert status == 0, err
    [priced] = json.loads(out)["bills"]
    # 400 control steps are at random, then there are two blocks of 300; the network also runs where an episode begins.
    assert 600 < priced["steps"] / 20.0 <= 600 + int(err.split(" episodes")[0].split()[-1])


def test_until_needs_a_world(run, network):
    status, _, err = run(*RUN, "--until", "5")
    assert (status, err) == (2, "error: --until: has no effect without a network with a world\n")
