"""Parts of the loop that only some networks need: each is compiled by itself, and called by its address.

So a network compiles what it needs, and what it compiles is kept for all others. The addresses lie in a table, which
`link` fills. Of what a network does not need the address is 0: who adds a call says in `_needed` when it may happen.
"""

# mypy: disable-error-code="no-untyped-call"
from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
from numba import types

from neuro.kernels.address import Entry, caller
from neuro.kernels.beside import addresses
from neuro.kernels.jit import merged
from neuro_event import tables as t
from neuro_event.arrays import Arrays
from neuro_event.views import net_of

STAGES = {
    "arrive": ("arrivals", "view, q, step, thread", types.void),
    "at_emission": ("arrivals", "view, q, step, after, thread", types.void),
    "deliver_log": ("deliver", "view, q, j, k, begin, stop, ring", types.void),
    "add_counts": ("counted", "view, thread, q, step, n_all, slots, blocks", types.void),
    "draw_counts": ("counted", "view, thread, pop, step", types.void),
    "drive": ("drive", "view, thread, step", types.void),
    "charge": ("drive", "view, thread, step", types.void),
    "step_collecting": ("collected", "view, thread, pop, step, at, done, h, slots, blocks", types.int64),
    "settle": ("groups", "view, thread, pop, n, step, at, done, h", types.int64),
    "post_spike": ("plastic", "view, pop, thread, local, m, step, done, h", types.void),
    "dopamine_arrivals": ("plastic", "view, q, step, thread, h", types.void),
    "note": ("noting", "view, q, source, step, thread", types.void),
}
"""By the name of the function: its module, its arguments, and what it returns."""

_LOOP = {
    "run": ("loop", "view, first, last, longest, reach, h", types.int64),
    "share": ("loop", "view, told, thread, last, longest, reach, h", types.int64),
    "finish": ("loop", "view, thread, last, h", types.void),
    "begin_trial": ("trials", "view, pop, group, start, h", types.void),
    "run_trial": ("trials", "view, group, first, last, at_decision, reach, h", types.int64),
    "end_trial": ("trials", "view, pop, group, end, h", types.void),
}
"""Likewise of what Python calls to run a network."""

_NAMES = list(STAGES)
_KINDS = {"h": types.float64, "told": types.int64[:, ::1], "at_decision": types.boolean}


def _kinds(arguments: str) -> list[Any]:
    """The types of arguments: nearly all are whole numbers."""
    return [_KINDS.get(word, types.int64) for word in arguments.split(", ")]


def _stage(name: str) -> Any:
    """A compiled function that calls a stage."""
    _, arguments, result = STAGES[name]
    space = {"call": caller(result, *_kinds(arguments)), "net_of": net_of}
    code = f"def {name}({arguments}):\n    return call(net_of(view).stages[{_NAMES.index(name)}], ({arguments}))"
    exec(code, space)
    return merged(space[name])


arrive, at_emission, deliver_log, add_counts, draw_counts, drive, charge = map(_stage, _NAMES[:7])
step_collecting, settle, post_spike, dopamine_arrivals, note = map(_stage, _NAMES[7:])


def entry(name: str) -> Entry:
    """A stage, or what runs a network, to be compiled."""
    module, arguments, result = (STAGES | _LOOP)[name]
    return Entry(getattr(import_module(f"neuro_event.{module}"), name), result(*_kinds(arguments)))


def link(a: Arrays) -> None:
    """Compile all that a network calls by address, and write the addresses to where they are asked for."""
    stages = a.net["stages"]
    for name in _needed(a):
        number = _NAMES.index(name)
        if stages[number] == 0:
            a.ask(stages, number, partial(entry, name))
    if a.asked:
        runs = [partial(entry, name) for name in _running(a)]
        found = addresses([*runs, *(each for _, _, each in a.asked)])[len(runs) :]
        for (row, column, _), address in zip(a.asked, found, strict=True):
            row[column] = address
        a.asked.clear()


def _running(a: Arrays) -> tuple[str, ...]:
    """What runs a network."""
    if a.program.trials is not None:
        return "run_trial", "begin_trial", "end_trial"
    return ("run",) if a.net["edges"].shape[1] == 2 else ("run", "share", "finish")


def _needed(a: Arrays) -> Iterator[str]:
    """The stages that may be called."""
    net, plastic = a.net, a.plastic["table"]
    into, at_emission = (net["projections"][net[name]] for name in ("incoming", "at_emission"))
    on_arrival = into[into[:, t.LAG] != 0]
    counted = on_arrival[:, t.DENSE_COUNTS] == 1
    may: dict[str, Any] = {
        "arrive": on_arrival[:, t.RUN] >= 0,
        "at_emission": len(at_emission),
        "deliver_log": np.append(on_arrival[~counted, t.RUN], at_emission[:, t.RUN]) < 0,
        "add_counts": counted,
        "draw_counts": net["pops"][:, t.COUNTS] >= 0,
        "drive": len(net["lines"]),
        "charge": len(net["lines"]),
        "step_collecting": net["pops"][:, t.COLLECTS] >= 0,
        "settle": net["pops"][:, t.GROUP] >= 0,
        "post_spike": net["pops"][:, t.HISTORY] >= 0,
        "dopamine_arrivals": plastic[:, t.DOPAMINE] >= 0,
        "note": plastic[:, t.NOTED] == 1,
    }
    yield from (name for name, places in may.items() if np.any(places))
