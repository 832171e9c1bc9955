"""Checks of synapse models of third parties."""

from __future__ import annotations

import numpy as np

from neuro.core.own_parts import check_functions, fill
from neuro.model.synapses.base import FUNCTIONS, MORE_TEACHING, TEACHING, DelayRule, Modulated, Synapse, Trace
from neuro.model.synapses.moves import GATHERING, MoveRule

_REASONS = {
    "dopamine": "synapses share dopamine",
    "trials": "the end of a trial teaches all synapses",
    "moves": "the end of a move teaches all synapses",
}
"""The reason why a parameter must have one value for all synapses, by the kind of rule."""


def complete(model: type[Synapse]) -> type[Synapse]:
    """Return a synapse model if it has everything that backends need.

    Raises:
        TypeError: something is missing or not supported. The message names it.
    """
    message = f"synapse model '{model.__name__}'"
    if model.learns not in ("", "pairs", "moves", "trials", "chip"):
        raise TypeError(f"{message}: learns = '{model.learns}': expected '', 'pairs', 'moves', 'trials' or 'chip'")
    if model.modulated and not issubclass(model, Modulated):
        raise TypeError(f"{message}: expected a subclass of Modulated, which has the parameters that set n")
    if model.delays and not issubclass(model, DelayRule):
        raise TypeError(f"{message}: expected a subclass of DelayRule, which has bounds of delays")
    first_state = [state.name for state in model.states[:1]]
    if model.delays and (model.modulated or model.learns not in ("pairs", "trials") or first_state != ["delay"]):
        raise TypeError(
            f"{message} changes delays: expected learns 'pairs' or 'trials', no dopamine, first state 'delay'"
        )
    if not model.learns and any(hasattr(model.arithmetic, name) for name in ("on_pre", "on_post")):
        raise TypeError(f"{message} has rules for spikes and learns = '': expected learns = 'pairs'")
    if model.learns == "pairs":
        _check_traces(message, model)
        _check_shared_parameters(message, model)
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
        _check_shared_parameters(message, model)
        check_functions(message, model, GATHERING)
        _check_constants(message, model)
    if model.learns == "trials":
        _check_shared_parameters(message, model)
        optional = {name: count for name, count in MORE_TEACHING.items() if hasattr(model.arithmetic, name)}
        check_functions(message, model, {**TEACHING, **optional})
        if model.delays and "settle" in optional:
            raise TypeError(f"{message} changes delays: expected no function 'settle', which is for weights")
        _check_constants(message, model)
    return model


def _check_constants(label: str, model: type[Synapse]) -> None:
    """Raise an error if the constants cannot be computed from the defaults."""
    defaults = model.defaults()
    if all(word in defaults for word in model.numbers()):
        fill(label, model, np.array([float(defaults[word]) for word in model.numbers()]), np.zeros(model.width))


def _check_traces(label: str, model: type[Synapse]) -> None:
    """Raise an error for a trace whose time constant is not a parameter."""
    names = model.numbers()
    for side, traces in (("pre", model.pre), ("post", model.post)):
        for trace in traces if isinstance(traces, tuple) else (traces,):
            if not isinstance(traces, tuple):
                raise TypeError(f"{label}: {side} = {traces!r}: expected a tuple such as {side} = (Trace(...),)")
            if not isinstance(trace, Trace):
                raise TypeError(f"{label}: {side} has {trace!r}: expected a Trace")
            if trace.tau and trace.tau not in names and (side, trace.tau) != ("post", "tau_minus"):
                raise TypeError(f"{label} has no '{trace.tau}': expected one, the time constant of a {side} trace")
            if trace.starts and (side == "post" or not trace.tau or trace.starts not in names):
                raise TypeError(
                    f"{label}: a {side} trace starts as '{trace.starts}': expected a parameter, of a pre trace"
                )


def _check_shared_parameters(label: str, model: type[Synapse]) -> None:
    """Raise an error for a per-synapse parameter that must be shared.

    Synapses of one source or target share traces and dopamine. The parameters of a rule for trials or moves are the
    same for all synapses.
    """
    shared = {trace.tau for trace in (*model.pre, *model.post)} | {trace.starts for trace in model.pre}
    for word, q in model.quantities().items():
        if q.arrays and (word in shared or model.modulated or model.learns in ("moves", "trials")):
            kind = "dopamine" if model.modulated else model.learns
            reason = _REASONS.get(kind, "synapses share their traces")
            raise TypeError(
                f"{label}: '{word}' has a value per synapse: expected one for all synapses, because {reason}"
            )
