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

Kernels of a grid are spelled out on both: the chips share no weights between neurons. A chip without an arithmetic here
(Loihi 2) is packed as Loihi 1, as no other format was found published.
"""

from __future__ import annotations

from typing import Any

from neuro.chips.arrival_rule import longest_lag, register
from neuro.chips.description import Chip
from neuro.chips.loihi.arithmetic import REGISTER_OF_ONE
from neuro.program.program import Program

BLOCK = 64
BLOCK_BITS = 10
UNIT_BITS = 64
WEIGHT_BITS = 8
TAG_BITS = 9
SHORTEST_INDEX = 6
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


def synapse_bits(program: Program, index: int) -> int:
    """Bits of one synapse of a projection in Loihi's blocks, without its index."""
    part = program.projections[index]
    weight = int(part.synapse.parameters().get("num_weight_bits", WEIGHT_BITS))
    longest = int(register(longest_lag(program, index), REGISTER_OF_ONE).max(initial=0))
    tagged = part.synapse.learns in ("pairs", "chip") or part.synapse.delays
    return weight + longest.bit_length() + (TAG_BITS if tagged else 0)
