"""Columns of the tables that describe a program to the kernels. Neurons are counted through all populations.

A population begins at a multiple of `BLOCK * GROUPED` neurons, so that blocks and groups of blocks belong to one.
"""

BLOCK = 64
GROUPED = 8
NONE = -1

POISSON, LISTED, CURRENT, NEURON, GENERATOR = range(5)
ONE_TO_ONE, DENSE, CSR, GRID = range(4)
POSITIVE, NEGATIVE, MIXED = range(3)

# populations
(
    KIND,
    MODEL,  # of states that earlier versions have saved
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
    POPULATION_COLUMNS,
) = range(28)

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
    PROJECTION_COLUMNS,
) = range(34)

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
DONE, DONE_DOPAMINE, HORIZON, OVERRUN = range(4)

# groups
FIRST_TO_FIRE, IN_TRIAL, WINNER, DECIDED, RIVALS, APART, GROUP_COLUMNS = range(1, 8)

# groups with several winners; RADIUS is NONE for others
RADIUS, PER_MAP, LOCAL_MAPS, LOCAL_ROWS, LOCAL_COLUMNS, NEXT_MAP, NEXT_PLACE, LOCAL_ENTRIES = range(8)

# how they stand
OPEN, WINS = range(2)

# why a neuron must not fire: it is left out of a trial, silenced by a winner, or has won
SILENCED, BLOCKED, WON = 1, 2, 4

TALLY_BITS = 20
"""Of a tally, see `counted`: the lower bits that hold spikes; the others hold events, of which there are no more."""
