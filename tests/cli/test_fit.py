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
  in_out: {from: in, to: out, rule: all_to_all, weight: 300.0, delay: 1.0, synapse: {stdp: {Wmax: 500.0}}}
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
    assert [line.split()[0] for line in second.splitlines()] == [
        "population",
        "out",
        "tau_syn_ex",
        "V_th",
        "I_e",
        "t_ref",
    ]
    assert third.splitlines()[1].split()[:6] == ["in_out", "12", "8", "excitatory", "exponent", "3"]
    assert rest[0].startswith("notes\n  - the host sends")
    assert rest[1].startswith("'fits' on loihi: 1 core on 1 tile of 1 chip, order: connected")
    assert answer.out.endswith("\n\n'fits' fits on loihi\n")


def test_parameters_are_set(neuro, file):
    answer = neuro("fit", file(FITS), "--set", "w=0.0001", "--chip", "spinnaker")
    assert answer.status == 0
    assert answer.out.endswith(
        "approximated: net.yaml:8:3: projection 'in_out': 100.0% of the weights other than 0 become 0\n"
        "  hint: raise the small weights, or lower the largest one, which sets the scale\n\n"
        "approximated: net.yaml:8:3: projection 'in_out': 100.0% is the rms error of the weights\n"
        "  hint: raise the small weights, or lower the largest one, which sets the scale\n\n"
        "'fits' fits on spinnaker: 2 approximated\n"
    )


def test_a_network_that_does_not_fit_is_told_with_lines_and_ways_out(neuro, file):
    answer = neuro("fit", file(WRONG), "--chip", "spinnaker")
    assert (answer.status, answer.err) == (1, "")
    assert answer.out.endswith(
        "refused: net.yaml:6:3: population 'out': tau_m = inf: the membrane resistance tau_m / C_m would be infinite\n"
        "  hint: use a finite tau_m, or iaf_psc_delta\n\n"
        "refused: net.yaml:8:3: projection 'in_out': stdp: pairwise learning is not emulated on spinnaker\n"
        "  hint: run it on loihi or event, or send static weights: sim.network() has what was learnt\n\n"
        "'wrong' does not fit on spinnaker: 2 refused\n"
    )


def test_refusals_are_told_before_approximations_and_once(neuro, file):
    answer = neuro("fit", file(WRONG))
    kinds = [line.split(":")[0] for line in answer.out.splitlines() if line.startswith(("refused", "approximated"))]
    assert kinds == ["refused", "approximated"]
    assert answer.out.count("V_reset = -60 mV") == 1
    assert answer.out.endswith("'wrong' does not fit on loihi: 1 refused, 1 approximated\n")


def test_too_large_a_network_is_told_once(neuro, file):
    text = FITS.replace("shape: 3", "shape: 5").replace("shape: 4", "shape: 5000")
    answer = neuro("fit", file(text))
    assert answer.status == 1
    refusals = [line for line in answer.out.splitlines() if line.startswith("refused: ")]
    assert len(refusals) == 1
    assert answer.out.count(refusals[0].split(": ", 2)[2]) == 1
    assert answer.out.endswith("'fits' does not fit on loihi: 1 refused\n")


def test_a_chip_without_arithmetic(neuro, file):
    answer = neuro("fit", file(FITS), "--chip", "truenorth")
    assert answer.status == 0
    assert answer.out.startswith(
        "the arithmetic of IBM TrueNorth is not known here: its rounding is not reported\n\n'fits' on "
    )


def test_a_delay_that_is_too_long_is_told_once(neuro, file):
    text = FITS.replace("delay: 1.0", "delay: 50.0")
    for chip, most, refused in (("loihi2", 63, 2), ("loihi", 62, 1)):  # loihi2 has no refractory period, either
        answer = neuro("fit", file(text), "--chip", chip)
        assert answer.status == 1
        told = f"100 steps in the delay register, which holds at most {most} on {chip}"
        assert answer.out.count(told) == 1
        assert answer.out.endswith(f"'fits' does not fit on {chip}: {refused} refused\n")


@pytest.mark.parametrize("target", ["cpu", "gpu", "arm", "spinnaker2"])
def test_a_target_without_cores_or_limits(neuro, file, target):
    answer = neuro("fit", file(FITS), "--chip", target)
    assert (answer.status, answer.out) == (2, "")
    assert answer.err == (
        f"error: chip '{target}' has no cores or limits to fit\n"
        "  hint: expected one of loihi, loihi2, spinnaker, truenorth, or a table with limits\n"
    )


def test_json(neuro, file):
    answer = neuro("fit", file(FITS), "--json")
    found = json.loads(answer.out)
    assert list(found) == ["rounding", "placement", "problems"]
    assert found["rounding"]["projections"]["in_out"]["exponent"] == 3
    assert found["problems"] == []
    assert answer.status == 0


def test_json_of_a_network_that_does_not_fit(neuro, file):
    def no_constant(word):
        raise AssertionError(word)

    answer = neuro("fit", file(WRONG), "--chip", "spinnaker", "--json")
    found = json.loads(answer.out, parse_constant=no_constant)
    assert answer.status == 1
    assert found["rounding"]["populations"]["out"]["rounding"]["tau_m"]["wanted"] == "inf"
    assert [text.split(": ")[0] for text in found["problems"]] == ["refused", "refused"]


def test_an_unknown_chip(neuro, file):
    answer = neuro("fit", file(FITS), "--chip", "loihy")
    assert answer.status != 0
    assert "unknown chip 'loihy'" in answer.err
    assert "did you mean 'loihi'" in answer.err


LONG = "like: loihi\nlimits:\n  delay_max: {value: 200, source: my board}\n"


def test_a_table_of_ones_own(neuro, file, tmp_path):
    text = FITS.replace("delay: 1.0", "delay: 50.0")
    (tmp_path / "my.yaml").write_text(LONG)
    answer = neuro("fit", file(text), "--chip", "my.yaml")
    assert (answer.status, answer.err) == (0, "")
    assert answer.out.startswith("network 'fits' in the integers of Intel Loihi 1\n")
    assert answer.out.endswith("\n\n'fits' fits on my\n")
    (tmp_path / "my.yaml").write_text(LONG.replace("200", "99"))
    answer = neuro("fit", file(text), "--chip", "my.yaml")
    assert answer.status == 1
    assert "100 steps in the delay register, which holds at most 99 on my\n" in answer.out


def test_a_mistake_in_a_table_of_ones_own(neuro, file, tmp_path):
    (tmp_path / "my.yaml").write_text(LONG.replace("200", "many"))
    answer = neuro("fit", file(FITS), "--chip", "my.yaml")
    assert (answer.status, answer.out) == (2, "")
    assert answer.err == "error: my.yaml:3:22: delay_max: value: found 'many': expected a number >= 0\n"


def test_the_commands_run_on_a_table(neuro, file, tmp_path):
    text = FITS.replace("delay: 1.0", "delay: 50.0")
    (tmp_path / "my.yaml").write_text(LONG)
    ran = neuro("run", file(text), "--backend", "my.yaml", "--for", "100", "--out", "out.h5")
    assert ran.status == 0
    assert "\n100 ms took " in ran.err
    checked = neuro("check", file(text), "--backend", "my.yaml")
    assert checked.out.startswith("net.yaml: ok on my.yaml: 7 neurons")
    compared = neuro("compare", file(text), "--backends", "event,my.yaml", "--for", "100", "--json")
    assert list(json.loads(compared.out)["backends"]) == ["event", "my.yaml"]
    priced = neuro("energy", file(text), "--backend", "my.yaml", "--chips", "my.yaml", "--for", "100", "--json")
    assert json.loads(priced.out)["bills"][0]["target"] == "my"
