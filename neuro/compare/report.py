"""Page about a comparison, self-contained: no other fonts, scripts or network connections."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from neuro.chips.description import Chip, Mesh, mesh_of
from neuro.chips.energy import FASTEST
from neuro.chips.fixed_program import FixedProgram
from neuro.chips.known import chip
from neuro.chips.placing import Core, Placement
from neuro.compare import cells
from neuro.compare.result import Comparison, Run
from neuro.core import html
from neuro.core.html import Html, join, table, tag
from neuro.core.outputs import sealed
from neuro.core.version import VERSION
from neuro.pages import raster
from neuro.pages.bills import joules
from neuro.pages.histograms import drawings
from neuro.pages.raster import Strip, Window, window

PAGE = sealed("a page of 'neuro compare'", '<meta name="generator" content="neuro compare">', "<!-- digest {} -->")

DISTANCE = (
    "The distance is that of Victor and Purpura (1996), divided by the spikes of both runs: adding or removing a spike "
    "costs 1, moving it by 10 ms costs 1. 0 is equal; at 1 no spike has a partner."
)
ENERGY = (
    "Counts times published figures, and static power times the time of the emulated chip, which works as fast as it "
    "can or waits for each step in real time; in brackets the range of the figures. cpu and gpu do the same "
    "work as dense layers: every synapse in every step. A total behind > lacks costs for which no figure is published: "
    "static power, or learning; the notes name them. A chip that refuses the network has no total. - stands where no "
    "time is known."
)
ROUNDED = ("population", "quantity", ">described", ">on the chip", "unit", ">error")
SCALED = ("projection", ">exponent", "signs", ">bits", ">step", ">saturated", ">turned to 0", ">largest error", ">rms")


def page(comparison: Comparison) -> str:
    """Return the page as HTML text."""
    parts = (
        _head(comparison),
        tag("div", *(_card(comparison, run) for run in comparison.runs), class_="cards"),
        _numbers(comparison),
        *_spikes(comparison),
        *_weights(comparison),
        *_maps(comparison),
        tag("h2", "Energy"),
        tag("p", ENERGY),
        joules([(f"counts of {bill.counted_on}", bill.energy) for bill in comparison.bills if bill.energy]),
        *_rounding(comparison),
        *_remarks(comparison),
        tag("footer", f"Written by neuro {VERSION} (neuro compare)."),
    )
    return html.page(
        "neuro compare", f"{comparison.network}: a comparison of backends", parts, raster.script(), comparison.record
    )


def _head(comparison: Comparison) -> Html:
    names = [run.backend for run in comparison.runs]
    line = f"{comparison.ms:g} ms in steps of {comparison.resolution_ms:g} ms, seed {comparison.seed}, on "
    backends = f"{', '.join(names[:-1])} and {names[-1]}, each compared with {comparison.first.backend}."
    return tag("header", tag("h1", comparison.network), tag("p", line + backends, class_="lead"))


def _card(comparison: Comparison, run: Run) -> Html:
    """Return the card of a backend with its main facts."""
    name = tag("h3", run.backend)
    if run.refused:
        head = tag("p", "refused", class_="big")
        return tag("section", name, head, tag("p", run.reason), class_="card refused")
    assert run.counts is not None
    facts = [("spikes", f"{run.counts.spikes:,}"), ("synaptic operations", f"{run.counts.synaptic_ops:,}")]
    if run is comparison.first:
        result, explanation = "baseline", "reference of the comparison"
    else:
        equal = sum(part.same for part in run.neurons.values())
        result, explanation = f"{equal} of {len(run.neurons)}", "populations fire exactly the same spikes"
        facts += [("first difference", cells.earliest(comparison, run)), ("distance", cells.far(run.per_spike))]
    if run.own is not None:
        facts.append((f"energy, {FASTEST}", run.own.total(3)))
    rows = [part for term, value in facts for part in (tag("dt", term), tag("dd", value))]
    return tag("section", name, tag("p", result, class_="big"), tag("p", explanation), tag("dl", *rows), class_="card")


def _numbers(comparison: Comparison) -> Html:
    inputs = [f"on {run.backend} {cells.INPUTS[run.inputs]}" for run in comparison.ran[1:]]
    counts = f"Counts that all backends share; - where nothing is compared. Input spikes: {'; '.join(inputs)}."
    natives = list(cells.natives(comparison))
    parts = [tag("h2", "In numbers"), tag("p", counts), table(cells.SUMMARY, cells.summary(comparison))]
    worlds = list(cells.worlds(comparison))
    parts += [table(cells.WORLD, worlds)] if worlds else []
    return join([*parts, html.folded("Counts of one backend alone", table(cells.NATIVE, natives)) if natives else None])


def _spikes(comparison: Comparison) -> Iterator[Html]:
    yield tag("h2", "Spikes")
    yield tag("p", f"A dashed line marks the first difference. {raster.HELP}")
    yield rasters(comparison)
    populations = table(cells.POPULATIONS, cells.populations(comparison))
    yield html.folded("Rates, first differences and distances of each population", tag("p", DISTANCE), populations)


def _weights(comparison: Comparison) -> Iterator[Html]:
    if not comparison.histograms:
        return
    yield tag("h2", "Weights")
    if any(run.fixed for run in comparison.ran):
        yield tag("p", "Weights as described, and as stored in the weight memory of each chip after quantisation.")
    chips = [run.backend for run in comparison.ran if run.fixed]
    yield drawings(comparison.histograms, {"described": "as described"} | {name: f"on {name}" for name in chips})
    yield tag("h3", f"At the end of the run, against {comparison.first.backend}")
    if comparison.learnt:
        yield drawings(comparison.learnt, {run.backend: f"on {run.backend}" for run in comparison.ran})
    yield tag("p", "The last column is the effect of quantisation alone on the described weights.")
    yield table(cells.PROJECTIONS, cells.projections(comparison))


def _maps(comparison: Comparison) -> Iterator[Html]:
    placements = [(run, run.placement) for run in comparison.ran if run.placement is not None]
    if placements:
        yield tag("h2", "Chips")
    for run, placement in placements:
        yield tag("h3", run.backend)
        yield chip_map(placement, chip(run.backend))


def _rounding(comparison: Comparison) -> Iterator[Html]:
    fixed_programs = [(run.backend, run.fixed) for run in comparison.ran if run.fixed is not None]
    if fixed_programs:
        yield tag("h2", "Rounding")
        yield tag("p", "Values represented by the registers of each chip, for the neuron with the largest difference.")
    for name, fixed in fixed_programs:
        notes = tag("ul", *(tag("li", note) for note in fixed.notes), class_="remarks") if fixed.notes else None
        yield html.folded(name, table(ROUNDED, _rounded(fixed)), table(SCALED, _scaled(fixed)), notes)


def _rounded(fixed: FixedProgram) -> Iterator[tuple[object, ...]]:
    for part in fixed.populations:
        for i, r in enumerate(part.rounding):
            name = "" if i else part.name
            yield (name, r.quantity, f"{r.exact:.6g}", f"{r.got:.6g}", r.unit, f"{r.error:+.3%}")


def _scaled(fixed: FixedProgram) -> Iterator[tuple[object, ...]]:
    for part in fixed.projections:
        if part is not None:
            rounding = part.rounding
            shares = (f"{share:.3%}" for share in (rounding.saturated, rounding.zeroed, rounding.worst, rounding.rms))
            exponent = part.exponent if part.sign_mode else "-"
            yield (part.name, exponent, part.sign_mode or "-", part.bits, f"{part.step.max():.4g}", *shares)


def _remarks(comparison: Comparison) -> Iterator[Html]:
    remarks = [f"{run.backend} refused: {run.refused}" for run in comparison.runs if run.refused]
    remarks += [text for run in comparison.runs for text in run.warnings]
    remarks += [f"no bill for {bill.target}: {bill.reason}" for bill in cells.unpriced(comparison)]
    remarks += comparison.notes
    yield tag("h2", "Warnings and notes")
    notes = tag("ul", *(tag("li", text) for text in remarks), class_="remarks") if remarks else tag("p", "None.")
    yield html.folded(f"{len(remarks)} warnings and notes", notes) if len(remarks) > MOST_REMARKS else notes


MOST_REMARKS = 5
"""Number of warnings and notes above which they are folded."""

MOST_DOTS = 40_000
MOST_DOTS_IN_ALL = 400_000
MOST_POPULATIONS = 40


def rasters(comparison: Comparison) -> Html:
    """Return a drawing for each population, neurons first, then input."""
    populations = comparison.first.populations
    order = sorted(populations, key=lambda name: populations[name].generator)
    active = [name for name in order if any(run.populations[name].spikes for run in comparison.ran)]
    names, silent = active[:MOST_POPULATIONS], [name for name in order if name not in active]
    dots = min(MOST_DOTS, MOST_DOTS_IN_ALL // max(1, len(names) * len(comparison.ran)))
    parts: list[object] = [_raster(comparison, name, dots) for name in names]
    if len(active) > len(names):
        parts.append(tag("p", f"{MOST_POPULATIONS} populations are drawn, {len(active) - len(names)} more are not."))
    if silent:
        parts.append(tag("p", f"Silent on every backend: {', '.join(silent)}."))
    name = comparison.first.backend
    kinds = (("same", f"as on {name}"), ("extra", f"only here, not on {name}"), ("missing", f"on {name}, not here"))
    return html.join([html.legend(*kinds), *parts])


def _raster(comparison: Comparison, name: str, dots: int) -> Html:
    ms, resolution = comparison.ms, comparison.resolution_ms
    trains = [(run.trains[name].steps, run.trains[name].ids) for run in comparison.ran]
    divergences = [run.populations[name].first for run in comparison.ran]
    differing_neurons = [divergence.neuron for divergence in divergences if divergence is not None]
    part = comparison.first.populations[name]
    drawn_window = window(part.neurons, trains, round(ms / resolution), dots, differing_neurons)
    strips = [_strip(comparison, run, name, drawn_window) for run in comparison.ran]
    label = f"raster of {name} on {', '.join(run.backend for run in comparison.ran)}"
    picture = raster.raster(strips, ms, resolution, label=label, linked=True)
    kind = "input, " if part.generator else ""
    return html.figure(picture, kind + drawn_window.described(ms, resolution), name, "raster")


def _strip(comparison: Comparison, run: Run, name: str, drawn_window: Window) -> Strip:
    """Return the strip of a backend, with the differences from the spikes of the first backend."""
    trains = (run.trains[name], comparison.first.trains[name])
    own_keys, first_keys = (drawn_window.keys(train.steps, train.ids) for train in trains)
    part = run.populations[name]
    kinds = {
        "same": np.intersect1d(own_keys, first_keys),
        "missing": np.setdiff1d(first_keys, own_keys),
        "extra": np.setdiff1d(own_keys, first_keys),
    }
    mark = None if part.first is None or run is comparison.first else part.first.ms
    return Strip(
        run.backend, f"{part.rate_hz:{'.3g' if part.rate_hz < 1000 else ',.0f'}} Hz", drawn_window, kinds, mark
    )


CORE, TILE_GAP, CHIP_GAP = 24.0, 7.0, 26.0
_HEAD = 20.0
MOST_CHIPS, MOST_ROWS = 48, 200
CORE_COLUMNS = (">chip", ">tile", ">core", "holds", ">neurons", ">bytes", ">fullest")
LIMITS = {
    "neurons_per_core": "neurons",
    "synapse_bytes_per_core": "synaptic memory",
    "axons_in_per_core": "axons in",
    "axons_out_per_core": "axons out",
}


def chip_map(placement: Placement, chip: Chip) -> Html:
    """Return a map of all chips in use. Pointing at a core shows its content."""
    mesh = mesh_of(chip, len(placement.cores))
    numbers = sorted({core.chip for core in placement.cores})[:MOST_CHIPS]
    cores = [core for core in placement.cores if core.chip in numbers]
    side = math.ceil(math.sqrt(mesh.cores_per_tile))
    width, height = _tile(side) * mesh.columns + TILE_GAP, _tile(_rows(mesh, side)) * mesh.rows + TILE_GAP
    corner = {core.chip: (core.column // mesh.columns, core.row // mesh.rows) for core in cores}
    parts: list[object] = []
    for number, (column, row) in sorted(corner.items()):
        x, y = column * (width + CHIP_GAP), row * (height + CHIP_GAP + _HEAD)
        parts.append(html.text(x + 2, y + 13, f"chip {number}", "tick"))
        parts.append(_chip(mesh, side, x, y + _HEAD, width, height))
    parts += [_core(placement, mesh, side, core, width, height) for core in cores]
    map_width = (1 + max((column for column, _ in corner.values()), default=0)) * (width + CHIP_GAP) - CHIP_GAP
    map_height = (1 + max((row for _, row in corner.values()), default=0)) * (height + CHIP_GAP + _HEAD) - CHIP_GAP
    label = f"map of {placement.chips_used} chips of {chip.title}"
    drawing = html.svg(map_width + 2, map_height + 2, *parts, label=label, class_="map")
    return html.join([html.figure(html.join([_scale(), drawing]), _caption(placement, chip, mesh)), _list(placement)])


def _list(placement: Placement) -> Html:
    """Return the cores as a table, for readers on paper or without a mouse."""
    rows = [
        (*_place(core), neurons_on(placement, core), f"{core.neurons:,}", f"{core.synapse_bytes:,}", _full(core))
        for core in placement.cores[:MOST_ROWS]
    ]
    n_left_out = len(placement.cores) - len(rows)
    more = tag("p", f"and {n_left_out:,} more") if n_left_out else None
    return html.folded("Cores", html.table(CORE_COLUMNS, rows), more)


def _place(core: Core) -> tuple[str, str, str]:
    return f"{core.chip}", f"{core.column},{core.row}", f"{core.slot}"


def _full(core: Core) -> str:
    name, share = max(core.load.items(), key=lambda pair: pair[1], default=("", 0.0))
    return f"{share:.0%} {LIMITS.get(name, name)}" if name else "-"


def _tile(cores: int) -> float:
    return cores * CORE + TILE_GAP


def _rows(mesh: Mesh, side: int) -> int:
    return math.ceil(mesh.cores_per_tile / side)


def _chip(mesh: Mesh, side: int, x: float, y: float, width: float, height: float) -> Html:
    """Draw the outline of a chip and its empty cores."""
    cells = [
        _spot(mesh, side, column, row, slot)
        for row in range(mesh.rows)
        for column in range(mesh.columns)
        for slot in range(mesh.cores_per_tile)
    ]
    n = CORE - 2
    path = "".join(f"M{x + left:.0f} {y + top:.0f}h{n:.0f}v{n:.0f}h-{n:.0f}z" for left, top in cells)
    outline = tag("rect", x=x + 1, y=y + 1, width=width, height=height, rx=4, class_="chip")
    return html.join([outline, tag("path", d=path, class_="empty")])


def _spot(mesh: Mesh, side: int, column: int, row: int, slot: int) -> tuple[float, float]:
    """Return the position of a core on its chip."""
    left = TILE_GAP + column * _tile(side) + (slot % side) * CORE
    return left + 1, TILE_GAP + row * _tile(_rows(mesh, side)) + (slot // side) * CORE + 1


def _core(placement: Placement, mesh: Mesh, side: int, core: Core, width: float, height: float) -> Html:
    left, top = _spot(mesh, side, core.column % mesh.columns, core.row % mesh.rows, core.slot)
    x = core.column // mesh.columns * (width + CHIP_GAP) + left
    y = core.row // mesh.rows * (height + CHIP_GAP + _HEAD) + _HEAD + top
    load = max(core.load.values(), default=0.0)
    kind = "core over" if load > 1.0 else "core"
    return html.box(x, y, CORE - 2, CORE - 2, kind, title(placement, core), 0.18 + 0.82 * min(load, 1.0))


def neurons_on(placement: Placement, core: Core) -> str:
    """Return the neurons on a core by population, e.g. "cells[0:128], output[0:10]"."""
    return ", ".join(f"{placement.populations[p]}[{first}:{last}]" for p, first, last in core.parts)


def title(placement: Placement, core: Core) -> str:
    """Return the content and the load of a core as text."""
    loads = ", ".join(f"{LIMITS.get(name, name)} {share:.0%}" for name, share in core.load.items())
    position = "chip {}, tile {}, core {}".format(*_place(core))
    size = f"{core.neurons:,} neuron{'s' * (core.neurons != 1)}, {core.synapse_bytes:,} bytes of synapses"
    return f"{position}\n{neurons_on(placement, core)}\n{size}\n{loads}"


def _scale() -> Html:
    steps = (html.box(i * 15.0, 0, 14, 10, "core", "", 0.18 + 0.82 * i / 7) for i in range(8))
    drawing = html.svg(120, 10, *steps, label="from empty to full")
    parts = ("empty", drawing, "full, by the closest limit")
    return tag("p", *(part if isinstance(part, Html) else tag("span", part) for part in parts), class_="scale")


def _caption(placement: Placement, chip: Chip, mesh: Mesh) -> str:
    fullest = max(placement.cores, key=lambda core: max(core.load.values(), default=0.0), default=None)
    cores_per_chip = mesh.columns * mesh.rows * mesh.cores_per_tile
    remarks = [
        f"{len(placement.cores):,} of {cores_per_chip * placement.chips_used:,} cores on {placement.chips_used:,} "
        f"chip{'s' * (placement.chips_used != 1)} of {chip.title}",
        f"{placement.synapse_bytes:,} bytes of synapses",
        f"{placement.total_hops:,} hops if every source spikes once",
    ]
    if fullest is not None and fullest.load:
        name, share = max(fullest.load.items(), key=lambda pair: pair[1])
        remarks.append(f"the fullest core uses {share:.0%} of its {LIMITS.get(name, name)}")
    if placement.chips_used > MOST_CHIPS:
        remarks.append(f"{MOST_CHIPS} chips are drawn")
    return "; ".join(remarks) + ". Pointing at a core shows its content."
