"""Run the cases on a backend and compare."""

from __future__ import annotations

from functools import cache
from typing import Any

from neuro.backend import Backend, find
from neuro.errors import ModelError
from neuro.network import Network
from neuro.simulation import Simulation, compile
from neuro.testing import connections, features, laws, learning, trials  # noqa: F401
from neuro.testing.case import CASES, Found, differences


def check_backend(backend: str | Backend) -> None:
    """Run every case on a backend.

    Args:
        backend: its name, or the backend itself.

    Raises:
        AssertionError: some cases fail; all of them are told, with what was found and what was expected.
    """
    chosen = find(backend) if isinstance(backend, str) else backend
    failures = []
    for name in CASES:
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
        "" if it passes; the reason if it is declared unsupported and indeed does not.

    Raises:
        AssertionError: it fails, or passes although it is declared unsupported.
    """
    chosen = find(backend) if isinstance(backend, str) else backend
    declared: dict[str, str] = getattr(chosen, "unsupported", {})
    for other in declared:
        assert other in CASES, f"backend '{chosen.name}' declares an unknown case '{other}' as unsupported"
    found = deviations(chosen, name)
    if name in declared:
        assert found, f"case '{name}' is declared unsupported but passes: take it off the list"
        return declared[name]
    assert not found, f"case '{name}' ({CASES[name].about})\n  " + "\n  ".join(found)
    return ""


def deviations(backend: Backend, name: str) -> list[str]:
    """What a backend does otherwise than the reference in one case; a refusal counts as one deviation."""
    case = CASES[name]

    def start(net: Network, seed: int = 1, threads: int = 1, **options: Any) -> Simulation:
        return compile(net, backend, seed=seed, threads=threads, **options)

    try:
        found = case.run(start)
    except ModelError as error:
        return [f"it is refused: {error}"]
    if case.exact:
        first, second = found
        return differences(first, second, exact=True)
    return differences(_expected(name), found, exact=False)


@cache
def _expected(name: str) -> Found:
    def start(net: Network, seed: int = 1, threads: int = 1, **options: Any) -> Simulation:
        return compile(net, "reference", seed=seed)

    found: Found = CASES[name].run(start)
    return found
