"""Parameters that NEST refuses and other backends run: what each of its models checks when its values are set."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neuro.program.program import Floats, Population, Projection

Values = Mapping[str, Floats]

LARGEST_EXPONENT = math.log(sys.float_info.max / 1e20)
"""The largest (V_peak - V_th) / Delta_T that NEST's aeif neurons take."""

LARGEST_GROWTH = math.log(sys.float_info.max)
"""The largest exponent in NEST's propagators. Beyond it V_m is no number, or wrong without a word (iaf_psc_exp)."""


@dataclass(frozen=True, slots=True)
class Limit:
    """A check of a model of NEST.

    Attributes:
        words: the parameters that it is about, the first of which the message names first.
        refuses: tells, by the parameters of a population and the length of a step in ms, which neurons NEST refuses.
        why: what NEST expects.
        way_out: what else to write.
    """

    words: tuple[str, ...]
    refuses: Callable[[Values, float], NDArray[np.bool_]]
    why: str
    way_out: str


def _overflows(p: Values, _: float) -> NDArray[np.bool_]:
    with np.errstate(all="ignore"):
        return (p["Delta_T"] > 0.0) & ((p["V_peak"] - p["V_th"]) / p["Delta_T"] >= LARGEST_EXPONENT)


SHARP = Limit(
    ("Delta_T", "V_peak", "V_th"),
    _overflows,
    f"NEST expects (V_peak - V_th) / Delta_T < {LARGEST_EXPONENT:.1f}, so that no exponential overflows",
    "use a larger Delta_T, a lower V_peak, or Delta_T = 0, which fires at V_th",
)
PEAK = Limit(("V_peak", "V_th"), lambda p, _: p["V_peak"] < p["V_th"], "NEST expects V_peak >= V_th", "raise V_peak")
HOLDS = Limit(
    ("t_ref",), lambda p, h: np.rint(p["t_ref"] / h) < 1.0, "NEST expects t_ref > 0 ms", "set t_ref to one step"
)
RESET = Limit(
    ("V_reset", "V_th", "E_L"),
    lambda p, _: p["V_reset"] - p["E_L"] >= p["V_th"] - p["E_L"],
    "NEST holds potentials relative to E_L, in which these two are equal",
    "choose an E_L nearer to them",
)


def _differs(word: str) -> Limit:
    text = f"NEST expects tau_m and {word} that differ"
    return Limit((word, "tau_m"), lambda p, _: p[word] == p["tau_m"], text, f"change {word} by 1e-6 of it")


def _too_fast(word: str) -> Limit:
    def refuses(p: Values, h: float) -> NDArray[np.bool_]:
        with np.errstate(all="ignore"):
            return h / p[word] - h / p["tau_m"] > LARGEST_GROWTH

    text = f"NEST's propagator overflows where a step is longer than {LARGEST_GROWTH:.0f} {word}"
    return Limit((word, "tau_m"), refuses, text, f"use a larger {word}")


FAST = (_too_fast("tau_syn_ex"), _too_fast("tau_syn_in"))

LIMITS: Mapping[str, tuple[Limit, ...]] = {
    **dict.fromkeys(("aeif_cond_exp", "aeif_psc_exp"), (PEAK, SHARP)),
    "mat2_psc_exp": (HOLDS, _differs("tau_syn_ex"), _differs("tau_syn_in"), *FAST),
    "iaf_psc_delta": (RESET,),
    **dict.fromkeys(("iaf_psc_exp", "iaf_psc_alpha"), (RESET, *FAST)),
}
"""The checks of each model that a value within our bounds may fail, in NEST's order."""


def refused_values(part: Population, values: Values, resolution: float) -> Iterator[tuple[Limit, str]]:
    """Yield each limit that some neurons exceed, and the values of the first of these as text.

    Args:
        part: the population.
        values: all its parameters, shape (1,) or (size,).
        resolution: length of a step in ms.
    """
    for limit in LIMITS.get(part.model.name, ()):
        bad = np.broadcast_to(limit.refuses(values, resolution), part.size)
        if bad.any():
            first = int(np.argmax(bad))
            units = {word: q.unit for word, q in part.model.quantities().items()}
            texts = [
                f"{word} = {np.broadcast_to(values[word], part.size)[first]:g} {units[word]}" for word in limit.words
            ]
            yield limit, ", ".join(texts)


def refuses_weight(part: Projection) -> bool:
    """Return whether NEST refuses weights of 0 of a rule whose Wmax is negative: it counts 0 as positive."""
    limits = part.synapse.parameters()
    return bool(np.any((np.asarray(limits.get("Wmax", 0.0)) < 0.0) & (np.asarray(part.weight) >= 0.0)))
