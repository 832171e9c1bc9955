"""Report of a run with the metrics of the NeuroBench harness 2.3, and further figures.

The harness hooks into torch modules; here the same numbers follow from counters. `connection_sparsity`,
`activation_sparsity`, `synaptic_operations`, `membrane_updates` and `neuron_ops` are metrics of the harness. The last
two need potentials. All counts are per sample.

Source: NeuroBench 2.3.0, `neurobench/metrics`; Yik et al., Nature Communications 16:1545, 2025.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.chips.energy import STATIC, Energy, sourced
from neuro.chips.hosting import ROW
from neuro.chips.incoming import dense_size, fan_out, spiking
from neuro.core.errors import ModelError
from neuro.program.backend import EngineCounts
from neuro.program.counts import Tally
from neuro.program.program import Floats, Program

if TYPE_CHECKING:
    from neuro.chips.placing import Placement

OPS = {"iaf_psc_delta": 4, "iaf_psc_exp": 8, "cuba_lif": 8, "iaf_psc_alpha": 24}
"""NeuroBench's operations per membrane update of snnTorch's Leaky, Synaptic and Alpha, which are reset to 0."""

_COSTS = {
    "synaptic_op": "synop",
    "mac": "synop",
    "neuron_update_active": "neuron",
    "neuron_update_inactive": "neuron",
    "spike_in_tile": "route",
    "hop_east_west": "route",
    "hop_north_south": "route",
    "packet": "route",
    "learning_update": "learn",
    "signal_update": "learn",
    "weight_write": "learn",
    STATIC: "static",
    ROW: ROW,
}


def neurobench(
    program: Program,
    counts: EngineCounts,
    *,
    samples: int = 1,
    steps: int | None = None,
    weights: Sequence[Floats] | None = None,
    potentials: Mapping[str, Floats] | None = None,
    stride_s: float | None = None,
    placement: Placement | None = None,
    energy: Energy | None = None,
) -> dict[str, Any]:
    """Return the report of a run in NeuroBench's form, ready for JSON.

    Args:
        program: the program that ran.
        counts: counts of the run.
        samples: number of samples in the run.
        steps: steps of one sample; default: all steps / samples. The harness passes a spike through all layers in one
            step. A sample of 20 steps needs 22 steps here if two layers have a delay of 1; pass 20 then.
        weights: present weights of each projection; default: the weights of the program.
        potentials: V_m of populations by name at the end of each step, shape (samples, steps, neurons). If any neuron
            lacks potentials, `membrane_updates` and `neuron_ops.effective` are None.
        stride_s: time between two executions of the model in s, as declared by the author of the model.
        placement: the placement on a chip, for `hops`.
        energy: the bill of the run, for `energy_j` and `table_source`.

    Raises:
        ModelError: the samples have more steps than the run, or potentials have another shape.
    """
    steps = _steps(counts.steps, samples, steps)
    weights = [part.weight for part in program.projections] if weights is None else weights
    report = _Report(program, counts, samples, steps, weights)
    updates = None if potentials is None else report.membrane_updates(potentials)
    items = () if energy is None else energy.items
    return {
        "footprint_bytes": report.footprint(),
        "parameter_count": sum(part.size for part in program.projections),
        "connection_sparsity": report.connection_sparsity(),
        "activation_sparsity": report.activation_sparsity(),
        "synaptic_operations": report.synaptic_operations(),
        "membrane_updates": None if updates is None else sum(updates.values()) / samples,
        "membrane_updates_dense": report.dense_updates / samples,
        "membrane_updates_performed": report.tally.neuron_updates_active / samples,
        "neuron_ops": report.neuron_ops(updates),
        "model_execution_rate_hz": None if stride_s is None else 1.0 / stride_s,
        "spikes": report.spikes(),
        "weight_writes": report.tally.learning_updates / samples,
        "packets": report.packets(),
        "hops": None if placement is None else report.hops(placement),
        "energy_j": None if energy is None else _joules(energy, samples),
        "table_source": list(dict.fromkeys(sourced(item.source, item.conditions) for item in items if item.source)),
        "samples": samples,
        "steps_per_sample": steps,
    }


def _steps(total: int, samples: int, steps: int | None) -> int:
    """Return the steps of one sample."""
    if isinstance(samples, bool) or not isinstance(samples, int) or samples < 1:
        raise ModelError(f"samples = {samples!r}: expected a whole number >= 1")
    if steps is None and total % samples:
        raise ModelError(f"samples = {samples}: expected a number that divides the {total} steps", hint="or pass steps")
    steps = total // samples if steps is None else steps
    if isinstance(steps, bool) or not isinstance(steps, int) or not 0 <= steps * samples <= total:
        raise ModelError(f"steps = {steps!r}: expected at most the {total} steps of the run / {samples} samples")
    return steps


class _Report:
    """The metrics of a run, one per method."""

    def __init__(
        self, program: Program, counts: EngineCounts, samples: int, steps: int, weights: Sequence[Floats]
    ) -> None:
        self.program, self.counts, self.weights = program, counts, weights
        self.samples, self.steps = samples, steps
        self.tally = Tally(program).between(None, counts)
        self.layers = spiking(program)
        self.neurons = [i for i, part in enumerate(program.populations) if part.kind == "neuron"]
        self.dense_updates = samples * steps * sum(program.populations[i].size for i in self.neurons)

    def footprint(self) -> int:
        """Return the bytes of all arrays of the network: connections, weights, delays, parameters, states."""
        size = 0
        for part, weight in zip(self.program.projections, self.weights, strict=True):
            size += weight.nbytes + part.delay.nbytes + part.targets.nbytes + part.row_ends.nbytes
        for population in self.program.populations:
            arrays = (*population.parameters.values(), population.spike_steps, population.spike_ids)
            size += sum(array.nbytes for array in arrays)
            size += 8 * population.size * len(population.model.states)
        return size

    def connection_sparsity(self) -> float:
        """Return the share of weights that are 0, to four digits.

        Absent synapses count as 0; a grid counts its kernels.
        """
        zeros = total = 0
        for index in self.layers:
            part = self.program.projections[index]
            sizes = (self.program.populations[part.source].size, self.program.populations[part.target].size)
            size = part.size if part.grid is not None else sizes[0] * sizes[1]
            zeros += size - int(np.count_nonzero(np.broadcast_to(self.weights[index], part.size)))
            total += size
        return round(zeros / total, 4) if total else 0.0

    def activation_sparsity(self) -> float:
        """Return the share of neuron-steps without a spike."""
        total = self.dense_updates
        fired = sum(int(self.counts.events[index].sum()) for index in self.neurons)
        return (total - fired) / total if total else 0.0

    def synaptic_operations(self) -> dict[str, float]:
        """Return the operations on nonzero weights: accumulates for binary spikes, else multiply-accumulates."""
        ops = {"effective_acs": 0, "effective_macs": 0, "dense": 0}
        for index in self.layers:
            source = self.program.projections[index].source
            events = self.counts.events[source]
            binary = int(events.sum()) == int(self.counts.spikes[source].sum())
            ops_made = int(events @ fan_out(self.program, index, self.weights[index]))
            ops["effective_acs" if binary else "effective_macs"] += ops_made
            ops["dense"] += self.samples * self.steps * dense_size(self.program, index)
        return {name: count / self.samples for name, count in ops.items()}

    def membrane_updates(self, potentials: Mapping[str, Floats]) -> dict[str, int]:
        """Return the updates by population: every neuron in the first step of a sample, then each change of V_m."""
        updates = {}
        for index in self.neurons:
            part = self.program.populations[index]
            shape = (self.samples, self.steps, part.size)
            v = potentials.get(part.name)
            if v is None or v.shape != shape:
                shape_text = "none" if v is None else f"shape {v.shape}"
                raise ModelError(f"potentials of '{part.name}': found {shape_text}: expected shape {shape}")
            updates[part.name] = self.samples * part.size * min(1, shape[1]) + int(np.count_nonzero(np.diff(v, axis=1)))
        return updates

    def neuron_ops(self, updates: Mapping[str, int] | None) -> dict[str, Any]:
        """Return membrane updates x operations of the model. Models unknown to the harness are left out."""
        parts = [self.program.populations[index] for index in self.neurons]
        ops_of = {part.name: OPS[part.model.name] for part in parts if part.model.name in OPS}
        dense = self.samples * self.steps * sum(part.size * OPS.get(part.model.name, 0) for part in parts)
        effective = None if updates is None else sum(ops * updates[name] for name, ops in ops_of.items()) / self.samples
        left_out = [part.name for part in parts if part.name not in ops_of]
        return {"effective": effective, "dense": dense / self.samples, "left_out": left_out}

    def spikes(self) -> dict[str, Any]:
        """Return the spikes of generators, and of populations with and without outgoing projections."""
        senders = {part.source for part in self.program.projections}
        spikes_by_name = {name: part.spikes / self.samples for name, part in self.tally.populations.items()}
        sums = {"in": 0.0, "hidden": 0.0, "out": 0.0}
        for index, part in enumerate(self.program.populations):
            inner = "hidden" if index in senders else "out"
            sums["in" if part.kind != "neuron" else inner] += spikes_by_name[part.name]
        return {**sums, "total": sum(sums.values()), "per_population": spikes_by_name}

    def packets(self) -> float:
        """Return the spikes of populations with an outgoing projection."""
        senders = {part.source for part in self.program.projections}
        return sum(int(self.counts.spikes[index].sum()) for index in senders) / self.samples

    def hops(self, placement: Placement) -> float:
        """Return the hops of all spikes from tile to tile, on one chip or between two."""
        total = 0
        for index, part in enumerate(self.program.projections):
            hops = placement.hops(index)
            total += int(self.counts.spikes[part.source] @ (hops.east_west + hops.north_south))
        return total / self.samples


def _joules(energy: Energy, samples: int) -> dict[str, Any]:
    """Return the joules of one sample by kind of operation at the bill's clock, and the totals in real time."""
    sums = dict.fromkeys(("synop", "neuron", "route", "learn", "static", ROW), 0.0)
    for item in energy.items:
        sums["learn" if item.kind == ROW != item.what else _COSTS[item.what]] += (item.joules or 0.0) / samples
    clock, real = ({"total": e.total_j, "low": e.low_j, "high": e.high_j} for e in (energy, energy.real_time))
    per_sample = [
        {name: None if energy.refused else joules / samples for name, joules in totals.items()}
        for totals in (clock, real)
    ]
    return {"model": energy.target, "clock": energy.clock, **per_sample[0], **sums, "real_time": per_sample[1]}
