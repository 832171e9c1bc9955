"""Every feature of the language, on every installed backend, against the reference."""

import pytest

from neuro.program.backend import installed
from neuro.testing import CASES, check_case

TRIED = [
    (backend, name)
    for backend in installed()
    for name, case in CASES.items()
    if case.exact or backend != "reference"  # which is compared with itself then
]


@pytest.mark.parametrize(("backend", "name"), TRIED)
def test_conformance(backend: str, name: str, request: pytest.FixtureRequest):
    if backend in ("nest", "torch"):
        request.getfixturevalue(backend)
    if reason := check_case(backend, name):
        pytest.xfail(reason)
