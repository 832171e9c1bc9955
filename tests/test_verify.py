"""`neuro.testing.verify`: NEST's traces come out on every float backend, and a wrong value is found."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import neuro
from neuro.testing.golden import Result
from neuro.testing.verify import verify
from refused import refused

BACKENDS = ("reference", "event")


@pytest.fixture(scope="session")
def traces(golden: Path) -> Path:
    return golden / "nest"


@pytest.fixture
def one(traces: Path, tmp_path: Path):
    """Copy one case, whose json and arrays may be changed on the way."""

    def copy(case: str, arrays=lambda a: None, facts=lambda f: None) -> Path:
        told = json.loads((traces / f"{case}.json").read_text())
        with np.load(traces / f"{case}.npz") as stored:
            values = {name: stored[name].copy() for name in stored.files}
        facts(told)
        arrays(values)
        (tmp_path / f"{case}.json").write_text(json.dumps(told))
        np.savez(tmp_path / f"{case}.npz", **values)
        return tmp_path

    return copy


def wrong(results: list[Result]) -> dict[str, str]:
    return {result.quantity: result.message for result in results if not result.ok}


@pytest.mark.parametrize("backend", [pytest.param("reference", marks=pytest.mark.slow), "event"])
def test_every_trace_of_nest_comes_out(traces: Path, backend: str):
    results = verify(traces, backend)
    assert [f"{r.case} {r.quantity}: {r.message}" for r in results if not r.ok] == []
    assert {r.case[0] for r in results} >= set("abcd")
    assert {r.quantity for r in results} >= {"spikes", "V_m", "I_syn_ex", "w_after", "final", "w", "c", "n", "Kplus"}


def test_a_missing_spike_is_found(one):
    folder = one("a1_iaf_psc_exp", lambda arrays: arrays.update(spikes_ms=arrays["spikes_ms"][1:]))
    assert wrong(verify(folder, "reference")) == {"spikes": "1 differ, first: neuron 0 at 11.1 ms is not expected"}


@pytest.mark.parametrize(
    ("case", "array", "index", "change", "quantity"),
    [
        ("a1_iaf_psc_exp", "spikes_ms", 3, lambda t: t + 0.1, "spikes"),
        ("a1_iaf_psc_exp", "V_m", 1, lambda v: v + 1e-8, "V_m"),
        ("a2_iaf_psc_delta", "V_m", 5, lambda v: np.nan, "V_m"),
        ("a3_iaf_psc_alpha", "I_syn_in", 1, lambda i: i + 1e-8, "I_syn_in"),
        ("b1_stdp_multiplicative", "w_after", 1, lambda w: w + 1e-8, "w_after"),
        ("b2_stdp_additive", "final", 1, lambda w: w + 1e-8, "final"),
        *(("c1_stdp_dopamine", "trace", (-1, k), lambda v: v + 1e-8, n) for k, n in enumerate(("w", "c", "n"), 1)),
        ("c1_stdp_dopamine", "trace", (-1, 4), lambda v: v + 1e-8, "Kplus"),
        ("d1_recurrent100", "V_sample", (0, 1), lambda v: v + 1e-8, "V_m"),
        ("d1_recurrent100", "spike_id", 10, lambda neuron: (neuron + 1) % 100, "spikes"),
    ],
)
def test_what_is_altered_is_found(one, case: str, array: str, index: Any, change: Callable[[Any], Any], quantity: str):
    def alter(arrays):
        arrays[array][index] = change(arrays[array][index])

    found = wrong(verify(one(case, alter), "event" if case[0] in "cd" else "reference"))
    assert list(found) == [quantity]
    assert quantity == "spikes" or ": expected " in found[quantity]


def test_files_that_are_no_cases_get_a_message(one, traces: Path):
    folder = one("a6_iaf_psc_exp_dc_generator")
    (folder / "broken.json").write_text("{")
    (folder / "foreign.json").write_text('{"what": "something else"}')
    np.savez(folder / "foreign.npz", x=np.zeros(1))
    (folder / "list.json").write_text("[]")
    (folder / "lonely.json").write_text("{}")
    shutil.copy(traces / "b1_stdp_multiplicative.json", folder / "torn.json")
    (folder / "torn.npz").write_bytes(b"PK\x03\x04torn")
    results = verify(folder, "reference")
    messages = {result.case: result.message for result in results if not result.ok}
    assert messages["foreign"] == (
        "found a case of unknown kind: expected 'neuron' with 'inputs' or 'src', or 'synapse'"
    )
    assert messages["list"] == "list.json: expected an object that describes a case"
    assert messages["lonely"] == "lonely.npz is missing"
    assert messages["broken"].startswith("broken.json cannot be read: Expecting property name")
    assert messages["torn"].startswith("torn.npz cannot be read: ")
    assert {r.case for r in results if r.ok} == {"a6_iaf_psc_exp_dc_generator"}


def test_a_case_that_cannot_be_built_gets_a_message(one, tmp_path: Path, monkeypatch, messages):
    def told(change: Callable[[dict], Any]) -> str:
        found = wrong(verify(one("a1_iaf_psc_exp", facts=change), "reference"))
        assert list(found) == ["case"]
        return re.sub(r"\w+\.py:[0-9]+: ", "", found["case"])

    changes = {
        "model": lambda f: f["neuron"].update(model="aeif"),
        "params": lambda f: f["neuron"].pop("params"),
        "delay": lambda f: f["inputs"]["exc"].update(delay_ms="soon"),
        "inputs": lambda f: f["inputs"].update(exc=3),
    }
    answers = {name: told(change) for name, change in changes.items()}
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    messages(answers | {name: refused(verify, name) for name in ("empty", "nowhere")})


def test_a_case_of_izhikevich_neurons_is_understood(tmp_path: Path):
    params = {"a": 0.1, "b": 0.2, "c": -65.0, "d": 2.0, "V_min": "-inf", "consistent_integration": True}
    facts = {
        "resolution_ms": 0.1,
        "t_sim_ms": 50.0,
        "neuron": {"model": "izhikevich", "params": params, "initial": {"V_m": -65.0, "U_m": -13.0}},
        "inputs": {
            "exc": {"spike_times_ms": [1.0, 1.5, 2.0, 20.0], "weight": 12.0, "delay_ms": 1.0},
            "dc": {"amplitude_pA": 6.0, "start_ms": 5.0, "stop_ms": 40.0, "delay_ms": 0.5},
        },
    }
    net = neuro.Network("izhikevich", resolution=0.1)
    net.population("exc", 1, neuro.spike_generator(spike_times=[1.0, 1.5, 2.0, 20.0]))
    net.population("dc", 1, neuro.dc_generator(amplitude=6.0, start=5.0, stop=40.0))
    net.population("cell", 1, neuro.izhikevich(a=0.1, d=2.0))
    net.connect("exc", "cell", neuro.one_to_one(), weight=12.0, delay=1.0)
    net.connect("dc", "cell", neuro.one_to_one(), delay=0.5)
    for state in ("V_m", "U_m"):
        net.probe(state, "cell", state)
    sim = neuro.compile(net, "reference")
    sim.run(50.0)
    times, v_m = sim.trace("V_m")
    traces = {"times_ms": times, "V_m": v_m[:, 0], "U_m": sim.trace("U_m")[1][:, 0]}
    assert sim.spikes("cell")[0].size > 2
    (tmp_path / "case.json").write_text(json.dumps(facts))
    np.savez(tmp_path / "case.npz", spikes_ms=sim.spikes("cell")[0], **traces)
    for backend in BACKENDS:
        results = verify(tmp_path, backend)
        assert [(r.quantity, r.message) for r in results] == [("spikes", ""), ("V_m", ""), ("U_m", "")]
