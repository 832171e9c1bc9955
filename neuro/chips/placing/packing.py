"""How many bits the synapses of a core take in its memory.

Loihi keeps, for each source neuron and projection, a list of the synapses onto the core in blocks of at most 64. A
block of n takes n (weight + delay + tag + index bits) + 10 bits, rounded up to 64: nengo-loihi 1.1.0's packing, where
the 10 bits are 4 for the format and 6 for the length. The bits of one synapse:

- weight: 8, or `num_weight_bits` of a `loihi_static`;
- delay: those of the largest delay register of the projection, none where that is 0 (shared delays are stored, too:
  a synapse has no other place for its delay);
- tag: 9 where the chip learns, none where the host applies the rule (`r_stdp`);
- index: those that tell the compartments of the core apart, none for one compartment, otherwise at least 6.

SpiNNaker keeps, for each projection and core, one row per source neuron in SDRAM: 3 words of header and one word of 32
bits per synapse, all rows as long as the longest, so that a row is found by multiplying (sPyNNaker's static rows; a
plastic synapse has two half words and takes as much).

Kernels of a grid are spelled out on both: these chips share no weights between neurons. A chip without an arithmetic
here is packed as Loihi 1.

Loihi 2 packs other synapses as Loihi 1, but keeps a kernel once on each core: for each place of the kernel and channel
a row of 8 bits a map, rounded up to 64. A core has fewer than 4,096 neurons of a layer with a kernel, whole columns of
its maps, of which there are a power of 2. So the layers of PilotNet take the cores that Intel's compiler prints for
them: 13, 25, 13, 3, 3 and 2 (lava-dl, `pilotnet_snn/benchmark.ipynb`), whose kernels have fewer bits where few do.
"""

from __future__ import annotations

import math
from typing import Any

from neuro.chips.arrival_rule import longest_lag, register
from neuro.chips.description import Chip
from neuro.chips.loihi.arithmetic import REGISTER_OF_ONE
from neuro.model.synapses import loihi2_convolution
from neuro.program.program import Program

BLOCK = 64
BLOCK_BITS = 10
UNIT_BITS = 64
WEIGHT_BITS = 8
TAG_BITS = 9
SHORTEST_INDEX = 6
LAYER_NEURONS = 4096
"""A core of Loihi 2 has fewer neurons of a layer with a kernel."""
SHARED = -1
"""In place of the bits of a synapse where a core keeps a kernel once."""
ROW_WORDS = 3
WORD_BITS = 32


def memory_limit(chip: Chip) -> int | None:
    """Bytes that the synapses of one core can take at most: its own memory, or all that its chip shares."""
    own = chip.limit("synapse_bytes_per_core")
    return chip.limit("synapse_bytes_per_chip") if own is None else own


def block_bits(synapses: Any, bits: Any) -> Any:
    """Bits of the synapses of one source onto one core, in Loihi's blocks; numbers or arrays.

    Args:
        synapses: how many.
        bits: of one synapse.
    """
    rest = synapses % BLOCK
    full = (BLOCK * bits + BLOCK_BITS + UNIT_BITS - 1) // UNIT_BITS
    last = (rest * bits + BLOCK_BITS + UNIT_BITS - 1) // UNIT_BITS
    return UNIT_BITS * (synapses // BLOCK * full + (rest > 0) * last)


def index_bits(neurons: int) -> int:
    """Bits that tell the compartments of a core apart; the formats are 0, 6, 7, ... (nengo-loihi 1.1.0)."""
    if neurons <= 1:
        return 0
    bits = SHORTEST_INDEX
    while neurons > 1 << bits:
        bits += 1
    return bits


def has_kernel(program: Program, index: int) -> bool:
    """Whether the synapses of a projection share kernels, which Loihi 2 keeps once on a core."""
    part = program.projections[index]
    return part.grid is not None or isinstance(part.synapse, loihi2_convolution)


def kernel_bits(program: Program, index: int, onto: int) -> int:
    """Bits of a kernel on a core of Loihi 2; `onto` is the most synapses onto a neuron."""
    part = program.projections[index]
    maps, fan_in = program.populations[part.target].shape[0], onto
    if part.grid is not None:
        maps, fan_in = part.grid.kernels[0], math.prod(part.grid.kernels[1:])
    return fan_in * -(-maps * WEIGHT_BITS // UNIT_BITS) * UNIT_BITS


def columns_per_core(shape: tuple[int, ...]) -> int:
    """Columns of a layer's maps on a core of Loihi 2."""
    most = max((LAYER_NEURONS - 1) // math.prod(shape[:-1]), 1)
    return 1 << most.bit_length() - 1


def synapse_bits(program: Program, index: int) -> int:
    """Bits of one synapse of a projection in Loihi's blocks, without its index."""
    part = program.projections[index]
    weight = int(part.synapse.parameters().get("num_weight_bits", WEIGHT_BITS))
    longest = int(register(longest_lag(program, index), REGISTER_OF_ONE).max(initial=0))
    tagged = part.synapse.learns in ("pairs", "chip") or part.synapse.delays
    return weight + longest.bit_length() + (TAG_BITS if tagged else 0)
