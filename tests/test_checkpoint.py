"""A training under way: kept, gone on with, and not mixed with another."""

import json
import re

import h5py
import numpy as np
import pytest

from neuro.apps import Checkpoint
from refused import refused

TOLD = {"seed": 3, "settings": {"epochs": 2, "order": "frames"}}


@pytest.fixture
def kept(tmp_path):
    made = Checkpoint(tmp_path / "model.h5", "my training 1", TOLD)
    made.keep(
        state={"w": np.arange(3.0), "n": np.array(4)}, history=np.array([1.0, 2.0]), file=np.arange(9, dtype="u1")
    )
    return made


def test_what_is_kept_comes_back(kept, tmp_path):
    found = Checkpoint(tmp_path / "model.h5", "my training 1", TOLD).resume()
    assert found["state"]["w"].tolist() == [0.0, 1.0, 2.0]
    assert found["state"]["n"] == 4
    assert found["history"].tolist() == [1.0, 2.0]
    assert found["file"].tobytes() == bytes(range(9))
    assert kept.path == tmp_path / "model.h5.training"
    kept.remove()
    assert kept.resume() == {}


def test_another_training_is_refused(kept, tmp_path):
    for told, expected in (
        ({**TOLD, "seed": 4}, "seed = 3: found 4 now"),
        ({"seed": 3, "settings": {"epochs": 2}}, "settings.order = frames: found its default now"),
    ):
        assert refused(Checkpoint(tmp_path / "model.h5", "my training 1", told).resume) == (
            f"{kept.path}: an unfinished training with {expected}\n"
            "  hint: give the same options to continue it, or delete the file"
        )


def test_another_file_is_neither_read_nor_replaced(kept):
    kept.path.unlink()
    with h5py.File(kept.path, "w") as file:
        file.attrs["format"] = "another 1"
    assert "not a my training 1\n  hint: the file has no digest" in refused(kept.resume)
    assert "expected a new name" in refused(kept.keep, history=np.zeros(1))


def test_a_byte_that_flipped_is_found(tmp_path):
    made = Checkpoint(tmp_path / "model.h5", "my training 1", TOLD)
    weights = np.arange(64.0) + 0.5
    made.keep(weights=weights, groups={"a.b": np.ones(3), "c": np.zeros(2, np.uint8)})
    assert set(made.resume()) == {"weights", "groups"}
    whole = made.path.read_bytes()
    at = whole.index(weights.tobytes()) + 100
    made.path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    told = r"model.h5.training: damaged my training 1: the content does not match the digest\n  hint: delete the file"
    assert re.search(told, refused(made.resume))


@pytest.mark.parametrize("error", [RuntimeError, ValueError, KeyError, TypeError, AttributeError])
def test_whatever_h5py_says_of_a_damaged_file_is_told(kept, monkeypatch, error):
    """Bits flipped at random brought all of these."""

    def broken(*told):
        raise error("bad heap free list")

    monkeypatch.setattr("neuro.files.state.take", broken)
    told = refused(kept.resume)
    assert told.startswith(f"{kept.path}: damaged my training 1: ")
    assert "bad heap free list" in told
    assert told.endswith("hint: delete the file to start again")


def test_what_it_was_told_cannot_be_mended_by_hand(kept):
    with h5py.File(kept.path, "r+") as file:
        file.attrs["told"] = json.dumps({**TOLD, "seed": 4})
    assert "the content does not match the digest\n  hint: delete the file to start again" in refused(kept.resume)


def test_a_way_out_of_its_own(kept, tmp_path):
    other = Checkpoint(tmp_path / "model.h5", "my training 1", {**TOLD, "seed": 4}, {"seed": "sow the same"})
    assert re.search(r"found 4 now\n  hint: sow the same, or delete the file$", refused(other.resume))
