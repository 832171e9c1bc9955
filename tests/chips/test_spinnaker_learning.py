"""SpiNNaker's plastic synapses come out as in the machine code of its released programs, bit for bit."""

import json
import shutil

import numpy as np
import pytest

from neuro.chips.spinnaker_rule import PROGRAMS, fixed_point, rule_of, table_of
from neuro.testing.verify import verify
from neuro_chip.replay import replay
from refused import refused

NAME = "spinnaker_learning"
KNOWN = {
    "known_neuromodulation": 10307 / 1024,
    "known_triplet_minus": 5312 / 16384,
    "known_triplet_plus": 9001 / 16384,
    "known_pair_additive": 5126 / 2048,
    "known_pair_multiplicative": 5136 / 2048,
    "known_nearest_additive": 5124 / 2048,
    "known_nearest_multiplicative": 5131 / 2048,
}
"""Last weights that public tests and descriptions state, some read from boards."""


@pytest.fixture(scope="module")
def folder(golden):
    return golden / "spinnaker-learning"


@pytest.fixture(scope="module")
def cases(folder):
    return {case["name"]: case for case in json.loads((folder / f"{NAME}.json").read_text())["cases"]}


@pytest.fixture(scope="module")
def arrays(folder):
    with np.load(folder / f"{NAME}.npz") as stored:
        return {name: stored[name] for name in stored.files}


def test_every_case_comes_out(folder, cases):
    results = verify(folder)
    assert [f"{r.case} {r.quantity}: {r.message}" for r in results if not r.ok] == []
    assert len({r.case for r in results}) == len(cases) == 80
    ran = {case["ran"]["released_program"].removeprefix("synapses_stdp_") for case in cases.values()}
    assert ran == {*PROGRAMS.values()}


def test_known_numbers(cases, arrays):
    for name, weight in KNOWN.items():
        found = replay(cases[name], arrays[f"{name}__events"])["weights"]
        assert found[-1, 0] * cases[name]["weight_unit"][0] == weight, name


@pytest.mark.parametrize("quantity", ["weights", "eligibility", "pre", "post", "marks", "counters"])
def test_one_altered_bit_is_found(folder, cases, tmp_path, quantity, arrays):
    case = cases["nm_both"]
    key = f"nm_both__{quantity}"
    altered = arrays | {key: arrays[key].copy()}
    altered[key].flat[-1] ^= 1
    (tmp_path / f"{NAME}.json").write_text(json.dumps({"cases": [case]}))
    np.savez(tmp_path / f"{NAME}.npz", **altered)
    assert [r.quantity for r in verify(tmp_path) if not r.ok] == [quantity]


def test_a_packet_at_another_tick_is_found(cases, arrays):
    events = arrays["nm_both__events"].copy()
    events[np.flatnonzero(events[:, 0] == 0)[5], 2] += 1
    assert not np.array_equal(replay(cases["nm_both"], events)["weights"], arrays["nm_both__weights"])


def test_other_backends_say_so(folder, tmp_path, messages):
    for suffix in (".json", ".npz"):
        shutil.copy(folder / f"{NAME}{suffix}", tmp_path)
    messages({backend: verify(tmp_path, backend)[0].message for backend in ("event", "loihi")})


def test_constants_and_tables():
    assert [fixed_point(value) for value in (1.0, 0.01, -0.5, 2.5 / 32768, 1e-9)] == [32768, 328, -16384, 2, 0]
    lengths = {(5, 0, 1.0): 40, (20, 0, 1.0): 154, (1000, 0, 1.0): 7626, (20, 0, 0.1): 1526, (101, 2, 1.0): 194}
    lengths |= {(200, 2, 1.0): 382, (200, 2, 0.1): 3814, (1000, 4, 1.0): 478, (1000, 4, 0.1): 4766}
    for (tau, shift, dt), length in lengths.items():
        table = table_of(tau, dt, shift)
        assert (table.size, table[0]) == (length, 2048)


def test_what_no_program_does_is_refused(messages):
    numbers = dict.fromkeys(("w_min", "A_plus", "A_minus"), 0.0) | dict.fromkeys(
        ("w_max", "tau_plus", "tau_minus"), 1.0
    )
    taught = {"tau_c": 1000.0, "tau_d": 200.0, "w_min": 0.0, "w_max": 1.0}
    messages(
        {
            "triplet": refused(rule_of, "triplet", "multiplicative", numbers, dt=1.0),
            "nearest": refused(rule_of, "nearest", "additive", numbers, dt=1.0, neuromodulation=taught),
            "table": refused(rule_of, "pair", "additive", numbers | {"tau_plus": 9000.0}, dt=1.0),
        }
    )
