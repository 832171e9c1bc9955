"""Every mistake on the command line: exit status 2 and this text on stderr, nothing on stdout."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))["all"]


def test_mistakes(neuro, network, messages):
    before, said = Path(network).read_bytes(), {}
    for words in MISTAKES:
        status, out, said[words] = neuro(*words.split())
        assert (status, out, os.listdir(), Path(network).read_bytes()) == (2, "", ["net.yaml"], before), words
    messages(said)
    most = max(64, os.cpu_count())
    told = f"error: threads = 20000: expected a whole number >= 1 and <= {most}\n"
    assert neuro("run", network, "--threads", 20000).err == told


def test_results_in_place_of_a_network(neuro, tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)
    Path("o.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    messages({command: neuro(command, "o.h5").err for command in ("energy", "run", "check")})


def test_a_mistake_in_the_network(neuro, network):
    text = Path(network).read_text().replace("iaf_psc_exp,", "iaf_psc_ex,")
    Path(network).write_text(text)
    for command in ("run", "check", "show"):
        answer = neuro(command, network)
        assert (answer.status, answer.out) == (2, "")
        assert answer.err.startswith("error: net.yaml:8:16: ")
        assert answer.err.endswith("hint: did you mean 'iaf_psc_exp'?\n")


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is unwritable to root")
def test_unwritable(neuro, network, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    answer = neuro("run", network, "--out", "locked/out.h5")
    assert (answer.status, answer.err) == (2, "error: locked/out.h5: cannot be written: Permission denied\n")


@pytest.mark.parametrize("group", ["recognise", "drone"])
def test_a_group_of_commands_alone_prints_its_help(neuro, group):
    status, out, err = neuro(group)
    assert f"Usage: neuro {group} [OPTIONS] COMMAND" in out + err
    assert (status, "error:" in err) == (2, False)


def test_bugs_are_not_hidden(neuro, network, monkeypatch):
    monkeypatch.setattr("neuro.model.language.load", lambda *a, **k: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        neuro("run", network)


@pytest.mark.filterwarnings("default")
def test_a_warning_is_a_line(neuro, network):
    Path("fast.yaml").write_text(
        "neuro: 1\nname: fast\nresolution: 1.0\n"
        "populations:\n  in: {model: {poisson_generator: {rate: 100.0}}, shape: 4}\n"
        "  out: {model: iaf_psc_exp, shape: 4}\n"
        "projections:\n  w: {from: in, to: out, rule: one_to_one, weight: 10.0, delay: 1.0}\n"
    )
    answer = neuro("run", "fast.yaml", "--for", "10", "--backend", "loihi", "--verbose")
    assert answer.status == 0
    assert answer.err.startswith("warning: backend 'loihi': fast.yaml:5:3: population 'in': poisson_generator: 4.8% of")
    assert ".py" not in answer.err


def test_a_full_disk_behind_standard_output(network):
    """Devices are opened by the shell, so nothing of ours can replace them."""
    command = [sys.executable, "-c", "from neuro.cli import main; main()", "show", network]
    with open("/dev/full", "w") as full:
        told = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert (told.returncode, told.stderr) == (2, "error: standard output: cannot be written: No space left on device\n")
