"""Printed lines, tables and JSON of the commands."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from neuro.apps import Test, check_output, console, provenance, sealed, table, write_text
from neuro_agent.compare import NAMES, Comparison

FORMAT = "neuro agent comparison 1"
TABLE = sealed("a table of 'neuro agent compare'", f'"format": "{FORMAT}"', ', "digest": "{}"')
CONTROLS = {
    "agent": "learns",
    "shuffled": "errors of other times",
    "frozen": "no learning",
    "random": "random actions",
    "scrambled": "places permuted at each step",
}


def summary(test: Test) -> str:
    """Return the results of a test in one line."""
    return str(test).removeprefix("Test(").removesuffix(")")


def as_json(test: Test, about: Mapping[str, Any]) -> str:
    """Return all results of a test as JSON."""
    interval = list(test.interval) if len(test.returns) > 1 else None
    figures = {"episodes": len(test.returns), "mean": test.mean, "interval": interval}
    episodes = {"returns": test.returns.tolist(), "lengths": test.lengths.tolist()}
    return json.dumps({**about, **figures, **episodes}, indent=1)


def show_controls(tests: Mapping[str, Test], about: str) -> None:
    """Print a table of the agent and its controls."""
    rows = []
    for name, test in tests.items():
        low, high = test.interval
        interval = f"{low:.5g} to {high:.5g}" if len(test.returns) > 1 else ""
        rows.append((name, CONTROLS[name], f"{test.mean:.5g}", interval, len(test.returns)))
    columns = ("control", "description", ">mean return", ">95 %", ">episodes")
    console().print(table(columns, rows, title=f"{about}; weights frozen"))


def check_table(path: Path) -> None:
    """Raise an error if a table cannot be written to a path, before the trainings begin."""
    check_output(path, TABLE)


def write_table(comparison: Comparison, path: Path) -> None:
    """Write all results as JSON."""
    plan = comparison.plan
    contents = {
        "format": FORMAT,
        "winner": comparison.winner,
        "environment": plan.environment,
        "steps": plan.steps,
        "seeds": list(plan.seeds),
        "episodes": plan.episodes,
        "settings": dict(plan.settings),
        "left_out": comparison.left_out,
        "means": {name: comparison.means(name) for name in comparison.names},
        "provenance": provenance(),
        "each": [dict(result) for result in comparison.each],
    }
    write_text(path, json.dumps(contents, indent=1), TABLE)


def show_comparison(comparison: Comparison) -> None:
    """Print the winner and the table."""
    plan, screen, rows = comparison.plan, console(), []
    for name in comparison.names:
        means, trials = comparison.means(name), [result for result in comparison.each if result["name"] == name]
        spread = f" ± {np.std(means, ddof=1):.3g}" if len(means) > 1 else ""
        steps, seconds = (float(np.mean([result[key] for result in trials])) for key in ("steps", "seconds"))
        rows.append(
            (
                name,
                NAMES[name],
                f"{steps:,.0f}",
                f"{comparison.mean(name):.5g}{spread}",
                f"{min(means):.5g}",
                f"{seconds:.1f}",
            )
        )
    seeds = ", ".join(map(str, plan.seeds))
    title = f"{plan.environment}, seeds {seeds}; weights frozen, {plan.episodes} new episodes each"
    screen.print(comparison.winner, soft_wrap=True, markup=False)
    screen.print(table(("method", "description", ">steps", ">mean return", ">worst seed", ">s"), rows, title=title))
    for name, reason in comparison.left_out.items():
        if not plan.only or name in comparison.failed:
            screen.print(f"not compared: {name}: {reason}", soft_wrap=True, markup=False)
