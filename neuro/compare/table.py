"""A comparison on the terminal."""

from __future__ import annotations

from typing import Any

from neuro.cli.tables import table
from neuro.compare import words
from neuro.compare.result import Comparison

DISTANCE = "distance: edits per spike (Victor and Purpura, 10 ms), 0 where equal, 1 where no spike has a partner"


def show(comparison: Comparison, out: Any) -> None:
    """Print tables of the backends, populations, projections, chips' own counts and bills, then what else to know.

    Args:
        comparison: what was found.
        out: a rich console.
    """
    first = comparison.first.backend
    title = f"{comparison.network}: {comparison.ms:g} ms, seed {comparison.seed}, compared with {first}"
    out.print(table(words.SUMMARY, words.summary(comparison), title=title))
    out.print(table(words.POPULATIONS, words.populations(comparison)))
    out.print(DISTANCE, markup=False)
    for columns, rows in (
        (words.PROJECTIONS, words.projections(comparison)),
        (words.NATIVE, words.natives(comparison)),
        (words.ENERGY, words.bills(comparison)),
    ):
        told = list(rows)
        if told:
            out.print()
            out.print(table(columns, told))
    for line in _remarks(comparison):
        out.print(line, markup=False)


def _remarks(comparison: Comparison) -> list[str]:
    refused = [f"refused: {run.refused}" for run in comparison.runs if run.refused]
    unpriced = [f"no bill for {bill.target}: {bill.reason}" for bill in words.unpriced(comparison)]
    inputs = [
        f"input of {run.backend}: {words.INPUTS[run.inputs]} as on {comparison.first.backend}"
        for run in comparison.ran
        if run.inputs != "same"
    ]
    warnings = [f"warning: {text}" for run in comparison.runs for text in run.warnings]
    return [*refused, *inputs, *warnings, *unpriced, *(f"note: {note}" for note in comparison.notes)]
