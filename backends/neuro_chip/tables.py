"""Columns of the tables that describe a quantised program to the kernels; neurons are counted through all."""

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
    POPULATION_COLUMNS,
) = range(16)

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
    PROJECTION_COLUMNS,
) = range(27)

# groups
POPULATION, FIRST_TO_FIRE, CLOSED, WINNER, DECIDED, RIVALS, APART, GROUP_COLUMNS = range(8)

# groups with several winners; RADIUS is NONE for others
RADIUS, PER_MAP, LOCAL_MAPS, LOCAL_ROWS, LOCAL_COLUMNS = range(5)

# how they stand: how many may still win, and have won
OPEN, WINS = range(2)

# why a neuron must not fire: it is left out of a trial, silenced by a winner, or has won
SILENCED, BLOCKED, WON = 1, 2, 4

# what is listed of a generator: the next spike, and one after the last
NEXT, AFTER = range(2)

# the clock
STEP, RECORDED, EMITTED, STOP_GROUP, CLOCK_COLUMNS = range(5)

# overflows and what else only chips count, per population
INPUT_WRAPS, WRAPS, DRIVE_WRAPS, CLIPS, SATURATIONS, MERGED, NATIVE_COLUMNS = range(7)
NATIVE = ("input wraps", "current wraps", "drive wraps", "voltage clips", "slot saturations", "merged spikes")
