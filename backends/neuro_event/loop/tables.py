"""Columns of the tables that describe a program to the kernels. Neurons are counted through all populations.

A population begins at a multiple of `BLOCK * GROUPED` neurons, so that blocks and groups of blocks belong to one.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,no-any-return,misc"
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from neuro.core.interrupts import AT_ONCE as AT_ONCE  # the kernels compare `stop` with it
from neuro.kernels import address
from neuro.kernels.address import Views, caller, fields_of, viewer
from neuro.kernels.jit import inlined, subkernel

# 64 neurons are a block; 8 blocks are a group, whose flags, a byte each, are tested as one word of 64 bits.
BLOCK = 64
BLOCK_SHIFT = 6
assert 1 << BLOCK_SHIFT == BLOCK
GROUPED = 8
NONE = -1

POISSON, LISTED, CURRENT, NEURON, GENERATOR = range(5)
ONE_TO_ONE, DENSE, CSR, GRID = range(4)
POSITIVE, NEGATIVE, MIXED = range(3)

# populations
(
    KIND,
    MODEL,  # unused; saved states have it
    BEGIN,
    END,
    FIRST_BLOCK,
    LAST_BLOCK,
    CONSTANT,
    CONSTANT_STRIDE,
    RECEPTORS,
    RELAY,
    LINEAR,
    RECORD,
    GROUP,
    HISTORY,
    ARRIVALS,
    ARRIVALS_END,
    RINGS,
    RINGS_END,
    COUNTS,
    COUNTS_STEPS,
    TABLE,
    START,
    STOP,
    NUMBER,
    ENTRY,
    CARRIED,
    COLLECTS,
    GATHERS,  # 1: synapses onto it learn by moves
    JOINED,  # of what arrives: those in joined rows, and the end
    JOINED_END,
    PAYLOAD,  # the state that its spikes carry, none where they carry no payload
    POPULATION_COLUMNS,
) = range(32)

# projections
(
    SOURCE,
    TARGET,
    LAYOUT,
    LAG,
    RING,
    RING_MASK,
    RING_SIZE,
    ROW,
    SYNAPSE,
    WEIGHT,
    WEIGHT_STRIDE,
    DELAY,
    DELAY_STRIDE,
    SIGN,
    WAKE_ALL,
    DENSE_COUNTS,
    CHANNEL_HEIGHT,
    CHANNEL_WIDTH,
    MAPS,
    ROWS,
    COLUMNS,
    KERNEL_HEIGHT,
    KERNEL_WIDTH,
    STRIDE,
    TOP,
    LEFT,
    DEPTH,
    REACH,
    CHANNELS_INSIDE,
    RECEPTOR,
    RUN,
    SHORTEST,
    DELAYS,
    SINGLE,  # of joined rows, 1: weights are kept in 32 bits
    PROJECTION_COLUMNS,
) = range(35)

# plastic projections
(
    PROJECTION,
    RULE,
    MODULATED,
    FIRST_SYNAPSE,
    FIRST_SOURCE,
    FIRST_TARGET,
    INCOMING,
    DOPAMINE,
    DOPAMINE_ONE_TO_ONE,
    DOPAMINE_DELAY,
    GRID_STEPS,
    LONGEST,
    RULE_NUMBER,
    RULE_ENTRY,
    SOURCE_STRIDE,
    COLUMN,
    FEWEST,
    MOST,
    NOTED,
    CONSTANTS,
    CONSTANTS_STRIDE,
    EAGER,
    EPOCH,
    PLASTIC_COLUMNS,
) = range(24)

# projections that learn by moves
(
    MOVE_PROJECTION,
    MOVE_SYNAPSE,
    MOVE_SOURCE,
    MOVE_TARGET,
    MOVE_SEEN,
    MOVE_ENTRY,
    MOVE_COLUMNS,
) = range(7)

MOVE_TRACES = 4
"""The most pre traces of a rule for moves."""

# lines of currents that change at every step
(
    DRIVEN,
    CHARGED,
    BEGINS,
    HOW,
    FIRST_VALUE,
    VALUES,
    COLUMN_AT,
    LATE,
    LINE_WEIGHT,
    LINE_STRIDE,
    LINE_ENDS,
    SHARE,
    LINE_COLUMNS,
) = range(13)

# how a line goes: one column to all neurons, one to each, or as it is listed
TO_ALL, TO_EACH, AS_LISTED = range(3)

# threads
DONE, DONE_DOPAMINE, HORIZON, OVERRUN, UNCOUNTED = range(5)

# groups
FIRST_TO_FIRE, IN_TRIAL, WINNER, DECIDED, RIVALS, APART, GROUP_COLUMNS = range(1, 8)

# groups with several winners; RADIUS is NONE for others
RADIUS, PER_MAP, LOCAL_MAPS, LOCAL_ROWS, LOCAL_COLUMNS, NEXT_MAP, NEXT_PLACE, LOCAL_ENTRIES = range(8)

# how they stand
OPEN, WINS = range(2)

# why a neuron must not fire: it is left out of a trial, silenced by a winner, or has won
SILENCED, BLOCKED, WON = 1, 2, 4

TALLY_BITS = 20
"""Of a tally, see `generators`: the lower bits that hold spikes; the others hold events, of which there are no more."""


NET = """
pops i8 2          columns of `tables`, a row per population
projections i8 2   likewise, a row per projection
incoming i8 1      projections by target: those delivered on arrival, then those with a ring
at_emission i8 1   static projections that are delivered into a ring at emission
set_out i8 1       of each projection: the step up to which what was emitted lies in its ring, with the weights of then
edges i8 2         (populations, threads + 1) first block of each thread in each, and the end
most i8 1          spikes that a step of each thread can make
parameters f8 2    of each population, or of each neuron where they differ
constants f8 2     computed from them for one step
scratch f8 2       constants of another interval, a row per thread
state f8 2         (states, neurons)
initial f8 2       the states at step 0
x f8 2             (receptors, neurons) input of the present step; -0.0 where nothing arrived
bits i8 2          the same memory as integers
empty_input f8 2   no input
buf f8 1           the memory of x, then the rings
current f8 1       external current of the present step, pA
none f8 1          no current, for a group of blocks
lines i8 2         columns of `tables`, a row per line of currents that change at every step
line_ends i8 1     of lines that are listed: where the synapses of each neuron end
line_columns i8 1  columns of `emitted` of these synapses
line_lates i8 1    their delays, steps
line_weights f8 1  of all lines
shares f8 1        of lines that charge a state: what a step adds of a current, for each neuron
emitted f8 1       currents that are emitted, each value once: of each line (rows, columns)
emitted_rows i8 2  (lines, steps) which row of a line is emitted
emitted_from i8 1  the first of these steps
fired u1 1         how often each reached threshold in the present step
spots u1 1         eight neurons each: not 0 where input of the present step arrived, see `step_collecting`
spot_words u8 1    the same memory, a block at a time
muted u1 1         whether it must not fire, and why: bits of `tables`
events i8 1        spike events of each neuron
spikes i8 1        with their multiplicity
active i8 2        (threads, populations) neuron-steps with an arrival or a spike
draws f8 1         random numbers of the present step, of neurons whose models draw; else empty
order i8 1         id of each neuron in its population
awake u1 1         whether a block is stepped
awake_groups u8 1  the same memory, eight blocks at a time
due u1 2           (threads, slots * blocks) where input arrives; each thread marks its own blocks in its row
due_groups u8 2    the same memory, eight blocks at a time
due_slots u1 3     (threads, slots, blocks) the same memory, by slot
slept i8 1         last step of a sleeping block
busy i8 1          last step in which a block had input or a spike, or a silent one of a generator a rate
mean f8 1          of a poisson_generator's neurons, per step
nothing f8 1       exp(-mean)
words u8 2         random words of a group of blocks, a row per thread
guides u2 2        of `cumulative`, see `neuro.kernels.draws`
cumulative f8 2    Poisson tables
counts u2 1        rings of multiplicities of generators that keep them
tally u4 1         what these have sent and is not yet in `events` and `spikes`, see `generators`
keys u8 1          of the generators' draws
list_steps i8 1    listed spikes of the generators
list_ids i8 1
list_counts i8 1
cursor i8 2        (threads + 1, populations) next listed spike; the last row holds the ends
rows i8 1          ends of the CSR rows, cut at the threads' edges
runs u4 1          likewise of the runs of each source and delay, counted from a projection's first synapse
joined i8 2        joined rows, see `joined_rows`: columns of `tables` that say where runs lie; ROW: its own number
joined_runs u4 1   ends of their runs, as in `runs`
joined_steps u2 1  where each of their synapses adds, in x, counted from the one before in its run
joined_weights f8 1
joined_singles f4 1 weights of rows whose weights all fit into 32 bits
joined_bases i8 2  (rows, threads) where their runs begin in x
joined_reach u1 2  (rows, populations) whether any of their synapses ends there
queue i8 3         (threads, runs, 3) what is about to be added: first and last synapse, multiplicity
targets i4 1       local targets of all CSR synapses
weights f8 1       of all projections
delays i4 1        of all projections, steps
tau_minus f8 1     of each neuron
log_ids i4 2       (threads, capacity) spikes under way, a ring
log_counts i8 2
log_ends i8 3      (threads, steps, populations + 1) where each population's spikes of a step begin
log_at i8 2        (threads, cache line) where each thread writes next
rec_steps i8 2     recorded spikes of each thread
rec_ids i4 2
rec_counts i8 2
rec_at i8 2         (threads, a cache line)
found i8 2         neurons of a group that reached threshold
found_arrived u1 2
rivals i8 2        those of them of which one fires, a row per thread
groups i8 2        columns of `tables`, a row per group
group_keys u8 1
closed u1 1        whether no neuron of a group may fire any more
local i8 2         of groups with several winners, columns of `tables`, a row per group
standing i8 2      how many of each of these may still win, and have won in this trial
map_wins i8 2      (groups, maps) how often each of their maps has won
won i8 2           (neurons of the trials' output, 2) winners of this trial, in order, and the step
clock i8 2         (threads, columns of `tables`)
stop i8 1          whether to end, see `neuro.core.interrupts`
reached i8 1       the step before which a run ended
map_of i8 1        map of each neuron of the trials' output
potential f8 1     largest V_m of each map
best i8 1          the neuron that has it
resets i8 1        state rows that a trial starts anew
stages i8 1        addresses of what is compiled apart, see `stages`
"""

PLASTIC = """
table i8 2         columns of `tables`, a row per plastic projection
rule f8 2          constants of each rule, then those of synapses that have their own
tau f8 2           tau_plus and tau_n of each
decay f8 3         (projections, 3 + traces, steps) of tau_plus, tau_n, the targets' tau_minus, `kinds`; or 0
y f8 2             (states, synapses)
sent f8 1          weight at the last pre spike
reached i8 1       step up to which a modulated synapse has learnt; empty if none is
k_plus f8 2        (threads, sources) trace of each source at a step, as in `eager_rules`; each thread has a copy
k_time i8 2        the step of that value
spiked i8 2        the step of each source's last spike
n f8 1             dopamine of each target at a step
n_time i8 1        that step
incoming i8 1      synapses by target: ends
in_synapse i4 1    the synapses, from the first of their projection on
in_source i4 1     their sources
heard f8 2         (targets, traces) of the post spikes that eager synapses have heard, kept as in `eager_rules`
past i8 2          history of each neuron's spikes, see `histories`
traces f8 2        the same memory as floats
kinds f8 3         (projections, traces, 3) of third-party rules: time constant, nearest, what a spike adds
columns i8 3       (populations, columns, 2) whose post trace a column of `others` is: projection and trace
others f8 3        (histories, entries, columns) these traces just before each entry
draw_keys u8 1     of the synapses' draws, by projection
drawn_as i8 1      number of each synapse in the program's order; empty if no rule draws
note_this u1 1     whether a synapse is noted at pre spikes; empty if none is
note_at i8 2       (threads, cache line) where each thread notes next
note_steps i8 2    (threads, room) step of a pre spike
note_synapses i8 2 the synapse
note_y f8 3        (threads, states, room) what it was left with
move_table i8 2    columns of `tables`, a row per projection that learns by moves
move_rule f8 2     constants of each rule
move_left f8 2     (projections, traces) what a step leaves of a pre trace
move_adds f8 2     what a spike adds to it
move_x_min f8 1    below which a source counts as silent
move_sign f8 1     what arrives of a weight of 1
move_y f8 2        (states, synapses)
move_x f8 2        (threads, sources and traces) pre traces of the present step; each thread has a copy
move_lists i8 3    (threads, 2, sources) sources that are lit, and live, see `moves`
move_count i8 3    (threads, projections, 2) how many
move_is_lit u1 2   (threads, sources)
move_is_live u1 2  (threads, sources)
move_gate f8 1     of each target
move_signal f8 1   likewise, what teaches
move_spikes f8 1   likewise, how often each spiked in the present step; 0 between two
move_seen f8 1     likewise, the state that the rule sees; 0 if it sees none
move_concerned i8 1 targets of the present step that spiked or are seen, those of each thread together
"""

_NET, _PLASTIC = fields_of(NET), fields_of(PLASTIC)
NET_FIELDS, PLASTIC_FIELDS = ([name for name, _, _ in fields] for fields in (_NET, _PLASTIC))


def table_of(net: Mapping[str, NDArray[Any]], plastic: Mapping[str, NDArray[Any]]) -> NDArray[np.int64]:
    """The table for some arrays, by name. The caller keeps the arrays alive."""
    return address.table_of((_NET, net), (_PLASTIC, plastic))


def with_plastic(table: NDArray[np.int64], **arrays: NDArray[Any]) -> NDArray[np.int64]:
    """The same table with other arrays of the same shapes for some plastic fields."""
    other = table.copy()
    for name, array in arrays.items():
        other[len(NET_FIELDS) + PLASTIC_FIELDS.index(name), 0] = array.ctypes.data
    return other


ENTRY_TYPE = types.int64(*(types.int64,) * 7, types.float64)
"""Of the entry of a population's model."""

RULE_TYPE = types.int64(*(types.int64,) * 6, types.float64)
"""Of the entry of a rule."""

_call_entry = caller(ENTRY_TYPE.return_type, *ENTRY_TYPE.args)
_call = caller(RULE_TYPE.return_type, *RULE_TYPE.args)


@inlined
def slot_mask(net):
    """What takes a step to its slot in `due`. To divide the sizes of `due` would take as long as a spike."""
    return net.due_slots.shape[1] - 1


@subkernel
def call_rule(view, row, operation, index, step, thread, h):
    """Let the entry of a rule do an operation, see `lazy_rules`; `row` is its projection's in `plastic.table`."""
    return _call(row[RULE_ENTRY], (view, row[RULE_NUMBER], operation, index, step, thread, h))


@subkernel
def call_moves(view, k, operation, index, step, thread, h):
    """Let the entry of a rule for moves do an operation, see `moves`."""
    return _call(plastic_of(view).move_table[k, MOVE_ENTRY], (view, k, operation, index, step, thread, h))


@subkernel
def call_entry(view, row, operation, lo, hi, thread, step, h):
    """Let the entry of a population's model do an operation, see `operations`."""
    return _call_entry(row[ENTRY], (view, row[NUMBER], operation, lo, hi, thread, step, h))


net_of = viewer(Views("Net", 0, _NET))
plastic_of = viewer(Views("Plastic", len(NET_FIELDS), _PLASTIC))
