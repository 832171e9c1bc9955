"""Synapse models of third parties: refused unless they have all that backends rely on."""

from __future__ import annotations

import numpy as np

from neuro.core.own_parts import check_functions, fill
from neuro.model.synapses.base import FUNCTIONS, MORE_TEACHING, TEACHING, DelayRule, Modulated, Synapse, Trace
from neuro.model.synapses.moves import GATHERING, MoveRule


def complete(model: type[Synapse]) -> type[Synapse]:
    """Return a synapse model if it has all that backends rely on.

    Raises:
        TypeError: something is missing or not possible yet; it says what.
    """
    message = f"synapse model '{model.__name__}'"
    if model.learns not in ("", "pairs", "moves", "trials", "chip"):
        raise TypeError(f"{message}: learns = '{model.learns}': expected '', 'pairs', 'moves', 'trials' or 'chip'")
    if model.modulated and not issubclass(model, Modulated):
        raise TypeError(f"{message}: expected a subclass of Modulated, whose words say where n comes from")
    if model.delays and not issubclass(model, DelayRule):
        raise TypeError(f"{message}: expected a subclass of DelayRule, which says how far a delay may go")
    first = [state.name for state in model.states[:1]]
    if model.delays and (model.modulated or model.learns not in ("pairs", "trials") or first != ["delay"]):
        raise TypeError(
            f"{message} changes delays: expected learns 'pairs' or 'trials', no dopamine, first state 'delay'"
        )
    if not model.learns and any(hasattr(model.arithmetic, name) for name in ("on_pre", "on_post")):
        raise TypeError(f"{message} has rules for spikes and learns = '': expected learns = 'pairs'")
    if model.learns == "pairs":
        _check_traces(message, model)
        _check_of_each(message, model)
        functions = FUNCTIONS | ({"advance": 7} if model.modulated else {}) | ({"on_pre": 6} if model.draws else {})
        check_functions(message, model, functions | ({"sent": 3} if hasattr(model.arithmetic, "sent") else {}))
        _check_constants(message, model)
    code = getattr(model, "microcode", None)
    if code is not None and (model.learns != "pairs" or code.__code__.co_argcount != 2):
        raise TypeError(f"{message}: expected a method microcode(self, engine), of a rule with learns = 'pairs'")
    if model.learns == "moves":
        if not issubclass(model, MoveRule):
            raise TypeError(f"{message}: learns = 'moves': expected a subclass of MoveRule")
        if model.post or not all(trace.tau and not trace.nearest and not trace.starts for trace in model.pre):
            raise TypeError(f"{message} learns by moves: expected pre traces that decay from 0, and no post traces")
        _check_traces(message, model)
        _check_of_each(message, model)
        check_functions(message, model, GATHERING)
        _check_constants(message, model)
    if model.learns == "trials":
        _check_of_each(message, model)
        more = {name: count for name, count in MORE_TEACHING.items() if hasattr(model.arithmetic, name)}
        check_functions(message, model, {**TEACHING, **more})
        if model.delays and "settle" in more:
            raise TypeError(f"{message} changes delays: expected no function 'settle', which is for weights")
        _check_constants(message, model)
    return model


def _check_constants(label: str, model: type[Synapse]) -> None:
    """The constants can be computed from the defaults, where each parameter has one."""
    defaults = model.defaults()
    if all(word in defaults for word in model.numbers()):
        fill(label, model, np.array([float(defaults[word]) for word in model.numbers()]), np.zeros(model.width))


def _check_traces(label: str, model: type[Synapse]) -> None:
    """Each trace has a time constant among the parameters."""
    known = model.numbers()
    for side, traces in (("pre", model.pre), ("post", model.post)):
        for trace in traces if isinstance(traces, tuple) else (traces,):
            if not isinstance(traces, tuple):
                raise TypeError(f"{label}: {side} = {traces!r}: expected a tuple, as {side} = (Trace(...),)")
            if not isinstance(trace, Trace):
                raise TypeError(f"{label}: {side} has {trace!r}: expected a Trace")
            if trace.tau and trace.tau not in known and (side, trace.tau) != ("post", "tau_minus"):
                raise TypeError(f"{label} has no '{trace.tau}': expected one, the time constant of a {side} trace")
            if trace.starts and (side == "post" or not trace.tau or trace.starts not in known):
                raise TypeError(
                    f"{label}: a {side} trace starts as '{trace.starts}': expected a parameter, of a pre trace"
                )


def _check_of_each(label: str, model: type[Synapse]) -> None:
    """What synapses of one source or target share, a trace or dopamine, has one number; so have rules for trials."""
    shared = {trace.tau for trace in (*model.pre, *model.post)} | {trace.starts for trace in model.pre}
    for word, q in model.quantities().items():
        if q.arrays and (word in shared or model.modulated or model.learns in ("moves", "trials")):
            who = "dopamine acts by" if model.modulated else "traces have"
            why = {"trials": "the end of a trial teaches by", "moves": "the end of a move teaches by"}.get(
                model.learns, who
            )
            raise TypeError(f"{label}: '{word}' takes a value for each synapse: expected one for all, as {why} one")
