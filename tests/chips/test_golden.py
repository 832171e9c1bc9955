"""The golden traces of both chips come out bit for bit."""

import json
import shutil

import numpy as np
import pytest

from neuro.testing.verify import verify

CASES = {"loihi": 25, "spinnaker": 9}


@pytest.fixture(params=CASES)
def chip(request):
    return request.param


def test_every_trace_comes_out(golden, chip):
    results = verify(golden / chip, chip)
    assert [f"{r.case} {r.quantity}: {r.message}" for r in results if not r.ok] == []
    assert len({r.case for r in results}) >= CASES[chip]


@pytest.mark.parametrize(("name", "quantity"), [("basic__v", "v"), ("basic__u", "u"), ("basic__s", "spikes")])
def test_one_altered_bit_is_found(golden, tmp_path, name, quantity):
    folder = golden / "loihi"
    shutil.copy(folder / "a_single_lif.json", tmp_path)
    with np.load(folder / "a_single_lif.npz") as stored:
        arrays = {key: stored[key].copy() for key in stored.files}
    arrays[name].flat[40] ^= 1
    np.savez(tmp_path / "a_single_lif.npz", **arrays)
    facts = json.loads((tmp_path / "a_single_lif.json").read_text())
    wrong = [r for r in verify(tmp_path, "loihi") if not r.ok]
    assert len(facts["cases"]) == 21
    assert [(r.case.endswith("basic"), r.quantity) for r in wrong] == [(True, quantity)]
