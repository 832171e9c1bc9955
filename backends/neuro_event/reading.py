"""Reading what is computed lazily, and writing to it, between two runs."""

# mypy: ignore-errors
import math

import numpy as np

from neuro_event import loop
from neuro_event import tables as t
from neuro_event.deliver import log_delivery
from neuro_event.jit import kernel
from neuro_event.plastic import bring_target, dopamine_at
from neuro_event.views import net_of, plastic_of, table_of, with_plastic


def state(engine, population):
    """All state rows, those of one population as of now; a copy where some of its neurons sleep."""
    net = engine._a.net
    row = net["pops"][population]
    if net["awake"][row[t.FIRST_BLOCK] : row[t.LAST_BLOCK]].all():
        return net["state"]
    copied = {name: net[name].copy() for name in ("state", "awake", "busy", "fired", "scratch")}
    view = table_of({**net, **copied}, engine._a.plastic)
    loop.wake_population(view, population, engine.step, engine._program.resolution)
    return copied["state"]


@kernel
def bring(view, q, n_targets, step, h):
    """Catch up every synapse of a projection."""
    for target in range(n_targets):
        bring_target(view, q, 0, target, step, h)


@kernel
def bring_traces(view, q, n_sources, n_targets, step, h):
    """Let K+ and n decay to the present."""
    p = plastic_of(view)
    for target in range(n_targets):
        place = p.table[q, t.FIRST_TARGET] + target
        p.n[place] = dopamine_at(view, q, target, step, h)
        p.n_time[place] = step
    for thread in range(p.k_plus.shape[0]):
        for source in range(n_sources):
            place = p.table[q, t.FIRST_SOURCE] + source
            p.k_plus[thread, place] *= math.exp(-(step - p.k_time[thread, place]) * h / p.tau[q, 0])
            p.k_time[thread, place] = step


@kernel
def write_signal(view, q, values, step, h):
    """Catch up a modulated projection, then set n."""
    p = plastic_of(view)
    for target in range(values.shape[0]):
        bring_target(view, q, 0, target, step, h)
        p.n[p.table[q, t.FIRST_TARGET] + target] = values[target]
        p.n_time[p.table[q, t.FIRST_TARGET] + target] = step


@kernel
def concentrations(view, q, out, step, h):
    """Fill `out` with n of every target at a step."""
    for target in range(out.shape[0]):
        out[target] = dopamine_at(view, q, target, step, h)


@kernel
def deliver_between(view, q, first, last):
    """Put the spikes that a projection's source emitted in the steps first..last into its ring."""
    net = net_of(view)
    for thread in range(net.edges.shape[0] - 1):
        for step in range(max(first, net.clock[thread, loop.HORIZON] + 1), last + 1):
            log_delivery(view, q, step, 0, thread, True)


def bring_all(engine, k):
    """Catch up the plastic projection number k to the present, before something of it is set."""
    program = engine._program
    p = program.projections[engine._a.plastic["table"][k, t.PROJECTION]]
    n_sources, n_targets = program.populations[p.source].size, program.populations[p.target].size
    bring(engine._view, k, n_targets, engine.step, program.resolution)
    bring_traces(engine._view, k, n_sources, n_targets, engine.step, program.resolution)


def synapses(engine, projection, name):
    """A state of the synapses of one projection, in the order of the program's weights."""
    a, program, h = engine._a, engine._program, engine._program.resolution
    p, arranged = program.projections[projection], a.synapses[projection]
    if projection not in a.plastic_of:
        return _static_weights(engine, projection)
    k = a.plastic_of[projection]
    plastic = a.plastic
    row = plastic["table"][k]
    here = slice(row[t.FIRST_SYNAPSE], row[t.FIRST_SYNAPSE] + p.size)
    if name in ("n", "K_plus"):
        values = _trace(engine, k, name)
        found = values[arranged.targets] if name == "n" else np.repeat(values, np.diff(arranged.row_ends))
    elif p.synapse.modulated:
        copied = {"y": plastic["y"].copy(), "reached": plastic["reached"].copy()}
        view = with_plastic(engine._view, **copied)
        bring(view, k, program.populations[p.target].size, engine.step, h)
        states = ["weight", *(s.name for s in type(p.synapse).states)]
        found = copied["y"][states.index(name), here]
    else:
        found = plastic["sent"][here]
    return _told(found, arranged)


def _trace(engine, k, name):
    program, plastic = engine._program, engine._a.plastic
    row = plastic["table"][k]
    p = program.projections[row[t.PROJECTION]]
    if name == "n":
        out = np.empty(program.populations[p.target].size)
        concentrations(engine._view, k, out, engine.step, program.resolution)
        return out
    here = slice(row[t.FIRST_SOURCE], row[t.FIRST_SOURCE] + program.populations[p.source].size)
    age = (engine.step - plastic["k_time"][0, here]) * program.resolution
    return plastic["k_plus"][0, here] * np.exp(-age / plastic["tau"][k, 0])


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
