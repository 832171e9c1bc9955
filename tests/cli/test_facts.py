"""Commands that only tell: check, schema, models, backends, verify."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from neuro import load
from neuro.cli.catalogue import KINDS, catalogue
from neuro.compiler import compile_network
from neuro.compiler.show import program_text
from neuro.program.backend import Problem


def test_check(neuro, network, monkeypatch, messages):
    class Small:
        def problems(self, program):
            first, last = program.populations[0], program.populations[3]
            return (
                Problem(False, "population 'one'", "7 bits of weight", origin=last.origin),
                Problem(True, "population 'noise': 20 neurons", "the limit is 10", "split it", first.origin),
            )

    Path("one.yaml").write_text("neuro: 1\npopulations: {a: {model: iaf_psc_exp, shape: 1}}\n")
    answers = [neuro("check", name) for name in (network, "one.yaml")]
    monkeypatch.setattr("neuro.program.backend.find_backend", lambda name: Small())
    answers.append(neuro("check", network))
    assert [(answer.status, bool(answer.out), bool(answer.err)) for answer in answers] == [
        *((0, True, False), (0, True, False), (2, False, True))
    ]
    messages({name: a.out + a.err for name, a in zip(("some", "one", "refused"), answers, strict=True)})


def test_schema_and_backends(neuro):
    assert json.loads(neuro("schema").out)["title"] == "neuro network"
    text = neuro("backends").out
    assert " event " in text
    assert " reference " in text


def test_models_lists_all_in_few_lines(neuro):
    answer = neuro("models").out
    assert len(answer.splitlines()) <= 30
    words = answer.replace(",", " ").split()
    names = [name for kind, title in KINDS.items() for name in (kind, *catalogue()[title])]
    assert [word for word in words if word in names] == names
    assert answer.endswith("neuro models --long: all models in full\n")


def test_models_lists_a_kind(neuro):
    assert list(KINDS.values()) == list(catalogue())
    assert not KINDS.keys() & {name for choices in catalogue().values() for name in choices}
    for kind, title in KINDS.items():
        rows = [line.split() for line in neuro("models", kind).out.splitlines() if line.split() and line[1] != " "]
        assert [row[0] for row in rows if row[0] in catalogue()[title] and len(row) > 1] == list(catalogue()[title])
    assert neuro("models", "neurns").err == "error: unknown model 'neurns'\n  hint: did you mean 'neurons'?\n"
    assert "alpha" not in neuro("models", "rules", "--long").out
    assert "fixed_indegree" in neuro("models", "rules", "--long").out


def test_models_tells_everything(neuro):
    text = " ".join(neuro("models", "--long").out.split())
    for section, choices in catalogue().items():
        assert section in text
        for name, choice in choices.items():
            assert f" {name} " in text
            for word, q in choice.quantities().items():
                assert f" {word} " in text, (name, word)
                assert q.doc, (name, word)


def test_one_model(neuro):
    text = neuro("models", "izhikevich").out
    assert "equation: V_m' = 0.04 V_m^2 + 5 V_m + 140 - U_m + I" in text
    assert "source: Izhikevich, IEEE Trans. Neural Networks 14:1569, 2003" in text
    row = next(line.split() for line in text.splitlines() if line.split()[:1] == ["c"])
    assert row == ["c", "-65", "mV", "a", "number", "yes", "V_m", "after", "a", "spike"]
    assert "stdp" not in text


def test_a_required_parameter(neuro):
    rows = [line.split() for line in neuro("models", "pairwise_bernoulli").out.splitlines()]
    assert ["p", "required", "a", "number", ">=", "0", "and", "<=", "1", "probability"] in rows


@pytest.fixture
def one_case(golden, tmp_path) -> Path:
    for file in (golden / "nest").glob("a1_*"):
        shutil.copy(file, tmp_path)
    return tmp_path


def test_verify(neuro, one_case):
    answer = neuro("verify", one_case)
    assert (answer.status, answer.err) == (0, "")
    assert answer.out.endswith("1 of 1 cases agree\n")


def test_verify_a_wrong_value(neuro, one_case):
    file = one_case / "a1_iaf_psc_exp.npz"
    arrays = dict(np.load(file))
    arrays["V_m"][100] += 1e-6
    np.savez(file, **arrays)
    answer = neuro("verify", one_case)
    assert answer.status == 1
    assert "WRONG" in answer.out
    assert answer.out.endswith("0 of 1 cases agree\n")
    answer = neuro("verify", one_case, "--json")
    assert answer.status == 1
    wrong = [row for row in json.loads(answer.out) if not row["ok"]]
    assert [(row["case"], row["quantity"]) for row in wrong] == [("a1_iaf_psc_exp", "V_m")]
    assert wrong[0]["error"] == pytest.approx(1e-6, rel=1e-3)


def test_verify_json_has_no_infinity(neuro, tmp_path):
    (tmp_path / "case.json").write_text("{}")
    answer = neuro("verify", tmp_path, "--json")
    assert answer.status == 1
    assert "Infinity" not in answer.out
    assert json.loads(answer.out)[0]["error"] is None


def test_show(neuro, network):
    answer = neuro("show", network, "--set", "w=5")
    assert (answer.status, answer.err) == (0, "")
    rows = [line.split() for line in answer.out.splitlines() if line.strip()]
    texts = [" ".join(row) for row in rows]
    assert "exc iaf_psc_exp 2 x 4 8" in texts
    assert "probe v exc V_m every 1 ms" in texts
    heads = [text.rpartition(" ")[0] for text in texts]
    assert "noise_exc noise exc all_to_all 160 5 1 stdp" in heads
    assert "exc_one exc one pairs 2 10 .. 20 2 static" in heads
    titles = [row[0] for row in rows if len(row) == 1 and row[0].isalpha()]
    assert titles == ["populations", "projections", "more", "memory"]


def test_show_program(neuro, network):
    program = compile_network(load(network), 3)
    assert neuro("show", network, "--program", "--seed", "3").out == program_text(program)
