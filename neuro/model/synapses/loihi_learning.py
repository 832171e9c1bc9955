"""A synapse of Loihi 1 that learns by the chip's own rules, in its own registers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.errors import ModelError, here
from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Synapse
from neuro.model.synapses.loihi_rule import KEEP, LONGEST_EPOCH, POST, PRE, TRACE_MAX, LearningRule, Term, Trace, text
from neuro.model.synapses.loihi_rule_text import parse
from neuro.model.synapses.loihi_static import SIGN_MODES

SHAPES = ("first_order", "exponential")
ROUNDINGS = ("stochastic", "away")


def _impulse(trace: str) -> Any:
    return quantity(0, "", f"what a spike adds to {trace}", kind="integer", at_least=0, at_most=TRACE_MAX)


def _tau(trace: str) -> Any:
    return quantity(0, "steps", f"time constant of {trace}", kind="integer", at_least=0, at_most=KEEP)


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi_learning(Synapse):
    """Changes its mantissa by `dw` and its tag by `dt`, sums of products, at the end of each epoch.

    A product is whole numbers, powers 2^n and factors joined by "*": x0 and y0 (a pre, a post spike in this epoch),
    x1, x2, y1, y2, y3 (traces), w, t, (factor + constant), u_k (1 in every 2^k-th epoch). Traces rise by their impulse
    at a spike, up to 127, and keep 1 - 1/tau of themselves per step (`trace_decay: exponential`: exp(-1/tau)).

    Source: Davies et al., IEEE Micro 38(1):82, 2018; Michaelis et al., Front. Neuroinform. 16:1015624, 2022.
    """

    equation: ClassVar[str] = "w += sum of products dw; t += sum of products dt; sends 64 floor(w 2^weight_exp)"
    source: ClassVar[str] = "Davies et al., IEEE Micro 38(1):82, 2018; Michaelis et al., Front. Neuroinform. 16, 2022"
    learns: ClassVar[str] = "chip"
    chip: ClassVar[str] = "loihi"
    states: ClassVar[tuple[State, ...]] = (State("t", "", "tag"),)

    weight_exp: int = quantity(0, "", "weight exponent", kind="integer", at_least=-8, at_most=7)
    num_weight_bits: int = quantity(8, "", "bits of a weight", kind="integer", at_least=1, at_most=8)
    sign_mode: str = quantity("mixed", "", "which signs the weights have", kind="word", words=SIGN_MODES)
    dw: str = quantity("", "", "change of the mantissa, a sum of products", kind="names")
    dt: str = quantity("", "", "change of the tag, a sum of products", kind="names")
    x1_impulse: int = _impulse("x1")
    x1_tau: int = _tau("x1")
    x2_impulse: int = _impulse("x2")
    x2_tau: int = _tau("x2")
    y1_impulse: int = _impulse("y1")
    y1_tau: int = _tau("y1")
    y2_impulse: int = _impulse("y2")
    y2_tau: int = _tau("y2")
    y3_impulse: int = _impulse("y3")
    y3_tau: int = _tau("y3")
    epoch: int = quantity(1, "steps", "length of an epoch", kind="integer", at_least=1, at_most=LONGEST_EPOCH)
    trace_decay: str = quantity("first_order", "", "what a trace keeps per step", kind="word", words=SHAPES)
    rounding: str = quantity("stochastic", "", "how a change becomes whole mantissas", kind="word", words=ROUNDINGS)

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            for word in ("dw", "dt"):
                object.__setattr__(self, word, text(self._terms(word)))
            self.rule()
        except ModelError as error:
            raise error.at(here(), "loihi_learning") from None

    def _terms(self, word: str) -> tuple[Term, ...]:
        said = getattr(self, word)
        terms = parse(said if isinstance(said, str) else " + ".join(said), word)
        for term in terms:
            for factor in term.factors:
                if factor.name in ("r1", "r2"):
                    raise ModelError(
                        f"{word} reads {factor.name}, which nothing sets here",
                        hint="stdp_dopa has a signal or dopamine",
                        path=(word,),
                    )
        return terms

    def rule(self) -> LearningRule:
        """The rule with its traces.

        Raises:
            ModelError: a trace that is read has no impulse or no time constant.
        """
        make = Trace.first_order if self.trace_decay == "first_order" else Trace.exponential
        said = {name: (getattr(self, f"{name}_impulse"), getattr(self, f"{name}_tau")) for name in (*PRE, *POST)}
        traces = {name: make(impulse, tau) for name, (impulse, tau) in said.items() if impulse and tau}
        return LearningRule(parse(self.dw), parse(self.dt, "dt"), traces, self.epoch, self.rounding)
