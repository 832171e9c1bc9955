"""What of a run is kept as a number: by name, or by a function of the user's."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.core.errors import ModelError, unknown
from neuro.core.registry import Registry
from neuro.core.values import shown

if TYPE_CHECKING:
    from neuro.run.simulation import Simulation

Metric = Callable[["Simulation"], Any]

METRICS: Registry[Metric] = Registry("metric", (), group="neuro.metrics")
"""Functions of a simulation that has run to a number, or to numbers by name."""

TOTALS = ("spikes", "synaptic_ops", "neuron_updates", "neuron_updates_active", "learning_updates")
_OF_POPULATIONS = ("rate", "spikes", "cv")
_OF_PROJECTIONS = ("weight", "weight_sd")
_OF_CHIPS = ("energy", "energy_real_time")


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
        return _variation(sim, of)
    spikes, size = sim.counts().populations[of].spikes, sim.handles.neurons(of).part.size
    return spikes if word == "spikes" else spikes / size / (sim.time / 1000.0) if size and sim.time else 0.0


def _variation(sim: Simulation, population: str) -> float:
    """The mean over neurons; not a number where none has two intervals. Softky & Koch, J. Neurosci. 13:334, 1993."""
    times, ids = sim.spikes(population)
    order = np.lexsort((times, ids))
    times, ids = times[order], ids[order]
    same = ids[1:] == ids[:-1]
    lengths, whose = np.diff(times)[same], ids[1:][same]
    each = [lengths[whose == neuron] for neuron in np.unique(whose)]
    found = [part.std() / part.mean() for part in each if part.size >= 2 and part.mean() > 0]
    return float(np.mean(found)) if found else float("nan")
