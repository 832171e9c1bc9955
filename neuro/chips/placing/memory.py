"""What the synapses of all cores take of their memories."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from neuro.chips.arithmetics import placed_as
from neuro.chips.description import Chip
from neuro.chips.placing.incoming import Incoming
from neuro.chips.placing.packing import ROW_WORDS, WORD_BITS, block_bits, index_bits
from neuro.program.program import Ints

Words = NDArray[np.int32]


def core_bytes(chip: Chip, neurons: Ints, core: Words, line: Words, synapses: Words, into: Incoming) -> Ints:
    """Bytes of synapses of every core.

    Args:
        chip: tells the packing.
        neurons: of every core.
        core: a core that a line (a source neuron of a projection) reaches, one entry for each such pair.
        line: the line.
        synapses: how many it has onto that core.
        into: what the lines are.
    """
    n = len(neurons)
    if not placed_as(chip).in_rows:
        index = np.array([index_bits(int(count)) for count in neurons], dtype=np.int64)
        bits = into.bits[into.projection[line]] + index[core]
        counts, widths = np.arange(synapses.max(initial=0) + 1), np.arange(bits.max(initial=0) + 1)
        taken = block_bits(counts[:, None], widths)[synapses, bits]
        return np.bincount(core, weights=taken, minlength=n).astype(np.int64) // 8
    longest = np.zeros((n, len(into.bits)), dtype=np.int64)
    np.maximum.at(longest, (core, into.projection[line]), synapses)
    row = np.where(longest > 0, ROW_WORDS + longest, 0) * WORD_BITS
    return np.asarray(row @ into.sources // 8)
