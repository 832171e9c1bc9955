"""What a model takes for one example: counts in NeuroBench's words, and joules with the source of each row.

Joules of multiply-accumulates are a lower bound where only the arithmetic is counted; those of processors are measured:

| row | of a multiply-accumulate | source |
| --- | --- | --- |
| int8 arithmetic | 0.2 + 0.03 pJ, those whose factors are not 0 | Horowitz, ISSCC 2014, figure 1.1.9: 45 nm, 0.9 V |
| float32 arithmetic | 3.7 + 0.9 pJ, likewise; a sum alone 0.9 | the same |
| microcontroller, int8 | 0.33 nJ, all of them | MLPerf Tiny 0.7, closed, STMicroelectronics, see below |
| CPU core, float32 | 8.6 nJ, all of them | Degnan et al., IEEE Trans. VLSI Syst. 24:58, 2015, as in `cpu.yaml` |

The microcontroller is a Cortex-M33 (NUCLEO-U575ZI-Q), on which 4.151 mJ were measured for ResNet-8, which has 12.5 M of
them; on a Cortex-M4 (NUCLEO-L4R5ZI) it was 12.298 mJ, so 0.98 nJ.

By Horowitz 64 bits of an 8 kB cache take 10 pJ more and of DRAM 1,300 pJ or more. Loihi and SpiNNaker are bills by
`neuro.chips`, whose tables cite a source for each figure, with routing and static power; a chip that refuses the
network has none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import neuro

PICOJOULES = {"int8": 0.23, "float32": 4.6, "float32 sum": 0.9}
"""Of the arithmetic of a multiply-accumulate, or of a sum."""
CHIPS = {"loihi": "Loihi", "spinnaker": "SpiNNaker"}
"""What spiking networks are priced on."""
PROCESSORS = {"int8": ("microcontroller, int8", 330.0), "float32": ("CPU core, float32", 8600.0)}
"""By type what computes it, and pJ of a multiply-accumulate there."""
BY_SPIKES = ("synaptic_op", "spike_in_tile", "hop_east_west", "hop_north_south", "packet")
"""Costs of a chip that grow with the spikes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Costs:
    """What a model takes for one example, in NeuroBench's words.

    A value of a series is an example, and so is a step of a regression. None: not known.

    Attributes:
        parameters: numbers that were learnt.
        footprint_bytes: of the weights, of a spiking network also of what describes the neurons.
        connection_sparsity: share of the weights that are 0.
        activation_sparsity: share of the activations that are 0.
        effective_macs: multiply-accumulates whose factors are both not 0.
        effective_acs: accumulates of weights that are not 0, by spikes.
        dense: operations if nothing were 0.
        joules: of one example, by what it is computed on.
        joules_of_spikes: the part of these that grows with the spikes.
        refused: why a chip cannot run it, by the chip; it is in no bill.
        unpriced: names of the costs that are missing from `joules`, as no figure is published, by what has some.
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

    def as_words(self) -> dict[str, Any]:
        """All of it as plain data."""
        return asdict(self)


UNKNOWN = Costs(
    parameters=None, footprint_bytes=None, connection_sparsity=None, activation_sparsity=None, effective_macs=None,
    effective_acs=None, dense=None,
)  # fmt: skip
"""Of what nobody counted."""


def arithmetic(kind: str, macs: float, dense: float) -> dict[str, float]:
    """Joules of multiply-accumulates of a type of `PICOJOULES`, under the names of what they are of.

    Args:
        kind: the type.
        macs: those whose factors are both not 0, which the arithmetic alone is counted for.
        dense: all, which a processor does.
    """
    name, each = PROCESSORS[kind]
    return {f"{kind} arithmetic, 45 nm": PICOJOULES[kind] * 1e-12 * macs, name: each * 1e-12 * dense}


def product_costs(parameters: int, footprint_bytes: int, macs: float, dense: float, **words: Any) -> Costs:
    """Costs of a model of float32 multiply-accumulates alone.

    Args:
        parameters: numbers that were learnt.
        footprint_bytes: of the weights.
        macs: multiply-accumulates of an example whose factors are both not 0.
        dense: all of them.
        words: other attributes of `Costs`.
    """
    counts: Any = {"effective_macs": macs, "dense": dense, "joules": arithmetic("float32", macs, dense)}
    return Costs(parameters=parameters, footprint_bytes=footprint_bytes, **counts, **words)


def spiking_costs(
    sim: neuro.Simulation, taken: Any, examples: int, *, steps: int | None = None, clock: bool = True
) -> Costs:
    """By NeuroBench's counts, and the bills of the chips that can run the network.

    Args:
        sim: the network.
        taken: what so many examples took.
        examples: how many.
        steps: of one; all that were run, divided by the examples, if not given.
        clock: whether real time has a meaning, which it lacks where a step has no time of its own.
    """
    from neuro.chips import neurobench

    found = neurobench(sim.program, taken.raw_counts, samples=examples, steps=steps)
    ops = found["synaptic_operations"]
    return Costs(
        parameters=found["parameter_count"],
        **{word: found[word] for word in ("footprint_bytes", "connection_sparsity", "activation_sparsity")},
        **{word: ops[word] for word in ("effective_macs", "effective_acs", "dense")},
        **on_chips(sim, taken, examples, clock),
    )


def on_chips(sim: neuro.Simulation, taken: Any, examples: int, clock: bool = True) -> dict[str, Any]:
    """The words `joules`, `joules_of_spikes`, `refused` and `unpriced` of a spiking network; see `spiking_costs`."""
    from neuro.chips import chip, place, quantise

    joules, moved, refused, unpriced = {}, {}, {}, {}
    for target, title in CHIPS.items():
        problems = (*quantise(sim.program, chip(target)).problems, *place(sim.program, chip(target)).problems)
        if why := [f"{each.what}: {each.why}" for each in problems if each.refused]:
            refused[title] = why[0]
            continue
        bill = sim.energy(target, of=taken).per(examples, "example")
        for name, one in (("as fast as it can", bill), ("in real time", bill.real_time))[: 2 if clock else 1]:
            joules[f"{title}, {name}"] = one.total_j
            if one.missing:
                unpriced[f"{title}, {name}"] = list(one.missing)
            moved[f"{title}, {name}"] = sum(value for what, value in one.by_cost().items() if what in BY_SPIKES)
    return {"joules": joules, "joules_of_spikes": moved, "refused": refused, "unpriced": unpriced}


def break_even(joules: float, of_spikes: float, opponent: float) -> float:
    """By which factor the spikes may change until a spiking network takes as much as its opponent; 0: even silent more.

    Times and updates stay as they are, so it is an estimate: with more spikes a chip also takes longer.

    Args:
        joules: of an example.
        of_spikes: the part that grows with the spikes.
        opponent: joules of an example of the other.
    """
    if not of_spikes:
        return math.inf if joules <= opponent else 0.0
    return max(0.0, (opponent - (joules - of_spikes)) / of_spikes)
