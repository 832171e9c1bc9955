"""Results of a comparison: a run on each backend, differences from the first run, and bills."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from neuro.chips.energy import Energy
from neuro.chips.fixed_program import FixedProgram
from neuro.chips.placing import Placement
from neuro.compare.differences import ComparedSpikes, Distance, Divergence, WeightDifference
from neuro.core.outputs import sealed
from neuro.core.tables import Table, as_html, as_text
from neuro.pages.histograms import Histogram
from neuro.program.counts import Counts
from neuro.program.program import Floats, Program

FORMAT = "neuro comparison 1"
JSON = sealed("a comparison as JSON", f'"format": "{FORMAT}"', ', "digest": "{}"')
SHARED = ("spikes", "synaptic_ops", "neuron_updates", "neuron_updates_active", "learning_updates")
"""Counts that are equal on every backend for equal spikes."""


@dataclass(frozen=True, slots=True)
class PopulationResult:
    """Spikes of a population on a backend, compared with the first backend.

    Attributes:
        neurons: number of neurons.
        spikes: number of spikes.
        rate_hz: mean rate of a neuron.
        generator: whether the population is input, with spikes that should be equal on all backends.
        same: whether the spikes are exactly those of the first run.
        first: first difference, or None.
        distance: distance of the spike trains; None for the first run, and without the library.
    """

    neurons: int
    spikes: int
    rate_hz: float
    generator: bool
    same: bool = True
    first: Divergence | None = None
    distance: Distance | None = None


@dataclass(frozen=True, slots=True)
class WorldResult:
    """Steps, episodes and decisions of a backend's network in a world.

    Attributes:
        steps: number of control steps in which the network decided.
        episodes: number of finished episodes.
        mean_return: mean return of these episodes; None without episodes.
        same: share of the decisions that are equal to the decision of the first run in the same step.
    """

    steps: int
    episodes: int
    mean_return: float | None
    same: float = 1.0


@dataclass(frozen=True, slots=True)
class Bill:
    """Bill of a run on a target.

    Attributes:
        target: name of the chip or processor.
        counted_on: backend whose counts are priced.
        energy: the bill, or None.
        reason: reason for a missing bill.
    """

    target: str
    counted_on: str
    energy: Energy | None
    reason: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the bill for JSON."""
        fields = self.energy.as_dict() if self.energy else {"target": self.target, "reason": self.reason}
        return {"counted_on": self.counted_on, **fields}


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Run on one backend.

    Attributes:
        backend: name of the backend, or the table file of its chip.
        refused: reasons for a refusal; "" if the network ran. `reason` is the first reason, in one line.
        warnings: approximations and overflows.
        inputs: input compared with the first run: "same", "merged" (several spikes of a neuron in a step are one),
            "other".
        counts: counts of the run.
        populations: results by name, without generators of currents.
        weights: difference of the final weights from the first run's, by projection.
        delays: difference of the final delays in ms, for projections with learning delays.
        rounding: rounding error of the described weights, by projection; None for a float backend.
        fixed, placement: the network in the chip's integers and on its cores; None for a float backend.
        bills: bill on the own chip; for the first run also bills on other targets.
        trains: the spikes.
        final: final weights of each projection, one for each synapse; `final_delays` in ms, if they learn.
        program: the program of the backend.
        world: steps, episodes and decisions in a world; None without one. `actions` are the decisions.
    """

    backend: str
    refused: str = ""
    reason: str = ""
    warnings: tuple[str, ...] = ()
    inputs: str = "same"
    counts: Counts | None = None
    populations: Mapping[str, PopulationResult] = field(default_factory=dict)
    weights: Mapping[str, WeightDifference] = field(default_factory=dict)
    delays: Mapping[str, WeightDifference] = field(default_factory=dict)
    rounding: Mapping[str, WeightDifference] | None = None
    fixed: FixedProgram | None = None
    placement: Placement | None = None
    bills: tuple[Bill, ...] = ()
    trains: Mapping[str, ComparedSpikes] = field(default_factory=dict)
    final: Mapping[str, Floats] = field(default_factory=dict)
    final_delays: Mapping[str, Floats] = field(default_factory=dict)
    program: Program | None = None
    world: WorldResult | None = None
    actions: Floats | None = None

    @property
    def own(self) -> Energy | None:
        """Bill on the chip of the backend."""
        return next((bill.energy for bill in self.bills if bill.target == self.backend), None)

    @property
    def neurons(self) -> dict[str, PopulationResult]:
        """Results of all populations except input."""
        return {name: part for name, part in self.populations.items() if not part.generator}

    @property
    def first(self) -> tuple[str, Divergence] | None:
        """Earliest difference among the populations of neurons, with the name of the population."""
        differences = [(name, part.first) for name, part in self.neurons.items() if part.first is not None]
        return min(differences, key=lambda pair: pair[1].ms, default=None)

    def first_difference(self) -> str:
        """Return time and place of the first difference, e.g. "12.5 ms, exc[3]"; "none" if there is none."""
        return "none" if self.first is None else f"{self.first[1].ms:g} ms, {self.first[0]}[{self.first[1].neuron}]"

    @property
    def per_spike(self) -> float | None:
        """Spike-train distance per spike over all populations of neurons; None if it was not measured."""
        distances = [part.distance for part in self.neurons.values() if part.distance is not None]
        return sum(d.edits for d in distances) / max(sum(d.spikes for d in distances), 1) if distances else None

    def as_dict(self) -> dict[str, Any]:
        """Return everything except spikes and weights, for JSON."""
        if self.refused:
            return {"ran": False, "reason": self.refused, "warnings": list(self.warnings)}
        assert self.counts is not None
        counts = {name: getattr(self.counts, name) for name in ("steps", *SHARED)}
        return {
            "ran": True,
            "reason": None,
            "warnings": list(self.warnings),
            "inputs": self.inputs,
            "counts": counts,
            "native_counts": dict(self.counts.native),
            "populations": {name: asdict(part) for name, part in self.populations.items()},
            "weights": {name: asdict(part) for name, part in self.weights.items()},
            "delays": {name: asdict(part) for name, part in self.delays.items()},
            "weight_rounding": self.rounding and {name: asdict(part) for name, part in self.rounding.items()},
            "rounding": self.fixed.as_dict() if self.fixed else None,
            "placement": self.placement.as_dict() if self.placement else None,
            **({} if self.world is None else {"world": asdict(self.world)}),
        }


def _words(parts: Mapping[str, WeightDifference] | None) -> dict[str, Any] | None:
    return None if parts is None else {name: asdict(part) for name, part in parts.items()}


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """A network on several backends.

    Attributes:
        network: name of the network.
        ms: duration of the runs.
        resolution_ms: length of a step.
        seed: seed of all random numbers, the same for all backends.
        runs: run on each backend, in the given order. The first that ran is the reference of the others.
        histograms: histograms of the weights of each projection as described and on each chip.
        learnt: histograms of the final weights of each projection that learns, on each backend.
        notes: notes for the reader.
        record: provenance, see `neuro.core.provenance`.
    """

    network: str
    ms: float
    resolution_ms: float
    seed: int
    runs: tuple[Run, ...]
    histograms: tuple[Histogram, ...]
    learnt: tuple[Histogram, ...]
    notes: tuple[str, ...]
    record: Mapping[str, Any] = field(default_factory=dict)

    @property
    def first(self) -> Run:
        """The reference: the first run that was not refused."""
        return self.ran[0]

    @property
    def ran(self) -> tuple[Run, ...]:
        """The runs that were not refused."""
        return tuple(run for run in self.runs if not run.refused)

    def __repr__(self) -> str:
        backends = ", ".join(run.backend for run in self.runs)
        return f"Comparison({self.network!r}, {self.ms:g} ms on {backends})"

    def __str__(self) -> str:
        return as_text(repr(self), self._tables())

    def _repr_html_(self) -> str:
        return as_html(repr(self), self._tables())

    def _tables(self) -> list[Table]:
        """A row for each backend."""
        rows = []
        for run in self.runs:
            counts, differs = run.counts, "-" if run is self.first else run.first_difference()
            figures = (
                ("-", "-", "refused") if counts is None else (f"{counts.spikes:,}", f"{counts.synaptic_ops:,}", differs)
            )
            rows.append((run.backend, *figures))
        return [Table("", ("backend", ">spikes", ">synaptic ops", "first difference"), tuple(rows))]

    @property
    def bills(self) -> tuple[Bill, ...]:
        """Bills of all chip backends, then of other targets with the counts of the first run."""
        return tuple(sorted((bill for run in self.ran for bill in run.bills), key=lambda b: b.target != b.counted_on))

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison for JSON. The keys are stable, see docs/how-to/compare-backends.md."""
        return {
            "format": FORMAT,
            "network": self.network,
            "ms": self.ms,
            "resolution_ms": self.resolution_ms,
            "seed": self.seed,
            "compared_with": self.first.backend,
            "backends": {run.backend: run.as_dict() for run in self.runs},
            "energy": [bill.as_dict() for bill in self.bills],
            "notes": list(self.notes),
        }
