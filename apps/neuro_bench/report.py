"""Results as files and tables; the first line of a comparison names the best method."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from neuro import ModelError
from neuro.apps import console, number, sealed, table, write_text
from neuro_bench.costs import break_even
from neuro_bench.running import FORMAT

RESULT = sealed("a result of 'neuro bench run'", f'"format": "{FORMAT}"', ', "digest": "{}"')
SAME = ("tries", "seeds", "folds", "split_seed")
"""Fields of the request that all results of a table must share, besides task, split and data."""
COUNTS = {
    "parameters": "weights", "footprint_bytes": "bytes", "connection_sparsity": "0 w.", "activation_sparsity": "0 act.",
    "effective_macs": "MACs", "effective_acs": "ACs",
}  # fmt: skip
"""Costs in the table, and the titles of their columns."""


def write(result: Mapping[str, Any], path: Path) -> None:
    """Write a result as JSON."""
    write_text(path, json.dumps(_finite(result), indent=1), RESULT)


def read(path: Path) -> dict[str, Any]:
    """Read a result from its file.

    Raises:
        ModelError: the file cannot be read or is not a result of 'neuro bench run'.
    """
    try:
        result = json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:
        result = {}
    if not isinstance(result, dict) or result.get("format") != FORMAT:
        raise ModelError(f"{path}: expected a result of 'neuro bench run'")
    return result


def compared(results: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Sort the results of one table, best first.

    Raises:
        ModelError: the results differ in task, split or data, or in a field of `SAME`.
    """
    first = results[0]
    for result in results[1:]:
        pairs = [(f"task {word}", "task", word) for word in ("name", "split", "metric")]
        pairs += [(word, "asked", word) for word in SAME]
        values = [(label, first[part][word], result[part][word]) for label, part, word in pairs]
        for label, value, other_value in (*values, ("data", first.get("data"), result.get("data"))):
            if value != other_value:
                message = f"results differ in {label}: {value} and {other_value}: expected the same in one table"
                raise ModelError(message)
    sign = -1.0 if first["task"]["higher"] else 1.0
    return sorted(results, key=lambda value: sign * value["mean"])


def verdict(results: Sequence[Mapping[str, Any]]) -> str:
    """Return a line that names the best method and the best method of the other kind, spiking or non-spiking.

    Args:
        results: the results, best first.
    """
    best = results[0]
    spiking, kinds = best["method"]["spiking"], {True: "spiking", False: "non-spiking"}
    name, unit = best["method"]["name"], best["task"]["metric"]
    line = f"{name} wins, a {kinds[spiking]} network or method: {_score(best)} ({unit})"
    rival = next((result for result in results if result["method"]["spiking"] != spiking), None)
    if rival is None:
        return f"{line}; nothing {kinds[not spiking]} was compared"
    gap = abs(best["mean"] - rival["mean"])
    (low, high), (rival_low, rival_high) = _interval(best), _interval(rival)  # NaN of a single score
    note = "; their intervals overlap" if low <= rival_high and rival_low <= high else ""
    return f"{line}; the best {kinds[not spiking]} is {rival['method']['name']}, {_number(gap, best)} behind{note}"


def _interval(result: Mapping[str, Any]) -> tuple[float, float]:
    low, high = (float("nan") if value is None else float(value) for value in result["interval"])
    return low, high


def _score(result: Mapping[str, Any]) -> str:
    mean, low, high = (_number(value, result) for value in (result["mean"], *_interval(result)))
    return mean if low == "nan" else f"{mean} [{low}, {high}]"


def _number(value: float, result: Mapping[str, Any]) -> str:
    """Format a score with two decimals, or three for R2."""
    return f"{value:.{3 if result['task']['metric'].startswith('R2') else 2}f}"


def show(results: Sequence[Mapping[str, Any]]) -> None:
    """Print the table of results, after a line with the best method if there are several results."""
    ordered = compared(results)
    first = ordered[0]
    request, task = first["asked"], first["task"]
    if len(ordered) > 1:
        console().print(verdict(ordered), soft_wrap=True)
    rows = [row(run) for run in ordered]
    head = ("method", "spikes", f">{task['metric']}", *(f">{word}" for word in (*COUNTS.values(), "ms", "cpu s")))
    tries = f"{request['tries']} {'try' if request['tries'] == 1 else 'tries'} each"
    folds = f"{len(first['folds'])} trainings tested"
    console().print(table(head, rows, title=f"{task['title']}; {task['split']} folds; {folds}; {tries}"))
    for line in sensitivity(ordered):
        console().print(line, soft_wrap=True)
    machines = list(dict.fromkeys(name for run in ordered for name in run["costs"]["joules"]))
    if machines:
        bills = [[run["method"]["name"], *(_uj(run["costs"], m) for m in machines)] for run in ordered]
        console().print(table(("method", *(f">{m}" for m in machines)), bills, title="uJ per example"))
    for run in ordered:
        name, costs = run["method"]["name"], run["costs"]
        if host := costs.get("host"):
            counts = f"{number(host['macs'])} mac, {number(host['bytes'])} bytes"
            console().print(
                f"{name}: host: {counts}, {1e6 * host['joules']:.3g} uJ, in its joules on chips", soft_wrap=True
            )
        for machine, cost_names in costs.get("unpriced", {}).items():
            console().print(
                f"{name}: {machine}: without {', '.join(cost_names)} (no published figure), hence >", soft_wrap=True
            )
        for chip, reason in costs.get("refused", {}).items():
            console().print(f"{name}: refused by {chip}: {reason}", soft_wrap=True)


def sensitivity(results: Sequence[Mapping[str, Any]]) -> list[str]:
    """Compare the energy of the best spiking network with the energy of the best non-spiking method that has one.

    Each line states the factor of the number of spikes up to which the spiking network needs less energy.
    """
    spiking = next((result for result in results if result["method"]["spiking"]), None)
    dense = next((result for result in results if not result["method"]["spiking"] and result["costs"]["joules"]), None)
    if spiking is None or dense is None:
        return []
    lines, costs, dense_joules = [], spiking["costs"], dense["costs"]["joules"]
    for chip, spike_joules in costs.get("joules_of_spikes", {}).items():
        for name, joules in dense_joules.items():
            times = break_even(costs["joules"][chip], spike_joules, joules)
            contest = f"{spiking['method']['name']} on {chip} against {dense['method']['name']} on {name}"
            answer = f"fewer joules up to {times:.3g} times its spikes" if times else "more joules, even without spikes"
            lines.append(f"{contest}: {answer}")
    return lines


def row(result: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the row of a result in the table."""
    costs, times_ms = result["costs"], [fold["ms_an_example"] for fold in result["folds"]]
    return (
        result["method"]["name"],
        "yes" if result["method"]["spiking"] else "no",
        _score(result),
        *("-" if costs[word] is None else number(costs[word]) for word in COUNTS),
        f"{sum(times_ms) / len(times_ms):.3g}",
        f"{result['cpu_s']:.0f}",
    )


def _uj(costs: Mapping[str, Any], machine: str) -> str:
    """Format the energy of an example on a machine in uJ, with ">" if a cost has no published figure."""
    joules = costs["joules"].get(machine)
    return "-" if joules is None else "> " * (machine in costs.get("unpriced", {})) + f"{1e6 * joules:.3g}"


def _finite(value: Any) -> Any:
    """Replace infinities and NaN by None, because JSON has neither."""
    if isinstance(value, Mapping):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
