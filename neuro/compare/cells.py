"""Tables of a comparison, for the terminal and the page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from neuro.chips.energy import COLUMNS, quantity
from neuro.compare.differences import Divergence
from neuro.compare.result import Bill, Comparison, Run
from neuro.core.tables import table

INPUTS = {"same": "the same", "merged": "the same, several spikes in a step as one", "other": "not the same"}

COUNTS = (">spikes", ">synaptic ops", ">active updates", ">learning")
SUMMARY = ("backend", *COUNTS, ">distance", "first difference")
POPULATIONS = ("population", "backend", ">neurons", ">spikes", ">rate Hz", "first difference", ">distance")
PROJECTIONS = ("projection", "backend", ">largest", ">rms", ">relative rms", ">by rounding")
ENERGY = ("chip", "counts of", *COLUMNS)
WORLD = ("backend", ">steps", ">episodes", ">mean return", ">decisions alike", ">a step")
NATIVE = ("backend", "counted on it only", ">count")


def summary(comparison: Comparison) -> Iterator[tuple[str, ...]]:
    """Yield a row for each backend, with the reason of a refusal."""
    for run in comparison.runs:
        if run.counts is None:
            yield (run.backend, *5 * "-", f"refused: {run.reason}")
            continue
        c = run.counts
        numbers = (f"{n:,}" for n in (c.spikes, c.synaptic_ops, c.neuron_updates_active, c.learning_updates))
        yield (run.backend, *numbers, far(run.per_spike), earliest(comparison, run))


def earliest(comparison: Comparison, run: Run) -> str:
    """Return time and neuron of the first difference of a run from the first run."""
    return "-" if run is comparison.first else run.first_difference()


def populations(comparison: Comparison) -> Iterator[tuple[str, ...]]:
    """Yield a row for each population on each backend."""
    for name in comparison.first.populations:
        for run in comparison.ran:
            part = run.populations[name]
            kind = f"{name} (input)" if part.generator else name
            names = (kind if run is comparison.first else "", run.backend)
            figures = (f"{part.neurons:,}", f"{part.spikes:,}", f"{part.rate_hz:.2f}")
            differences = ("", "")
            if run is not comparison.first:
                difference = "none" if part.first is None else where(part.first)
                differences = (difference, far(part.distance.per_spike if part.distance else None))
            yield (*names, *figures, *differences)


def where(divergence: Divergence) -> str:
    """Return time, neuron and kind of a first difference as text."""
    return f"{divergence.ms:g} ms, neuron {divergence.neuron}: {'missing' if divergence.only_in_first else 'extra'}"


def projections(comparison: Comparison) -> Iterator[tuple[str, ...]]:
    """Yield a row for each projection on each backend after the first."""
    for part in comparison.histograms:
        runs = [run for run in comparison.ran if part.projection in run.weights]
        for run in runs:
            difference = run.weights[part.projection]
            name = part.projection if run is runs[0] else ""
            by_rounding = (run.rounding or {}).get(part.projection)
            share = "-" if by_rounding is None else f"{by_rounding.relative:.3%}"
            numbers = (f"{difference.largest:.4g} {part.unit}".rstrip(), f"{difference.rms:.4g} {part.unit}".rstrip())
            yield (name, run.backend, *numbers, f"{difference.relative:.3%}", share)
        for k, run in enumerate(run for run in runs if part.projection in run.delays):
            delay = run.delays[part.projection]
            name = "" if k else f"{part.projection}: delays"
            yield (name, run.backend, f"{delay.largest:.4g} ms", f"{delay.rms:.4g} ms", f"{delay.relative:.3%}", "-")


def bills(comparison: Comparison) -> Iterator[tuple[str, ...]]:
    """Yield a row for each bill. `unpriced` lists the missing bills."""
    for bill in comparison.bills:
        e = bill.energy
        if e is not None:
            yield (bill.target, bill.counted_on, *e.cells())


def unpriced(comparison: Comparison) -> Iterator[Bill]:
    """Return the bills without energy, which have a reason instead."""
    return (bill for bill in comparison.bills if bill.energy is None)


def natives(comparison: Comparison) -> Iterator[tuple[str, ...]]:
    """Yield a row for each of a backend's own counts."""
    for run in comparison.ran:
        assert run.counts is not None
        for name, count in run.counts.native.items():
            yield (run.backend, name, f"{count:,}")


def worlds(comparison: Comparison) -> Iterator[tuple[str, ...]]:
    """Yield a row for each backend of a network with a world."""
    for run in comparison.ran:
        if (world := run.world) is not None:
            mean = "-" if world.mean_return is None else f"{world.mean_return:.5g}"
            equal_share = "-" if run is comparison.first else f"{world.same:.1%}"
            bill = run.own
            joules = "-" if bill is None or bill.refused else quantity(bill.total_j / max(world.steps, 1), "J")
            yield (run.backend, f"{world.steps:,}", f"{world.episodes:,}", mean, equal_share, joules)


def far(per_spike: float | None) -> str:
    """Return a distance per spike as text."""
    return "-" if per_spike is None else f"{per_spike:.3f}" if per_spike == 0 or per_spike >= 0.0005 else "<0.001"


DISTANCE = "distance: edits per spike (Victor and Purpura, 10 ms), 0 for equal trains, 1 if no spike has a partner"


def show(comparison: Comparison, out: Any) -> None:
    """Print tables of backends, populations, projections, chips' own counts and bills, then remarks.

    Args:
        comparison: the comparison.
        out: a rich console.
    """
    baseline = comparison.first.backend
    title = f"{comparison.network}: {comparison.ms:g} ms, seed {comparison.seed}, compared with {baseline}"
    out.print(table(SUMMARY, summary(comparison), title=title))
    out.print(table(POPULATIONS, populations(comparison)))
    out.print(DISTANCE, markup=False)
    for columns, rows in (
        (WORLD, worlds(comparison)),
        (PROJECTIONS, projections(comparison)),
        (NATIVE, natives(comparison)),
        (ENERGY, bills(comparison)),
    ):
        table_rows = list(rows)
        if table_rows:
            out.print()
            out.print(table(columns, table_rows))
    for line in _remarks(comparison):
        out.print(line, markup=False)


def _remarks(comparison: Comparison) -> list[str]:
    refused = [f"refused: {run.refused}" for run in comparison.runs if run.refused]
    no_bills = [f"no bill for {bill.target}: {bill.reason}" for bill in unpriced(comparison)]
    inputs = [
        f"input of {run.backend}: {INPUTS[run.inputs]} as on {comparison.first.backend}"
        for run in comparison.ran
        if run.inputs != "same"
    ]
    warnings = [f"warning: {text}" for run in comparison.runs for text in run.warnings]
    return [*refused, *inputs, *warnings, *no_bills, *(f"note: {note}" for note in comparison.notes)]
