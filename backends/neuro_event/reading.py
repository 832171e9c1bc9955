"""Reading what is computed lazily, and writing to it, between two runs."""

# mypy: ignore-errors
import numpy as np

from neuro_event import loop
from neuro_event import tables as t
from neuro_event.deliver import log_delivery
from neuro_event.jit import kernel
from neuro_event.plastic import bring_target, dopamine_at


def state(engine, population):
    """All state rows, those of one population as of now; a copy where some of its neurons sleep."""
    net = engine._net
    row = net.pops[population]
    if net.awake[row[t.FIRST_BLOCK] : row[t.LAST_BLOCK]].all():
        return net.state
    copied = {name: getattr(net, name).copy() for name in ("state", "awake", "busy", "fired", "scratch")}
    loop.wake_population(net._replace(**copied), population, engine.step, engine._program.resolution)
    return copied["state"]


@kernel
def bring(net, q, step, h):
    """Catch up every synapse of a modulated projection."""
    p = net.plastic
    row = net.projections[p.table[q, t.PROJECTION]]
    target_row = net.pops[row[t.TARGET]]
    for target in range(target_row[t.END] - target_row[t.BEGIN]):
        bring_target(p, q, row, target_row, 0, target, step, net.delays, h)


@kernel
def write_signal(net, q, values, step, h):
    """Catch up a modulated projection, then set n."""
    p = net.plastic
    row = net.projections[p.table[q, t.PROJECTION]]
    target_row = net.pops[row[t.TARGET]]
    for target in range(values.shape[0]):
        bring_target(p, q, row, target_row, 0, target, step, net.delays, h)
        p.n[p.table[q, t.FIRST_TARGET] + target] = values[target]
        p.n_time[p.table[q, t.FIRST_TARGET] + target] = step


@kernel
def concentrations(net, q, n, step, h):
    """n of every target at a step."""
    out = np.empty(n)
    for target in range(n):
        out[target] = dopamine_at(net.plastic, q, target, step, h)
    return out


@kernel
def deliver_between(net, q, first, last):
    """Put the spikes that a projection's source emitted in the steps first..last into its ring."""
    blocks = net.awake.shape[0]
    slots = net.due.shape[0] // blocks - 1
    threads = net.edges.shape[0] - 1
    for thread in range(threads):
        for step in range(max(first, net.clock[thread, loop.HORIZON] + 1), last + 1):
            log_delivery(
                q, step, 0, thread, threads, net.edges, net.pops, net.projections[q], net.log_ids, net.log_counts,
                net.log_ends, True, net.rows, net.targets, net.weights, net.delays, net.buf, net.due, slots, blocks,
                net.x.shape[1],
            )  # fmt: skip


def synapses(engine, projection, name):
    """A state of the synapses of one projection, in the order of the program's weights."""
    a, program, h = engine._a, engine._program, engine._program.resolution
    p, arranged = program.projections[projection], a.synapses[projection]
    if projection not in a.plastic_of:
        return _static_weights(engine, projection)
    k = a.plastic_of[projection]
    net, plastic = engine._net, engine._net.plastic
    row = plastic.table[k]
    here = slice(row[t.FIRST_SYNAPSE], row[t.FIRST_SYNAPSE] + p.size)
    if name in ("n", "K_plus"):
        values = _trace(engine, k, name)
        found = values[arranged.targets] if name == "n" else np.repeat(values, np.diff(arranged.row_ends))
    elif p.synapse.modulated:
        copied = plastic._replace(y=plastic.y.copy(), reached=plastic.reached.copy())
        bring(net._replace(plastic=copied), k, engine.step, h)
        states = ["weight", *(s.name for s in type(p.synapse).states)]
        found = copied.y[states.index(name), here]
    else:
        found = plastic.sent[here]
    return _told(found, arranged)


def _trace(engine, k, name):
    program, plastic = engine._program, engine._net.plastic
    row = plastic.table[k]
    p = program.projections[row[t.PROJECTION]]
    if name == "n":
        n = program.populations[p.target].size
        return concentrations(engine._net, k, n, engine.step, program.resolution)
    here = slice(row[t.FIRST_SOURCE], row[t.FIRST_SOURCE] + program.populations[p.source].size)
    age = (engine.step - plastic.k_time[0, here]) * program.resolution
    return plastic.k_plus[0, here] * np.exp(-age / plastic.tau[k, 0])


def _told(values, arranged):
    if arranged.order is None:
        return values.copy()
    out = np.empty_like(values)
    out[arranged.order] = values
    return out


def _static_weights(engine, projection):
    p, row = engine._program.projections[projection], engine._a.net["projections"][projection]
    if engine._a.net["pops"][p.target, t.RELAY] == 1:
        kept = engine._kept_weights.get(projection, p.weight)
        return np.broadcast_to(kept, p.size).copy()
    first = row[t.WEIGHT]
    if row[t.WEIGHT_STRIDE] == 0:
        return np.full(p.size, engine._a.net["weights"][first])
    return _told(engine._a.net["weights"][first : first + p.size], engine._a.synapses[projection])
