"""What the benchmarks share: the modules beside them, and a table of figures after the run."""

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
    """Note a figure for the table: what, value, unit, and the aim that it is measured against."""

    def note(what: str, value: float, unit: str, aim: str = "") -> None:
        FIGURES.append((what, value, unit, aim))

    return note


@pytest.fixture
def least_cpu(benchmark: Any) -> Callable[..., float]:
    """Time some work as a benchmark; the least seconds of the processor of its rounds."""

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
    """Print the table."""
    if not FIGURES:
        return
    terminalreporter.section("figures")
    width = max(len(what) for what, *_ in FIGURES)
    for what, value, unit, aim in FIGURES:
        terminalreporter.write_line(f"{what:<{width}}  {value:>12.4g} {unit:<18} {aim}")
