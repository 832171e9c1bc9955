"""Numbers of a run: metrics at its end, by name or by a function of the user's, and the steps that it reports.

A run that reports steps may be ended early, where a tuning sees that others were better.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.core.checks import is_number
from neuro.core.errors import ModelError, unknown
from neuro.core.registry import Registry
from neuro.core.values import shown
from neuro.files.recorded import variation

if TYPE_CHECKING:
    from neuro.run.simulation import Simulation

Metric = Callable[["Simulation"], Any]

METRICS: Registry[Metric] = Registry("metric", (), group="neuro.metrics")
"""Functions of a simulation that has run to a number, or to numbers by name."""

TOTALS = ("spikes", "synaptic_ops", "neuron_updates", "neuron_updates_active", "learning_updates")
_OF_POPULATIONS = ("rate", "spikes", "cv")
_OF_PROJECTIONS = ("weight", "weight_sd")
_OF_CHIPS = ("energy", "energy_real_time")
UNITS = {"rate": "Hz", "energy": "J", "energy_real_time": "J"}
"""Of metrics of one part, by their first word."""


def check_metrics(names: Iterable[str], populations: Collection[str], projections: Collection[str]) -> None:
    """See whether metrics have a meaning, before the first run.

    Raises:
        ModelError: one has none.
    """
    for name in names:
        word, dot, of = name.partition(".")
        if dot and word in _OF_POPULATIONS and of not in populations:
            raise unknown(f"population of the metric '{name}':", of, populations, path=("metrics",))
        if dot and word in _OF_PROJECTIONS and of not in projections:
            raise unknown(f"projection of the metric '{name}':", of, projections, path=("metrics",))
        if dot and word in _OF_CHIPS:
            from neuro.chips.known import chip

            chip(of)
        if not (dot and word in (*_OF_POPULATIONS, *_OF_PROJECTIONS, *_OF_CHIPS)) and name not in (*TOTALS, *METRICS):
            of_parts = [f"{each}.{part}" for each in _OF_POPULATIONS for part in populations]
            of_parts += [f"{each}.{part}" for each in _OF_PROJECTIONS for part in projections]
            known = (*TOTALS, *of_parts, *(f"{each}.CHIP" for each in _OF_CHIPS), *METRICS)
            raise unknown("metric", name, known, path=("metrics",))


def measured(sim: Simulation, names: Iterable[str], tables: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Metrics of a simulation that has run, by name.

    Args:
        sim: the simulation.
        names: `spikes` and other totals; `rate.POPULATION` in Hz a neuron, `spikes.POPULATION`, `cv.POPULATION`, the
            mean coefficient of variation of the intervals; `weight.PROJECTION`, their mean at the end, and
            `weight_sd.PROJECTION`; `energy.CHIP` in J, as fast as the chip can, and `energy_real_time.CHIP`; or
            that of a registered function.
        tables: of chips by name, where the sweep changes their figures.
    """
    found: dict[str, Any] = {}
    for name in names:
        value = METRICS[name](sim) if name in METRICS else _own(sim, name, tables or {})
        found |= numbers(value, name)
    return found


def numbers(value: Any, name: str) -> dict[str, Any]:
    """What a function returned, as plain values by name.

    Raises:
        ModelError: it is neither a number nor numbers by name.
    """
    each = value if isinstance(value, Mapping) else {name: value}
    return {str(word): _plain(one, str(word)) for word, one in each.items()}


def _plain(value: Any, name: str) -> Any:
    if isinstance(value, (np.generic, np.ndarray)) and value.ndim == 0:
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise ModelError(f"metric '{name}' = {shown(value)}: expected a number or a text")


def _own(sim: Simulation, name: str, tables: Mapping[str, str]) -> Any:
    word, dot, of = name.partition(".")
    if not dot:
        return getattr(sim.counts(), name)
    if word in _OF_CHIPS:
        bill = sim.energy(tables.get(of, of))
        return (bill if word == "energy" else bill.real_time).total_j
    if word in _OF_PROJECTIONS:
        weight = sim.get(of, "weight")
        return float((weight.mean() if word == "weight" else weight.std()) if weight.size else np.nan)
    if word == "cv":
        each = variation(*sim.spikes(of))
        return float(each.mean()) if each.size else np.nan
    spikes, size = sim.counts().populations[of].spikes, sim.handles.neurons(of).part.size
    return spikes if word == "spikes" else spikes / size / (sim.time / 1000.0) if size and sim.time else 0.0


IsWorse = Callable[[int, float], bool]
"""Gets a step and its value; whether the run is so much worse than others that it ends."""


class Pruned(Exception):
    """A run ends early: at this step others were better. Raised by `report_step`; to be let through."""


@dataclass
class ReportedSteps:
    """The steps that a run has reported.

    Attributes:
        worse: whether it ends; None where nothing is pruned.
        steps: value by step.
    """

    worse: IsWorse | None = None
    steps: dict[str, float] = field(default_factory=dict)


_heard: ContextVar[ReportedSteps | None] = ContextVar("heard", default=None)


def report_step(value: float, step: int) -> None:
    """Report how good a run is so far, so that a tuning which prunes can end it where others were better.

    Called by a function that `neuro.tune` calls, after each epoch say. It does nothing where nothing is pruned, so the
    function runs as well by itself.

    Args:
        value: of the objective, as far as it is known.
        step: of what grows in the run, from 0 on: the epoch; each at most once.

    Raises:
        Pruned: the run is to end. Not an error: let it through.
        ModelError: the value is no finite number, or the step none from 0 on.
    """
    if not is_number(value) or not math.isfinite(value):
        raise ModelError(f"report_step: value = {shown(value)}: expected a finite number")
    if isinstance(step, bool) or not isinstance(step, int) or step < 0:
        raise ModelError(f"report_step: step = {shown(step)}: expected a whole number >= 0")
    heard = _heard.get()
    if heard is None:
        return
    heard.steps[str(step)] = float(value)
    if heard.worse is not None and heard.worse(step, float(value)):
        raise Pruned(f"step {step}: {value:g}")


@contextmanager
def gathering_steps(worse: IsWorse | None) -> Iterator[ReportedSteps]:
    """Gather the steps that are reported inside."""
    heard = ReportedSteps(worse)
    token = _heard.set(heard)
    try:
        yield heard
    finally:
        _heard.reset(token)
