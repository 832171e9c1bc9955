"""The conformance suite: every feature of the language as a small case, compared with the reference backend.

A stranger's backend is tested by `check_backend(backend)`, or case by case in pytest:

    from neuro.testing import CASES, check_case

    @pytest.mark.parametrize("name", CASES)
    def test_conformance(name):
        if reason := check_case(backend, name):
            pytest.xfail(reason)

A backend that cannot do something says so in its attribute `unsupported`, a dict from the name of a case to the
reason. It is held to that: a case declared unsupported that passes is a failure.
"""

from neuro.testing.case import CASES, Case, Found, observe
from neuro.testing.conformance import check_backend, check_case, deviations

__all__ = ["CASES", "Case", "Found", "check_backend", "check_case", "deviations", "observe"]
