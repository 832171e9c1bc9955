"""A comparison as one page that needs nothing else: no font, no network, no script but its own."""

from __future__ import annotations

from collections.abc import Iterator

from neuro.chips.known import chip
from neuro.chips.quantising.fixed_program import FixedProgram
from neuro.compare import cells
from neuro.compare.chipmap import chip_map
from neuro.compare.raster import rasters
from neuro.compare.result import Comparison, Run
from neuro.core import html
from neuro.core.html import Html, join, table, tag
from neuro.core.outputs import sealed
from neuro.core.version import VERSION
from neuro.pages import raster
from neuro.pages.bills import joules
from neuro.pages.histograms import drawings

PAGE = sealed("a page of 'neuro compare'", '<meta name="generator" content="neuro compare">', "<!-- digest {} -->")

DISTANCE = (
    "The distance is that of Victor and Purpura (1996), divided by the spikes of both runs: adding or removing a spike "
    "costs 1, moving it by 10 ms costs 1. 0 is equal; at 1 no spike has a partner."
)
ENERGY = (
    "Counts times published figures, and static power times the time of the emulated chip, which works as fast as it "
    "can or waits for each step in real time; in brackets the range of the figures. cpu and gpu do the same "
    "work as dense layers: every synapse in every step."
)
ROUNDED = ("population", "quantity", ">described", ">on the chip", "unit", ">error")
SCALED = ("projection", ">exponent", "signs", ">bits", ">step", ">saturated", ">turned to 0", ">largest error", ">rms")


def page(comparison: Comparison) -> str:
    """The page as HTML text."""
    parts = (
        _head(comparison),
        tag("div", *(_card(comparison, run) for run in comparison.runs), class_="cards"),
        _numbers(comparison),
        *_spikes(comparison),
        *_weights(comparison),
        *_maps(comparison),
        *_energy(comparison),
        *_rounding(comparison),
        *_remarks(comparison),
        tag("footer", f"Written by neuro {VERSION} (neuro compare)."),
    )
    return html.page(
        "neuro compare", f"{comparison.network}: a comparison of backends", parts, raster.script(), comparison.record
    )


def _head(comparison: Comparison) -> Html:
    names = [run.backend for run in comparison.runs]
    told = f"{comparison.ms:g} ms in steps of {comparison.resolution_ms:g} ms, seed {comparison.seed}, on "
    backends = f"{', '.join(names[:-1])} and {names[-1]}, each compared with {comparison.first.backend}."
    return tag("header", tag("h1", comparison.network), tag("p", told + backends, class_="lead"))


def _card(comparison: Comparison, run: Run) -> Html:
    """What to know of a backend at a glance."""
    name = tag("h3", run.backend)
    if run.refused:
        head = tag("p", "refused", class_="big")
        return tag("section", name, head, tag("p", cells.reason(run)), class_="card refused")
    assert run.counts is not None
    facts = [("spikes", f"{run.counts.spikes:,}"), ("synaptic operations", f"{run.counts.synaptic_ops:,}")]
    if run is comparison.first:
        big, below = "baseline", "what the others are compared with"
    else:
        equal = sum(part.same for part in run.neurons.values())
        big, below = f"{equal} of {len(run.neurons)}", "populations fire exactly the same spikes"
        facts += [("first difference", cells.earliest(comparison, run)), ("distance", cells.far(run.per_spike))]
    if run.own is not None:
        facts.append(("energy", run.own.totals()))
    rows = [part for what, value in facts for part in (tag("dt", what), tag("dd", value))]
    return tag("section", name, tag("p", big, class_="big"), tag("p", below), tag("dl", *rows), class_="card")


def _numbers(comparison: Comparison) -> Html:
    inputs = [f"on {run.backend} {cells.INPUTS[run.inputs]}" for run in comparison.ran[1:]]
    told = f"Counts that all backends share. Input spikes: {'; '.join(inputs)}."
    natives = list(cells.natives(comparison))
    parts = [tag("h2", "In numbers"), tag("p", told), table(cells.SUMMARY, cells.summary(comparison))]
    return join([*parts, table(cells.NATIVE, natives) if natives else None])


def _spikes(comparison: Comparison) -> Iterator[Html]:
    yield tag("h2", "Spikes")
    yield tag("p", f"A dashed line marks the first difference. {raster.HELP}")
    yield rasters(comparison)
    yield tag("h3", "Populations")
    yield tag("p", DISTANCE)
    yield table(cells.POPULATIONS, cells.populations(comparison))


def _weights(comparison: Comparison) -> Iterator[Html]:
    if not comparison.histograms:
        return
    yield tag("h2", "Weights")
    if any(run.fixed for run in comparison.ran):
        yield tag("p", "Before and after quantisation: as described, and as the weight memory of each chip holds them.")
    chips = [run.backend for run in comparison.ran if run.fixed]
    yield drawings(comparison.histograms, {"described": "as described"} | {name: f"on {name}" for name in chips})
    yield tag("h3", f"At the end of the run, against {comparison.first.backend}")
    if comparison.learnt:
        yield drawings(comparison.learnt, {run.backend: f"on {run.backend}" for run in comparison.ran})
    yield tag("p", "The last column is what quantising alone does to the weights as described.")
    yield table(cells.PROJECTIONS, cells.projections(comparison))


def _maps(comparison: Comparison) -> Iterator[Html]:
    placed = [(run, run.placement) for run in comparison.ran if run.placement is not None]
    if placed:
        yield tag("h2", "Chips")
    for run, placement in placed:
        yield tag("h3", run.backend)
        yield chip_map(placement, chip(run.backend))


def _energy(comparison: Comparison) -> Iterator[Html]:
    yield tag("h2", "Energy")
    yield tag("p", ENERGY)
    yield joules([(f"counts of {bill.counted_on}", bill.energy) for bill in comparison.bills if bill.energy])


def _rounding(comparison: Comparison) -> Iterator[Html]:
    found = [(run.backend, run.fixed) for run in comparison.ran if run.fixed is not None]
    if found:
        yield tag("h2", "Rounding")
        yield tag("p", "What the registers of each chip stand for, of the neuron where they differ most.")
    for name, fixed in found:
        yield tag("h3", name)
        yield table(ROUNDED, _rounded(fixed))
        yield table(SCALED, _scaled(fixed))
        if fixed.notes:
            yield tag("ul", *(tag("li", note) for note in fixed.notes), class_="remarks")


def _rounded(fixed: FixedProgram) -> Iterator[tuple[object, ...]]:
    for part in fixed.populations:
        for i, r in enumerate(part.rounding):
            name = "" if i else part.name
            yield (name, r.quantity, f"{r.wanted:.6g}", f"{r.got:.6g}", r.unit, f"{r.error:+.3%}")


def _scaled(fixed: FixedProgram) -> Iterator[tuple[object, ...]]:
    for part in fixed.projections:
        if part is not None:
            lost = part.rounding
            shares = (f"{share:.3%}" for share in (lost.saturated, lost.zeroed, lost.worst, lost.rms))
            exponent = part.exponent if part.sign_mode else "-"
            yield (part.name, exponent, part.sign_mode or "-", part.bits, f"{part.step.max():.4g}", *shares)


def _remarks(comparison: Comparison) -> Iterator[Html]:
    told = [f"{run.backend} refused: {run.refused}" for run in comparison.runs if run.refused]
    told += [text for run in comparison.runs for text in run.warnings]
    told += [f"no bill for {bill.target}: {bill.reason}" for bill in cells.unpriced(comparison)]
    told += comparison.notes
    yield tag("h2", "Warnings and notes")
    yield tag("ul", *(tag("li", text) for text in told), class_="remarks") if told else tag("p", "None.")
