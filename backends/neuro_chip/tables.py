"""The arrays of a quantised program as the compiled loop sees them, and the columns of tables.

Neurons are numbered over all populations. `NET` lists the arrays; `neuro.kernels.address` describes how kernels access
them.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,misc"
from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from neuro.core.interrupts import AT_ONCE as AT_ONCE  # the kernels compare `stop` with this value
from neuro.kernels.address import Views, fields_of, pointer, row_of, table_of

Arrays = dict[str, NDArray[Any]]
"""All arrays that the loop reads and writes, by the names of `NET`."""

NONE = -1

POISSON, LISTED, CURRENT, RELAY, STEPPED = range(5)
"""Kinds of populations; numbers from `STEPPED` on are those of `neuro_chip.build.NUMBERS`."""

ONE_TO_ONE, DENSE, CSR, GRID = range(4)

# populations
(
    KIND,
    BEGIN,
    END,
    RING,
    SLOTS,
    RECORD,
    GROUP,
    BINARY,
    EXC_SHIFT,
    INH_SHIFT,
    START,
    STOP,
    ARRIVED,
    LATE,
    RECEPTORS,
    LOWEST,
    GRADED,  # the integer step resets neurons and sets their payloads
    PLANES,  # the first plane, and the end of the planes
    PLANES_END,
    INTERVAL,  # steps between resets of the states, 0: none
    OFFSET,
    INPUT_EXP,
    STATE_EXP,
    RELU,
    CUMULATIVE,
    POPULATION_COLUMNS,
) = range(26)

# projections
(
    SOURCE,
    TARGET,
    LAYOUT,
    WORD,
    WORD_STRIDE,
    LAG,
    LAG_STRIDE,
    ROW,
    SYNAPSE,
    POSITIVE,
    NEGATIVE,
    CHANNEL_HEIGHT,
    CHANNEL_WIDTH,
    ROWS,
    COLUMNS,
    KERNEL_HEIGHT,
    KERNEL_WIDTH,
    STRIDE,
    TOP,
    LEFT,
    DEPTH,
    REACH,
    MAPS,
    KERNEL,
    GATHER,
    MARKS,
    PLANE,  # offset of the projection's plane from the common ring of the target; 0: no plane
    PLANE_STRIDE,  # offset between the planes of two successive lags
    FIRST_LAG,
    PROJECTION_COLUMNS,
) = range(30)

# planes: rings of projections whose sums are shifted or wrapped before they are added to the common ring
PLANE_RING, PLANE_SHIFT, PLANE_WRAPS, PLANE_RECEPTOR, PLANE_COLUMNS = range(5)

# groups
POPULATION, FIRST_TO_FIRE, CLOSED, WINNER, DECIDED, RIVALS, APART, GROUP_COLUMNS = range(8)

# groups with several winners; RADIUS is NONE for others
RADIUS, PER_MAP, LOCAL_MAPS, LOCAL_ROWS, LOCAL_COLUMNS = range(5)

# state of groups with several winners: numbers of neurons that may still win, and that have won
OPEN, WINS = range(2)

# reasons why a neuron must not fire: silenced for a trial, silenced by a winner, or a winner itself
SILENCED, BLOCKED, WON = 1, 2, 4

# the clock
STEP, RECORDED, EMITTED, STOP_GROUP, CLOCK_COLUMNS = range(5)

# overflows and other counts that exist only on chips, per population
INPUT_WRAPS, WRAPS, DRIVE_WRAPS, CLIPS, SATURATIONS, MERGED, NATIVE_COLUMNS = range(7)
NATIVE = ("input wraps", "current wraps", "drive wraps", "voltage clips", "slot saturations", "merged spikes")


NET = """
pops i8 2           columns of `tables`, a row per population
projections i8 2    columns of `tables`, a row per projection
out i8 1            projections by source
out_ends i8 1       end of each source's projections in `out`
groups i8 2         columns of `tables`, a row per group
clock i8 1          columns of `tables`
stop i8 1           whether to end, see `neuro.core.interrupts`
words {words} 1     words of all synapses
kernels {words} 1   words of grids, sorted by place and map, see `deliver`
lags i4 1           lags of all synapses in steps
rows i8 1           ends of the CSR rows
targets i4 1        local targets of all CSR synapses
gathered i4 1       sums of a step on grids
marked u1 1         places with a sum
ring i4 1           input of future steps
planes i8 2         columns of `tables`, a row per plane
came u1 1           whether there is input, for each population and slot
arrived u1 1        whether a spike reaches a neuron, for each slot
arrived_all u1 1    whether a spike reaches all neurons of a population, for each slot
v i4 1              states
u i4 1
g_inh i4 1
hold i4 1
keep_u i4 1         registers
keep_v i4 1
threshold i4 1
bias i4 1
v_reset i4 1
fall i4 1           decrease of v at a spike; 0: v is reset to v_reset
refractory i4 1
v_rest i4 1
r_m i4 1
exc_decay i8 1
exc_init i8 1
inh_decay i8 1
inh_init i8 1
still i4 2          the states before a step without input
resting u1 1        whether a population is unchanged until input comes
local i8 2          groups with several winners, columns of `tables`, a row per group
standing i8 2       state of these groups, columns of `tables`
map_wins i8 2       (groups, maps) number of winners of each map
won i8 2            (neurons, 2) winners in their order, and the step
fired u1 1          whether a neuron is above threshold in the present step
payload i4 1        payload of a graded neuron in the present step
muted u1 1          reasons why a neuron must not fire, bits of `tables`; 0: it may
first i8 1          step of each neuron's first spike since the beginning of the run or trial
events i8 1         spike events of each neuron
spikes i8 1         spikes of each neuron, with multiplicity
active i8 1         neuron-steps with an arrival or a spike, by population
native i8 2         counts that exist only on chips, columns of `tables`
potential i4 1      v at a decision
emitted i8 1        neurons that fired in the last step
emitted_times i8 1  multiplicity or payload of each emitted event
set_out i8 1        last step whose spikes were sent ahead, before weights changed, by projection
keys u8 1           keys of the generators' draws
group_keys u8 1     keys of the groups' draws
mean f8 1           mean of a poisson_generator's neuron per step
nothing f8 1        exp(-mean)
list_steps i8 1     listed spikes of the generators
list_ids i8 1
list_counts i8 1
cursor i8 2         (2, populations) the next listed spike, and the end of the list
rec_steps i8 1      recorded spikes
rec_ids i8 1
rec_counts i8 1
"""

_FIELDS = {kind: fields_of(NET.format(words=kind)) for kind in ("i2", "i4")}
_VIEWS = {getattr(types, np.dtype(kind).name): Views(f"Chip {kind}", 0, fields) for kind, fields in _FIELDS.items()}


class Bound:
    """The arrays as arguments of the loop; the object keeps them alive.

    Attributes:
        view: the table of their addresses.
        words: the array of words, whose type selects the compiled loop.
    """

    def __init__(self, arrays: Arrays) -> None:
        self._fields = _FIELDS[arrays["words"].dtype.str[1:]]
        self._arrays, self.words = dict(arrays), arrays["words"]
        self.view = table_of((self._fields, arrays))

    def take(self, arrays: Arrays) -> None:
        """Replace the arrays that have changed."""
        self.words = arrays["words"]
        for k, field in enumerate(self._fields):
            array = arrays[field[0]]
            if array is not self._arrays[field[0]]:
                self._arrays[field[0]] = array
                self.view[k] = row_of(field, array)


@intrinsic
def net_of(typingctx, table, words):
    """Return the arrays of a table; `words` is the array of that name, whose type the family of chips determines."""
    return _VIEWS[words.dtype](table, words), pointer
