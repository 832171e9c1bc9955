"""Resources of a SpiNNaker core for learning: bytes of its own memory, and cycles of its ticks.

| of the 64 KiB | bytes |
| --- | --- |
| history of a neuron | 4 + 16 (4 + n), with dopamine 8 + 16 (6 + n); traces need n = 2, nearest 0, triplet 8 |
| slots | 2 x delays x receptors x neurons, each factor rounded up to a power of two |
| tables | 2 per entry, and 4 |
| two buffers of rows | the longest row onto the core |
| neuron | 15 words: the registers and states of `iaf_psc_exp` |

A program may allocate 59,756 bytes. Stack, recordings and the table of sources need further memory that is not counted
here. A refused network therefore does not fit, and a network near the limit may not fit either.

The cycles were measured with the machine code of two released programs, `synapses_stdp_mad_pair_additive` and
`synapses_stdp_izhikevich_neuromodulation_pair_additive`, executed in an emulator with the timings of the ARM9E-S and
memory without wait states. The cycles are a lower bound, because packets, transfers of rows, neurons and static
synapses are not counted. The other programs are assumed to need as many cycles. Source: sPyNNaker 7.4.1; its issue 620.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from neuro.chips.description import Chip
from neuro.chips.incoming import row_form, row_words, rows_of, spiking
from neuro.chips.inputs import longest_lag, register
from neuro.chips.spinnaker_rule import INDEX_SHIFTS, KNOWN, PLUS, C, D, X, Y, program_of, table_length
from neuro.model.synapses import Synapse, spinnaker_learning, vogels_sprekeler
from neuro.program.program import Program

SLOT_BITS = 14
"""Bits of the index of a slot. The index consists of a delay, a receptor and a neuron of the core."""
REGISTER_OF_ONE = 1
Parts = Sequence[tuple[int, int, int]]
"""Runs of neurons on a core: population, and its neurons first <= i < last."""
Visits = Mapping[int, tuple[float, float]]
"""Work of a tick by projection: synapses visited by packets, and synapses visited by post spikes."""
ENTRIES = 16
"""Entries in the history of a neuron, one per post spike."""
NEURON_BYTES = 60
CLOCK_HZ = 200e6


PAIR, TAUGHT = (170, 44), (379, 123)
"""Cycles per synapse visited by a packet, and per post spike in the history, without and with dopamine."""


def neuron_bits(neurons: int) -> int:
    """Return the bits that number the neurons of a core."""
    return max(1, (neurons - 1).bit_length())


def slots_of(program: Program, chip: Chip, target: int) -> int:
    """Return the number of slots for delays onto a population. The host holds back spikes with longer delays."""
    size = program.populations[target].size
    limit = int(2 ** (SLOT_BITS - neuron_bits(min(size, chip.limit("neurons_per_core") or size)) - 1))
    lags = (longest_lag(program, k) for k in spiking(program) if program.projections[k].target == target)
    longest = max((int(register(lag, REGISTER_OF_ONE).max(initial=1)) for lag in lags), default=1)
    return min(max(2, 1 << (longest - 1).bit_length()), limit)


def learning_onto(program: Program, target: int) -> list[int]:
    """Return the indices of the projections onto a population that learn on the machine."""
    parts = program.projections
    indices = (k for k in spiking(program) if parts[k].target == target and parts[k].grid is None)
    return [k for k in indices if isinstance(parts[k].synapse, KNOWN)]


def bytes_of(program: Program, chip: Chip, target: int, neurons: int) -> int:
    """Return the bytes of a core's own memory for learning onto some neurons of a population.

    Args:
        program: the whole network.
        chip: the chip with the limit of neurons.
        target: index of the population.
        neurons: number of neurons of the population on the core.

    Returns:
        The bytes; 0 if no synapse onto the population learns.
    """
    plastic = learning_onto(program, target)
    if not plastic:
        return 0
    part = program.populations[target]
    synapse, tau_minus = program.projections[plastic[0]].synapse, float(np.max(part.parameters.get("tau_minus", 20.0)))
    slots = 4 * slots_of(program, chip, target) << neuron_bits(neurons)
    rows = [rows_of(program, k) for k in plastic]
    longest = [min(int((sources.end - sources.begin).max(initial=0)), neurons) for sources in rows]
    buffers = 2 * max(4 * int(row_words(n, row_form(program, k))) for k, n in zip(plastic, longest, strict=True))
    tables = sum(2 * table_length(tau, program.resolution, shift) + 4 for tau, shift in _tables(synapse, tau_minus))
    return neurons * (_history_bytes(synapse) + NEURON_BYTES) + slots + tables + buffers


def _history_bytes(synapse: Synapse) -> int:
    timing, dopamine = program_of(synapse)
    return 8 + ENTRIES * 8 if dopamine else 4 + ENTRIES * (4 + {"nearest": 0, "triplet": 8}.get(timing, 2))


def _tables(synapse: Synapse, tau_minus: float) -> list[tuple[float, int]]:
    """Return the time constants of a rule's tables in ms, and the shifts of their indices."""
    numbers, (timing, dopamine) = synapse.parameters(), program_of(synapse)
    if timing == "recurrent":  # both windows have tables like those of the pair rule
        return [(numbers["mean_pre_window"], 0), (numbers["mean_post_window"], 0)]
    taus: dict[int, Any] = {PLUS: numbers["tau" if isinstance(synapse, vogels_sprekeler) else "tau_plus"]}
    if isinstance(synapse, spinnaker_learning):
        tau_minus = synapse.tau_minus
    if timing == "triplet":
        own_taus = ("tau_x", "tau_y") if "tau_x" in numbers else ("tau_plus_triplet", "tau_minus_triplet")
        taus |= {X: numbers[own_taus[0]], Y: numbers[own_taus[1]]}
    taus |= {C: numbers["tau_c"], D: numbers["tau_n"]} if dopamine else {}
    return [(tau_minus, 0), *((float(np.max(tau)), INDEX_SHIFTS[k]) for k, tau in taus.items())]


def busiest(program: Program, cores: Iterable[Parts], visits: Visits) -> float:
    """Return a lower bound of the cycles of learning per tick on the busiest core.

    Args:
        program: the whole network.
        cores: parts of each core.
        visits: work of learning, to be divided among the cores by their share of the target's neurons.
    """
    largest = 0.0
    for parts in cores:
        cycles = 0.0
        for population, first, last in parts:
            for k in learning_onto(program, population):
                _, dopamine = program_of(program.projections[k].synapse)
                cycles_per_visit = TAUGHT if dopamine else PAIR
                work = sum(n * each for n, each in zip(visits[k], cycles_per_visit, strict=True))
                cycles += work * (last - first) / program.populations[population].size
        largest = max(largest, cycles)
    return largest


def learning_notes(program: Program, chip: Chip, cores: Sequence[Parts], visits: Visits | None) -> Iterator[str]:
    """Yield notes on memory and time of learning; arguments are those of `Arithmetic.learning_notes`."""
    if not any(learning_onto(program, k) for k in range(len(program.populations))):
        return
    condition = "if all sources and targets spike once in a tick"
    if visits is None:
        limit = chip.limit("memory_bytes_per_core")
        need = max((sum(bytes_of(program, chip, p, b - a) for p, a, b in parts) for parts in cores), default=0)
        limit_text = "" if limit is None else f" of the {limit:,}"
        yield f"learning needs up to {need:,}{limit_text} bytes of a core's own memory"
        visits = {k: (part.size, part.size) for k, part in enumerate(program.projections)}
    else:
        condition = "on average"
    cycles, tick = busiest(program, cores, visits), CLOCK_HZ * (1e-3 if chip.step_s is None else chip.step_s.value)
    slower = ": slower than real time" if cycles > tick else ""
    yield f"learning needs > {cycles:,.0f} of the {tick:,.0f} cycles of a tick on the busiest core {condition}{slower}"
