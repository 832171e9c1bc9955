"""Energy and time per control step of a lap on chips, beside a dense network, and whether a chip is in time."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from neuro import ModelError
from neuro.apps import console, number, sourced, table
from neuro.chips import COLUMNS, chip, dense, footnotes
from neuro_drone.controllers.deep import DQNSettings, Flier
from neuro_drone.controllers.pilot import ControllerPilot
from neuro_drone.env import ACTIONS, CELLS
from neuro_drone.evaluate import Flights, Start, fly_lap, reset_arguments
from neuro_drone.model import Model

if TYPE_CHECKING:
    from neuro import Counts
    from neuro.chips import BillItem, Energy


PROCESSORS = ("cpu", "gpu")
"""Targets of the dense network."""

CAMERA = "not in the bill: the camera, counting events in fields, and the transfer between host and chip"
POISSON = "not in the bill: the Poisson spikes of the cells, which the host generates"
BATCH = "the dense network runs once per control step; the gpu's cost per mac holds for much larger batches"


@dataclass(frozen=True, slots=True)
class Bills:
    """Energy and time per control step, as means over a lap.

    Attributes:
        model: the model that flew the lap.
        steps: control steps of the lap.
        error_px: mean error of the lap, px.
        counts: counts of the spiking network over the whole lap; None without a spiking network.
        spiking: bills of the spiking network, one per target.
        dense: bills of a dense network.
    """

    model: Model
    steps: int
    error_px: float
    counts: Counts | None
    spiking: tuple[Energy, ...]
    dense: tuple[Energy, ...]

    def share(self, bill: Energy) -> float | None:
        """Return the time on the chip as a share of the control step, in time if <= 1; None if it is unknown."""
        if bill.chip_time_s is None:
            return None
        return bill.chip_time_s / (self.model.scenario.step / 1000.0)


def compute_bills(model: Model, targets: Iterable[str]) -> Bills:
    """Fly a lap with frozen weights and compute its bills.

    Args:
        model: model of a spiking network, DQN, DDPG or PPO.
        targets: chips, processors or table files, see `neuro.Simulation.energy`.

    Raises:
        ModelError: the controller has no network, or a target does not exist, cannot hold the network, or has no costs.
    """
    scenario = model.scenario
    start = Start((0.0, 0.0), 1 if scenario.kind == "line" else 0)
    env = Flights(scenario, [reset_arguments(start)])
    loop = model.loop(env)
    pilot = loop.pilot.controller if isinstance(loop.pilot, ControllerPilot) else None
    if isinstance(pilot, Flier):
        lap, layers = fly_lap(loop, env, start), [weight.shape for weight, _ in pilot.dense.layers]
        return Bills(model, lap.steps, lap.error_px, None, (), _dense(model.controller, layers, targets))
    if pilot is not None:
        raise ModelError(f"controller '{model.controller}' has no network: expected a spiking one, dqn, ddpg or ppo")
    targets = tuple(targets)
    for name in targets:
        loop.sim.energy(name)  # raises errors of the target before the lap
    lap = fly_lap(loop, env, start)
    bills = tuple(loop.sim.energy(name).per(lap.steps, "control step") for name in targets)
    hidden = DQNSettings().hidden
    layers = [(hidden, CELLS * CELLS), (hidden, hidden), (len(ACTIONS), hidden)]
    return Bills(model, lap.steps, lap.error_px, loop.sim.counts(), bills, _dense("dqn", layers, PROCESSORS))


def _dense(name: str, layers: Iterable[tuple[int, ...]], targets: Iterable[str]) -> tuple[Energy, ...]:
    """Return the bills of a dense network on those targets that have a cost per multiply-accumulate."""
    shapes = [(rows, columns) for rows, columns in layers]
    macs = sum(rows * columns for rows, columns in shapes)
    title = f"{name}: {'-'.join(str(n) for n in (shapes[0][1], *(rows for rows, _ in shapes)))}"
    processors = [target for target in targets if "mac" in chip(target).costs]
    return tuple(dense({title: macs}, target, of="control step") for target in processors)


def words(bills: Bills) -> str:
    """Return all figures as JSON; joules and seconds are per control step."""
    model, step = bills.model, bills.model.scenario.step
    context = {"controller": model.controller, "scenario": model.scenario.name, "steps": bills.steps}
    record: dict[str, Any] = {**context, "error_px": bills.error_px, "step_us": step * 1000.0}
    record["per_step"] = _counts_per_step(bills)
    record["bills"] = [
        bill.as_dict()
        | {
            "time_us": None if bill.chip_time_s is None else bill.chip_time_s * 1e6,
            "share_of_step": bills.share(bill),
            "in_time": _in_time(bills.share(bill)),
        }
        for bill in bills.spiking
    ]
    record["dense"] = [
        {"target": d.target, "what": item.of, "macs": item.count, "total_j": d.total_j, "source": _source(item)}
        | {"total_low_j": d.low_j, "total_high_j": d.high_j}
        for d in bills.dense
        for item in d.items
    ]
    return json.dumps(record | {"notes": notes(bills)}, indent=1)


def _source(item: BillItem) -> str:
    return sourced(item.source, item.conditions)


def _counts_per_step(bills: Bills) -> dict[str, float]:
    counts, n = bills.counts, bills.steps
    if counts is None:
        return {}
    sums = {
        "network_steps": counts.steps,
        "input_spikes": counts.populations["cells"].spikes,
        "spikes": sum(population.spikes for name, population in counts.populations.items() if name != "cells"),
        "synaptic_ops": counts.synaptic_ops,
        "neuron_updates": counts.neuron_updates,
    }
    return {name: count / n for name, count in sums.items()}


def notes(bills: Bills) -> list[str]:
    """Return notes: parts that the bills do not contain, and the batch size of the dense network."""
    return [CAMERA, *([POISSON] if bills.spiking else []), BATCH]


def _in_time(share: float | None) -> bool | None:
    return None if share is None else bool(share <= 1.0 + 1e-9)


def show(bills: Bills, sources: bool = False) -> None:
    """Print the counts, a row for each chip, and the assumptions.

    Args:
        bills: the bills of a lap.
        sources: True adds the sources of the costs.
    """
    model, step = bills.model, bills.model.scenario.step
    rows: list[tuple[str, ...]] = []
    for bill in bills.spiking:
        share = bills.share(bill)
        fits = {None: "-", True: "yes", False: "no"}[_in_time(share)]
        rows.append((bill.target, *bill.cells(), fits))
    rows += [(f"{d.target}, {d.items[0].of.partition(':')[0]}", *d.cells(), "-") for d in bills.dense]
    columns = ("chip", *COLUMNS, "in time")
    title = (
        f"energy per control step of {step:g} ms; {model.controller} in {model.scenario.name}, "
        f"{bills.error_px:.2f} px, mean of {bills.steps:,} steps"
    )
    counts = ", ".join(f"{number(count)} {name.replace('_', ' ')}" for name, count in _counts_per_step(bills).items())
    if counts:
        typer.echo(f"per control step: {counts}\n")
    layers = dict.fromkeys(
        f"{dense_bill.target}: {item.of}, {item.count:,} mac" + (f": {_source(item)}" if sources else "")
        for dense_bill in bills.dense
        for item in dense_bill.items
    )
    console().print(table(columns, rows, title=title))
    for line in (*footnotes(bills.spiking, sources), *layers, *notes(bills)):
        typer.echo(f"- {line}")
