"""What the benchmarks share: the modules beside them, and a table of figures after the run."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

FIGURES: list[tuple[str, float, str, str]] = []


@pytest.fixture
def figure() -> Callable[[str, float, str, str], None]:
    """Note a figure for the table: what, value, unit, and the aim that it is measured against."""

    def note(what: str, value: float, unit: str, aim: str = "") -> None:
        FIGURES.append((what, value, unit, aim))

    return note


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the table."""
    if not FIGURES:
        return
    terminalreporter.section("figures")
    width = max(len(what) for what, *_ in FIGURES)
    for what, value, unit, aim in FIGURES:
        terminalreporter.write_line(f"{what:<{width}}  {value:>12.4g} {unit:<18} {aim}")
