"""Every feature of the language, on every installed backend, against the reference."""

import pytest

from neuro.program.backend import installed
from neuro.testing import CASES, check_case


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("backend", installed())
def test_conformance(backend: str, name: str, request: pytest.FixtureRequest):
    if backend in ("nest", "torch"):
        request.getfixturevalue(backend)
    if reason := check_case(backend, name):
        pytest.xfail(reason)
