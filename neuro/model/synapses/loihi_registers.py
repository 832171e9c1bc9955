"""Synapses of Loihi 1 and Loihi 2 whose parameters are registers, static or learning by the chips' rules."""

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
_RECEPTOR = "receptor of the target, for targets with two receptors"
_IMPULSE: Mapping[str, Any] = {"kind": "integer", "at_least": 0, "at_most": TRACE_MAX}
_TAU: Mapping[str, Any] = {"kind": "integer", "at_least": 0, "at_most": KEEP}


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi_static(Synapse):
    """Synapse that adds 64 floor(m 2^weight_exp) to the current register.

    The weight of the projection is the mantissa m.

    The sign mode `mixed` has m from -256 to 254 in steps of 2, `excitatory` 0 to 255, `inhibitory` -255 to 0. With
    fewer weight bits the lowest bits are dropped (rounded towards 0); mixed mode drops one bit more. The sum is clipped
    to +-(2^21 - 64). A weight that is read back is the added amount / (64 2^weight_exp), without the dropped bits. The
    mantissa register keeps all bits.

    Source: Michaelis et al., Front. Neuroinform. 16:1015624, 2022. The paper shifts each weight and reports a match
    with the chip.
    """

    equation: ClassVar[str] = "sends 64 floor(m 2^weight_exp)"
    source: ClassVar[str] = "Davies et al., IEEE Micro 38(1):82, 2018; Michaelis et al., Front. Neuroinform. 16, 2022"
    chip: ClassVar[str] = "loihi"

    weight_exp: int = quantity(0, "", "weight exponent", kind="integer", at_least=-8, at_most=7)
    num_weight_bits: int = quantity(8, "", "bits of a weight", kind="integer", at_least=1, at_most=8)
    sign_mode: str = quantity("mixed", "", "signs of the weights", kind="word", words=SIGN_MODES)


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi2_static(Synapse):
    """Synapse that adds the sum of m p over the spikes of a step, shifted by weight_exp.

    m is the weight and p the payload.
    The sign mode `mixed` has m from -256 to 255, `excitatory` 0 to 255, `inhibitory` -255 to 0. Weights out of range
    are clipped. The lowest 8 - num_weight_bits bits are dropped, in mixed mode one more. Weights are thus rounded down,
    and in inhibitory mode towards 0. A negative weight_exp rounds down the sum of all spikes of a step and delay; on
    Loihi 1 each weight is rounded. In lava: Dense, Sparse, DelayDense, DelaySparse.
    """

    equation: ClassVar[str] = "adds 2^weight_exp sum m p, rounded down"
    source: ClassVar[str] = "lava 0.10 Dense, Sparse, fixed point"
    chip: ClassVar[str] = "loihi2"

    weight_exp: int = quantity(0, "", "weight exponent", kind="integer", at_least=-8, at_most=7)
    num_weight_bits: int = quantity(8, "", "bits of a weight", kind="integer", at_least=1, at_most=8)
    sign_mode: str = quantity("mixed", "", "signs of the weights", kind="word", words=SIGN_MODES)
    receptor: str | None = quantity(None, "", _RECEPTOR, kind="receptor")


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi2_convolution(Synapse):
    """Synapse that adds the sum of w p over the spikes of a step.

    Weights are whole numbers of 8 bits and a sign. No bit is dropped.

    With `wraps` the sum of a step and delay is a two's complement of 24 bits. In lava: Conv, which ignores the weight
    exponent and the number of bits, and ConvInTime, whose sums do not wrap.
    """

    equation: ClassVar[str] = "adds sum w p"
    source: ClassVar[str] = "lava 0.10 Conv, ConvInTime, fixed point"
    chip: ClassVar[str] = "loihi2"

    wraps: bool = quantity(True, "", "whether the sum wraps around at 24 bits", kind="boolean")
    receptor: str | None = quantity(None, "", _RECEPTOR, kind="receptor")


@dataclass(frozen=True, kw_only=True, eq=False)
class RegisterLearning(Synapse):
    """Base of the learning rules in registers: sums of products of traces, applied at the end of each epoch."""

    learns: ClassVar[str] = "chip"

    weight_exp: int = quantity(0, "", "weight exponent", kind="integer", at_least=-8, at_most=7)
    num_weight_bits: int = quantity(8, "", "bits of a weight", kind="integer", at_least=1, at_most=8)
    sign_mode: str = quantity("mixed", "", "signs of the weights", kind="word", words=SIGN_MODES)
    dw: str = quantity("", "", "change of the mantissa, a sum of products", kind="names")
    dt: str = quantity("", "", "change of the tag, a sum of products", kind="names")
    x1_impulse: int = quantity(0, "", "increase of x1 per spike", **_IMPULSE)
    x1_tau: int = quantity(0, "steps", "time constant of x1", **_TAU)
    x2_impulse: int = quantity(0, "", "increase of x2 per spike", **_IMPULSE)
    x2_tau: int = quantity(0, "steps", "time constant of x2", **_TAU)
    y1_impulse: int = quantity(0, "", "increase of y1 per spike", **_IMPULSE)
    y1_tau: int = quantity(0, "steps", "time constant of y1", **_TAU)
    y2_impulse: int = quantity(0, "", "increase of y2 per spike", **_IMPULSE)
    y2_tau: int = quantity(0, "steps", "time constant of y2", **_TAU)
    y3_impulse: int = quantity(0, "", "increase of y3 per spike", **_IMPULSE)
    y3_tau: int = quantity(0, "steps", "time constant of y3", **_TAU)
    epoch: int = quantity(1, "steps", "length of an epoch", kind="integer", at_least=1, at_most=LONGEST_EPOCH)

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            for word in ("dw", "dt"):
                products = getattr(self, word)
                terms = self.parse_products(products if isinstance(products, str) else " + ".join(products), word)
                for factor in (factor for term in terms for factor in term.factors):
                    if factor.name in ("r1", "r2"):
                        message = f"{word} reads {factor.name}, which nothing sets: expected other factors"
                        raise ModelError(message, hint="use stdp_dopa, which has a signal or dopamine", path=(word,))
                object.__setattr__(self, word, text(terms))
            self.rule()
        except ModelError as error:
            raise error.at(here(), self.name) from None

    @staticmethod
    def parse_products(rule: str, what: str) -> tuple[Term, ...]:
        """Return the products of `dw` or `dt`."""
        return parse(rule, what)

    def rule(self) -> LearningRule:
        """Return the rule with its traces.

        Raises:
            ModelError: the rule reads a trace that never rises.
        """
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi_learning(RegisterLearning):
    """Synapse whose mantissa changes by `dw` and whose tag changes by `dt`, sums of products, at the end of each epoch.

    A product consists of whole numbers, powers 2^n and factors joined by "*": x0 and y0 (a pre or post spike in this
    epoch), x1, x2, y1, y2, y3 (traces), w (weight), t (tag), (factor + constant), u_k (1 in every 2^k-th epoch). A
    spike increases a trace by its impulse, up to 127. Per step a trace is multiplied by 1 - 1/tau (with `trace_decay:
    exponential` by exp(-1/tau)).

    Source: Davies et al., IEEE Micro 38(1):82, 2018; Michaelis et al., Front. Neuroinform. 16:1015624, 2022.
    """

    equation: ClassVar[str] = "w += sum of products dw; t += sum of products dt; sends 64 floor(w 2^weight_exp)"
    source: ClassVar[str] = "Davies et al., IEEE Micro 38(1):82, 2018; Michaelis et al., Front. Neuroinform. 16, 2022"
    chip: ClassVar[str] = "loihi"
    states: ClassVar[tuple[State, ...]] = (State("t", "", "tag"),)

    trace_decay: str = quantity("first_order", "", "form of the decay per step", kind="word", words=SHAPES)
    rounding: str = quantity("stochastic", "", "rounding of changes to whole mantissas", kind="word", words=ROUNDINGS)

    def rule(self) -> LearningRule:
        """Return the rule with its traces.

        Raises:
            ModelError: the rule reads a trace without impulse or time constant.
        """
        make = Trace.first_order if self.trace_decay == "first_order" else Trace.exponential
        registers = {name: (getattr(self, f"{name}_impulse"), getattr(self, f"{name}_tau")) for name in (*PRE, *POST)}
        traces = {name: make(impulse, tau) for name, (impulse, tau) in registers.items() if impulse and tau}
        return LearningRule(parse(self.dw), parse(self.dt, "dt"), traces, self.epoch, self.rounding)


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi2_learning(RegisterLearning):
    """Synapse whose mantissa changes by `dw` and whose tag changes by `dt` at the end of each epoch.

    The arithmetic is that of lava's "bit approximate" models.

    `dw` and `dt` have the same form as in `loihi_learning`. lava drops the low bits of products of more than 15 bits,
    so the changes by long products are smaller than in the formula. Per step a trace is multiplied by exp(-1/tau) (0 at
    tau 0) and rounded at random. Each epoch has three random numbers: for the traces of all sources, for the traces of
    all targets, and for all weights. If a neuron spikes several times in an epoch, the last spike counts at its step,
    and the earlier spikes count at the beginning of the epoch.

    With `graded` (lava's graded_spike_cfg) a payload p changes x1 by q = p/2, rounded (ties to even) and mod 256.
    `overwrite` sets x1 to q, `add_with_saturation` adds q up to 127, and `add_without_saturation` adds q and keeps the
    excess above 127; only an excess then counts as a spike, which increases x2. Random numbers depend on the network's
    seed; `rng_seed` selects the random numbers of lava instead.
    In lava: LearningDense with Loihi2FLearningRule. Source: lava 0.10, magma/core/model/py/connection.py.
    """

    equation: ClassVar[str] = "w += sum of products dw; t += sum of products dt; adds 2^weight_exp sum w p"
    source: ClassVar[str] = "lava 0.10 LearningDense, fixed point (bit approximate)"
    chip: ClassVar[str] = "loihi2"
    takes_graded: ClassVar[bool] = True
    states: ClassVar[tuple[State, ...]] = (
        State("t", "", "tag"),
        State("x1", "", "trace x1 of the pre neuron"),
        State("x2", "", "trace x2 of the pre neuron"),
        State("y1", "", "trace y1 of the post neuron"),
        State("y2", "", "trace y2 of the post neuron"),
        State("y3", "", "trace y3 of the post neuron"),
    )

    graded: str = quantity("impulse", "", "effect of payloads on x1", kind="word", words=GRADED_TRACES)
    rng_seed: int = quantity(
        -1, "", "seed of lava's random numbers; -1: the network's seed", kind="integer", at_least=-1, at_most=2**31 - 1
    )

    @staticmethod
    def parse_products(rule: str, what: str) -> tuple[Term, ...]:
        """Return the products of `dw` or `dt`, with scales as in lava."""
        terms = parse(rule, what, as_lava=True)
        for term in terms:
            if not -FRACTION_BITS <= term.exponent <= LARGEST_EXPONENT - 1:
                message = f"'{term}': exponent {term.exponent}: expected {-FRACTION_BITS} to {LARGEST_EXPONENT - 1}"
                raise ModelError(message, path=(what,))
        return terms

    def rule(self) -> LearningRule:
        """Return the rule with its traces.

        Raises:
            ModelError: the rule reads a trace that neither an impulse nor a payload raises, x1 has both, or periods
                differ.
        """
        if self.graded != "impulse" and self.x1_impulse:
            message = f"x1_impulse = {self.x1_impulse} with graded: {self.graded}: expected none, payloads raise x1"
            raise ModelError(message, hint="leave out x1_impulse", path=("x1_impulse",))
        registers = {name: (getattr(self, f"{name}_impulse"), getattr(self, f"{name}_tau")) for name in (*PRE, *POST)}
        rising = {name for name, (impulse, _) in registers.items() if impulse}
        rising |= {"x1"} if self.graded != "impulse" else set()
        traces = {
            name: Trace.exponential(impulse, tau) if tau else Trace(impulse, 0, 1)
            for name, (impulse, tau) in registers.items()
            if name in rising
        }
        rule = LearningRule(self.parse_products(self.dw, "dw"), self.parse_products(self.dt, "dt"), traces, self.epoch)
        periods = sorted({term.every for term in (*rule.dw, *rule.dt) if term.gate == "u"})
        if len(periods) > 1:
            message = f"u{periods[0]} and u{periods[1]} in one rule: expected one period for dw and dt, as in lava"
            raise ModelError(message, hint="use one period", path=("dt",))
        return rule


@dataclass(frozen=True, slots=True)
class LoihiEngine:
    """Properties of Loihi's learning engine, the argument of the method `microcode` of a user-defined synapse model.

    Attributes:
        h: length of a step in ms.
        tau_minus: time constant of the target's K- in ms.
        mantissa: weight of the mantissa 1, in the unit of the weight.
        n: value of the modulator n for one unit of r1 or r2. r1 has the positive part of n, r2 the negative part.
        modulatory: traces r1 and r2 of a rule with a modulator.
    """

    h: float
    tau_minus: float
    mantissa: float
    n: float = 0.0
    modulatory: Mapping[str, Trace] = field(default_factory=dict)

    def rule(self, dw: str, dt: str = "", **traces: tuple[int, float]) -> LearningRule:
        """Return the learning rule that the engine applies at the end of each step.

        Args:
            dw: the sum of products that changes the mantissa, see `loihi_learning`. r1 and r2 are accepted as factors.
            dt: the sum of products that changes the tag.
            traces: for each trace the impulse of a spike, 0 to 127, and the time constant in ms, e.g. x1=(16, 20.0).
                0 ms stands for one step.

        Raises:
            ModelError: a sum cannot be parsed or does not fit the chip, or a trace does not exist or never rises.
        """
        all_traces = dict(self.modulatory)
        for name, (impulse, tau) in traces.items():
            if name not in (*PRE, *POST):
                raise ModelError(f"trace '{name}': expected {', '.join((*PRE, *POST))}", hint=near(name, (*PRE, *POST)))
            if impulse != round(impulse) or not tau >= 0.0:
                raise ModelError(f"{name} = ({impulse!r}, {tau!r}): expected a whole number and at least 0 ms")
            all_traces[name] = Trace.exponential(round(impulse), tau / self.h) if tau else Trace(round(impulse), 0, 1)
        return LearningRule(parse(dw), parse(dt, "dt"), all_traces)


_TOKEN = re.compile(r"\s*(?:(\d+\.\d*|\.\d+)|(2\s*\^\s*[+-]?\d+)|(\d+)|([A-Za-z_]\w*)|(.))")
_DECIMAL, _POWER, _INTEGER, _NAME, _MARK = range(1, 6)
_HINTS = {
    "d": "delays cannot learn",
    "r": "the modulatory traces are r1 (adds) and r2 (subtracts)",
    "u": "write the period: u0 is every epoch, u3 every 8th",
}


def parse(rule: str, what: str = "dw", as_lava: bool = False) -> tuple[Term, ...]:
    """Parse a sum of products. "" is the empty sum.

    Args:
        rule: the text. A product consists of factors joined by "*": whole numbers, powers 2^n, x0 .. y3, r1, r2, w, t,
            u0 .. u9 or (factor + constant). A product without x0, y0 and u_k acts in every epoch, like u0.
        what: name of the sum in messages.
        as_lava: whether a scale keeps the given mantissa and exponent if they fit, instead of an odd mantissa.

    Raises:
        ModelError: a part of the text is unknown, misplaced or does not fit the chip.
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
            raise self.wrong("found the end: expected a factor")
        self.at += 1
        return self.tokens[self.at - 1]

    def terms(self) -> tuple[Term, ...]:
        products: list[Term] = []
        while self.at < len(self.tokens):
            sign = 1
            if self.peek() in ("+", "-"):
                sign = -1 if self.take()[1] == "-" else 1
            elif products:
                raise self.wrong(f"found '{self.peek()}' after a product: expected +, - or *", _mark_hint(self.peek()))
            products.append(self.product(sign))
        return tuple(products)

    def product(self, sign: int) -> Term:
        begin = self.at
        scale, exponent, gate, period = sign, 0, "", -1
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
                period = self.period(token, period)
            elif kind == _NAME and token in ("x0", "y0") and not gate and not (self.as_lava and period >= 0):
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
            product_text = "".join(token for _, token in self.tokens[begin : self.at])
            raise self.wrong(f"'{product_text}' is always 0", "leave it out")
        # In lava, 4 and 2^2 lose different bits of a product.
        while scale % 2 == 0 and not (self.as_lava and (abs(scale) <= LARGEST_MANTISSA or exponent == 8)):
            scale, exponent = scale // 2, exponent + 1
        try:
            return Term(scale, exponent, gate or "u", max(0, period), tuple(factors))
        except ModelError as error:
            raise self.wrong(error.message, error.hint) from None

    def period(self, token: str, earlier_period: int) -> int:
        period = int(token[1:])
        if earlier_period >= 0:
            raise self.wrong(f"'{token}' and 'u{earlier_period}' in one product: expected one of them")
        if period > LARGEST_U:
            raise self.wrong(f"'{token}': expected u0 to u{LARGEST_U}")
        return period

    def name(self, token: str) -> str:
        if token in FACTORS:
            return token
        all_factors = f"factors are {', '.join(FACTORS)}, u0 to u{LARGEST_U}"
        raise self.wrong(f"unknown factor '{token}'", _HINTS.get(token) or near(token, FACTORS) or all_factors)

    def sum_of_two(self) -> tuple[Factor, int]:
        """Parse (name + constant) in any order.

        Return the factor with a positive name, and the sign that is factored out: (3 - x1) gives (x1 - 3) and -1.
        """
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
            raise self.wrong("found an open bracket: expected (name + whole number)")
        self.take()
        if not name:
            raise self.wrong("found a bracket without a name", "write the number without brackets")
        if abs(constant) > LARGEST_CONSTANT:
            raise self.wrong(f"constant {constant}: expected at most {LARGEST_CONSTANT} in size")
        return Factor(name, sign * constant), sign

    def unexpected(self, kind: int, token: str) -> ModelError:
        if kind == _DECIMAL:
            return self.wrong(f"found the scale {token}: expected whole numbers and powers of 2, such as 3*2^-4")
        if token == "/":
            return self.wrong("found '/': expected no division, which the chip lacks", "multiply by 2^-n")
        return self.wrong(f"found '{token}': expected a factor", _mark_hint(token))


def _mark_hint(token: str) -> str:
    if token == "^":
        return "only powers of 2 are possible: 2^-3"
    if token == "/":
        return "the chip cannot divide: multiply by 2^-n"
    return "write 2^-3 without brackets" if token == "(" else ""
