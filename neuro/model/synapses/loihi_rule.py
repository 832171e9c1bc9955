"""Loihi's learning rules: changes of the weight w and the tag t of a synapse as sums of products.

    dw = sum_i S_i prod_j (factor_ij + C_ij)        S = m 2^e, m = -8..7, e.g. "2^-2*x1*y0 - 2^-2*x0*y1"

Each product has a dependency and is added only if the dependency holds: x0 (a pre spike in this epoch), y0 (a post
spike) or u_k (every 2^k-th epoch; u0: every epoch). The rule is applied at the end of every epoch of 1 to 63 steps.

Sources: Davies et al., IEEE Micro 38(1):82, 2018 (widths, sums of products, epochs); Michaelis et al., Front.
Neuroinform. 16:1015624, 2022 (Brian2Loihi: exponents, traces); lava-nc 0.10 (4-bit scale mantissas, 8-bit constants,
16-bit accumulator, 9-bit tags). For contradictions between the sources see `backends/neuro_chip/learning.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from neuro.core.errors import ModelError

TRACE_MAX = 127
"""Largest trace, an unsigned number of 7 bits."""
FRACTION_BITS = 7
"""Fractional bits of the 16-bit accumulator, which holds a 9-bit variable. Smaller changes are lost."""
PRODUCT_BITS = 15
"""Bits of a product without its sign that fit the accumulator."""
MANTISSA_BITS = 4
"""Bits of a scale's mantissa, which is -8..7."""
LARGEST_MANTISSA = 7
LEVEL = 8
"""Factor on the values that a target sends as y2 and y3. With a mantissa of 4 the product is 2^5, and Loihi 2 drops 5
bits."""
LARGEST_EXPONENT = 9
LARGEST_CONSTANT = 255
LONGEST_EPOCH = 63
LARGEST_U = 9
MOST_FACTORS = 4
"""Largest number of factors beside the dependency, so that products fit 64 bits. A limit of neuro, not of the chip."""
KEEP = 1 << 20
"""Denominator of an exponential decay, chosen so that the error after 10,000 steps is below 1 %."""

PRE, POST, MODULATORY = ("x1", "x2"), ("y1", "y2", "y3"), ("r1", "r2")
TRACES = (*PRE, *POST, *MODULATORY)
FACTORS = ("x0", *PRE, "y0", *POST, *MODULATORY, "w", "t")
WIDTHS = {"x0": 0, "y0": 0, **dict.fromkeys(TRACES, 7), "w": 9, "t": 9}
"""Bits of each factor in a product. Spikes (x0, y0) are gates without bits."""


@dataclass(frozen=True, slots=True)
class Factor:
    """A factor of a product, `name + add`."""

    name: str
    add: int = 0

    def __str__(self) -> str:
        return f"({self.name} {'-' if self.add < 0 else '+'} {abs(self.add)})" if self.add else self.name


@dataclass(frozen=True, slots=True)
class Term:
    """A product of a learning rule.

    Attributes:
        mantissa, exponent: the scale, mantissa 2^exponent. The mantissa is odd except on Loihi 2.
        gate: the dependency "x0", "y0" or "u". With "x0" or "y0" traces are read at the step of this spike.
        every: the k of u_k; 0 for a product that is added in every epoch.
        factors: the remaining factors.

    Raises:
        ModelError: the product does not fit the chip's bits.
    """

    mantissa: int
    exponent: int
    gate: str
    every: int
    factors: tuple[Factor, ...]

    def __post_init__(self) -> None:
        if not -8 <= self.mantissa <= LARGEST_MANTISSA:
            message = f"'{self}': scale {self.mantissa} x 2^{self.exponent}: expected -8 to 7 times a power of 2"
            raise ModelError(message, hint="split it into two products")
        lowest = -FRACTION_BITS - max(0, self.bits - PRODUCT_BITS)
        if not lowest <= self.exponent <= LARGEST_EXPONENT:
            raise ModelError(
                f"'{self}': exponent {self.exponent}: expected {lowest} to {LARGEST_EXPONENT} for a product of "
                f"{self.bits} bits"
            )
        if len(self.factors) > MOST_FACTORS:
            raise ModelError(
                f"'{self}': {len(self.factors)} factors and a dependency: expected at most {MOST_FACTORS} factors"
            )

    @property
    def bits(self) -> int:
        """Sum of the bits of the factors and of the scale's mantissa."""
        return sum(WIDTHS[f.name] for f in self.factors) + MANTISSA_BITS

    def __str__(self) -> str:
        parts = [] if abs(self.mantissa) == 1 else [str(abs(self.mantissa))]
        parts += [f"2^{self.exponent}"] if self.exponent else []
        parts += [f"u{self.every}"] if self.every or self.gate == "u" else []
        parts += [self.gate] if self.gate != "u" else []
        parts += [str(f) for f in self.factors]
        return ("-" if self.mantissa < 0 else "") + "*".join(parts)


@dataclass(frozen=True, slots=True)
class Trace:
    """A 7-bit trace.

    A spike adds `impulse`, and each step multiplies by numerator / denominator with stochastic rounding.
    """

    impulse: int
    numerator: int
    denominator: int

    def __post_init__(self) -> None:
        if not 0 <= self.impulse <= TRACE_MAX:
            raise ModelError(f"impulse {self.impulse}: expected 0 to {TRACE_MAX}")
        if not 0 <= self.numerator <= self.denominator <= KEEP:
            raise ModelError(f"decay {self.numerator}/{self.denominator}: expected 0 to 1, denominator <= {KEEP}")

    @classmethod
    def first_order(cls, impulse: int, tau: int) -> Trace:
        """Return a trace that is multiplied by 1 - 1/tau per step (tau in steps, >= 1), as in Brian2Loihi."""
        return cls(impulse, tau - 1, tau)

    @classmethod
    def exponential(cls, impulse: int, tau: float) -> Trace:
        """Return a trace that is multiplied by exp(-1/tau) per step (tau in steps), with 20 bits, as in lava."""
        return cls(impulse, round(KEEP * math.exp(-1.0 / tau)), KEEP)

    @property
    def tau(self) -> float:
        """Time constant of the mean of the trace in steps."""
        keep = self.numerator / self.denominator
        return math.inf if keep == 1 else 0.0 if keep == 0 else -1.0 / math.log(keep)


@dataclass(frozen=True, slots=True)
class Outgoing:
    """Program of a target that sends its third factor: n - baseline as y2 if it is positive, else baseline - n as y3.

    The difference in units of n is divided by 2^shift, rounded stochastically to at most 15, and multiplied by `LEVEL`.

    Attributes:
        baseline: baseline of n, in units of 2^-7 of the unit of n.
        shift: number of bits that are rounded away.
    """

    baseline: int
    shift: int


@dataclass(frozen=True, slots=True)
class LearningRule:
    """Learning rule of a plastic projection on Loihi.

    Attributes:
        dw, dt: products that change the weight and the tag. Either may be empty.
        traces: all traces that the products read, by name.
        epoch: number of steps between two applications of the rule.
        rounding: "stochastic": the part below the resolution of a weight is rounded randomly. "away": a
            change is rounded away from 0 to a whole mantissa, and then towards 0 to the resolution of a weight.
            Brian2Loihi rounds products of spikes in this way.
        outgoing: for rules with a third factor n on Loihi 2, whose targets send y1, y2 and y3: the program that
            computes y2 and y3 from n.

    Raises:
        ModelError: the rule reads a trace that never rises, or the epoch is out of bounds.
    """

    dw: tuple[Term, ...]
    dt: tuple[Term, ...] = ()
    traces: Mapping[str, Trace] = field(default_factory=dict)
    epoch: int = 1
    rounding: str = "stochastic"
    outgoing: Outgoing | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.epoch <= LONGEST_EPOCH:
            raise ModelError(f"epoch = {self.epoch}: expected 1 to {LONGEST_EPOCH} steps")
        if self.rounding not in ("stochastic", "away"):
            raise ModelError(f"rounding = '{self.rounding}': expected stochastic or away")
        for term in (*self.dw, *self.dt):
            for factor in term.factors:
                if factor.name in TRACES and factor.name not in self.traces:
                    message = f"'{term}' reads {factor.name}, which never rises"
                    raise ModelError(message, hint=f"give {factor.name}_impulse and {factor.name}_tau")

    def __str__(self) -> str:
        lines = [f"{word} = {text(terms)}" for word, terms in (("dw", self.dw), ("dt", self.dt)) if terms]
        lines += [f"{name}: impulse {tr.impulse}, tau {tr.tau:.4g} steps" for name, tr in self.traces.items()]
        return "\n".join([*lines, f"epoch {self.epoch}"])


def text(terms: tuple[Term, ...]) -> str:
    """Return a sum of products as text. `loihi_registers.parse` reads the text back to the same products."""
    parts = [str(term) for term in terms]
    return "".join(parts[:1] + [f" - {p[1:]}" if p.startswith("-") else f" + {p}" for p in parts[1:]])
