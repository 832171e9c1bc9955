"""Bills of a decision on a recording, on chips and as dense layers: a table, and where its figures come from."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import typer

import neuro
from neuro import ModelError
from neuro.apps import console, number, quantity, table
from neuro.chips import COLUMNS, footnotes
from neuro_recognise.method import Run
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.telling.report import Tried

if TYPE_CHECKING:
    from neuro.chips import Energy


@dataclass(frozen=True, slots=True, eq=False)
class Priced:
    """What it takes to decide on a recording.

    Attributes:
        run: of the network, on any backend.
        recordings: that were shown.
        bills: by target, of one recording.
        refused: by target why it cannot run the network.
    """

    run: Run
    recordings: int
    bills: Mapping[str, Energy]
    refused: Mapping[str, str]


def price(
    run: Run,
    recordings: int,
    targets: Iterable[str],
    neurons_per_core: int | None = None,
    duration_s: float | None = None,
) -> Priced:
    """The bill of a recording on each target.

    Args:
        run: of a network on some recordings, on any backend.
        recordings: how many were shown.
        targets: chips, processors or table files, see `neuro.Simulation.energy`.
        neurons_per_core: of a chip, see `Answer`.
        duration_s: of all recordings, see `Answer`.

    Raises:
        ModelError: there is no such target, or it has no published costs.
    """
    sim, taken = run
    from neuro.chips import chip, place, price as of_counts

    bills: dict[str, Energy] = {}
    refused: dict[str, str] = {}
    for name in targets:
        asked = chip(name)
        if why := refusal(sim, name):
            refused[name] = why
        elif neurons_per_core is None or asked.mesh is None or not asked.costs:
            bills[name] = sim.energy(name, of=taken, duration_s=duration_s).per(recordings, "recording")
        else:
            placement = place(sim.program, asked, neurons_per_core=neurons_per_core)
            bill = of_counts(sim.program, taken.raw_counts, placement, asked, duration_s=duration_s)
            bills[name] = bill.per(recordings, "recording")
    return Priced(run, recordings, bills, refused)


def refusal(sim: neuro.Simulation, target: str) -> str:
    """Why a chip cannot run a network, the first reason; "" if it can, or if its arithmetic is not known here."""
    from neuro.chips import chip, quantise

    asked = chip(target)
    problems = quantise(sim.program, asked).problems if asked.arithmetic else ()
    return next((f"{one.what}: {one.why}" for one in problems if one.refused), "")


FORMAT = "neuro recognise energy 1"

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
    sim = neuro.compile(net)
    for name in targets:
        sim.energy(name)


def bills(tried: Tried, targets: Iterable[str]) -> Priced:
    """The bill of a recording on each target.

    Args:
        tried: what a network was run on, on any backend.
        targets: chips, processors or table files, see `neuro.Simulation.energy`.

    Raises:
        ModelError: as of `check_targets`.
    """
    assert tried.answer.run is not None, "of a network only"
    answer = tried.answer
    return price(tried.answer.run(), tried.own.n, targets, answer.neurons_per_core, answer.duration_s)


def counted(priced: Priced) -> dict[str, float]:
    """What a recording takes on the mean, whatever runs it; frames where it is shown as trials."""
    sim, taken = priced.run
    counts = taken.counts
    inputs = [name for name, part in sim.network().populations.items() if isinstance(part.model, neuro.spike_generator)]
    sums = {"frames": len(taken)} if len(taken) else {}
    sums |= {
        "steps": counts.steps,
        "input_spikes": sum(counts.populations[name].spikes for name in inputs),
        "synaptic_ops": counts.synaptic_ops,
        "neuron_updates": counts.neuron_updates,
        "neuron_updates_active": counts.neuron_updates_active,
    }
    return {name: count / priced.recordings for name, count in sums.items()}


def notes(priced: Priced) -> list[str]:
    """What the bills do not include, and what dense layers would take if they were run once a frame."""
    _, taken = priced.run
    costs = {name: bill.by_cost() for name, bill in priced.bills.items()}
    dense = {name: by_cost["mac"] for name, by_cost in costs.items() if "mac" in by_cost}
    if not dense or not len(taken):
        return [FRONT_END]
    steps, frames = taken.counts.steps, len(taken)
    once = ", ".join(f"{name} {quantity(joules * frames / steps, 'J')}" for name, joules in dense.items())
    return [FRONT_END, f"dense layers once a frame, not in each of its {number(steps / frames)} steps: {once}"]


def words(recogniser: Recogniser, tried: Tried, priced: Priced) -> str:
    """The bills, the counts and the accuracy as JSON."""
    own = tried.own
    about: dict[str, object] = {"format": FORMAT, "method": recogniser.method.called()}
    about |= {"backend": priced.run[0].backend, "accuracy": own.accuracy, "interval": list(own.interval)}
    about |= {"recordings": own.n, "per_recording": counted(priced)}
    about |= {"bills": [bill.as_dict() for bill in priced.bills.values()], "refused": dict(priced.refused)}
    return json.dumps(about | {"notes": notes(priced)}, indent=1)


def show(recogniser: Recogniser, tried: Tried, priced: Priced, sources: bool = False) -> None:
    """Print what was counted, a row for each chip, and what that assumes, with the sources if asked for."""
    own = tried.own
    low, high = own.interval
    right = f"{own.accuracy:.1%} of {own.n} right (95 % interval {low:.1%} - {high:.1%})"
    title = f"energy per recording; {right} by {recogniser.method.called()} on {priced.run[0].backend}"
    rows = [(bill.target, *bill.cells()) for bill in priced.bills.values()]
    rows += [(name, "refused", *["-"] * (len(COLUMNS) - 1)) for name in priced.refused]
    text = ", ".join(f"{number(count)} {name.replace('_', ' ')}" for name, count in counted(priced).items())
    typer.echo(f"a recording: {text}\n")
    console().print(table(("chip", *COLUMNS), rows, title=title))
    refused = (f"{name} refuses the network: {why}" for name, why in priced.refused.items())
    for line in (*refused, *footnotes(priced.bills.values(), sources), *notes(priced)):
        typer.echo(f"- {line}")
