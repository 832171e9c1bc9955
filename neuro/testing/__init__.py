"""The conformance suite: every feature of the language as a small case, compared with the reference backend.

A third-party backend is tested by `check_backend(backend)`, or case by case in pytest:

    from neuro.testing import CASES, check_case

    @pytest.mark.parametrize("name", CASES)
    def test_conformance(name):
        check_case(backend, name)

A backend that cannot do something says so in its attribute `unsupported`, a dict from the name of a case to the
reason. It is held to that: `problems` must refuse the case, or the run must; one that passes is a failure.

A backend that computes in integers says so in its attribute `arithmetic = "integer"`. Cases whose values only floats
hold exactly are then not run; `check_case` returns `NEEDS_FLOATS` for them. Those that integers hold exactly, too,
and the laws of cutting, saving, seeds and counts must pass on every backend.

A third-party model or rule is tried by `check_part`, in networks of its own, on a backend beside the reference.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import public_names

if TYPE_CHECKING:
    from neuro.testing.case import Case as Case, Found as Found, observe as observe
    from neuro.testing.conformance import (
        CASES as CASES,
        NEEDS_FLOATS as NEEDS_FLOATS,
        check_backend as check_backend,
        check_case as check_case,
        deviations as deviations,
    )
    from neuro.testing.parts import check_part as check_part


if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = public_names(__name__, __file__)
