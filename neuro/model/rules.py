"""Connection rules: which neuron of one population reaches which of another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from neuro.core.choice import Choice
from neuro.core.errors import ModelError
from neuro.core.quantities import quantity
from neuro.core.registry import Registry

SAME = "same"
"""The padding that keeps the size of a sheet."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rule(Choice):
    """Base of the connection rules. A rule of one's own says its pairs in `connect`."""

    kind: ClassVar[str] = "rule"

    def connect(
        self, source: tuple[int, ...], target: tuple[int, ...], same: bool, rng: np.random.Generator
    ) -> tuple[ArrayLike, ArrayLike]:
        """The pairs of neurons that are connected, in any order; a pair may come twice.

        Args:
            source: sizes of the axes of the source, of a view those of the view; its neurons are counted from 0 in C
                order.
            target: of the target.
            same: whether both are the same neurons.
            rng: draws the same numbers in each run of a network, others with another seed.

        Returns:
            Source and target of every synapse, whole numbers. An array of weights or delays has the same order.

        Raises:
            ModelError: the rule does not fit the populations.
        """
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True, eq=False)
class one_to_one(Rule):
    """Neuron i reaches neuron i; both populations have the same size."""


@dataclass(frozen=True, kw_only=True, eq=False)
class all_to_all(Rule):
    """Every neuron reaches every neuron, itself only with `autapses`."""

    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")


@dataclass(frozen=True, eq=False)
class fixed_indegree(Rule):
    """Every target has n sources drawn at random."""

    n: int = quantity(doc="sources of each target", kind="integer", at_least=1)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")
    multapses: bool = quantity(True, "", "whether a pair may be drawn twice", kind="boolean")


@dataclass(frozen=True, eq=False)
class fixed_outdegree(Rule):
    """Every source has n targets drawn at random."""

    n: int = quantity(doc="targets of each source", kind="integer", at_least=1)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")
    multapses: bool = quantity(True, "", "whether a pair may be drawn twice", kind="boolean")


@dataclass(frozen=True, eq=False)
class pairwise_bernoulli(Rule):
    """Every pair is connected with probability p."""

    p: float = quantity(doc="probability", at_least=0, at_most=1)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")


@dataclass(frozen=True, eq=False)
class pairs(Rule):
    """The listed pairs: source pre[k] reaches target post[k]; a pair may be listed twice."""

    pre: Any = quantity(doc="sources", kind="ids")
    post: Any = quantity(doc="targets", kind="ids")

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.pre) != len(self.post):
            raise ModelError(
                f"pairs: {len(self.pre)} sources and {len(self.post)} targets: expected as many of each",
                path=("post",),
            )


@dataclass(frozen=True, eq=False)
class grid(Rule):
    """A sheet of neurons with one kernel per map, as a convolution.

    The source has the shape (channels, height, width) or (height, width), the target (maps, rows, columns).
    Target (m, r, c) is reached from channel k, row r stride + i - padding, column c stride + j - padding with
    the weight kernel[m, k, i, j]; the target's rows and columns may be `auto`. With padding `same` they are those of
    the source divided by the stride, rounded up, and the border is spread evenly, an odd line of it at the end. With
    `depthwise` each map is reached from one channel only, as many maps from each in order, with kernel[m, 0, i, j].
    """

    kernel: tuple[int, ...] = quantity(doc="height and width", kind="shape", at_least=1)
    stride: int = quantity(1, "", "step of the kernel", kind="integer", at_least=1)
    padding: int | str = quantity(0, "", "silent border round the source", kind="integer", at_least=0, words=(SAME,))
    depthwise: bool = quantity(False, "", "whether a map is reached from one channel only", kind="boolean")

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.kernel) != 2:
            raise ModelError(
                f"grid.kernel = {list(self.kernel)}: expected two numbers, height and width", path=("kernel",)
            )


def complete(rule: type[Rule]) -> type[Rule]:
    """Return a rule of a stranger if it says its pairs.

    Raises:
        TypeError: it does not.
    """
    if rule.connect is Rule.connect:
        raise TypeError(f"rule '{rule.__name__}' has no method 'connect', which says its pairs")
    taken, expected = rule.connect.__code__.co_argcount, Rule.connect.__code__.co_argcount
    if taken != expected:
        raise TypeError(f"rule '{rule.__name__}': 'connect' takes {taken} arguments with self: expected {expected}")
    return rule


RULES: Registry[type[Rule]] = Registry(
    "rule",
    (one_to_one, all_to_all, fixed_indegree, fixed_outdegree, pairwise_bernoulli, pairs, grid),
    takes=lambda part: isinstance(part, type) and issubclass(part, Rule),
    group="neuro.rules",
    complete=complete,
)
"""All connection rules by name."""
