"""Groups: who of those at threshold fires, and whom that resets."""

# mypy: ignore-errors
from neuro.kernels.jit import kernel
from neuro_event.candidates import choose, weigh_maps
from neuro_event.lateral_reset import settle_rivals
from neuro_event.local_winners import settle_locally
from neuro_event.neurons import emit, spike
from neuro_event.tables import (
    DECIDED,
    FIRST_TO_FIRE,
    GROUP,
    IN_TRIAL,
    RADIUS,
    RIVALS,
    WINNER,
)
from neuro_event.views import net_of


@kernel
def settle(view, thread, pop, n, step, at, done, h):
    """Let the winner among the found neurons of a group fire; return the next place in the log."""
    net = net_of(view)
    row = net.pops[pop]
    group = row[GROUP]
    if net.local[group, RADIUS] >= 0:
        return settle_locally(view, thread, pop, row, n, step, at, done, h)
    if net.groups[group, RIVALS] > 0:
        return settle_rivals(view, thread, pop, row, n, step, at, done, h)
    winner = choose(view, group, row, net.found[thread], n, step)
    if net.groups[group, IN_TRIAL] == 1 and net.groups[group, WINNER] < 0:
        weigh_maps(view, thread, row, step, h)
        net.groups[group, WINNER] = winner
        net.groups[group, DECIDED] = step
    for k in range(n):
        i = net.found[thread, k]
        if i == winner:
            spike(view, pop, i)
            at = emit(view, thread, pop, i, 1, step, done, h, at)
            net.active[thread, pop] += 1 - net.found_arrived[thread, k]
        elif net.groups[group, FIRST_TO_FIRE] == 0:
            spike(view, pop, i)
    if net.groups[group, FIRST_TO_FIRE] == 1:
        net.closed[group] = 1
    return at
