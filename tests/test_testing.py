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


def test_a_backend_of_integers_must_be_exact_where_it_can():
    with pytest.raises(AssertionError, match="V_m of cells: 5 differ"):
        check_case(Whole(digits=-1), "exact_dense_rows")


def test_an_approximation_is_judged_by_its_outcome():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert check_case(Whole(), "exact_one_to_one") == ""


def test_a_case_that_needs_floats_is_not_declared_by_a_backend_of_integers():
    backend = Whole(unsupported={"delta_neuron": "it rounds"})
    with pytest.raises(AssertionError, match="'delta_neuron' is declared unsupported but needs floats"):
        check_case(backend, "exact_one_to_one")


def test_an_unknown_arithmetic_is_a_failure():
    backend = Whole()
    backend.arithmetic = "decimal"
    with pytest.raises(AssertionError) as caught:
        check_case(backend, "delta_neuron")
    assert str(caught.value).splitlines()[0] == (
        "backend 'whole': arithmetic = 'decimal': expected one of ('float', 'integer')"
    )


@pytest.mark.parametrize("name", ["exact_grid", "counts_follow_from_spikes_of_fixed_weights"])
def test_wrong_counts_are_found(name: str):
    with pytest.raises(AssertionError, match=r"counts of \w+: 1 differ, first"):
        check_case(Miscounting(), name)


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


def test_a_part_that_cannot_be_tried_is_told():
    with pytest.raises(neuro.ModelError) as told:
        check_part("izhikevic")
    assert str(told.value).splitlines() == [
        "there is no model, synapse model or connection rule 'izhikevic'",
        "  hint: did you mean 'izhikevich'?",
    ]
    with pytest.raises(neuro.ModelError, match="hint: give an instance of it"):
        check_part("fixed_indegree")
