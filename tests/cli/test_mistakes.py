"""Every mistake on the command line: exit status 2 and this text on stderr, nothing on stdout."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

RUN = "\n  hint: see 'neuro run --help'"

RUN_MISTAKES = {
    "--for abc": "Invalid value for '--for': 'abc': expected a time > 0 ms" + RUN,
    "--for -5": "Invalid value for '--for': '-5': expected a time > 0 ms" + RUN,
    "--for 0": "Invalid value for '--for': '0': expected a time > 0 ms" + RUN,
    "--for nan": "Invalid value for '--for': 'nan': expected a time > 0 ms" + RUN,
    "--for inf": "Invalid value for '--for': 'inf': expected a time > 0 ms" + RUN,
    "--for 0.05": "--for = 0.05 ms: expected a multiple of the resolution, 0.1 ms\n  hint: the nearest is 0.1 ms",
    "--seed x": "Invalid value for '--seed': 'x': expected a whole number >= 0" + RUN,
    "--seed -1": "Invalid value for '--seed': '-1': expected a whole number >= 0" + RUN,
    "--threads 0": "Invalid value for '--threads': '0': expected a whole number >= 1" + RUN,
    "--threads 20000": f"threads = 20000: expected a whole number >= 1 and <= {max(64, os.cpu_count())}",
    "--threads 1.5": "Invalid value for '--threads': '1.5': expected a whole number >= 1" + RUN,
    "--backend evnt": "unknown backend 'evnt'\n  hint: did you mean 'event'?",
    "--set w": "Invalid value for '--set': 'w': expected NAME=VALUE" + RUN,
    "--set =3": "Invalid value for '--set': '=3': expected NAME=VALUE" + RUN,
    "--set w=[": "Invalid value for '--set': 'w=[': its value is not YAML" + RUN,
    "--set v=3": "net.yaml: unknown parameter 'v'\n  hint: known: rate, w",
    "--record ex": "--record: unknown population 'ex'\n  hint: did you mean 'exc'?",
    "--record current": "--record: 'current' is a dc_generator, which has no spikes",
    "--out nowhere/out.h5": "nowhere/out.h5: cannot be written: No such file or directory",
    "--out .": ".: is a folder, expected the name of a file",
}


@pytest.mark.parametrize("words", RUN_MISTAKES)
def test_run(neuro, network, words):
    answer = neuro("run", network, *words.split())
    assert (answer.status, answer.out, answer.err) == (2, "", f"error: {RUN_MISTAKES[words]}\n")
    assert os.listdir() == ["net.yaml"]


OTHERS = {
    "rnu": "unknown command 'rnu'\n  hint: did you mean 'run'?",
    "simulate net.yaml": "unknown command 'simulate'\n  hint: did you mean 'run'?",
    "run": "Missing argument 'FILE'\n  hint: see 'neuro run --help'",
    "run nope.yaml": "nope.yaml: no such file\n  hint: did you mean 'net.yaml'?",
    "run microcirciut": (
        "Invalid value for 'FILE': 'microcirciut': no such file, and no published network of that name: "
        "did you mean 'microcircuit'?\n  hint: see 'neuro run --help'"
    ),
    "run nope": "nope: no such file\n  hint: known: net.yaml",
    "check nope.yaml": "nope.yaml: no such file\n  hint: did you mean 'net.yaml'?",
    "check net.yaml --backend refrence": "unknown backend 'refrence'\n  hint: did you mean 'reference'?",
    "plot nope.h5": "nope.h5: no such file",
    "plot .": ".: is a folder: expected a file",
    "run .": ".: found a folder: expected a YAML file",
    "fit net.yaml --chip foo": "unknown chip 'foo'\n  hint: known: loihi, loihi2, spinnaker, truenorth",
    "compare net.yaml --html net.yaml": "net.yaml: exists and is not a page of 'neuro compare': expected a new name",
    "compare net.yaml --out net.yaml": "net.yaml: exists and is not a comparison as JSON: expected a new name",
    "plot net.yaml": "net.yaml: not a file of results, as 'neuro run' writes it",
    "verify nope": "nope: no such folder: expected one with cases NAME.json and NAME.npz",
    "verify .": ".: no case in it: expected files NAME.json and NAME.npz",
    "verify . --backend evnt": "unknown backend 'evnt'\n  hint: did you mean 'event'?",
    "models stpd": "unknown model 'stpd'\n  hint: did you mean 'stdp'?",
}


@pytest.mark.parametrize("words", OTHERS)
def test_others(neuro, network, words):
    answer = neuro(*words.split())
    assert (answer.status, answer.out, answer.err) == (2, "", f"error: {OTHERS[words]}\n")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("plot o.h5 --format gif", "error: '--format': found 'gif': expected one of 'png', 'pdf', 'svg'\n"),
        ("check a.yaml b.yaml", "error: found 'b.yaml', too: expected neuro check FILE [OPTIONS]\n"),
        ("report o.h5 p.h5 q.h5", "error: found 'p.h5 q.h5', too: expected neuro report FILE [OPTIONS]\n"),
    ],
)
def test_what_is_expected(neuro, line, expected):
    answer = neuro(*line.split())
    assert (answer.status, answer.err.startswith(expected)) == (2, True), answer.err


@pytest.mark.parametrize("command", ["energy", "run", "check"])
def test_results_in_place_of_a_network(neuro, tmp_path, command):
    file = tmp_path / "o.h5"
    file.write_bytes(b"\x89HDF\r\n\x1a\n")
    assert neuro(command, file).err == (
        f"error: {file}:1:1: found the byte 0x89: expected UTF-8 text\n"
        "  hint: an HDF5 file, as results are: neuro report FILE tells what these hold, and their bill\n"
    )


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


def test_unknown_option(neuro, network):
    answer = neuro("run", network, "--fro", "3")
    assert (answer.status, answer.out) == (2, "")
    assert answer.err == "error: unknown option '--fro'\n  hint: did you mean '--for'?\n"


@pytest.mark.parametrize("group", ["recognise", "drone"])
def test_a_group_of_commands_alone_prints_its_help(neuro, group):
    status, out, err = neuro(group)
    assert f"Usage: neuro {group} [OPTIONS] COMMAND" in out + err
    assert (status, "error:" in err) == (2, False)


def test_bugs_are_not_hidden(neuro, network, monkeypatch):
    monkeypatch.setattr("neuro.model.language.load", lambda *a, **k: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        neuro("run", network)


def test_results_do_not_replace_the_network(neuro, network):
    before = Path(network).read_bytes()
    answer = neuro("run", network, "--for", "1", "--out", network)
    expected = "net.yaml: exists and is not a file of results: expected a new name"
    assert (answer.status, answer.err) == (2, f"error: {expected}\n")
    assert Path(network).read_bytes() == before


@pytest.mark.filterwarnings("default")
def test_a_warning_is_a_line(neuro, network):
    Path("fast.yaml").write_text(
        "neuro: 1\nname: fast\nresolution: 1.0\n"
        "populations:\n  in: {model: {poisson_generator: {rate: 100.0}}, shape: 4}\n"
        "  out: {model: iaf_psc_exp, shape: 4}\n"
        "projections:\n  w: {from: in, to: out, rule: one_to_one, weight: 10.0, delay: 1.0}\n"
    )
    answer = neuro("run", "fast.yaml", "--for", "10", "--backend", "loihi")
    assert answer.status == 0
    assert answer.err.startswith("warning: backend 'loihi': fast.yaml:5:3: population 'in': poisson_generator: 4.8% of")
    assert ".py" not in answer.err


@pytest.mark.parametrize("words", ["show net.yaml", "events formats"])
def test_a_full_disk_behind_standard_output(network, words):
    """Devices are opened by the shell, so nothing of ours can replace them."""
    code = "from neuro.cli import main; main()"
    command = [sys.executable, "-c", code, *words.split()]
    with open("/dev/full", "w") as full:
        told = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert (told.returncode, told.stderr) == (2, "error: standard output: cannot be written: No space left on device\n")
