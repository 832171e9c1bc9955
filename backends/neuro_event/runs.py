"""Where the runs of synapses lie that `arrivals` adds: by source, then delay."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel

QUEUE = 256
"""Runs that are gathered before they are added, so that memory can be asked for ahead."""


@kernel
def by_delay(row_ends, targets, delays):
    """Whether the synapses of every source lie by delay, then target."""
    for source in range(row_ends.size - 1):
        late, to = delays[row_ends[source] : row_ends[source + 1]], targets[row_ends[source] : row_ends[source + 1]]
        disorder = 0
        for e in range(1, late.size):  # without a way out, so that lanes do it
            disorder += (late[e] < late[e - 1]) | ((late[e] == late[e - 1]) & (to[e] < to[e - 1]))
        if disorder > 0:
            return False
    return True


@kernel
def fill_runs(row_ends, targets, delays, shortest, n_delays, edges, runs):
    """Where the runs of each source and delay begin, cut at the threads' edges (local targets); `runs` begins as 0."""
    threads = edges.size - 1
    for source in range(row_ends.size - 1):
        place = source * n_delays * threads
        thread = 0
        for e in range(row_ends[source], row_ends[source + 1]):
            if threads > 1:
                thread = 0
                while targets[e] >= edges[thread + 1]:
                    thread += 1
            runs[place + (np.int64(delays[e]) - shortest) * threads + thread + 1] += np.uint32(1)
    for k in range(1, runs.size):
        runs[k] += runs[k - 1]
