"""How it is said here what Brian2, NESTML and Python say otherwise: hints for words and signs that are unknown."""

from __future__ import annotations

from collections.abc import Mapping

from neuro.core.grammar import Expression, Hints, parse as read

_CHOICE = "write where(a > b, value, other)"
_RECEPTOR = "spikes arrive in 'receptors', e.g. {g: {kernel: exp, tau: tau_syn}}"
_NO_NOISE = "equations have no noise of their own: connect a poisson_generator"
_NO_TIME = "equations do not depend on time: connect a generator"
_LET = "an abbreviation is a word of 'let', e.g. {I_syn: g*(E - V_m)}"
REFRACTORY = "write refractory: {time: t_ref, hold: [V_m]}"
RIGHT_SIDE = "write the right side alone, by the name of its state: {V_m: (E_L - V_m)/tau_m}"

FUNCTIONS: Mapping[str, str] = {
    "clip": "write min(max(value, low), high)",
    "int": _CHOICE,
    "heaviside": _CHOICE,
    "pow": "write value^power",
    "ln": "write log(value)",
    "log10": "write log(value)/log(10)",
    "rand": _NO_NOISE,
    "randn": _NO_NOISE,
    "convolve": _RECEPTOR,
    "delta": _RECEPTOR,
}
NAMES: Mapping[str, str] = {
    "xi": _NO_NOISE,
    "t": _NO_TIME,
    "i": "neurons differ by parameters, which may be arrays",
    "pi": "write 3.141592653589793",
    "not_refractory": REFRACTORY,
    "volt": "write mV or V",
    "amp": "write pA or nA",
    "second": "write ms or s",
    "siemens": "write nS",
    "farad": "write pF",
    "ohm": "write MOhm",
}
SIGNS: Mapping[str, str] = {
    "=": f"{RIGHT_SIDE}; a comparison is < <= > or >=",
    "'": RIGHT_SIDE,
    ":": "leave the unit out: it follows from those of parameters, or 'initial' says it; refractoriness is a word",
    ";": "each state has an expression of its own: {V_m: ..., w: ...}",
    "?": _CHOICE,
    "if": _CHOICE,
    "and": "write min(where(a > b, 1, 0), where(c > d, 1, 0))",
    "or": "write max(where(a > b, 1, 0), where(c > d, 1, 0))",
}
WORDS: Mapping[str, str] = {
    "model": RIGHT_SIDE.replace("write", "'equations' has"),
    "method": "the method is a word of 'integrator', e.g. {rk4: {substeps: 4}}",
    "inline": _LET,
    "function": _LET,
    "kernel": _RECEPTOR,
    "input": _RECEPTOR,
    "onReceive": _RECEPTOR,
    "events": _RECEPTOR,
    "state": "a state is a word of 'equations', its first value one of 'initial'",
    "on_reward": "write on_signal",
}
_HINTS = Hints(SIGNS, "give parts of it a name in 'let'")


def parse(text: object) -> Expression:
    """Read an expression of a model; for the syntax of other languages the hint gives ours.

    Raises:
        ModelError: as `neuro.core.grammar.parse`.
    """
    return read(text, _HINTS)
