"""The conformance suite itself: it finds a backend that is wrong, and holds one to what it declares."""

from collections.abc import Sequence
from typing import Any

import pytest

from neuro.backend import Problem
from neuro.neurons import izhikevich
from neuro.program import Floats, Program
from neuro.testing import CASES, check_backend, check_case
from neuro_reference import ReferenceBackend
from neuro_reference.engine import ReferenceEngine


class LeakyEngine(ReferenceEngine):
    """Shows weights a little too large."""

    def get_synapses(self, projection: int, name: str) -> Floats:
        return super().get_synapses(projection, name) * (1.0 + 1e-7)


class Leaky(ReferenceBackend):
    name = "leaky"

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> ReferenceEngine:
        return LeakyEngine(program)


class NoIzhikevich(ReferenceBackend):
    """Cannot do one model."""

    name = "plain"

    def __init__(self, unsupported: dict[str, str]) -> None:
        self.unsupported = unsupported

    def problems(self, program: Program) -> Sequence[Problem]:
        found = [p for p in program.populations if isinstance(p.model, izhikevich)]
        return [Problem(True, f"population '{p.name}'", "it has no izhikevich") for p in found]


def test_a_wrong_backend_is_found():
    with pytest.raises(AssertionError) as caught:
        check_case(Leaky(), "rule_one_to_one")
    text = str(caught.value)
    assert text.startswith("case 'rule_one_to_one' (one_to_one with weights and delays of their own.)\n  weight of ")
    assert ": 5 differ, first [0] = " in text
    assert ", expected " in text


def test_a_refusal_is_a_failure_unless_it_is_declared():
    with pytest.raises(AssertionError, match="it is refused: backend 'plain' cannot run this network"):
        check_case(NoIzhikevich({}), "izhikevich_neuron")
    declared = NoIzhikevich({"izhikevich_neuron": "it has no izhikevich"})
    assert check_case(declared, "izhikevich_neuron") == "it has no izhikevich"
    assert check_case(declared, "delta_neuron") == ""


def test_a_declared_case_that_passes_is_a_failure():
    with pytest.raises(AssertionError, match="'delta_neuron' is declared unsupported but passes: take it off the list"):
        check_case(NoIzhikevich({"delta_neuron": "too hard"}), "delta_neuron")


def test_an_unknown_declared_case_is_a_failure():
    with pytest.raises(AssertionError, match="declares an unknown case 'delta_neurons' as unsupported"):
        check_case(NoIzhikevich({"delta_neurons": "too hard"}), "delta_neuron")


def test_all_failures_are_told_at_once():
    refused = {"currents", "dopamine_from_the_target", "initial_states", "izhikevich_neuron", "networks_of_all_models"}
    with pytest.raises(AssertionError) as caught:
        check_backend(NoIzhikevich(dict.fromkeys(refused - {"currents"}, "no izhikevich")))
    told = str(caught.value).splitlines()
    assert any(line.startswith("case 'currents'") for line in told)
    assert not any(line.startswith("case 'initial_states'") for line in told)


def test_every_case_says_what_it_shows():
    assert len(CASES) >= 70
    assert all(case.about.endswith(".") for case in CASES.values())
