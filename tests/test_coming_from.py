"""Words of other simulators beside ours: the page's last column is a program, and NEST has what is said of it."""

import re
from pathlib import Path

import pytest

import neuro

PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "coming-from.md"
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in PAGE.read_text("utf-8").splitlines()
    if line.startswith("| ") and "---" not in line
]
OURS = [(row[0], code) for row in ROWS for code in re.findall(r"`([^`]+)`", row[-1])]


def test_the_last_column_is_a_program(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    space = {"neuro": neuro}
    for what, code in OURS:
        if code.startswith("neuro models"):
            continue
        try:
            exec(code, space)
        except Exception as error:
            pytest.fail(f"{what}: `{code}`: {error}")
    assert space["times"].size
    assert space["v"].shape == (100, 10)
    assert (space["sim"].weights("noise_inh")[2] == 60.0).all()


def test_nest_has_what_the_page_says(nest):
    import nest

    told = " ".join(row[1] for row in ROWS)
    for name in re.findall(r"nest\.(\w+)", told):
        assert hasattr(nest, name), name
    for model in re.findall(r'Create\("(\w+)"', told):
        assert model in nest.node_models, model
    for model in ("stdp_dopamine_synapse", "stdp_synapse"):
        assert model in told
        assert model in nest.synapse_models
