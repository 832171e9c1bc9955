"""Run the conformance cases on a backend and compare the outcomes with the reference."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from functools import cache
from typing import Any, NoReturn

from neuro.core.errors import ModelError
from neuro.model.network import Network
from neuro.program.backend import Backend, find_backend, unreadable
from neuro.program.program import Program
from neuro.run.compiled import ApproximationWarning, compile
from neuro.run.simulation import Simulation
from neuro.testing import (  # noqa: F401
    connections,
    exact,
    features,
    laws,
    learning,
    probes,
    trials,
)
from neuro.testing.case import CASES as CASES, Found, Start, differences

ARITHMETIC = ("float", "integer")
"""Accepted values of a backend's attribute `arithmetic`."""
NEEDS_FLOATS = "its values are exact in floats only, and this backend computes in integers"
"""Reason for skipping a case on a backend whose `arithmetic` is "integer"."""


def check_backend(backend: str | Backend, cases: Iterable[str] = CASES) -> None:
    """Run all cases, or some of them, on a backend.

    Args:
        backend: name of the backend, or the backend itself.
        cases: names of the cases.

    Raises:
        AssertionError: at least one case fails; the message lists each failed case with found and expected values.
    """
    chosen = find_backend(backend) if isinstance(backend, str) else backend
    failures = []
    for name in cases:
        try:
            check_case(chosen, name)
        except AssertionError as error:
            failures.append(str(error))
        except Exception as error:
            failures.append(f"case '{name}' ({CASES[name].about})\n  {type(error).__name__}: {error}")
    if failures:
        raise AssertionError(f"backend '{chosen.name}' fails {len(failures)} cases\n" + "\n".join(failures))


def check_case(backend: str | Backend, name: str) -> str:
    """Run one case on a backend.

    Args:
        backend: name of the backend, or the backend itself.
        name: name of the case.

    Returns:
        "" if the case passes. The declared reason if the case is declared unsupported and is refused or fails.
        `NEEDS_FLOATS` if the case needs floats and the backend computes in integers.

    Raises:
        AssertionError: the case fails, or passes although it is declared unsupported, or the declarations are wrong.
    """
    chosen = find_backend(backend) if isinstance(backend, str) else backend
    declared: dict[str, str] = getattr(chosen, "unsupported", {})
    integer = _computes_in_integers(chosen)
    for case in declared:
        assert case in CASES, f"backend '{chosen.name}' declares an unknown case '{case}' as unsupported"
        assert not (integer and CASES[case].floats), (
            f"case '{case}' is declared unsupported, but is skipped, as it needs floats: remove the declaration"
        )
    if integer and CASES[name].floats:
        return NEEDS_FLOATS
    if name in declared:
        fails = refusal(chosen, name) or deviations(chosen, name)
        assert fails, f"case '{name}' is declared unsupported but passes: remove the declaration"
        return declared[name]
    messages = deviations(chosen, name)
    assert not messages, f"case '{name}' ({CASES[name].about})\n  " + "\n  ".join(messages)
    return ""


def _computes_in_integers(backend: Backend) -> bool:
    """Return whether a backend declares integer arithmetic; the default is float."""
    arithmetic = getattr(backend, "arithmetic", "float")
    message = f"backend '{backend.name}': arithmetic = {arithmetic!r}: expected one of {ARITHMETIC}"
    assert arithmetic in ARITHMETIC, message
    return bool(arithmetic == "integer")


class _Accepted(Exception):
    """Raised instead of building a network, when the backend has not refused it."""


class _Checked:
    """A backend that reports the problems of another backend, and builds no engine."""

    def __init__(self, backend: Backend) -> None:
        self.name, self.problems, self.description = backend.name, backend.problems, backend.description

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> NoReturn:
        raise _Accepted


def refusal(backend: Backend, name: str) -> str:
    """Return the message with which a backend refuses the first network of a case, or ""."""
    try:
        CASES[name].run(_starting(_Checked(backend), unreadable(backend)))
    except ModelError as error:
        return str(error)
    except _Accepted:
        pass
    return ""


def _starting(backend: Backend, hidden: frozenset[str]) -> Start:
    """Return the function `start` of a case; it removes probes of states that the backend cannot read."""

    def start(net: Network, seed: int = 1, threads: int = 1, **options: Any) -> Simulation:
        net.probes = {name: probe for name, probe in net.probes.items() if probe.record not in hidden}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ApproximationWarning)
            sim: Simulation = compile(net, backend, seed=seed, threads=threads, **options)
            return sim

    return start


def deviations(backend: Backend, name: str) -> list[str]:
    """Return the deviations of a backend from the reference in one case, one line for each quantity.

    A refusal is one deviation. Warnings about approximations are ignored, because the outcome is compared.
    """
    case, hidden = CASES[name], unreadable(backend)
    try:
        outcome = case.run(_starting(backend, hidden))
    except ModelError as error:
        return [f"it is refused: {error}"]
    if case.exact:
        first, second = outcome
        return differences(first, second, exact=True)
    expected = {key: values for key, values in _expected(name).items() if not any(state in key for state in hidden)}
    return differences(expected, outcome, exact=False)


@cache
def _expected(name: str) -> Found:
    """Return the outcome of a case on the reference, which runs only once for each case."""

    def start(net: Network, seed: int = 1, threads: int = 1, **options: Any) -> Simulation:
        return compile(net, "reference", seed=seed)

    outcome: Found = CASES[name].run(start)
    return outcome
