"""Columns of the tables that describe a program to the kernels, and declarations of all arrays.

Neurons are numbered through all populations, and so are blocks. A population begins at a multiple of
`BLOCK * GROUPED` neurons, so each block and each group of blocks belongs to one population.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,no-any-return,misc"
from __future__ import annotations

from collections import namedtuple
from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from neuro.core.interrupts import AT_ONCE as AT_ONCE  # the kernels compare `stop` with it
from neuro.kernels import address
from neuro.kernels.address import Entry, Views, caller, declared, viewer
from neuro.kernels.jit import inlined, subkernel

# A block has 64 neurons. A group has 8 blocks, whose flags of a byte each are tested as a word of 64 bits.
BLOCK = 64
BLOCK_SHIFT = 6
assert 1 << BLOCK_SHIFT == BLOCK
GROUPED = 8
NONE = -1

KINDS = ("poisson", "listed", "current", "neuron", "generator")
POISSON, LISTED, CURRENT, NEURON, GENERATOR = range(5)
ONE_TO_ONE, DENSE, CSR, GRID = range(4)
POSITIVE, NEGATIVE, MIXED = range(3)

# populations
(
    KIND,  # index in KINDS
    BEGIN,  # first neuron, numbered through all populations
    END,  # neuron after the last
    FIRST_BLOCK,  # first block, numbered through all populations
    LAST_BLOCK,  # block after the last
    CONSTANT,  # first row of `constants`
    CONSTANT_STRIDE,  # 1: a row per neuron; 0: the same for all
    RECEPTORS,  # number of receptors
    RELAY,  # 1: the neurons repeat arriving spikes and have no states
    LINEAR,  # 1: the model can make many steps at once
    RECORD,  # 1: spikes are recorded
    GROUP,  # number of the group, or NONE
    HISTORY,  # row of the first neuron in `past`, or NONE
    ARRIVALS,  # first entry of `incoming` that is delivered on arrival
    ARRIVALS_END,
    RINGS,  # first entry of `incoming` with a ring
    RINGS_END,
    COUNTS,  # place in `counts` of a generator that keeps counts, or NONE
    COUNTS_STEPS,  # length of the ring of counts in steps, a power of two
    TABLE,  # row of `cumulative`, or NONE if rates differ
    START,  # a generator emits in each step with START < step <= STOP
    STOP,
    NUMBER,  # index of the population
    ENTRY,  # address of the model's operations
    CARRIED,  # 1: a projection carries a current to the population
    COLLECTS,  # state to which `step_collecting` adds the input, or NONE
    GATHERS,  # 1: synapses onto the population learn by moves
    JOINED,  # first entry of `incoming` that is in joined rows
    JOINED_END,
    PAYLOAD,  # index of the state that spikes carry, or NONE
    POPULATION_COLUMNS,
) = range(31)

# projections
(
    SOURCE,  # source population
    TARGET,  # target population
    LAYOUT,  # ONE_TO_ONE, DENSE, CSR or GRID
    LAG,  # delay in steps after which the spikes are read from the log; 0: the projection has a ring
    RING,  # place of the ring in `buf`
    RING_MASK,  # slots of the ring - 1
    RING_SIZE,  # targets in a slot
    ROW,  # place in `rows`
    SYNAPSE,  # place in `targets`
    WEIGHT,  # place in `weights`
    WEIGHT_STRIDE,  # 1: a weight per synapse; 0: the same for all
    DELAY,  # place in `delays`
    DELAY_STRIDE,  # 1: a delay per synapse; 0: the same for all
    SIGN,  # POSITIVE, NEGATIVE or MIXED weights
    WAKE_ALL,  # number of spikes in a step from which all blocks are marked at once
    DENSE_COUNTS,  # 1: the source keeps counts
    CHANNEL_HEIGHT,  # this and the next columns: a grid, see `deliver.grid_add`
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
    REACH,  # maps that a channel reaches
    CHANNELS_INSIDE,  # number of channels if the source is stored with the channels innermost, else 0
    RECEPTOR,  # named receptor, or NONE
    JOINED_ROW,  # row of `joined` that holds this projection alone, or NONE
    RUN,  # this and the next 3 columns: only of joined rows; place in `joined_runs`
    SHORTEST,  # shortest delay of the runs
    DELAYS,  # number of delays of the runs
    SINGLE,  # 1: the weights are stored with 32 bits
    SENDS_AT_ONCE,  # 1: spikes are sent with the weights of their step, see `Program.sends_at_once`
    PROJECTION_COLUMNS,
) = range(37)

# plastic projections
(
    PROJECTION,  # index of the projection
    RULE,  # index in `operations.RULES`, or NONE
    MODULATED,  # 0: the rule is in RULES and reads dopamine; else NONE
    FIRST_SYNAPSE,  # place in `y`
    FIRST_SOURCE,  # place in `k_plus`
    FIRST_TARGET,  # place in `n`
    INCOMING,  # place in `incoming`
    DOPAMINE,  # dopamine population, or NONE
    DOPAMINE_ONE_TO_ONE,  # 1: each dopamine neuron has one target
    DOPAMINE_DELAY,  # steps
    GRID_STEPS,  # interval of the integration of dopamine, steps
    LONGEST,  # longest delay, steps
    RULE_NUMBER,  # index of this row
    RULE_ENTRY,  # address of the rule's operations
    SOURCE_STRIDE,  # pre traces per source
    COLUMN,  # first column of the rule in `others`
    FEWEST,  # shortest possible delay, steps
    MOST,  # longest possible delay, steps
    NOTED,  # 1: probes record at pre spikes
    CONSTANTS,  # row of `rule` for synapse 0
    CONSTANTS_STRIDE,  # 1: a row per synapse; 0: the same for all
    EAGER,  # 1: learns eagerly
    EPOCH,  # steps of an epoch, see `eager_rules`
    PLASTIC_COLUMNS,
) = range(24)

# projections that learn by moves
(
    MOVE_PROJECTION,  # index of the projection
    MOVE_SYNAPSE,  # place in `move_y`
    MOVE_SOURCE,  # place in `move_x` and in the lists
    MOVE_TARGET,  # place in `move_gate` and other arrays of targets
    MOVE_SEEN,  # state of the target that the rule reads, or NONE
    MOVE_ENTRY,  # address of the rule's operations
    MOVE_COLUMNS,
) = range(7)

# shared kernels that learn
(
    SHARED_PROJECTION,  # index of the projection
    SHARED_NUMBER,  # index of this row
    SHARED_RULE,  # STDP or STDP_DOPA of `shared_kernels`
    SHARED_MEAN,  # 1: a weight changes by the mean over the places with a change; 0: by the sum
    SHARED_SOURCE,  # place in `shared_k_plus`
    SHARED_TARGET,  # place in `shared_k_minus` and other arrays of targets
    SHARED_ENTRY,  # place in `shared_change`
    SHARED_POSITION,  # place in `shared_live`
    SHARED_PAIR,  # place in `shared_c`
    SHARED_PLACE,  # place in `shared_last`
    SHARED_DOPAMINE,  # dopamine population, or NONE
    SHARED_ONE_TO_ONE,  # 1: each dopamine neuron has one target
    SHARED_LATER,  # delay of dopamine, steps
    SHARED_COLUMNS,
) = range(14)

MOVE_TRACES = 4
"""Largest number of pre traces of a rule for moves."""

# lines of currents that change at every step
(
    DRIVEN,  # target population
    CHARGED,  # state to which a receptor's current is added, or NONE
    BEGINS,  # 1: first line into a population, before which the kernel sets the current to 0
    HOW,  # TO_ALL, TO_EACH or AS_LISTED
    FIRST_VALUE,  # place in `emitted`
    VALUES,  # number of columns of a row of `emitted`
    COLUMN_AT,  # first column, unless HOW is AS_LISTED
    LATE,  # delay in steps, unless HOW is AS_LISTED
    LINE_WEIGHT,  # place in `line_weights`
    LINE_STRIDE,  # 1: a weight per synapse; 0: the same for all
    LINE_ENDS,  # place in `line_ends`, if HOW is AS_LISTED
    SHARE,  # place in `shares`
    LINE_COLUMNS,
) = range(13)

# values of HOW: a single column for all neurons, a column per neuron, or a list of columns for each neuron
TO_ALL, TO_EACH, AS_LISTED = range(3)

# columns of `clock`, for each thread
DONE, DONE_ARRIVALS, HORIZON, OVERRUN, UNCOUNTED = range(5)
"""The columns hold:

- DONE: last step whose spikes have acted at emission.
- DONE_ARRIVALS: last step whose post and dopamine spikes have acted, and whose spikes of devices are in the rings.
- HORIZON: step up to which spikes under way were dropped.
- OVERRUN: 1 + index of a population with a history that overflowed, or 0.
- UNCOUNTED: 1 + index of a population with a spike count that overflowed, or 0.
"""

# columns of `groups`; column 0 is the population
# FIRST_TO_FIRE: 1 if the first winner decides. IN_TRIAL: 1 during a trial. WINNER, DECIDED: the winner and its step.
# RIVALS: number of neurons of which one fires. APART: distance in places between two neighbouring rivals.
FIRST_TO_FIRE, IN_TRIAL, WINNER, DECIDED, RIVALS, APART, GROUP_COLUMNS = range(1, 8)

# columns of `local`, for groups with several winners; RADIUS is NONE for other groups
RADIUS, PER_MAP, LOCAL_MAPS, LOCAL_ROWS, LOCAL_COLUMNS, NEXT_MAP, NEXT_PLACE, LOCAL_ENTRIES = range(8)

# columns of `standing`: number of neurons that may still win, and number of wins in the trial
OPEN, WINS = range(2)

# bits of `muted`: the neuron is silenced for a trial, is blocked by a winner, or has won
SILENCED, BLOCKED, WON = 1, 2, 4

TALLY_BITS = 20
"""Number of lower bits of a tally, which count spikes. The upper bits count events; see `generators`.

There are never more events than spikes.
"""


NET = """
# neurons
pops           i8 0,0               columns columns of `tables`, a row per population
edges          i8 0,0               program (populations, threads + 1) first block of each thread, and the end
most           i8 threads           program largest number of spikes of each thread in a step
parameters     f8 0,0               run     of each population, or of each neuron if they differ
constants      f8 0,0               run     computed from the parameters, for one step
scratch        f8 threads,width     step    constants for several steps, a row per thread
state          f8 states,row@4      run     each row begins at another line of its page
initial        f8 0,0               program states at step 0
x              f8 0,0               view    (receptors, neurons) input of the present step; -0.0 means no input
bits           i8 0,0               =x      the same memory as integers
empty_input    f8 receptors,neurons step    no input
buf            f8 0                 run     the memory of x, then the rings
current        f8 neurons@8         run     external current of the present step, pA
none           f8 group@8           step    no current, for a group of blocks
lines          i8 0,LINE_COLUMNS    program columns of `tables`, a row per line of currents that change at every step
line_ends      i8 0                 program for lines with HOW AS_LISTED: end of the synapses of each neuron
line_columns   i8 0                 program columns of `emitted` of these synapses
line_lates     i8 0                 program delays of these synapses, steps
line_weights   f8 0                 program weights of all lines
shares         f8 0                 program share of a current that is added to a receptor's state, for each neuron
emitted        f8 0                 program emitted currents, each value once: (rows, columns) of each line
emitted_rows   i8 0,0               program (lines, steps) row of a line that is emitted in a step
emitted_from   i8 1                 program first of these steps
fired          u1 neurons@16        step    number of times that each neuron reached threshold in the present step
spots          u1 spots@0           step    eight neurons each: not 0 if input arrived, see `step_collecting`
spot_words     u8 0                 =spots  a block at a time
muted          u1 neurons           run     reasons why a neuron must not fire: bits SILENCED, BLOCKED, WON
events         i8 neurons@24        run     spike events of each neuron
spikes         i8 neurons@32        run     spikes of each neuron, with multiplicity
active         i8 threads,activity  run     (threads, populations) neuron steps with an arrival or a spike
draws          f8 0                 step    random numbers of the present step, empty if no model draws
order          i8 neurons           program id of each neuron in its population
awake          u1 blocks            run     whether a block is stepped
awake_groups   u8 0                 =awake  eight blocks at a time
due            u1 threads,marks@0   run     marks of blocks that receive input, by slot and block; a row per thread
due_groups     u8 0,0               =due    eight blocks at a time
due_slots      u1 0,0,0             view    (threads, slots, blocks) the same memory, by slot
slept          i8 blocks@0          run     last step of a sleeping block
busy           i8 blocks@0          run     last step in which a block had input, a spike, or a rate
mean           f8 neurons           run     mean number of spikes per step of a poisson_generator's neurons
nothing        f8 neurons           run     exp(-mean), the probability of no spike
words          u8 threads,group@0   step    random words of a group of blocks, a row per thread
guides         u2 populations,guides program of `cumulative`, see `neuro.kernels.draws`
cumulative     f8 populations,table program Poisson tables
counts         u2 0                 run     rings of multiplicities of generators that keep counts
tally          u4 0                 step    events and spikes of these generators that are not counted elsewhere yet
keys           u8 populations       program keys of the generators' draws
list_steps     i8 0                 program listed spikes of the generators
list_ids       i8 0                 program
list_counts    i8 0                 program
cursor         i8 0,0               program (threads + 1, populations) next listed spike; the last row holds the ends
tau_minus      f8 neurons           run     of each neuron
candidates     i8 threads,most      step    neurons of a group that reached threshold
candidate_arrived u1 threads,most   step    whether a candidate had input in the step
rivals         i8 threads,rivals    step    candidates of which only one fires
groups         i8 groups,GROUP_COLUMNS run     columns of `tables`
group_keys     u8 groups            program
closed         u1 groups            run     1 if no neuron of a group may fire any more
local          i8 groups,LOCAL_ENTRIES program columns of `tables`, for groups with several winners
standing       i8 groups,2          run     number of neurons of these groups that may still win, and that have won
map_wins       i8 groups,group_maps run     number of wins of each map of these groups
won            i8 0,2               step    winners of this trial, in order, and the step
clock          i8 threads,line      run     columns of `tables`
stop           i8 1                 step    request to end, see `neuro.core.interrupts`
reached        i8 1                 step    step before which a run ended
map_of         i8 1                 program map of each neuron of the trials' output
potential      f8 maps              run     largest V_m of each map
best           i8 maps              run     neuron with the largest V_m of each map
resets         i8 0                 program state rows that are reset when a trial begins
stages         i8 stages            program addresses of the functions in `STAGES`
projections    i8 0,0               columns columns of `tables`, a row per projection
incoming       i8 0                 program projections by target: those delivered on arrival, then those with a ring
at_emission    i8 0                 program static projections that are delivered into a ring at emission
joined         i8 0,PROJECTION_COLUMNS program columns of `tables`; TARGET is NONE for a row of several projections
joined_reach   u1 0,populations     program 1 if a joined row has synapses onto a population
queue          i8 threads,queue,3   step    runs to be added: first synapse, end, multiplicity
# synapses
rows           i8 0                 program ends of the CSR rows, cut at the threads' edges
joined_runs    u4 0                 program ends of the runs of each source and delay of joined rows, see `arrivals`
joined_steps   u2 0                 program distance in x of each synapse of joined rows to the one before in its run
joined_weights f8 0                 program weights of joined rows
joined_singles f4 0                 program weights of joined rows whose weights all fit into 32 bits
joined_bases   i8 0,threads         program places in x from which the first step of each run counts
targets        i4 0                 program local targets of all CSR synapses
weights        f8 0                 run     of all projections
delays         i4 0                 program of all projections, steps
late           f8 0                 run     the same in ms if rules for trials change delays; else empty
# spikes
log_ids        i4 threads,capacity  run     spikes under way, a ring
log_counts     i8 threads,capacity  run
log_ends       i8 threads,steps,ends run     place in the log of each population's first spike of a step, and the end
log_at         i8 threads,line      run     next place in the log of each thread
rec_steps      i8 threads,capacity  step    recorded spikes of each thread; a snapshot empties the record first
rec_ids        i4 threads,capacity  step
rec_counts     i8 threads,capacity  step
rec_at         i8 threads,line      step
"""
"""The arrays of a network, one per line: name, type, shape, lifetime, remarks.

A shape has the sizes of `building.build`. A size of 0 is chosen by the code that fills the array. A number after @ is
the cache line of a page at which the array begins.

| lifetime | meaning |
| --- | --- |
| run | changes while the network runs, and is in a snapshot |
| columns | some columns change and are in a snapshot, see `CHANGING` |
| program | follows from the program, or from other arrays of a snapshot |
| step | has no content that must be kept between two runs |
| view, =name | shares the memory of another array |

A heading is the key under which `memory` counts the arrays below it.
"""

PLASTIC = """
# neurons
table          i8 0,0               columns columns of `tables`, a row per plastic projection
tau            f8 0,0               run     tau_plus and tau_n of each projection
decay          f8 0,0,0             run     (projections, 3 + traces, steps) of tau_plus, tau_n, tau_minus, `kinds`
k_plus         f8 threads,sources   run     trace of each source at a step, as in `eager_rules`; each thread has a copy
k_time         i8 threads,sources   run     step of the value in `k_plus`
spiked         i8 threads,sources   run     step of each source's last spike
n              f8 targets           run     dopamine of each target at a step
n_time         i8 targets           run     step of the value in `n`
heard          f8 0,0               run     (targets, traces) traces of the post spikes that reached eager synapses
past           i8 0,0               run     history of each neuron's spikes, see `histories`
traces         f8 0,0               =past   the same memory as floats
kinds          f8 0,0,0             run     traces of third-party rules: time constant, nearest, increment by a spike
columns        i8 0,0,0             program projection and trace of each column of `others`
others         f8 0,0,0             run     (histories, entries, columns) these traces just before each entry
draw_keys      u8 0                 program keys of the synapses' draws, by projection
drawn_as       i8 0                 program number of each synapse in the program's order; empty if no rule draws
note_this      u1 0                 program 1 if a synapse is recorded at pre spikes; empty if none is
note_at        i8 threads,8         step    number of records of each thread, each in its own cache line
note_steps     i8 threads,room      step    step of a pre spike
note_synapses  i8 threads,room      step    synapse of the record
note_y         f8 threads,states,room step    states of the synapse after the spike
move_table     i8 0,0               program columns of `tables`, a row per projection that learns by moves
move_rule      f8 moves,move_width  program constants of each rule
move_left      f8 moves,move_traces program decay of a pre trace in a step
move_adds      f8 moves,move_traces program increment of a pre trace by a spike
move_x_min     f8 moves             program traces below this count as 0
move_sign      f8 moves             program sign with which weights arrive
move_y         f8 0,0               run     (states, synapses)
move_x         f8 threads,move_marks run     pre traces of the present step; each thread has a copy
move_lists     i8 threads,2,move_sources run     lit and live sources, see `moves`
move_count     i8 threads,moves,2   run     lengths of these lists
move_is_lit    u1 threads,move_sources run     1 if a source is in the list of lit ones
move_is_live   u1 threads,move_sources run     1 if a source is in the list of live ones
move_gate      f8 move_targets      run     gate of each target
move_signal    f8 move_targets      step    signal of each target
move_spikes    f8 move_targets      step    spikes of each target in the present step; 0 between two steps
move_seen      f8 move_targets      step    state of each target that the rule reads; 0 if it reads none
move_concerned i8 move_targets      step    targets with a spike or with such a state, those of each thread together
shared_table   i8 0,0               program columns of `tables`, a row per shared kernel that learns
shared_rule    f8 0,0               program constants of each rule
shared_left_plus f8 shared          program decay of K+ in a step
shared_left_minus f8 shared_targets program decay of K- in a step
shared_k_plus  f8 shared_sources    run     trace of each source
shared_k_minus f8 shared_targets    run     trace of each target, of the spikes that arrived before the present step
shared_heard   f8 shared_targets    run     spikes that have arrived in the present step
shared_n       f8 shared_targets    run     dopamine of each target
shared_dose    f8 shared_targets    step    dopamine spikes of the present step, by id; 0 between two steps
shared_live    u1 shared_positions  run     1 if a place has any eligibility
# synapses
shared_change  f8 shared_entries    run     change of each weight in the present step
shared_places  i8 shared_entries    run     number of places that have changed each weight, for a mean
shared_c       f8 shared_pairs      run     eligibility of each synapse
shared_last    i8 shared_marks      run     last step in which a synapse has changed its weight
rule           f8 0,0               program constants of each rule, then of synapses with their own numbers
y              f8 0,0               run     (states, synapses)
sent           f8 0                 run     weight at the last pre spike
reached        i8 0                 run     step up to which a modulated synapse has learnt; empty if none is
incoming       i8 0                 program ends of the list of synapses of each target
in_synapse     i4 0                 program synapses in these lists, counted in their projection
in_source      i4 0                 program sources of these synapses
"""
"""The arrays of learning, in the form of `NET`.

The sizes are those of `building.learning`, `building.move_rules` and `building.shared_kernels`.
"""

CHANGING = {
    "pops": [CONSTANT, CONSTANT_STRIDE, COUNTS],
    "projections": [LAG, RING, RING_MASK, RING_SIZE, WEIGHT, WEIGHT_STRIDE, SIGN, DENSE_COUNTS],
    "table": [GRID_STEPS],
}
"""Columns that a run may change, by table. Other columns follow from the program, or are addresses in this process."""

NET_ARRAYS, PLASTIC_ARRAYS = declared(NET), declared(PLASTIC)
_NET, _PLASTIC = ([array.field for array in arrays] for arrays in (NET_ARRAYS, PLASTIC_ARRAYS))
NET_FIELDS, PLASTIC_FIELDS = ([name for name, _, _ in fields] for fields in (_NET, _PLASTIC))


def table_of(net: Mapping[str, NDArray[Any]], plastic: Mapping[str, NDArray[Any]]) -> NDArray[np.int64]:
    """Return the table of addresses and shapes of the arrays. The caller must keep the arrays alive."""
    return address.table_of((_NET, net), (_PLASTIC, plastic))


ENTRY_TYPE = types.int64(*(types.int64,) * 7, types.float64)
"""Type of the compiled operations of a model."""

RULE_TYPE = types.int64(*(types.int64,) * 6, types.float64)
"""Type of the compiled operations of a rule."""

_call_entry = caller(ENTRY_TYPE.return_type, *ENTRY_TYPE.args)
_call = caller(RULE_TYPE.return_type, *RULE_TYPE.args)


@inlined
def slot_mask(net):
    """Return the mask that maps a step to its slot in `due`. A division would take as long as a spike."""
    return net.due_slots.shape[1] - 1


@subkernel
def call_rule(view, row, operation, index, step, thread, h):
    """Call an operation of a rule, see `lazy_rules`. `row` is the row of its projection in `plastic.table`."""
    return _call(row[RULE_ENTRY], (view, row[RULE_NUMBER], operation, index, step, thread, h))


@subkernel
def call_moves(view, k, operation, index, step, thread, h):
    """Call an operation of a rule for moves, see `moves`."""
    return _call(plastic_of(view).move_table[k, MOVE_ENTRY], (view, k, operation, index, step, thread, h))


@subkernel
def call_entry(view, row, operation, lo, hi, thread, step, h):
    """Call an operation of a population's model, see `operations`."""
    return _call_entry(row[ENTRY], (view, row[NUMBER], operation, lo, hi, thread, step, h))


net_of = viewer(Views("Net", 0, _NET))
plastic_of = viewer(Views("Plastic", len(NET_FIELDS), _PLASTIC))

Destination = namedtuple("Destination", "out receptors receptor_stride mark spot")
"""The destination of a delivery.

`out` is the index of target 0 in `buf`. `receptors` is the number of receptors among which the sign of a weight
chooses. `receptor_stride` is the distance from an input of the first receptor to the input of the second receptor of
the same neuron. `mark` and `spot` are as in `deliver.deliver_shared_weight`.
"""


# A stage is a part of the loop that only some networks need. Each stage is compiled separately and called by its
# address. A network compiles only the stages that it needs, and compiled stages are cached for other networks.
# `building.build.link` writes the addresses to `stages`. A stage that a network does not need has the address 0.
STAGES = {
    "add_row": ("arrivals", "view, k, step, thread", types.void),
    "deliver_log": ("deliver", "view, q, sent_step, now, begin, stop, ring", types.void),
    "add_counts": ("generators", "view, thread, q, step, n_all, slots, blocks", types.void),
    "draw_counts": ("generators", "view, thread, pop, step", types.void),
    "drive": ("generators", "view, thread, step", types.void),
    "charge": ("generators", "view, thread, step", types.void),
    "step_collecting": ("neurons", "view, thread, pop, step, log_at, processed_step, h, slots, blocks", types.int64),
    "settle": ("groups", "view, thread, pop, n, step, log_at, processed_step, h", types.int64),
    "post_spike": ("histories", "view, pop, thread, local, m, step, processed_step, h", types.void),
    "dopamine_arrivals": ("histories", "view, q, step, thread, h", types.void),
    "note": ("together", "view, q, source, step, thread", types.void),
    "gather_moves": ("moves", "view, thread, pop, step, h", types.void),
    "deliver_joined": ("arrivals", "view, begin, stop, step", types.void),
    "learn_kernels": ("shared_kernels", "view, step, done_arrivals, arrivals_only, h", types.void),
}
"""Module, arguments and type of the result of each stage, by the name of the function."""

_LOOP = {
    "run": ("steps", "view, first, last, longest, reach, h", types.int64),
    "share": ("steps", "view, progress, thread, last, longest, reach, h", types.int64),
    "finish": ("steps", "view, thread, last, h", types.void),
    "begin_trial": ("steps", "view, pop, group, start, h", types.void),
    "run_trial": ("steps", "view, group, first, last, at_decision, reach, h", types.int64),
    "end_trial": ("steps", "view, pop, group, end, h", types.void),
}
"""Module, arguments and type of the result of the functions that Python calls to run a network."""

_STAGED = list(STAGES)
_ARGUMENTS = {"h": types.float64, "progress": types.int64[:, ::1], "at_decision": types.boolean}


def _types_of(arguments: str) -> list[Any]:
    """Return the numba types of arguments. An argument that is not in `_ARGUMENTS` is an integer."""
    return [_ARGUMENTS.get(word, types.int64) for word in arguments.split(", ")]


def _stage(name: str) -> Any:
    """Return a compiled function that calls a stage by its address."""
    _, arguments, result = STAGES[name]
    space = {"call": caller(result, *_types_of(arguments)), "net_of": net_of}
    code = f"def {name}({arguments}):\n    return call(net_of(view).stages[{_STAGED.index(name)}], ({arguments}))"
    exec(code, space)
    return inlined(space[name])


add_row, deliver_log, add_counts, draw_counts, drive, charge, step_collecting = map(_stage, _STAGED[:7])
settle, post_spike, dopamine_arrivals, note, gather_moves, deliver_joined, learn_kernels = map(_stage, _STAGED[7:])


def stage_entry(name: str) -> Entry:
    """Return a stage, or a function that runs a network, as an entry to compile."""
    module, arguments, result = (STAGES | _LOOP)[name]
    return Entry(getattr(import_module(f"neuro_event.loop.{module}"), name), result(*_types_of(arguments)))
