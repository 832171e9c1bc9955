"""The compiled loop of networks with trials: how one begins, runs and ends."""

# mypy: ignore-errors
from neuro.kernels.jit import inner, kernel
from neuro_event.candidates import weigh_maps
from neuro_event.local_winners import admit_all, open_groups
from neuro_event.loop import act_at_emission, advance, room
from neuro_event.neurons import wake
from neuro_event.tables import (
    BEGIN,
    DONE,
    DONE_DOPAMINE,
    END,
    FIRST_BLOCK,
    HORIZON,
    IN_TRIAL,
    LAST_BLOCK,
    RADIUS,
    WINNER,
)
from neuro_event.views import net_of


@kernel
def begin_trial(view, pop, group, start, h):
    """Drop what is under way after step `start`, open the groups, and reset the population of the trials' own."""
    net = net_of(view)
    row = net.pops[pop]
    drop_all(view, start)
    open_groups(view)
    net.groups[group, IN_TRIAL] = 1
    net.groups[group, WINNER] = -1
    for block in range(row[FIRST_BLOCK], row[LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(view, 0, pop, block, start, h)
    for k in range(net.resets.shape[0]):
        r = net.resets[k]
        for i in range(row[BEGIN], row[END]):
            net.state[r, i] = net.initial[r, i]


@kernel
def run_trial(view, group, first, last, at_decision, reach, h):
    """Run the steps first:last of a trial; return the next step: at a decision, where there was no room, or `last`."""
    net = net_of(view)
    for step in range(first, last):
        if room(view, step, 1, reach) < 1:
            return step
        advance(view, 0, net.edges.shape[1] - 1, step, step + 1, h)
        if at_decision and net.closed[group] == 1:
            return step + 1
    return last


@kernel
def end_trial(view, pop, group, end, h):
    """Weigh the maps without a decision, let all neurons fire that nobody silenced, and finish step `end`."""
    net = net_of(view)
    row = net.pops[pop]
    if net.groups[group, WINNER] < 0 or net.local[group, RADIUS] >= 0:
        weigh_maps(view, 0, row, end, h)
    admit_all(view, row)
    for thread in range(net.edges.shape[1] - 1):
        act_at_emission(view, thread, end - 1, end, h)
    net.groups[group, IN_TRIAL] = 0


@inner
def drop_all(view, step):
    """Forget every spike under way at the end of a step."""
    net = net_of(view)
    for thread in range(net.clock.shape[0]):
        net.clock[thread, HORIZON] = step
        net.clock[thread, DONE] = step
        net.clock[thread, DONE_DOPAMINE] = step
    ring = net.x.shape[0] * net.x.shape[1]
    if net.buf.shape[0] > ring:
        net.buf[ring:] = -0.0
        net.due[:, :] = 0
