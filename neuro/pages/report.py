"""Page about a run in a single file, which needs neither the network's description nor a connection."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TypeAlias

import numpy as np

from neuro.chips.energy import Energy
from neuro.core import html
from neuro.core.errors import ModelError, some
from neuro.core.extension import extensions
from neuro.core.html import Html, table, tag
from neuro.core.outputs import sealed
from neuro.core.provenance import provenance
from neuro.core.version import VERSION
from neuro.files.finished_runs import energy
from neuro.files.parts import Train, Weights
from neuro.files.results import Results, spike_columns
from neuro.model.neurons import CurrentGenerator, Generator
from neuro.model.parts import Population
from neuro.pages import raster
from neuro.pages.bills import joules
from neuro.pages.curves import end_ms, rates, traces, world
from neuro.pages.histograms import drawings, histogram
from neuro.pages.raster import Strip, window

PAGE = sealed("a page of 'neuro report'", '<meta name="generator" content="neuro report">', "<!-- digest {} -->")

MOST_STRIPS = 300
MOST_DOTS = 40_000
MOST_DOTS_IN_ALL = 600_000
TALLEST, LOWER = 140, 60
"""Height of a strip in pixels, and its height if there are more than a dozen."""

POPULATIONS = ("population", "model", "shape", ">neurons", ">spikes", ">rate Hz", ">that fired", ">active updates")
PROJECTIONS = (
    "projection", "from", "to", "synapse", ">synapses", ">least weight", ">mean", ">largest", ">operations",
)  # fmt: skip
Described: TypeAlias = Mapping[str, Population]
"""Populations of the described network by name."""

TOTALS = {
    "spikes": "spikes",
    "synaptic_ops": "synaptic operations",
    "neuron_updates": "neuron updates",
    "neuron_updates_active": "of these with an arrival or a spike",
    "learning_updates": "learning updates",
}


def page(results: Results, file: Path, target: str = "loihi") -> str:
    """Return the page as HTML text.

    Args:
        results: results of the run.
        file: path of the results, for the commands on the page.
        target: chip of the bill.
    """
    bill, reason = _bill(results, target)
    described = _described_populations(results)
    has_traces = any(trace.population for trace in results.traces.values())
    parts = (
        _head(results),
        tag("div", *_cards(results, described, bill, target), class_="cards"),
        *_spikes(results, described),
        *([tag("h2", "Traces"), traces(results, "population")] if has_traces else ()),
        *([tag("h2", "World"), world(results)] if "rewards" in results.world else ()),
        *_weights(results, described),
        *_network(results, described),
        *_energy(results, bill, reason, target),
        *_next(results, file),
        tag("footer", f"Written by neuro {VERSION} (neuro report)."),
    )
    record = provenance((os.path.abspath(file), *extensions()))
    return html.page("neuro report", f"{results.about['network']}: a run", parts, raster.script(), record)


def _bill(results: Results, target: str) -> tuple[Energy | None, str]:
    """Return the bill, or the reason for a missing bill."""
    try:
        return energy(results, results.network(played=False), target), ""
    except ModelError as error:
        return None, str(error)


def _head(results: Results) -> Html:
    about = results.about
    line = f"{results.duration_ms:g} ms in steps of {about['resolution_ms']:g} ms on {about['backend']}"
    seed_and_version = f", seed {about['seed']}, by neuro {about['neuro']}."
    note = None if results.finished else tag("p", "The run did not reach its end: the page shows its records so far.")
    return tag("header", tag("h1", about["network"]), tag("p", line + seed_and_version, class_="lead"), note)


def _cards(results: Results, described: Described, bill: Energy | None, target: str) -> Iterator[Html]:
    populations, projections = results.populations, results.projections
    inputs = {
        name for name, part in described.items() if isinstance(part.model, Generator)
    }  # the spikes of generators are not spikes of neurons
    cells = [train for name, train in populations.items() if name not in inputs]
    summary = f"of {some(sum(part.size for part in cells), 'neuron')} in {some(len(cells), 'population')}"
    emitted = sum(populations[name].counts["spikes"] for name in inputs)
    summary += f"; generators emitted {emitted:,} more" if emitted else ""
    yield html.card("spikes", f"{sum(part.counts['spikes'] for part in cells):,}", summary)
    synapses = sum(part.synapses for part in projections.values())
    operations = some(int(results.about["counts.synaptic_ops"]), "operation")
    line = f"in {some(len(projections), 'projection')} carried {operations}"
    yield html.card("synapses", f"{synapses:,}", line)
    returns = results.world.get("returns", ())
    if len(returns):
        n = min(len(returns), 100)
        yield html.card(
            "mean return", f"{returns[-n:].mean():.5g}", f"of the last {n} of {some(len(returns), 'episode')}"
        )
    if bill is not None:
        joules = bill.total()
        yield html.card(f"energy on {target}", joules, bill.totals().removeprefix(joules).lstrip(" :"))


def _spikes(results: Results, described: Described) -> Iterator[Html]:
    yield tag("h2", "Spikes")
    names = [name for name, train in results.populations.items() if train.steps.size]
    if names:
        yield tag("p", raster.HELP)
        yield _raster(results, names[:MOST_STRIPS])
    if len(names) > MOST_STRIPS:
        yield tag("p", f"{len(names) - MOST_STRIPS} more populations are not drawn.")
    silent = [name for name, train in results.populations.items() if train.recorded and train.spikes == 0]
    unrecorded = [n for n, train in results.populations.items() if train.counts["spikes"] and not train.steps.size]
    if silent:
        yield tag("p", f"Silent: {', '.join(silent)}.")
    if unrecorded:
        yield tag("p", f"Not kept: {', '.join(unrecorded)}; neuro run --record NAME keeps them.")
    rows = (_population(name, described, train, results) for name, train in results.populations.items())
    yield table(POPULATIONS, rows)
    if names:
        yield tag("h3", "Rates along time")
        yield rates(results)


def _raster(results: Results, names: list[str]) -> Html:
    """Draw a strip for each population."""
    step, end = float(results.about["resolution_ms"]), end_ms(results)
    most_dots = min(MOST_DOTS, MOST_DOTS_IN_ALL // len(names))
    strips = []
    for name in names:
        train = results.populations[name]
        steps = np.asarray(train.steps)
        part = window(train.size, [(steps, train.ids)], int(results.about["counts.steps"]), most_dots)
        text = f"{train.counts['spikes'] / train.size / (end / 1000.0):.2f} Hz, {part.described(end, step)}"
        strips.append(Strip(name, text, part, {"spike": part.keys(steps, train.ids)}))
    picture = raster.raster(
        strips, end, step, label=f"raster of {', '.join(names)}", tallest=TALLEST if len(names) < 13 else LOWER
    )
    return html.figure(picture, "Each row is a neuron, the first at the bottom.", class_="raster")


def _described_populations(results: Results) -> Described:
    """Return the described populations, because compiling changes the model of a recording; {} if unknown."""
    try:
        return results.network().populations
    except ModelError:
        return {}


def _weight_unit(described: Described, part: Weights) -> str:
    """Return the unit of a projection's weights; "" for currents and unknown units."""
    if part.target not in described or isinstance(described[part.source].model, CurrentGenerator):
        return ""
    return str(getattr(described[part.target].model, "weight_unit", ""))


def _population(name: str, described: Described, train: Train, results: Results) -> tuple[object, ...]:
    model = described[name].model.name if name in described else train.model  # a recording is compiled to another model
    fired = f"{np.unique(train.ids).size:,}" if train.recorded else "-"
    shape = " x ".join(map(str, train.shape))
    active = f"{train.counts['neuron_updates_active']:,}"
    return (
        name,
        model,
        shape,
        f"{train.size:,}",
        *spike_columns(train.spikes, train.size, end_ms(results)),
        fired,
        active,
    )


def _weights(results: Results, described: Described) -> Iterator[Html]:
    histograms = [
        histogram(name, _weight_unit(described, part), {"end": part.weight.ravel()})
        for name, part in results.projections.items()
        if part.weight is not None and part.weight.size
    ]
    has_traces = any(trace.projection for trace in results.traces.values())
    if histograms or has_traces:
        yield tag("h2", "Weights")
    if has_traces:
        yield tag("h3", "Along time")
        yield traces(results, "projection")
    if histograms:
        yield tag("h3", "At the end of the run")
        yield drawings(histograms, {"end": "at the end"})


def _network(results: Results, described: Described) -> Iterator[Html]:
    yield tag("h2", "Network")
    if results.projections:
        yield table(PROJECTIONS, (_projection(described, name, part) for name, part in results.projections.items()))
    else:
        yield tag("p", "Nothing is connected.")
    yield tag("h3", "Counts")
    yield table(("what", ">count"), [(label, f"{int(results.about[f'counts.{n}']):,}") for n, label in TOTALS.items()])


def _projection(described: Described, name: str, part: Weights) -> tuple[object, ...]:
    w = part.weight
    valid = w is not None and w.size > 0
    unit = _weight_unit(described, part)
    weights = (
        [f"{n:.4g} {unit}".rstrip() for n in (w.min(), w.mean(), w.max())] if valid and w is not None else ["-"] * 3
    )
    return (
        name,
        part.source,
        part.target,
        part.synapse_text,
        f"{part.synapses:,}",
        *weights,
        f"{part.counts['synaptic_ops']:,}",
    )


def _energy(results: Results, bill: Energy | None, reason: str, target: str) -> Iterator[Html]:
    yield tag("h2", "Energy")
    if bill is None:
        yield tag("p", f"There is no bill of {target}:")
        yield tag("ul", tag("li", reason), class_="remarks")
    else:
        yield tag("p", "Counts times published figures, and static power times the time of the emulated chip.")
        yield joules([(f"counts of {results.about['backend']}", bill)])


def _next(results: Results, file: Path) -> Iterator[Html]:
    name, net = shlex.quote(str(file)), "net.yaml"
    options = f"net.yaml --for {results.duration_ms:g} --seed {results.about['seed']}"
    read = f'from neuro import results\nresults.read("{file}").network().save("{net}")'
    yield tag("h2", "What next")
    yield tag("p", "Pictures of the run as files:")
    yield tag("pre", f"neuro plot {name}")
    yield tag("p", "The network is in the file; in Python:")
    yield tag("pre", read)
    yield tag("p", "Comparison with chips, with their energy and fit:")
    yield tag("pre", f"neuro compare {options} --html compare.html\nneuro energy {options}\nneuro fit {net}")
