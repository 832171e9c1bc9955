"""All arrays of a quantised program as the compiled loop sees them, and the columns of its tables.

Neurons are counted through all populations. `NET` lists the arrays; how a kernel sees them: `neuro.kernels.address`.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,misc"
from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from neuro.core.interrupts import AT_ONCE as AT_ONCE  # the kernels compare `stop` with it
from neuro.kernels.address import Views, fields_of, pointer, row_of, table_of

Arrays = dict[str, NDArray[Any]]
"""All arrays that the loop reads and writes, by the names of `NET`."""

NONE = -1

POISSON, LISTED, CURRENT, RELAY, STEPPED = range(5)
"""Kinds of populations; those from `STEPPED` on are the steps of `neuro_chip.families`."""

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
    GRADED,  # its step resets it and says what it sends
    PLANES,  # of rings that are shifted or wrapped apart: the first, and the end
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
    PLANE,  # how far behind the common ring of its target its own begins, 0: it has none
    PLANE_STRIDE,  # from one plane to that of the next lag, where sums of each lag are shifted apart
    FIRST_LAG,
    PROJECTION_COLUMNS,
) = range(30)

# planes: rings of projections whose sums are shifted or wrapped before they are added to the common one
PLANE_RING, PLANE_SHIFT, PLANE_WRAPS, PLANE_RECEPTOR, PLANE_COLUMNS = range(5)

# groups
POPULATION, FIRST_TO_FIRE, CLOSED, WINNER, DECIDED, RIVALS, APART, GROUP_COLUMNS = range(8)

# groups with several winners; RADIUS is NONE for others
RADIUS, PER_MAP, LOCAL_MAPS, LOCAL_ROWS, LOCAL_COLUMNS = range(5)

# how they stand: how many may still win, and have won
OPEN, WINS = range(2)

# why a neuron must not fire: it is left out of a trial, silenced by a winner, or has won
SILENCED, BLOCKED, WON = 1, 2, 4

# the clock
STEP, RECORDED, EMITTED, STOP_GROUP, CLOCK_COLUMNS = range(5)

# overflows and what else only chips count, per population
INPUT_WRAPS, WRAPS, DRIVE_WRAPS, CLIPS, SATURATIONS, MERGED, NATIVE_COLUMNS = range(7)
NATIVE = ("input wraps", "current wraps", "drive wraps", "voltage clips", "slot saturations", "merged spikes")


NET = """
pops i8 2           columns of `tables`, a row per population
projections i8 2    likewise, a row per projection
out i8 1            projections by source
out_ends i8 1       where those of each source end
groups i8 2         columns of `tables`, a row per group
clock i8 1          likewise
stop i8 1           whether to end, see `neuro.core.interrupts`
words {words} 1     of all synapses
kernels {words} 1   of grids, see `deliver`
lags i4 1           of all synapses, steps
rows i8 1           ends of the CSR rows
targets i4 1        local targets of all CSR synapses
gathered i4 1       sums of a step, of grids
marked u1 1         places that have one
ring i4 1           input to come
planes i8 2         columns of `tables`, a row per plane
came u1 1           whether any comes, for each population and slot
arrived u1 1        whether a spike reached a neuron
arrived_all u1 1    whether one reached all of a population
v i4 1              states
u i4 1
g_inh i4 1
hold i4 1
keep_u i4 1         registers
keep_v i4 1
threshold i4 1
bias i4 1
v_reset i4 1
fall i4 1           how far v falls at a spike; 0: it goes to v_reset
refractory i4 1
v_rest i4 1
r_m i4 1
exc_decay i8 1
exc_init i8 1
inh_decay i8 1
inh_init i8 1
still i4 2          the states before a step without input
resting u1 1        whether a population stays as it is until input comes
local i8 2          of groups with several winners, columns of `tables`, a row per group
standing i8 2       how many of each of these may still win, and have won
map_wins i8 2       (groups, maps) how often each of their maps has won
won i8 2            (neurons, 2) winners, in order, and the step
fired u1 1          whether above threshold in the present step
payload i4 1        what graded neurons send then
muted u1 1          whether it must not fire, and why: bits of `tables`
first i8 1          the step of each neuron's first spike since it was set to never
events i8 1         spike events of each neuron
spikes i8 1         with their multiplicity
active i8 1         neuron-steps with an arrival or a spike, by population
native i8 2         what only chips count, columns of `tables`
potential i4 1      v at a decision
emitted i8 1        neurons that fired in the last step
emitted_times i8 1  how often
set_out i8 1        of each projection: the step whose spikes were sent before its weights changed
keys u8 1           of the generators' draws
group_keys u8 1
mean f8 1           of a poisson_generator's neurons, per step
nothing f8 1        exp(-mean)
list_steps i8 1     listed spikes of the generators
list_ids i8 1
list_counts i8 1
cursor i8 2         (2, populations) the next of these, and their end
rec_steps i8 1      recorded spikes
rec_ids i8 1
rec_counts i8 1
"""

_FIELDS = {kind: fields_of(NET.format(words=kind)) for kind in ("i2", "i4")}
_VIEWS = {getattr(types, np.dtype(kind).name): Views(f"Chip {kind}", 0, each) for kind, each in _FIELDS.items()}


class Bound:
    """Arrays as the loop takes them, which it keeps alive.

    Attributes:
        view: their table.
        words: one of them, whose type the loop is compiled for.
    """

    def __init__(self, arrays: Arrays) -> None:
        self._fields = _FIELDS[arrays["words"].dtype.str[1:]]
        self._arrays, self.words = dict(arrays), arrays["words"]
        self.view = table_of((self._fields, arrays))

    def take(self, arrays: Arrays) -> None:
        """Take those that were replaced."""
        self.words = arrays["words"]
        for k, field in enumerate(self._fields):
            array = arrays[field[0]]
            if array is not self._arrays[field[0]]:
                self._arrays[field[0]] = array
                self.view[k] = row_of(field, array)


@intrinsic
def net_of(typingctx, table, words):
    """The arrays of a table; `words` is the array of that name, whose type a family of chips chooses."""
    return _VIEWS[words.dtype](table, words), pointer
