"""The conformance suite: a small case for each feature of the language, compared with the reference backend.

`check_backend(backend)` tests a third-party backend. In pytest each case can be a test:

    from neuro.testing import CASES, check_case

    @pytest.mark.parametrize("name", CASES)
    def test_conformance(name):
        check_case(backend, name)

A backend declares the cases that it does not support in its attribute `unsupported`, a dict from the name of a case to
the reason. The suite checks the declaration: a declared case must be refused or must deviate. A declared case that
passes is a failure.

A backend that computes in integers declares `arithmetic = "integer"`. Cases whose values are exact only in floats are
then skipped, and `check_case` returns `NEEDS_FLOATS` for them. Every backend must pass the cases that are also exact in
integers, and the laws. A law is a case with two outcomes that must agree; laws are about runs in parts, saved states,
seeds and counts.

`check_part` tests a third-party model or rule: it runs generated networks on a backend and on the reference.
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
