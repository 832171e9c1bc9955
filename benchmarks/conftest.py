"""Fixtures of the benchmarks: figures for a table after the run. The modules of this folder can be imported."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))

FIGURES: list[tuple[str, float, str, str]] = []


@pytest.fixture
def figure() -> Callable[[str, float, str, str], None]:
    """Return a function that adds a row to the table: name, value, unit, and the aim for the value."""

    def note(what: str, value: float, unit: str, aim: str = "") -> None:
        FIGURES.append((what, value, unit, aim))

    return note


@pytest.fixture
def least_cpu(benchmark: Any) -> Callable[..., float]:
    """Return a function that times some work as a benchmark, and returns the least processor time of a round in s."""

    def timed(work: Callable[[], object], rounds: int, **words: Any) -> float:
        taken: list[float] = []

        def one() -> None:
            began = time.process_time()
            work()
            taken.append(time.process_time() - began)

        benchmark.pedantic(one, rounds=rounds, **words)
        return min(taken)

    return timed


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the table of figures."""
    if not FIGURES:
        return
    terminalreporter.section("figures")
    width = max(len(what) for what, *_ in FIGURES)
    for what, value, unit, aim in FIGURES:
        terminalreporter.write_line(f"{what:<{width}}  {value:>12.4g} {unit:<18} {aim}")
