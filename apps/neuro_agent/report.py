"""What the commands tell: lines, tables and JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from neuro.apps import Test, check_output, console, provenance, sealed, table, write_text
from neuro_agent.compare import NAMES, Found

FORMAT = "neuro agent comparison 1"
TABLE = sealed("a table of 'neuro agent compare'", f'"format": "{FORMAT}"', ', "digest": "{}"')
CONTROLS = {
    "agent": "learns",
    "shuffled": "errors of other times teach",
    "frozen": "nothing teaches",
    "random": "actions are drawn",
    "scrambled": "places are permuted at each step",
}


def told(test: Test) -> str:
    """A test in a few words."""
    return str(test).removeprefix("Test(").removesuffix(")")


def as_json(test: Test, about: Mapping[str, Any]) -> str:
    """All figures of a test."""
    interval = list(test.interval) if len(test.returns) > 1 else None
    figures = {"episodes": len(test.returns), "mean": test.mean, "interval": interval}
    each = {"returns": test.returns.tolist(), "lengths": test.lengths.tolist()}
    return json.dumps({**about, **figures, **each}, indent=1)


def show_controls(found: Mapping[str, Test], about: str) -> None:
    """Print the agent and its controls."""
    rows = []
    for name, test in found.items():
        low, high = test.interval
        interval = f"{low:.5g} to {high:.5g}" if len(test.returns) > 1 else ""
        rows.append((name, CONTROLS[name], f"{test.mean:.5g}", interval, len(test.returns)))
    columns = ("control", "is", ">mean return", ">95 %", ">episodes")
    console().print(table(columns, rows, title=f"{about}; weights frozen"))


def check_table(path: Path) -> None:
    """See whether a table may be written there, before long work."""
    check_output(path, TABLE)


def write_table(found: Found, path: Path) -> None:
    """Write all figures as JSON."""
    plan = found.plan
    whole = {
        "format": FORMAT,
        "winner": found.winner,
        "environment": plan.environment,
        "steps": plan.steps,
        "seeds": list(plan.seeds),
        "episodes": plan.episodes,
        "settings": dict(plan.settings),
        "left_out": found.left_out,
        "means": {name: found.means(name) for name in found.names},
        "provenance": provenance(),
        "each": [dict(one) for one in found.each],
    }
    write_text(path, json.dumps(whole, indent=1), TABLE)


def show_comparison(found: Found) -> None:
    """Print who wins, and the table."""
    plan, out, rows = found.plan, console(), []
    for name in found.names:
        means, own = found.means(name), [one for one in found.each if one["name"] == name]
        spread = f" ± {np.std(means, ddof=1):.3g}" if len(means) > 1 else ""
        steps, seconds = (float(np.mean([one[key] for one in own])) for key in ("steps", "seconds"))
        rows.append(
            (
                name,
                NAMES[name],
                f"{steps:,.0f}",
                f"{found.mean(name):.5g}{spread}",
                f"{min(means):.5g}",
                f"{seconds:.1f}",
            )
        )
    seeds = ", ".join(map(str, plan.seeds))
    title = f"{plan.environment}, seeds {seeds}; weights frozen, {plan.episodes} new episodes each"
    out.print(found.winner, soft_wrap=True, markup=False)
    out.print(table(("who", "is", ">steps", ">mean return", ">worst seed", ">s"), rows, title=title))
    for name, reason in found.left_out.items():
        if not plan.only or name in found.failed:
            out.print(f"not compared: {name}: {reason}", soft_wrap=True, markup=False)
