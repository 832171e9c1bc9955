"""What it takes to recognise a recording, on chips and as dense layers: a table, and where its figures come from."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import TYPE_CHECKING

import typer

from neuro.apps import console, number, quantity, sealed, table
from neuro.chips import footnotes
from neuro_remus.model import Model
from neuro_remus.tried import Tried

FORMAT = "neuro remus energy 1"
BILLS = sealed("the bills of 'neuro remus demo'", f'"format": "{FORMAT}"', ', "digest": "{}"')

if TYPE_CHECKING:
    from neuro.chips import Energy

FRONT_END = (
    "not in the bill: the camera, the front end, which makes C1 spikes of events on the host, and the way between "
    "host and chip"
)


def bills(tried: Tried, targets: Iterable[str]) -> tuple[Energy, ...]:
    """The bill of a recording on each target.

    Args:
        tried: what was run, on any backend.
        targets: chips, processors or table files, see `neuro.Simulation.energy`.

    Raises:
        ModelError: there is no such target, the network does not fit on it, or it has no published costs.
    """
    return tuple(tried.sim.energy(name, of=tried.trials).per(tried.recordings, "recording") for name in targets)


def counted(tried: Tried) -> dict[str, float]:
    """What a recording takes on the mean, whatever runs it."""
    counts, n = tried.trials.counts, tried.recordings
    told = {
        "frames": len(tried.trials),
        "steps": counts.steps,
        "input_spikes": counts.populations["c1"].spikes,
        "synaptic_ops": counts.synaptic_ops,
        "neuron_updates": counts.neuron_updates,
        "neuron_updates_active": counts.neuron_updates_active,
    }
    return {name: count / n for name, count in told.items()}


def notes(tried: Tried, priced: Iterable[Energy]) -> list[str]:
    """What the bills do not include, and what dense layers would take if they were run once a frame."""
    steps, frames = tried.trials.counts.steps, len(tried.trials)
    dense = {bill.target: bill.by_cost()["mac"] for bill in priced if "mac" in bill.by_cost()}
    if not dense:
        return [FRONT_END]
    once = ", ".join(f"{name} {quantity(joules * frames / steps, 'J')}" for name, joules in dense.items())
    return [FRONT_END, f"dense layers once a frame, not in each of its {number(steps / frames)} steps: {once}"]


def words(model: Model, tried: Tried, priced: tuple[Energy, ...]) -> str:
    """The bills, the counts and the accuracy as JSON."""
    own = tried.votes[model.settings.vote]
    about = {"format": FORMAT, "backend": tried.sim.backend, "vote": model.settings.vote, "accuracy": own.accuracy}
    about |= {"interval": list(own.interval), "recordings": tried.recordings, "per_recording": counted(tried)}
    told = about | {"bills": [bill.as_dict() for bill in priced], "notes": notes(tried, priced)}
    return json.dumps(told, indent=1)


def show(model: Model, tried: Tried, priced: tuple[Energy, ...]) -> None:
    """Print a row for each target, what was counted, and the sources."""
    own = tried.votes[model.settings.vote]
    low, high = own.interval
    right = f"{own.accuracy:.1%} of {own.n} right (95 % interval {low:.1%} - {high:.1%})"
    title = f"energy per recording; {right} by {model.settings.vote} on {tried.sim.backend}"
    columns = ("target", "what", ">dynamic", ">static", ">total", ">chip time, us", ">chips")
    console().print(table(columns, map(_row, priced), title=title))
    counts = counted(tried)
    told = ", ".join(f"{number(count)} {name.replace('_', ' ')}" for name, count in counts.items())
    typer.echo(f"a recording: {told}\n")
    for line in (*footnotes(priced), *notes(tried, priced)):
        typer.echo(f"- {line}")


def _row(bill: Energy) -> tuple[str, ...]:
    if bill.chip_time_s is None:
        return (bill.target, bill.title, *bill.sums(), "-", "-")
    return (bill.target, bill.title, *bill.sums(), f"{bill.chip_time_s * 1e6:,.0f}", str(bill.chips))
