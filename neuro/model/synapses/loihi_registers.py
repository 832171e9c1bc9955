"""Synapses of Loihi 1 in its own registers: one that keeps its weight, and one that learns by the chip's rules."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from neuro.core.errors import ModelError, here
from neuro.core.hints import near
from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Synapse
from neuro.model.synapses.loihi_rule import (
    FACTORS,
    FRACTION_BITS,
    KEEP,
    LARGEST_CONSTANT,
    LARGEST_EXPONENT,
    LARGEST_MANTISSA,
    LARGEST_U,
    LONGEST_EPOCH,
    POST,
    PRE,
    TRACE_MAX,
    Factor,
    LearningRule,
    Term,
    Trace,
    text,
)

SIGN_MODES = ("mixed", "excitatory", "inhibitory")
SHAPES = ("first_order", "exponential")
ROUNDINGS = ("stochastic", "away")
GRADED_TRACES = ("impulse", "overwrite", "add_with_saturation", "add_without_saturation")
_RECEPTOR = "the receptor of the target, of those that have two"
_IMPULSE: Mapping[str, Any] = {"kind": "integer", "at_least": 0, "at_most": TRACE_MAX}
_TAU: Mapping[str, Any] = {"kind": "integer", "at_least": 0, "at_most": KEEP}


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi_static(Synapse):
    """Adds 64 floor(m 2^weight_exp) to the current register; the weight of the projection is the mantissa m.

    Mixed: m from -256 to 254 in steps of 2; excitatory: 0 to 255; inhibitory: -255 to 0. With fewer weight bits the
    lowest are dropped (towards 0), one more in mixed mode. What is added is clipped to +-(2^21 - 64). The weight that
    is read back, what is added / (64 2^weight_exp), has lost these bits; the mantissa is its register.

    Source: Michaelis et al., Front. Neuroinform. 16:1015624, 2022, which shifts each weight and reports a match with
    the chip.
    """

    equation: ClassVar[str] = "sends 64 floor(m 2^weight_exp)"
    source: ClassVar[str] = "Davies et al., IEEE Micro 38(1):82, 2018; Michaelis et al., Front. Neuroinform. 16, 2022"
    chip: ClassVar[str] = "loihi"

    weight_exp: int = quantity(0, "", "weight exponent", kind="integer", at_least=-8, at_most=7)
    num_weight_bits: int = quantity(8, "", "bits of a weight", kind="integer", at_least=1, at_most=8)
    sign_mode: str = quantity("mixed", "", "which signs the weights have", kind="word", words=SIGN_MODES)


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi2_static(Synapse):
    """Adds the sum of m p over the spikes of a step, shifted by weight_exp: m is the weight, p the payload.

    Mixed: m from -256 to 255, excitatory: 0 to 255, inhibitory: -255 to 0; what is beyond is clipped. The lowest
    8 - num_weight_bits bits are dropped, one more in mixed mode: rounded down, in inhibitory mode towards 0. A
    negative weight_exp rounds down the sum of all spikes of a step and delay, not each weight as on Loihi 1. lava:
    Dense, Sparse, DelayDense, DelaySparse.
    """

    equation: ClassVar[str] = "adds 2^weight_exp sum m p, rounded down"
    source: ClassVar[str] = "lava 0.10 Dense, Sparse, fixed point"
    chip: ClassVar[str] = "loihi2"

    weight_exp: int = quantity(0, "", "weight exponent", kind="integer", at_least=-8, at_most=7)
    num_weight_bits: int = quantity(8, "", "bits of a weight", kind="integer", at_least=1, at_most=8)
    sign_mode: str = quantity("mixed", "", "which signs the weights have", kind="word", words=SIGN_MODES)
    receptor: str | None = quantity(None, "", _RECEPTOR, kind="receptor")


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi2_convolution(Synapse):
    """Adds the sum of w p over the spikes of a step; weights are whole numbers of 8 bits and a sign, none is dropped.

    With `wraps` the sum of a step and delay is a two's complement of 24 bits. lava: Conv, which ignores the weight
    exponent and the number of bits; ConvInTime, whose sums do not wrap.
    """

    equation: ClassVar[str] = "adds sum w p"
    source: ClassVar[str] = "lava 0.10 Conv, ConvInTime, fixed point"
    chip: ClassVar[str] = "loihi2"

    wraps: bool = quantity(True, "", "keep 24 bits of the sum", kind="boolean")
    receptor: str | None = quantity(None, "", _RECEPTOR, kind="receptor")


@dataclass(frozen=True, kw_only=True, eq=False)
class RegisterLearning(Synapse):
    """Base of the rules in registers: weights, traces and sums of products, applied at the end of each epoch."""

    learns: ClassVar[str] = "chip"

    weight_exp: int = quantity(0, "", "weight exponent", kind="integer", at_least=-8, at_most=7)
    num_weight_bits: int = quantity(8, "", "bits of a weight", kind="integer", at_least=1, at_most=8)
    sign_mode: str = quantity("mixed", "", "which signs the weights have", kind="word", words=SIGN_MODES)
    dw: str = quantity("", "", "change of the mantissa, a sum of products", kind="names")
    dt: str = quantity("", "", "change of the tag, a sum of products", kind="names")
    x1_impulse: int = quantity(0, "", "what a spike adds to x1", **_IMPULSE)
    x1_tau: int = quantity(0, "steps", "time constant of x1", **_TAU)
    x2_impulse: int = quantity(0, "", "what a spike adds to x2", **_IMPULSE)
    x2_tau: int = quantity(0, "steps", "time constant of x2", **_TAU)
    y1_impulse: int = quantity(0, "", "what a spike adds to y1", **_IMPULSE)
    y1_tau: int = quantity(0, "steps", "time constant of y1", **_TAU)
    y2_impulse: int = quantity(0, "", "what a spike adds to y2", **_IMPULSE)
    y2_tau: int = quantity(0, "steps", "time constant of y2", **_TAU)
    y3_impulse: int = quantity(0, "", "what a spike adds to y3", **_IMPULSE)
    y3_tau: int = quantity(0, "steps", "time constant of y3", **_TAU)
    epoch: int = quantity(1, "steps", "length of an epoch", kind="integer", at_least=1, at_most=LONGEST_EPOCH)

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            for word in ("dw", "dt"):
                products = getattr(self, word)
                terms = self.parsed(products if isinstance(products, str) else " + ".join(products), word)
                for factor in (factor for term in terms for factor in term.factors):
                    if factor.name in ("r1", "r2"):
                        message = f"{word} reads {factor.name}, which nothing sets here"
                        raise ModelError(message, hint="stdp_dopa has a signal or dopamine", path=(word,))
                object.__setattr__(self, word, text(terms))
            self.rule()
        except ModelError as error:
            raise error.at(here(), self.name) from None

    @staticmethod
    def parsed(rule: str, what: str) -> tuple[Term, ...]:
        """The products of `dw` or `dt`."""
        return parse(rule, what)

    def rule(self) -> LearningRule:
        """The rule with its traces.

        Raises:
            ModelError: a trace that is read never rises.
        """
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi_learning(RegisterLearning):
    """Changes its mantissa by `dw` and its tag by `dt`, sums of products, at the end of each epoch.

    A product is whole numbers, powers 2^n and factors joined by "*": x0 and y0 (a pre, a post spike in this epoch),
    x1, x2, y1, y2, y3 (traces), w, t, (factor + constant), u_k (1 in every 2^k-th epoch). Traces rise by their impulse
    at a spike, up to 127, and keep 1 - 1/tau of themselves per step (`trace_decay: exponential`: exp(-1/tau)).

    Source: Davies et al., IEEE Micro 38(1):82, 2018; Michaelis et al., Front. Neuroinform. 16:1015624, 2022.
    """

    equation: ClassVar[str] = "w += sum of products dw; t += sum of products dt; sends 64 floor(w 2^weight_exp)"
    source: ClassVar[str] = "Davies et al., IEEE Micro 38(1):82, 2018; Michaelis et al., Front. Neuroinform. 16, 2022"
    chip: ClassVar[str] = "loihi"
    states: ClassVar[tuple[State, ...]] = (State("t", "", "tag"),)

    trace_decay: str = quantity("first_order", "", "what a trace keeps per step", kind="word", words=SHAPES)
    rounding: str = quantity("stochastic", "", "how a change becomes whole mantissas", kind="word", words=ROUNDINGS)

    def rule(self) -> LearningRule:
        """The rule with its traces.

        Raises:
            ModelError: a trace that is read has no impulse or no time constant.
        """
        make = Trace.first_order if self.trace_decay == "first_order" else Trace.exponential
        said = {name: (getattr(self, f"{name}_impulse"), getattr(self, f"{name}_tau")) for name in (*PRE, *POST)}
        traces = {name: make(impulse, tau) for name, (impulse, tau) in said.items() if impulse and tau}
        return LearningRule(parse(self.dw), parse(self.dt, "dt"), traces, self.epoch, self.rounding)


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi2_learning(RegisterLearning):
    """Changes its mantissa by `dw` and its tag by `dt` at the end of each epoch, as lava's "bit approximate" models do.

    `dw` and `dt` are written as of `loihi_learning`; lava drops the low bits of products of more than 15 bits, so that
    they are smaller than written. A trace keeps exp(-1/tau) of itself per step (0 at tau 0), rounded by one random
    number for all sources and one for all targets in an epoch; one number rounds all weights. Of several spikes of a
    neuron in an epoch the last counts at its step, the others at the beginning.

    Payloads may raise x1 (`graded`, lava's graded_spike_cfg), by p/2 rounded to even, mod 256: `overwrite` sets it;
    `add_with_saturation` adds up to 127; `add_without_saturation` adds, keeps what is above 127, and only then counts
    as a spike, which raises x2. Random numbers follow from the network's seed; with `rng_seed` they are lava's own.
    lava: LearningDense with Loihi2FLearningRule. Source: lava 0.10, magma/core/model/py/connection.py.
    """

    equation: ClassVar[str] = "w += sum of products dw; t += sum of products dt; adds 2^weight_exp sum w p"
    source: ClassVar[str] = "lava 0.10 LearningDense, fixed point (bit approximate)"
    chip: ClassVar[str] = "loihi2"
    takes_graded: ClassVar[bool] = True
    states: ClassVar[tuple[State, ...]] = (
        State("t", "", "tag"),
        State("x1", "", "trace x1 of its neuron"),
        State("x2", "", "trace x2 of its neuron"),
        State("y1", "", "trace y1 of its neuron"),
        State("y2", "", "trace y2 of its neuron"),
        State("y3", "", "trace y3 of its neuron"),
    )

    graded: str = quantity("impulse", "", "how payloads raise x1", kind="word", words=GRADED_TRACES)
    rng_seed: int = quantity(
        -1, "", "of lava's random numbers; -1: the network's seed", kind="integer", at_least=-1, at_most=2**31 - 1
    )

    @staticmethod
    def parsed(rule: str, what: str) -> tuple[Term, ...]:
        """The products of `dw` or `dt`, with their scales as lava reads them."""
        terms = parse(rule, what, as_lava=True)
        for term in terms:
            if not -FRACTION_BITS <= term.exponent <= LARGEST_EXPONENT - 1:
                found = f"'{term}': exponent {term.exponent}"
                raise ModelError(f"{found}: expected {-FRACTION_BITS} to {LARGEST_EXPONENT - 1}", path=(what,))
        return terms

    def rule(self) -> LearningRule:
        """The rule with its traces.

        Raises:
            ModelError: a trace that is read has no impulse and no payload raises it, x1 has both, or periods differ.
        """
        if self.graded != "impulse" and self.x1_impulse:
            message = f"x1_impulse = {self.x1_impulse} with graded: {self.graded}: payloads raise x1"
            raise ModelError(message, hint="leave it out", path=("x1_impulse",))
        said = {name: (getattr(self, f"{name}_impulse"), getattr(self, f"{name}_tau")) for name in (*PRE, *POST)}
        raised = {name for name, (impulse, _) in said.items() if impulse}
        raised |= {"x1"} if self.graded != "impulse" else set()
        traces = {
            name: Trace.exponential(impulse, tau) if tau else Trace(impulse, 0, 1)
            for name, (impulse, tau) in said.items()
            if name in raised
        }
        rule = LearningRule(self.parsed(self.dw, "dw"), self.parsed(self.dt, "dt"), traces, self.epoch)
        periods = sorted({term.every for term in (*rule.dw, *rule.dt) if term.gate == "u"})
        if len(periods) > 1:
            message = f"u{periods[0]} and u{periods[1]} in one rule: lava has one of them for dw and dt together"
            raise ModelError(message, hint="use one period", path=("dt",))
        return rule


@dataclass(frozen=True, slots=True)
class LoihiEngine:
    """Loihi's learning engine, as the method `microcode` of a synapse model of one's own is told of it.

    Attributes:
        h: length of a step in ms.
        tau_minus: time constant of the target's K- in ms.
        mantissa: weight of one mantissa, in the unit of the weight.
        n: modulator of one unit of r1, which holds its positive part, and of r2, which holds its negative part.
        modulatory: the traces r1 and r2 of a rule under a modulator.
    """

    h: float
    tau_minus: float
    mantissa: float
    n: float = 0.0
    modulatory: Mapping[str, Trace] = field(default_factory=dict)

    def rule(self, dw: str, dt: str = "", **traces: tuple[int, float]) -> LearningRule:
        """Return what the engine does at the end of each step.

        Args:
            dw: the sum of products that changes the mantissa, as of `loihi_learning`; also r1 and r2 are factors.
            dt: the sum that changes the tag.
            traces: impulse of a spike, 0 to 127, and time constant in ms by trace, e.g. x1=(16, 20.0); 0 ms: one step.

        Raises:
            ModelError: a sum cannot be read or does not fit the chip, or a trace does not exist or never rises.
        """
        made = dict(self.modulatory)
        for name, (impulse, tau) in traces.items():
            if name not in (*PRE, *POST):
                raise ModelError(f"trace '{name}': expected {', '.join((*PRE, *POST))}", hint=near(name, (*PRE, *POST)))
            if impulse != round(impulse) or not tau >= 0.0:
                raise ModelError(f"{name} = ({impulse!r}, {tau!r}): expected a whole number and at least 0 ms")
            made[name] = Trace.exponential(round(impulse), tau / self.h) if tau else Trace(round(impulse), 0, 1)
        return LearningRule(parse(dw), parse(dt, "dt"), made)


_TOKEN = re.compile(r"\s*(?:(\d+\.\d*|\.\d+)|(2\s*\^\s*[+-]?\d+)|(\d+)|([A-Za-z_]\w*)|(.))")
_DECIMAL, _POWER, _INTEGER, _NAME, _MARK = range(1, 6)
_REFUSED = {
    "d": "delays do not learn here",
    "r": "the modulatory traces are r1 (adds) and r2 (subtracts)",
    "u": "say how often: u0 in every epoch, u3 in every 8th",
}


def parse(rule: str, what: str = "dw", as_lava: bool = False) -> tuple[Term, ...]:
    """Read a sum of products; "" is the empty one.

    Args:
        rule: the text. A product is factors joined by "*": whole numbers, powers 2^n, x0 .. y3, r1, r2, w, t, u0 .. u9
            or (factor + constant). One without x0, y0 and u_k acts in every epoch, as if it had u0.
        what: how messages call it.
        as_lava: whether a scale stays as it is written, as far as it fits, in place of an odd mantissa.

    Raises:
        ModelError: something in it is unknown, misplaced or does not fit the chip.
    """
    return _Reader(rule, what, as_lava).terms()


class _Reader:
    def __init__(self, rule: str, what: str, as_lava: bool) -> None:
        self.rule, self.what, self.as_lava = rule, what, as_lava
        self.tokens = [(m.lastindex or 0, m.group(m.lastindex or 0)) for m in _TOKEN.finditer(rule.rstrip())]
        self.at = 0

    def wrong(self, message: str, hint: str = "") -> ModelError:
        return ModelError(f"{self.what} = '{self.rule}': {message}", hint=hint, path=(self.what,))

    def peek(self) -> str:
        return self.tokens[self.at][1] if self.at < len(self.tokens) else ""

    def take(self) -> tuple[int, str]:
        if self.at == len(self.tokens):
            raise self.wrong("ends where a factor is expected")
        self.at += 1
        return self.tokens[self.at - 1]

    def terms(self) -> tuple[Term, ...]:
        found: list[Term] = []
        while self.at < len(self.tokens):
            sign = 1
            if self.peek() in ("+", "-"):
                sign = -1 if self.take()[1] == "-" else 1
            elif found:
                raise self.wrong(f"found '{self.peek()}' after a product: expected +, - or *", _mark_hint(self.peek()))
            found.append(self.product(sign))
        return tuple(found)

    def product(self, sign: int) -> Term:
        begin = self.at
        scale, exponent, gate, every = sign, 0, "", -1
        factors: list[Factor] = []
        while True:
            kind, token = self.take()
            if kind == _INTEGER:
                scale *= int(token)
            elif kind == _POWER:
                exponent += int(token.partition("^")[2].replace(" ", ""))
            elif kind == _NAME and re.fullmatch(r"u\d+", token):
                if self.as_lava and gate:
                    raise self.wrong(f"'{token}' after '{gate}' in one product", f"write {token} first")
                every = self.period(token, every)
            elif kind == _NAME and token in ("x0", "y0") and not gate and not (self.as_lava and every >= 0):
                gate = token
            elif kind == _NAME:
                factors.append(Factor(self.name(token)))
            elif token == "(":
                factor, flip = self.sum_of_two()
                factors.append(factor)
                scale *= flip
            else:
                raise self.unexpected(kind, token)
            if self.peek() != "*":
                break
            self.take()
        if scale == 0:
            said = "".join(token for _, token in self.tokens[begin : self.at])
            raise self.wrong(f"'{said}' is always 0", "leave it out")
        # Where a product loses bits, 4 and 2^2 are not the same.
        while scale % 2 == 0 and not (self.as_lava and (abs(scale) <= LARGEST_MANTISSA or exponent == 8)):
            scale, exponent = scale // 2, exponent + 1
        try:
            return Term(scale, exponent, gate or "u", max(0, every), tuple(factors))
        except ModelError as error:
            raise self.wrong(error.message, error.hint) from None

    def period(self, token: str, before: int) -> int:
        every = int(token[1:])
        if before >= 0:
            raise self.wrong(f"'{token}' beside 'u{before}' in one product: expected one of them")
        if every > LARGEST_U:
            raise self.wrong(f"'{token}': expected u0 to u{LARGEST_U}")
        return every

    def name(self, token: str) -> str:
        if token in FACTORS:
            return token
        known = f"factors are {', '.join(FACTORS)}, u0 to u{LARGEST_U}"
        raise self.wrong(f"unknown factor '{token}'", _REFUSED.get(token) or near(token, FACTORS) or known)

    def sum_of_two(self) -> tuple[Factor, int]:
        """(name + constant), in any order, and the sign to take out so that the name has a +."""
        name, sign, constant = "", 1, 0
        while True:
            plus = -1 if self.peek() == "-" else 1
            if self.peek() in ("+", "-"):
                self.take()
            kind, token = self.take()
            if kind == _INTEGER:
                constant += plus * int(token)
            elif kind == _NAME and not name:
                name, sign = self.name(token), plus
            elif kind == _NAME:
                raise self.wrong(f"'{name}' and '{token}' in one bracket: expected one name and a whole number")
            else:
                raise self.unexpected(kind, token)
            if self.peek() not in ("+", "-"):
                break
        if self.peek() != ")":
            raise self.wrong("a bracket that is not closed", "expected (name + whole number)")
        self.take()
        if not name:
            raise self.wrong("a bracket without a name", "write the number without brackets")
        if abs(constant) > LARGEST_CONSTANT:
            raise self.wrong(f"constant {constant}: expected at most {LARGEST_CONSTANT} in size")
        return Factor(name, sign * constant), sign

    def unexpected(self, kind: int, token: str) -> ModelError:
        if kind == _DECIMAL:
            return self.wrong(f"scale {token} is no power of 2", "write whole numbers and powers, such as 3*2^-4")
        if token == "/":
            return self.wrong("found '/': the chip cannot divide", "multiply by 2^-n")
        return self.wrong(f"found '{token}': expected a factor", _mark_hint(token))


def _mark_hint(token: str) -> str:
    if token == "^":
        return "only 2 can be raised: 2^-3"
    if token == "/":
        return "the chip cannot divide: multiply by 2^-n"
    return "write 2^-3 without brackets" if token == "(" else ""
