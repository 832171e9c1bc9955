"""What it takes to recognise a recording, on chips and as dense layers: a table, and where its figures come from."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import TYPE_CHECKING

import typer

import neuro
from neuro import ModelError
from neuro.apps import console, number, quantity, table
from neuro.chips import footnotes
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.telling.tried import Tried

FORMAT = "neuro recognise energy 1"

if TYPE_CHECKING:
    from neuro.chips import Energy

FRONT_END = (
    "not in the bill: the camera, the front end, which makes spikes of events on the host, and the way between "
    "host and chip"
)


def check_targets(recogniser: Recogniser, targets: Iterable[str]) -> None:
    """Refuse targets before anything is run.

    Raises:
        ModelError: the recogniser is no network, there is no such target, the network does not fit on it, or it has no
            published costs.
    """
    net = recogniser.network()
    if net is None:
        name = recogniser.method.called()
        raise ModelError(f"method '{name}' is no network: expected one that chips can run", hint="neuro recognise list")
    if told := recogniser.method.unpriced:
        raise ModelError(f"method '{recogniser.method.called()}' has no bill: {told}")
    sim = neuro.compile(net)
    for name in targets:
        sim.energy(name)


def bills(tried: Tried, targets: Iterable[str]) -> tuple[Energy, ...]:
    """The bill of a recording on each target.

    Args:
        tried: what a network was run on, on any backend.
        targets: chips, processors or table files, see `neuro.Simulation.energy`.

    Raises:
        ModelError: as of `check_targets`.
    """
    sim, results = _run(tried)
    return tuple(sim.energy(name, of=results).per(tried.own.n, "recording") for name in targets)


def counted(tried: Tried) -> dict[str, float]:
    """What a recording takes on the mean, whatever runs it; frames where it is shown as trials."""
    sim, results = _run(tried)
    counts, n = _counts(tried), tried.own.n
    inputs = [name for name, part in sim.network().populations.items() if isinstance(part.model, neuro.spike_generator)]
    told = {} if results is None else {"frames": len(results)}
    told |= {
        "steps": counts.steps,
        "input_spikes": sum(counts.populations[name].spikes for name in inputs),
        "synaptic_ops": counts.synaptic_ops,
        "neuron_updates": counts.neuron_updates,
        "neuron_updates_active": counts.neuron_updates_active,
    }
    return {name: count / n for name, count in told.items()}


def notes(tried: Tried, priced: Iterable[Energy]) -> list[str]:
    """What the bills do not include, and what dense layers would take if they were run once a frame."""
    results = _run(tried)[1]
    dense = {bill.target: bill.by_cost()["mac"] for bill in priced if "mac" in bill.by_cost()}
    if not dense or results is None:
        return [FRONT_END]
    steps, frames = results.counts.steps, len(results)
    once = ", ".join(f"{name} {quantity(joules * frames / steps, 'J')}" for name, joules in dense.items())
    return [FRONT_END, f"dense layers once a frame, not in each of its {number(steps / frames)} steps: {once}"]


def words(recogniser: Recogniser, tried: Tried, priced: tuple[Energy, ...]) -> str:
    """The bills, the counts and the accuracy as JSON."""
    own = tried.own
    about: dict[str, object] = {"format": FORMAT, "method": recogniser.method.called()}
    about |= {"backend": _run(tried)[0].backend, "accuracy": own.accuracy, "interval": list(own.interval)}
    about |= {"recordings": own.n, "per_recording": counted(tried)}
    return json.dumps(about | {"bills": [bill.as_dict() for bill in priced], "notes": notes(tried, priced)}, indent=1)


def show(recogniser: Recogniser, tried: Tried, priced: tuple[Energy, ...]) -> None:
    """Print a row for each target, what was counted, and the sources."""
    own = tried.own
    low, high = own.interval
    right = f"{own.accuracy:.1%} of {own.n} right (95 % interval {low:.1%} - {high:.1%})"
    title = f"energy per recording; {right} by {recogniser.method.called()} on {_run(tried)[0].backend}"
    columns = ("target", "what", ">dynamic", ">static", ">total", ">chip time, us", ">chips")
    console().print(table(columns, map(_row, priced), title=title))
    counts = counted(tried)
    told = ", ".join(f"{number(count)} {name.replace('_', ' ')}" for name, count in counts.items())
    typer.echo(f"a recording: {told}\n")
    for line in (*footnotes(priced), *notes(tried, priced)):
        typer.echo(f"- {line}")


def _run(tried: Tried) -> tuple[neuro.Simulation, neuro.TrialCounts | None]:
    """What ran, and what its trials took; None where it ran without."""
    assert tried.answer.run is not None, "of a network only"
    return tried.answer.run


def _counts(tried: Tried) -> neuro.Counts:
    sim, results = _run(tried)
    return sim.counts() if results is None else results.counts


def _row(bill: Energy) -> tuple[str, ...]:
    if bill.chip_time_s is None:
        return (bill.target, bill.title, *bill.sums(), "-", "-")
    return (bill.target, bill.title, *bill.sums(), f"{bill.chip_time_s * 1e6:,.0f}", str(bill.chips))
