"""Parts of the loop that only some networks need: each is compiled by itself, and called by its address.

So a network compiles what it needs, and what it compiles is kept for all others. The addresses lie in a table, which
`link` fills; stages that a network does not need have address 0. A new stage needs a condition in `_needed` in
`building/build.py`, and its name in the lists of functions below `_stage`.
"""

# mypy: disable-error-code="no-untyped-call"
from __future__ import annotations

from importlib import import_module
from typing import Any

from numba import types

from neuro.kernels.address import Entry, caller
from neuro.kernels.jit import inlined
from neuro_event.loop.tables import net_of

STAGES = {
    "arrive": ("arrivals", "view, q, step, thread", types.void),
    "at_emission": ("arrivals", "view, q, step, after, thread", types.void),
    "deliver_log": ("deliver", "view, q, sent_step, now, begin, stop, ring", types.void),
    "add_counts": ("generators", "view, thread, q, step, n_all, slots, blocks", types.void),
    "draw_counts": ("generators", "view, thread, pop, step", types.void),
    "drive": ("varying_currents", "view, thread, step", types.void),
    "charge": ("varying_currents", "view, thread, step", types.void),
    "step_collecting": ("neurons", "view, thread, pop, step, at, done, h, slots, blocks", types.int64),
    "settle": ("groups", "view, thread, pop, n, step, at, done, h", types.int64),
    "post_spike": ("histories", "view, pop, thread, local, m, step, done, h", types.void),
    "dopamine_arrivals": ("histories", "view, q, step, thread, h", types.void),
    "note": ("probes", "view, q, source, step, thread", types.void),
    "gather_moves": ("moves", "view, thread, pop, step, h", types.void),
    "deliver_joined": ("joined_rows", "view, begin, stop, step", types.void),
}
"""By the name of the function: its module, its arguments, and what it returns."""

_LOOP = {
    "run": ("steps", "view, first, last, longest, reach, h", types.int64),
    "share": ("steps", "view, progress, thread, last, longest, reach, h", types.int64),
    "finish": ("steps", "view, thread, last, h", types.void),
    "begin_trial": ("steps", "view, pop, group, start, h", types.void),
    "run_trial": ("steps", "view, group, first, last, at_decision, reach, h", types.int64),
    "end_trial": ("steps", "view, pop, group, end, h", types.void),
}
"""Likewise of what Python calls to run a network."""

_NAMES = list(STAGES)
_KINDS = {"h": types.float64, "progress": types.int64[:, ::1], "at_decision": types.boolean}


def _kinds(arguments: str) -> list[Any]:
    """The types of arguments: nearly all are whole numbers."""
    return [_KINDS.get(word, types.int64) for word in arguments.split(", ")]


def _stage(name: str) -> Any:
    """A compiled function that calls a stage."""
    _, arguments, result = STAGES[name]
    space = {"call": caller(result, *_kinds(arguments)), "net_of": net_of}
    code = f"def {name}({arguments}):\n    return call(net_of(view).stages[{_NAMES.index(name)}], ({arguments}))"
    exec(code, space)
    return inlined(space[name])


arrive, at_emission, deliver_log, add_counts, draw_counts, drive, charge = map(_stage, _NAMES[:7])
step_collecting, settle, post_spike, dopamine_arrivals, note, gather_moves, deliver_joined = map(_stage, _NAMES[7:])


def entry(name: str) -> Entry:
    """A stage, or what runs a network, to be compiled."""
    module, arguments, result = (STAGES | _LOOP)[name]
    return Entry(getattr(import_module(f"neuro_event.loop.{module}"), name), result(*_kinds(arguments)))
