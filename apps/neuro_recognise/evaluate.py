"""What it takes to decide on a recording: its bill, or why a target refuses the network."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import neuro
from neuro_recognise.method import Run

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
    sim = run[0]
    reasons = {name: refusal(sim, name) for name in targets}
    bills = {
        name: _bill(run, name, neurons_per_core, duration_s).per(recordings, "recording")
        for name, why in reasons.items()
        if not why
    }
    return Priced(run, recordings, bills, {name: why for name, why in reasons.items() if why})


def _bill(run: Run, target: str, neurons_per_core: int | None, duration_s: float | None) -> Energy:
    """What a run takes; on a chip with so many neurons on a core."""
    from neuro.chips import chip, place, price as of_counts

    (sim, taken), asked = run, chip(target)
    if neurons_per_core is None or asked.mesh is None or not asked.costs:
        return sim.energy(target, of=taken, duration_s=duration_s)
    placement = place(sim.program, asked, neurons_per_core=neurons_per_core)
    return of_counts(sim.program, taken.raw_counts, placement, asked, duration_s=duration_s)


def refusal(sim: neuro.Simulation, target: str) -> str:
    """Why a chip cannot run a network, the first reason; "" if it can, or if its arithmetic is not known here."""
    from neuro.chips import chip, quantise

    asked = chip(target)
    problems = quantise(sim.program, asked).problems if asked.arithmetic else ()
    return next((f"{one.what}: {one.why}" for one in problems if one.refused), "")
