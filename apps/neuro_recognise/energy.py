"""Energy of a recogniser's network on chips, per recording: bills, a table, assumptions, and sources of figures."""

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
    from neuro.chips import Energy, HostWork


@dataclass(frozen=True, slots=True, eq=False)
class Priced:
    """Bills of a network's run, per recording.

    Attributes:
        run: run of the network, on any backend.
        recordings: number of recordings in the run.
        bills: bill of one recording, by the name of the target.
        refused: reason why a target cannot run the network, by the name of the target.
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
    host: Iterable[HostWork] = (),
) -> Priced:
    """Compute the bill per recording on each target.

    Args:
        run: run of a network on some recordings, on any backend.
        recordings: number of recordings in the run.
        targets: chips, processors or table files, see `neuro.Simulation.energy`.
        neurons_per_core: limit for the placement on a chip, see `Answer`.
        duration_s: total duration of the recordings, s, see `Answer`.
        host: operations outside of the network, see `Answer`.

    Raises:
        ModelError: there is no such target, or no costs of the target are published.
    """
    sim, trials = run
    from neuro.chips import chip, place, price as of_counts

    bills: dict[str, Energy] = {}
    refused: dict[str, str] = {}
    for name in targets:
        target = chip(name)
        if reason := refusal(sim, name):
            refused[name] = reason
        elif neurons_per_core is None or target.mesh is None or not target.costs:
            bills[name] = sim.energy(name, of=trials, duration_s=duration_s, host=host).per(recordings, "recording")
        else:
            placement = place(sim.program, target, neurons_per_core=neurons_per_core)
            bill = of_counts(sim.program, trials.raw_counts, placement, target, duration_s=duration_s, host=host)
            bills[name] = bill.per(recordings, "recording")
    return Priced(run, recordings, bills, refused)


def refusal(sim: neuro.Simulation, target: str) -> str:
    """Return the first reason why a chip cannot run a network.

    The reason is "" if the chip can run the network, or if the arithmetic of the chip is not modelled.
    """
    from neuro.chips import chip, quantise

    limits = chip(target)
    problems = quantise(sim.program, limits).problems if limits.arithmetic else ()
    return next((f"{problem.what}: {problem.why}" for problem in problems if problem.refused), "")


FORMAT = "neuro recognise energy 1"

CAMERA = "not in the bill: the camera, and the link between host and chip"


def check_targets(recogniser: Recogniser, targets: Iterable[str]) -> None:
    """Check the targets before the network is run.

    Raises:
        ModelError: the recogniser has no network, there is no such target, the network does not fit on the
            target, or no costs of the target are published.
    """
    net = recogniser.network()
    if net is None:
        name = recogniser.method.called()
        raise ModelError(
            f"method '{name}' has no network: expected one that chips can run", hint="neuro recognise list"
        )
    sim = neuro.compile(net)
    for name in targets:
        sim.energy(name)


def bills(result: Tried, targets: Iterable[str]) -> Priced:
    """Compute the bill per recording on each target.

    Args:
        result: test of a network, on any backend.
        targets: chips, processors or table files, see `neuro.Simulation.energy`.

    Raises:
        ModelError: see `check_targets`.
    """
    answer = result.answer
    assert answer.run is not None, "expected the test of a network"
    return price(answer.run(), result.own.n, targets, answer.neurons_per_core, answer.duration_s, answer.host)


def counted(priced: Priced) -> dict[str, float]:
    """Return the mean counts per recording, which do not depend on the target. Trials are counted as `frames`."""
    sim, trials = priced.run
    counts = trials.counts
    inputs = [name for name, part in sim.network().populations.items() if isinstance(part.model, neuro.spike_generator)]
    sums = {"frames": len(trials)} if len(trials) else {}
    sums |= {
        "steps": counts.steps,
        "input_spikes": sum(counts.populations[name].spikes for name in inputs),
        "synaptic_ops": counts.synaptic_ops,
        "neuron_updates": counts.neuron_updates,
        "neuron_updates_active": counts.neuron_updates_active,
    }
    return {name: count / priced.recordings for name, count in sums.items()}


def notes(priced: Priced) -> list[str]:
    """Return notes on the bills: the parts not included, and the energy of dense layers if they ran once per frame."""
    _, trials = priced.run
    costs = {name: bill.by_cost() for name, bill in priced.bills.items()}
    dense = {name: chip_costs["mac"] for name, chip_costs in costs.items() if "mac" in chip_costs}
    if not dense or not len(trials):
        return [CAMERA]
    steps, frames = trials.counts.steps, len(trials)
    dense_text = ", ".join(f"{name} {quantity(joules * frames / steps, 'J')}" for name, joules in dense.items())
    return [
        CAMERA,
        f"dense layers run once per frame instead of in each of its {number(steps / frames)} steps: {dense_text}",
    ]


def words(recogniser: Recogniser, result: Tried, priced: Priced) -> str:
    """Return the bills, the counts and the accuracy as JSON."""
    evaluation = result.own
    facts: dict[str, object] = {"format": FORMAT, "method": recogniser.method.called()}
    facts |= {"backend": priced.run[0].backend, "accuracy": evaluation.accuracy, "interval": list(evaluation.interval)}
    facts |= {"recordings": evaluation.n, "per_recording": counted(priced)}
    facts |= {"bills": [bill.as_dict() for bill in priced.bills.values()], "refused": dict(priced.refused)}
    return json.dumps(facts | {"notes": notes(priced)}, indent=1)


def show(recogniser: Recogniser, result: Tried, priced: Priced, sources: bool = False) -> None:
    """Print the counts, a row for each chip and the assumptions; with `sources`, also the sources of the figures."""
    evaluation = result.own
    low, high = evaluation.interval
    accuracy = f"{evaluation.accuracy:.1%} of {evaluation.n} right (95 % interval {low:.1%} - {high:.1%})"
    title = f"energy per recording; {accuracy} by {recogniser.method.called()} on {priced.run[0].backend}"
    rows = [(bill.target, *bill.cells()) for bill in priced.bills.values()]
    rows += [(name, "refused", *["-"] * (len(COLUMNS) - 1)) for name in priced.refused]
    text = ", ".join(f"{number(count)} {name.replace('_', ' ')}" for name, count in counted(priced).items())
    typer.echo(f"per recording: {text}\n")
    console().print(table(("chip", *COLUMNS), rows, title=title))
    refused = (f"{name} refuses the network: {reason}" for name, reason in priced.refused.items())
    for line in (*refused, *footnotes(priced.bills.values(), sources), *notes(priced)):
        typer.echo(f"- {line}")
