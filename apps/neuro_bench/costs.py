"""Costs of a model per example: NeuroBench's counts, and joules with their sources.

Two rows count the energy of the arithmetic only, which is a lower bound; the rows of processors are measured:

| row | joules of a multiply-accumulate (MAC) | source |
| --- | --- | --- |
| int8 arithmetic | 0.2 + 0.03 pJ for each MAC without a factor 0 | Horowitz, ISSCC 2014, figure 1.1.9: 45 nm, 0.9 V |
| float32 arithmetic | 3.7 + 0.9 pJ for each MAC without a factor 0; 0.9 pJ for a sum | the same |
| microcontroller, int8 | 0.33 nJ for each MAC | MLPerf Tiny 0.7, closed, STMicroelectronics, see below |
| CPU core, float32 | 8.6 nJ for each MAC | Degnan et al., IEEE Trans. VLSI Syst. 24:58, 2015, as in `cpu.yaml` |

The microcontroller is a Cortex-M33 (NUCLEO-U575ZI-Q), with 4.151 mJ measured for ResNet-8, which has 12.5 M MACs. A
Cortex-M4 (NUCLEO-L4R5ZI) needed 12.298 mJ, so 0.98 nJ for each MAC.

According to Horowitz, reading 64 bits adds 10 pJ from an 8 kB cache and 1,300 pJ or more from DRAM. The joules of Loihi
and SpiNNaker are bills of `neuro.chips`, which contain routing and static power; the tables of `neuro.chips` cite a
source for each figure. A chip that refuses the network has no bill.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import neuro
    from neuro.chips import HostWork

PICOJOULES = {"int8": 0.23, "float32": 4.6, "float32 sum": 0.9}
"""Energy of the arithmetic of a multiply-accumulate, or of a sum, in pJ."""
CHIPS = {"loihi": "Loihi", "spinnaker": "SpiNNaker"}
"""Chips on which spiking networks are priced."""
PROCESSORS = {"int8": ("microcontroller, int8", 330.0), "float32": ("CPU core, float32", 8600.0)}
"""Processor for each number format, and its energy of a multiply-accumulate in pJ."""
HOST = "cpu"
"""Processor whose figure prices the work outside of a network."""
BY_SPIKES = ("synaptic_op", "spike_in_tile", "hop_east_west", "hop_north_south", "packet")
"""Costs of a chip that are proportional to the number of spikes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Costs:
    """Costs of a model for one example, with NeuroBench's names of the metrics.

    An example of a time series is a single value, and an example of a regression is a single step. None stands for an
    unknown cost.

    Attributes:
        parameters: number of learnt parameters.
        footprint_bytes: memory of the weights, and of the neurons' parameters in a spiking network.
        connection_sparsity: share of the weights that are 0.
        activation_sparsity: share of the activations that are 0.
        effective_macs: number of multiply-accumulates whose factors are both not 0.
        effective_acs: number of accumulates of weights that are not 0, caused by spikes.
        dense: number of operations if no weight or activation were 0.
        joules: energy of one example, by processor or chip.
        joules_of_spikes: part of the energy that is proportional to the number of spikes, by chip.
        refused: reason why a chip cannot run the model, by chip.
        unpriced: names of the costs without a published figure, by chip. They are missing in `joules`.
        host: operations of an example outside of a spiking network: ``macs``, ``bytes``, and their ``joules``, which
            the joules of each chip include. Empty without a count.
    """

    parameters: int | None
    footprint_bytes: int | None
    connection_sparsity: float | None = 0.0
    activation_sparsity: float | None = 0.0
    effective_macs: float | None = 0.0
    effective_acs: float | None = 0.0
    dense: float | None = 0.0
    joules: Mapping[str, float] = field(default_factory=dict)
    joules_of_spikes: Mapping[str, float] = field(default_factory=dict)
    refused: Mapping[str, str] = field(default_factory=dict)
    unpriced: Mapping[str, Sequence[str]] = field(default_factory=dict)
    host: Mapping[str, float] = field(default_factory=dict)

    def as_words(self) -> dict[str, Any]:
        """Return all costs as plain data."""
        return asdict(self)


UNKNOWN = Costs(
    parameters=None, footprint_bytes=None, connection_sparsity=None, activation_sparsity=None, effective_macs=None,
    effective_acs=None, dense=None,
)  # fmt: skip
"""Costs of a model whose operations are not counted."""


def arithmetic(kind: str, macs: float, dense: float) -> dict[str, float]:
    """Return the energy of multiply-accumulates in J by row of the module's table: arithmetic alone, and a processor.

    Args:
        kind: number format, a key of `PROCESSORS`.
        macs: number of multiply-accumulates whose factors are both not 0. Only these count as arithmetic.
        dense: number of all multiply-accumulates. A processor computes all of them.
    """
    processor, picojoules = PROCESSORS[kind]
    return {f"{kind} arithmetic, 45 nm": PICOJOULES[kind] * 1e-12 * macs, processor: picojoules * 1e-12 * dense}


def product_costs(parameters: int, footprint_bytes: int, macs: float, dense: float, **others: Any) -> Costs:
    """Return the costs of a model that computes only float32 multiply-accumulates.

    Args:
        parameters: number of learnt parameters.
        footprint_bytes: memory of the weights.
        macs: number of multiply-accumulates of an example whose factors are both not 0.
        dense: number of all multiply-accumulates of an example.
        others: other attributes of `Costs`.
    """
    counts: Any = {"effective_macs": macs, "dense": dense, "joules": arithmetic("float32", macs, dense)}
    return Costs(parameters=parameters, footprint_bytes=footprint_bytes, **counts, **others)


def spiking_costs(
    sim: neuro.Simulation,
    counts: Any,
    examples: int,
    *,
    steps: int | None = None,
    clock: bool = True,
    host: Sequence[HostWork] = (),
) -> Costs:
    """Return the costs of a spiking network: NeuroBench's counts, and the bills of the chips that can run it.

    Args:
        sim: the network.
        counts: the simulation's counts for all these examples, from `Simulation.taken`.
        examples: number of examples.
        steps: steps of one example; by default the steps of the run divided by the number of examples.
        clock: True adds the bills in real time, which have no meaning if a step stands for no duration.
        host: operations outside of the network for all these examples.
    """
    from neuro.chips import neurobench

    metrics = neurobench(sim.program, counts.raw_counts, samples=examples, steps=steps)
    operations = metrics["synaptic_operations"]
    return Costs(
        parameters=metrics["parameter_count"],
        **{name: metrics[name] for name in ("footprint_bytes", "connection_sparsity", "activation_sparsity")},
        **{name: operations[name] for name in ("effective_macs", "effective_acs", "dense")},
        **on_chips(sim, counts, examples, clock, host),
    )


def on_chips(
    sim: neuro.Simulation, counts: Any, examples: int, clock: bool = True, host: Sequence[HostWork] = ()
) -> dict[str, Any]:
    """Return `joules`, `joules_of_spikes`, `refused`, `unpriced` and `host` of `Costs`; see `spiking_costs`."""
    from neuro.chips import chip, place, quantise

    joules, joules_of_spikes, refused, unpriced = {}, {}, {}, {}
    for target, title in CHIPS.items():
        problems = (*quantise(sim.program, chip(target)).problems, *place(sim.program, chip(target)).problems)
        if reasons := [f"{problem.what}: {problem.why}" for problem in problems if problem.refused]:
            refused[title] = reasons[0]
            continue
        fastest = sim.energy(target, of=counts, host=host).per(examples, "example")
        for pace, bill in (("as fast as it can", fastest), ("in real time", fastest.real_time))[: 2 if clock else 1]:
            name = f"{title}, {pace}"
            joules[name] = bill.total_j
            if bill.missing:
                unpriced[name] = list(bill.missing)
            joules_of_spikes[name] = sum(value for cost, value in bill.by_cost().items() if cost in BY_SPIKES)
    rows = [
        item for item in sim.energy(HOST, of=counts, host=host).per(examples, "example").items if item.kind == "host"
    ]
    sums = {"macs": "count", "bytes": "bytes", "joules": "joules"}
    host_sums = {name: sum(getattr(item, field) or 0.0 for item in rows) for name, field in sums.items()}
    figures = {"joules": joules, "joules_of_spikes": joules_of_spikes, "refused": refused, "unpriced": unpriced}
    return figures | {"host": host_sums}


def break_even(joules: float, of_spikes: float, opponent: float) -> float:
    """Return the factor of the number of spikes at which a spiking network needs as much energy as its opponent.

    A network of 5 uJ, 2 uJ of them for spikes, against 9 uJ: factor 3. The factor is 0 if the network would need more
    energy even without spikes. The result is an estimate, because more spikes also lengthen a step.

    Args:
        joules: energy of an example.
        of_spikes: part of this energy that is proportional to the number of spikes.
        opponent: energy of an example on the opponent.
    """
    if not of_spikes:
        return math.inf if joules <= opponent else 0.0
    return max(0.0, (opponent - (joules - of_spikes)) / of_spikes)
