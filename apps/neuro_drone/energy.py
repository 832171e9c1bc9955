"""What a control step of a lap takes on chips, beside a dense network, and whether the chip is in time."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from neuro import ModelError
from neuro.apps import console, number, quantity, sourced, table
from neuro.chips import COLUMNS, between, chip, footnotes
from neuro_drone.controllers.deep import DQNSettings, Flier
from neuro_drone.controllers.pilot import ControllerPilot
from neuro_drone.env import ACTIONS, CELLS
from neuro_drone.evaluate import Flights, Start, begun, fly_lap
from neuro_drone.model import Model

if TYPE_CHECKING:
    from neuro import Counts
    from neuro.chips import Energy


PROCESSORS = ("cpu", "gpu")
"""Targets that multiply densely."""

CAMERA = "not in the bill: the camera, the counting of events in fields, and the way between host and chip"
POISSON = "the Poisson spikes of the cells are made by the host and are not in the bill either"
BATCH = "the dense network is run once a control step; the gpu's figure is for much work in parallel, this is little"


@dataclass(frozen=True, slots=True)
class Dense:
    """A dense network on a processor.

    Attributes:
        target: the processor.
        what: network.
        macs: multiply-accumulates of a control step.
        joules: of a control step, without idle power.
        range: between what these lie.
        source: of the joules of one.
    """

    target: str
    what: str
    macs: int
    joules: float
    range: tuple[float, float]
    source: str


@dataclass(frozen=True, slots=True)
class Bills:
    """What a control step takes, mean of a lap.

    Attributes:
        model: that flew the lap.
        steps: of the lap.
        error_px: mean of the lap.
        counts: of the network over the whole lap; None of a controller without one.
        spiking: bills of the network, by target.
        dense: bills of a dense network.
    """

    model: Model
    steps: int
    error_px: float
    counts: Counts | None
    spiking: tuple[Energy, ...]
    dense: tuple[Dense, ...]

    def share(self, bill: Energy) -> float | None:
        """Time on the chip as a share of the control step; up to 1 it is in time. None where no time is known."""
        if bill.chip_time_s is None:
            return None
        return bill.chip_time_s / (self.model.scenario.step / 1000.0)


def priced(model: Model, targets: Iterable[str]) -> Bills:
    """Fly a lap with frozen weights and price it.

    Args:
        model: a spiking network, DQN, DDPG or PPO.
        targets: chips, processors or table files, see `neuro.Simulation.energy`.

    Raises:
        ModelError: it is none of these, or a target does not exist, cannot hold the network, or has no costs.
    """
    scenario = model.scenario
    start = Start((0.0, 0.0), 1 if scenario.kind == "line" else 0)
    env = Flights(scenario, [begun(start)])
    loop = model.loop(env)
    pilot = loop.pilot.controller if isinstance(loop.pilot, ControllerPilot) else None
    if isinstance(pilot, Flier):
        lap, layers = fly_lap(loop, env, start), [weight.shape for weight, _ in pilot.dense.layers]
        return Bills(model, lap.steps, lap.error_px, None, (), _dense(model.controller, layers, targets))
    if pilot is not None:
        raise ModelError(f"controller '{model.controller}' has no network: expected a spiking one, dqn, ddpg or ppo")
    targets = tuple(targets)
    for name in targets:
        loop.sim.energy(name)  # what cannot be priced is reported before the lap
    lap = fly_lap(loop, env, start)
    bills = tuple(loop.sim.energy(name).per(lap.steps, "control step") for name in targets)
    hidden = DQNSettings().hidden
    layers = [(hidden, CELLS * CELLS), (hidden, hidden), (len(ACTIONS), hidden)]
    return Bills(model, lap.steps, lap.error_px, loop.sim.counts(), bills, _dense("dqn", layers, PROCESSORS))


def _dense(name: str, layers: Iterable[tuple[int, ...]], targets: Iterable[str]) -> tuple[Dense, ...]:
    """What a dense network takes on those targets that multiply densely."""
    shapes = [(rows, columns) for rows, columns in layers]
    macs = sum(rows * columns for rows, columns in shapes)
    what = f"{name}: {'-'.join(str(n) for n in (shapes[0][1], *(rows for rows, _ in shapes)))}"
    out = []
    for target in targets:
        mac = chip(target).costs.get("mac")
        if mac is not None:
            low, high = mac.range()
            joules, ends = macs * mac.value, (macs * low, macs * high)
            out.append(Dense(target, what, macs, joules, ends, sourced(mac.source, mac.conditions)))
    return tuple(out)


def words(bills: Bills) -> str:
    """All figures as JSON; joules and seconds are of a control step."""
    model, step = bills.model, bills.model.scenario.step
    about = {"controller": model.controller, "scenario": model.scenario.name, "steps": bills.steps}
    record: dict[str, Any] = {**about, "error_px": bills.error_px, "step_us": step * 1000.0}
    record["per_step"] = _counted(bills)
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
        {"target": d.target, "what": d.what, "macs": d.macs, "total_j": d.joules, "source": d.source}
        | dict(zip(("total_low_j", "total_high_j"), d.range, strict=True))
        for d in bills.dense
    ]
    return json.dumps(record | {"notes": notes(bills)}, indent=1)


def _counted(bills: Bills) -> dict[str, float]:
    counts, n = bills.counts, bills.steps
    if counts is None:
        return {}
    sums = {
        "network_steps": counts.steps,
        "input_spikes": counts.populations["cells"].spikes,
        "spikes": sum(each.spikes for name, each in counts.populations.items() if name != "cells"),
        "synaptic_ops": counts.synaptic_ops,
        "neuron_updates": counts.neuron_updates,
    }
    return {name: count / n for name, count in sums.items()}


def notes(bills: Bills) -> list[str]:
    """What the bills do not include."""
    return [CAMERA, *([POISSON] if bills.spiking else []), BATCH]


def _in_time(share: float | None) -> bool | None:
    return None if share is None else bool(share <= 1.0 + 1e-9)


def show(bills: Bills, sources: bool = False) -> None:
    """Print what was counted, a row for each chip, and what that assumes, with the sources if asked for."""
    model, step = bills.model, bills.model.scenario.step
    rows: list[tuple[str, ...]] = []
    for bill in bills.spiking:
        share = bills.share(bill)
        fits = {None: "-", True: "yes", False: "no"}[_in_time(share)]
        rows.append((bill.target, *bill.cells(), fits))
    for one in bills.dense:
        joules = f"> {between(one.joules, *one.range)}"
        rows.append(
            (f"{one.target}, {one.what.partition(':')[0]}", quantity(one.joules, "J"), joules, joules, "-", "-", "-")
        )
    columns = ("chip", *COLUMNS, "in time")
    title = (
        f"energy per control step of {step:g} ms; {model.controller} in {model.scenario.name}, "
        f"{bills.error_px:.2f} px, mean of {bills.steps:,} steps"
    )
    counted = ", ".join(f"{number(count)} {name.replace('_', ' ')}" for name, count in _counted(bills).items())
    if counted:
        typer.echo(f"a control step: {counted}\n")
    dense = dict.fromkeys(
        f"{one.target}: {one.what}, {one.macs:,} mac" + (f": {one.source}" if sources else "") for one in bills.dense
    )
    console().print(table(columns, rows, title=title))
    for line in (*footnotes(bills.spiking, sources), *dense, *notes(bills)):
        typer.echo(f"- {line}")
