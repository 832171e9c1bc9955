"""Every feature of the language, on every installed backend, against the reference."""

import pytest

from neuro.program.backend import find_backend, installed
from neuro.testing import CASES, NEEDS_FLOATS, check_case, deviations
from neuro.testing.conformance import refusal

BACKENDS = {name: find_backend(name) for name in installed()}
DECLARED = {name: getattr(backend, "unsupported", {}) for name, backend in BACKENDS.items()}
ROUNDING = {name for name, backend in BACKENDS.items() if getattr(backend, "arithmetic", "float") == "integer"}
TRIED = [
    (backend, name)
    for backend in BACKENDS
    for name, case in CASES.items()
    if (case.exact or backend != "reference")  # which is compared with itself then
    and name not in DECLARED[backend]
    and not (case.floats and backend in ROUNDING)
]


@pytest.fixture(autouse=True)
def there(backend: str, request: pytest.FixtureRequest):
    if backend in ("nest", "torch"):
        request.getfixturevalue(backend)


@pytest.mark.parametrize(("backend", "name"), TRIED)
def test_conformance(backend: str, name: str):
    assert check_case(backend, name) == ""


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_not_supported_is_refused_for_the_listed_reason(backend: str):
    """By `check`, which builds nothing; what NEST refuses only once it runs, by the run."""
    chosen, declared = BACKENDS[backend], DECLARED[backend]
    refusals = {name: refusal(chosen, name) for name in declared}
    assert backend == "nest" or all(refusals.values())
    answers = {name: text or " ".join(deviations(chosen, name)) for name, text in refusals.items()}
    assert {name: answers[name] for name, reason in declared.items() if reason not in answers[name]} == {}


@pytest.mark.parametrize("backend", sorted(ROUNDING))
def test_what_needs_floats_is_not_run_in_integers(backend: str):
    unrun = [name for name, case in CASES.items() if case.floats]
    assert {check_case(backend, name) for name in unrun} == {NEEDS_FLOATS}
