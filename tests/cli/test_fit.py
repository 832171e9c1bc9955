import json

import pytest

FITS = """\
neuro: 1
name: fits
resolution: 0.5
populations:
  in: {model: spike_generator, shape: 4}
  out: {model: {iaf_psc_exp: {I_e: 100.0}}, shape: 3}
projections:
  in_out: {from: in, to: out, rule: all_to_all, weight: $w, delay: 1.0}
parameters: {w: 300.0}
"""

WRONG = """\
neuro: 1
name: wrong
resolution: 0.1
populations:
  in: {model: {poisson_generator: {rate: 1000.0}}, shape: 4}
  out: {model: {iaf_psc_exp: {V_reset: -60.0, tau_m: .inf}}, shape: 3}
projections:
  in_out: {from: in, to: out, rule: all_to_all, weight: 300.0, delay: 1.0, synapse: {stdp: {Wmax: 500.0, mu_plus: 0.0}}}
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    """Write a network as net.yaml of the current folder."""
    monkeypatch.chdir(tmp_path)

    def write(text):
        (tmp_path / "net.yaml").write_text(text)
        return "net.yaml"

    return write


def test_a_network_that_fits(neuro, file):
    answer = neuro("fit", file(FITS))
    assert (answer.status, answer.err) == (0, "")
    first, second, third, *rest = answer.out.split("\n\n")
    assert first == "network 'fits' in the integers of Intel Loihi 1"
    words = " ".join(line.split()[0] for line in second.splitlines())
    assert words == "population out tau_syn_ex V_th I_e t_ref"
    assert third.splitlines()[1].split()[:6] == ["in_out", "12", "8", "excitatory", "exponent", "3"]
    assert rest[0].startswith("notes\n  - the host sends")
    assert rest[1].startswith("'fits' on loihi: 1 core on 1 tile of 1 chip, order: connected")
    assert answer.out.endswith("\n\n'fits' fits on loihi\n")
    report = json.loads(neuro("fit", "net.yaml", "--json").out)
    assert list(report) == ["rounding", "placement", "problems"]
    assert report["rounding"]["projections"]["in_out"]["exponent"] == 3
    assert report["problems"] == []


@pytest.mark.filterwarnings("default")
def test_a_run_counts_the_approximations_that_fit_lists(neuro, file):
    run = ("run", file(OFTEN), "--for", "10", "--backend", "loihi")
    counted, verbose, fit = neuro(*run), neuro(*run, "--verbose"), neuro("fit", "net.yaml", "--chip", "loihi")
    listed = [line.removeprefix("approximated: ") for line in fit.out.splitlines() if line.startswith("approximated: ")]
    items = [line for line in fit.out.splitlines() if line.startswith("    - ")]
    assert items == [line for line in verbose.err.splitlines() if line.startswith("    - ")]
    priced = neuro("energy", "net.yaml", "--backend", "loihi", "--for", "10").err
    short = [f"{text} {len(items)}, listed by neuro fit" if text.endswith(":") else text for text in listed]
    assert [each for each in priced.splitlines() if "loihi" in each] == [
        f"warning: backend 'loihi': {s}" for s in short
    ]
    assert len(listed) == 2
    line = "backend 'loihi': 2 approximations of the network; --verbose or neuro fit net.yaml --chip loihi lists all"
    assert [each for each in counted.err.splitlines() if "loihi" in each] == [f"warning: {line}"]
    warned = [each for each in verbose.err.splitlines() if each.startswith("warning: ")]
    assert warned == [f"warning: backend 'loihi': {each}" for each in listed]
    assert counted.out == verbose.out


OFTEN = """\
neuro: 1
name: often
resolution: 1.0
populations:
  in: {model: {poisson_generator: {rate: 100.0}}, shape: 4}
  out: {model: iaf_psc_exp, shape: 4}
projections:
  static: {from: in, to: out, rule: one_to_one, weight: 10.0, delay: 1.0}
  learning: {from: in, to: out, rule: one_to_one, weight: 400.0, delay: 1.0, synapse: {stdp: {Wmax: 800.0}}}
"""


def end(answer):
    """What `fit` says of problems, and its verdict."""
    lines = answer.out.splitlines()
    first = next((k for k, line in enumerate(lines) if line.startswith(("refused", "approximated"))), len(lines) - 1)
    return "\n".join(lines[first:]) + answer.err


def test_problems_are_told_with_lines_and_ways_out(neuro, file, messages):
    answers = {
        "approximated": neuro("fit", file(FITS), "--set", "w=0.0001", "--chip", "spinnaker"),
        "refused": neuro("fit", file(WRONG), "--chip", "spinnaker"),
        "both": neuro("fit", file(WRONG)),
        "too large": neuro("fit", file(FITS.replace("shape: 3", "shape: 5").replace("shape: 4", "shape: 5000"))),
    }
    assert [answer.status for answer in answers.values()] == [0, 1, 1, 1]
    messages({name: end(answer) for name, answer in answers.items()})
    late = file(FITS.replace("delay: 1.0", "delay: 50.0"))
    for chip in ("loihi2", "loihi"):  # loihi2 has no refractory period, either
        messages({f"too late on {chip}": end(neuro("fit", late, "--chip", chip))})
    for chip in ("cpu", "gpu", "arm", "spinnaker2", "loihy"):
        answer = neuro("fit", file(FITS), "--chip", chip)
        assert (answer.status, answer.out) == (2, "")
        messages({chip: answer.err})


def test_a_chip_without_arithmetic(neuro, file):
    answer = neuro("fit", file(FITS), "--chip", "truenorth")
    assert answer.status == 0
    assert answer.out.startswith(
        "no rounding is reported, because the arithmetic of IBM TrueNorth is not known\n\n'fits' on "
    )


def test_json_of_a_network_that_does_not_fit(neuro, file):
    def no_constant(word):
        raise AssertionError(word)

    answer = neuro("fit", file(WRONG), "--chip", "spinnaker", "--json")
    found = json.loads(answer.out, parse_constant=no_constant)
    assert answer.status == 1
    assert found["rounding"]["populations"]["out"]["rounding"]["tau_m"]["wanted"] == "inf"
    assert [text.split(": ")[0] for text in found["problems"]] == ["refused", "refused"]


LONG = "like: loihi\nlimits:\n  delay_max: {value: 200, source: my board}\n"


def test_a_table_of_ones_own(neuro, file, tmp_path):
    name = file(FITS.replace("delay: 1.0", "delay: 50.0"))
    (tmp_path / "my.yaml").write_text(LONG)
    answer = neuro("fit", name, "--chip", "my.yaml")
    assert (answer.status, answer.err) == (0, "")
    assert answer.out.startswith("network 'fits' in the integers of Intel Loihi 1\n")
    assert answer.out.endswith("\n\n'fits' fits on my\n")
    ran = neuro("run", name, "--backend", "my.yaml", "--for", "100", "--out", "out.h5")
    assert ran.status == 0
    assert "\n100 ms simulated in " in ran.err
    assert neuro("check", name, "--backend", "my.yaml").out.startswith("net.yaml: ok on my.yaml: 7 neurons")
    compared = neuro("compare", name, "--backends", "event,my.yaml", "--for", "100", "--json")
    assert list(json.loads(compared.out)["backends"]) == ["event", "my.yaml"]
    priced = neuro("energy", name, "--backend", "my.yaml", "--chips", "my.yaml", "--for", "100", "--json")
    assert json.loads(priced.out)["bills"][0]["target"] == "my"
    (tmp_path / "my.yaml").write_text(LONG.replace("200", "99"))
    answer = neuro("fit", name, "--chip", "my.yaml")
    assert answer.status == 1
    assert "100 steps in the delay register, which holds at most 99 on my\n" in answer.out
    (tmp_path / "my.yaml").write_text(LONG.replace("200", "many"))
    answer = neuro("fit", name, "--chip", "my.yaml")
    expected = "error: my.yaml:3:22: delay_max: value: found 'many': expected a number >= 0\n"
    assert answer == (2, "", expected)
