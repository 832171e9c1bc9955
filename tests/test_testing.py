"""The conformance suite itself: it finds a backend that is wrong, and holds one to what it declares."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import neuro
from neuro.model.neurons import izhikevich
from neuro.program.backend import EngineCounts, Problem
from neuro.program.program import Floats, Ints, Program
from neuro.testing import CASES, NEEDS_FLOATS, check_backend, check_case, check_part
from neuro.testing.conformance import refusal
from neuro_reference import ReferenceBackend
from neuro_reference.engine import ReferenceEngine
from refused import refused


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


class Whole(ReferenceBackend):
    """Says that it computes in integers; rounds potentials that are shown and tells so."""

    name = "whole"
    arithmetic = "integer"

    def __init__(self, digits: int = 12, unsupported: dict[str, str] | None = None) -> None:
        self.digits, self.unsupported = digits, unsupported or {}

    def problems(self, program: Program) -> Sequence[Problem]:
        return [Problem(False, f"population '{p.name}'", "it is rounded") for p in program.populations]

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> ReferenceEngine:
        return WholeEngine(program, self.digits)


class WholeEngine(ReferenceEngine):
    """Shows rounded potentials."""

    def __init__(self, program: Program, digits: int) -> None:
        super().__init__(program)
        self.digits = digits

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        return np.round(super().get(population, name, ids), self.digits)


class Miscounting(ReferenceBackend):
    """Counts an arrival at the next step where nobody is reached."""

    name = "miscounting"

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> ReferenceEngine:
        return MiscountingEngine(program)


class MiscountingEngine(ReferenceEngine):
    """One active neuron too many."""

    def counts(self) -> EngineCounts:
        counts = super().counts()
        return replace(counts, active=counts.active + 1)


def test_a_backend_of_integers_is_not_run_where_floats_are_needed():
    assert check_case(Whole(), "delta_neuron") == NEEDS_FLOATS
    assert check_case(Whole(), "exact_dense_rows") == ""
    assert NEEDS_FLOATS == "its values are exact in floats only, and this backend computes in integers"


def test_an_approximation_is_judged_by_its_outcome():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert check_case(Whole(), "exact_one_to_one") == ""


def failure(backend: ReferenceBackend, case: str) -> str:
    with pytest.raises(AssertionError) as caught:
        check_case(backend, case)
    return str(caught.value)


def test_what_is_said_of_a_wrong_backend(messages):
    """Wrong values and counts, refusals that are not declared, and declarations that are wrong."""
    decimal = Whole()
    decimal.arithmetic = "decimal"
    wrong = [(Whole(digits=-1), "exact_dense_rows"), (Whole(unsupported={"delta_neuron": ""}), "exact_one_to_one")]
    wrong += [(decimal, "delta_neuron"), (Leaky(), "rule_one_to_one"), (NoIzhikevich({}), "izhikevich_neuron")]
    wrong += [(NoIzhikevich({case: "too hard"}), "delta_neuron") for case in ("delta_neuron", "delta_neurons")]
    wrong += [(Miscounting(), case) for case in ("exact_grid", "counts_follow_from_spikes_of_fixed_weights")]
    told = {f"{k} {backend.name} {case}": failure(backend, case) for k, (backend, case) in enumerate(wrong)}
    messages({case: "\n".join(text.split("\n")[:2]) for case, text in told.items()})


def test_a_refusal_is_no_failure_where_it_is_declared():
    declared = NoIzhikevich({"izhikevich_neuron": "it has no izhikevich"})
    assert check_case(declared, "izhikevich_neuron") == "it has no izhikevich"
    assert "it has no izhikevich" in refusal(declared, "izhikevich_neuron")
    assert check_case(declared, "delta_neuron") == refusal(declared, "delta_neuron") == ""


def test_all_failures_are_told_at_once():
    refused = {"currents", "dopamine_from_the_target", "initial_states", "izhikevich_neuron", "networks_of_all_models"}
    with pytest.raises(AssertionError) as caught:
        check_backend(NoIzhikevich(dict.fromkeys(refused - {"currents"}, "no izhikevich")), sorted(refused))
    told = str(caught.value).splitlines()
    assert any(line.startswith("case 'currents'") for line in told)
    assert not any(line.startswith("case 'initial_states'") for line in told)


def test_every_case_says_what_it_shows():
    assert len(CASES) >= 118
    assert sum(not case.floats for case in CASES.values()) >= 48
    assert all(case.about.endswith(".") for case in CASES.values())


def test_a_part_is_tried_on_both_sides():
    for part in ("izhikevich", neuro.stdp(Wmax=300.0, lambda_=0.1), neuro.fixed_outdegree(n=4)):
        check_part(part, ms=10.0)


def test_a_part_that_is_wrong_is_found():
    wrong = r"^stdp in 'noise_5.0_Hz', 1 threads\n  weight of noise_relay: 20 differ"
    with pytest.raises(AssertionError, match=wrong):
        check_part("stdp", Leaky())


def test_a_part_that_cannot_be_tried_is_told(messages):
    messages({part: refused(check_part, part) for part in ("izhikevic", "fixed_indegree")})
