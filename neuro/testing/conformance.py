"""Run the cases on a backend and compare."""

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
NEEDS_FLOATS = "its values are exact in floats only, and this backend computes in integers"
"""Why a case is not run on a backend whose `arithmetic` is "integer"."""


def check_backend(backend: str | Backend, cases: Iterable[str] = CASES) -> None:
    """Run every case, or some, on a backend.

    Args:
        backend: its name, or the backend itself.
        cases: their names.

    Raises:
        AssertionError: some cases fail; all of them are reported, with what was found and what was expected.
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
        backend: its name, or the backend itself.
        name: of the case.

    Returns:
        "" if it passes; the reason if it is declared unsupported and indeed refused or failed, or if it needs floats
        and the backend computes in integers. What `refusal` tells is not built.

    Raises:
        AssertionError: it fails, or passes although it is declared unsupported, or the declarations are wrong.
    """
    chosen = find_backend(backend) if isinstance(backend, str) else backend
    declared: dict[str, str] = getattr(chosen, "unsupported", {})
    integer = _computes_in_integers(chosen)
    for other in declared:
        assert other in CASES, f"backend '{chosen.name}' declares an unknown case '{other}' as unsupported"
        assert not (integer and CASES[other].floats), (
            f"case '{other}' is declared unsupported but needs floats, which says as much: take it off the list"
        )
    if integer and CASES[name].floats:
        return NEEDS_FLOATS
    if name in declared:
        unlike = refusal(chosen, name) or deviations(chosen, name)
        assert unlike, f"case '{name}' is declared unsupported but passes: take it off the list"
        return declared[name]
    found = deviations(chosen, name)
    assert not found, f"case '{name}' ({CASES[name].about})\n  " + "\n  ".join(found)
    return ""


def _computes_in_integers(backend: Backend) -> bool:
    """Whether a backend says that it rounds; one that says nothing computes in floats."""
    arithmetic = getattr(backend, "arithmetic", "float")
    message = f"backend '{backend.name}': arithmetic = {arithmetic!r}: expected one of {ARITHMETIC}"
    assert arithmetic in ARITHMETIC, message
    return bool(arithmetic == "integer")


class _Accepted(Exception):
    """The backend would build the network."""


class _Checked:
    """A backend that tells its problems and builds nothing."""

    def __init__(self, backend: Backend) -> None:
        self.name, self.problems, self.description = backend.name, backend.problems, backend.description

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> NoReturn:
        raise _Accepted


def refusal(backend: Backend, name: str) -> str:
    """The message by which a backend refuses the first network of a case; "" if it would build it."""
    try:
        CASES[name].run(_starting(_Checked(backend), unreadable(backend)))
    except ModelError as error:
        return str(error)
    except _Accepted:
        pass
    return ""


def _starting(backend: Backend, hidden: frozenset[str]) -> Start:
    """The `start` of a case on a backend, without probes of states that it does not show."""

    def start(net: Network, seed: int = 1, threads: int = 1, **options: Any) -> Simulation:
        net.probes = {name: probe for name, probe in net.probes.items() if probe.record not in hidden}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ApproximationWarning)
            sim: Simulation = compile(net, backend, seed=seed, threads=threads, **options)
            return sim

    return start


def deviations(backend: Backend, name: str) -> list[str]:
    """What a backend does otherwise than the reference in one case.

    A refusal counts as one deviation; what is approximated is judged by its outcome, not by its warning.
    """
    case, hidden = CASES[name], unreadable(backend)
    try:
        found = case.run(_starting(backend, hidden))
    except ModelError as error:
        return [f"it is refused: {error}"]
    if case.exact:
        first, second = found
        return differences(first, second, exact=True)
    shown = {what: values for what, values in _expected(name).items() if not any(word in what for word in hidden)}
    return differences(shown, found, exact=False)


@cache
def _expected(name: str) -> Found:
    def start(net: Network, seed: int = 1, threads: int = 1, **options: Any) -> Simulation:
        return compile(net, "reference", seed=seed)

    found: Found = CASES[name].run(start)
    return found
