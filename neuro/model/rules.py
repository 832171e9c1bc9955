"""Connection rules: which neuron of one population reaches which of another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from neuro.core.choice import Choice
from neuro.core.errors import ModelError
from neuro.core.own_parts import check_method
from neuro.core.quantities import quantity
from neuro.core.registry import Registry
from neuro.model.space import Mask, Profile

HERE, BACKEND = "neuro", "backend"
"""Who may draw the synapses of a rule."""

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

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """How many there are, where it follows from the sizes of source and target; None where it is drawn.

        Args:
            source: neurons of the source.
            target: neurons of the target.
            same: whether both are one population.
        """
        return None


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedRule(Rule):
    """A rule that simulators have by name: the backend may make its synapses in place of this language."""

    draw: str = quantity(
        HERE,
        "",
        "who draws the synapses: neuro, the same for every backend, or backend: by its own rules, if it has some, the "
        "same in distribution",
        kind="word",
        words=(HERE, BACKEND),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class one_to_one(NamedRule):
    """Neuron i reaches neuron i; both populations have the same size."""

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """How many there are."""
        return source


@dataclass(frozen=True, kw_only=True, eq=False)
class all_to_all(NamedRule):
    """Every neuron reaches every neuron, itself only with `autapses`."""

    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """How many there are."""
        return source * target - (source if same and not self.autapses else 0)


@dataclass(frozen=True, eq=False)
class fixed_indegree(NamedRule):
    """Every target has n sources drawn at random."""

    n: int = quantity(doc="sources of each target", kind="integer", at_least=1)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")
    multapses: bool = quantity(True, "", "whether a pair may be drawn twice", kind="boolean")

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """How many there are."""
        return self.n * target


@dataclass(frozen=True, eq=False)
class fixed_outdegree(NamedRule):
    """Every source has n targets drawn at random."""

    n: int = quantity(doc="targets of each source", kind="integer", at_least=1)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")
    multapses: bool = quantity(True, "", "whether a pair may be drawn twice", kind="boolean")

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """How many there are."""
        return source * self.n


@dataclass(frozen=True, eq=False)
class pairwise_bernoulli(NamedRule):
    """Every pair is connected with probability p."""

    p: float = quantity(doc="probability", at_least=0, at_most=1)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")


@dataclass(frozen=True, eq=False)
class fixed_total_number(NamedRule):
    """So many synapses in all, each between a source and a target drawn at random. NEST calls n N."""

    n: int = quantity(doc="synapses", kind="integer", at_least=0)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")
    multapses: bool = quantity(True, "", "whether a pair may be drawn twice", kind="boolean")


@dataclass(frozen=True, eq=False)
class symmetric_pairwise_bernoulli(Rule):
    """Neurons of one population are connected in both directions.

    Each neuron draws each other one with probability p, and both reach each other; two that draw each other are
    connected twice. So a neuron of n has 2 p (n - 1) sources in the mean. Both directions take one drawn weight.
    Source: NEST, symmetric_pairwise_bernoulli with make_symmetric
    """

    p: float = quantity(doc="probability", at_least=0, at_most=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class distance_dependent(Rule):
    """Every pair is connected with a probability that follows from the distance between the two.

    The mask lies around the source; a target outside of it is not reached.
    """

    p: Any = quantity(
        1.0, "", "probability, a function of the distance", kind="choice", choice=Profile, at_least=0, at_most=1
    )
    mask: Any = quantity(None, "", "where targets may lie; anywhere if not given", kind="choice", choice=Mask)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")


@dataclass(frozen=True, eq=False)
class pairs(Rule):
    """The listed pairs: source pre[k] reaches target post[k]; a pair may be listed twice."""

    pre: Any = quantity(doc="sources", kind="ids")
    post: Any = quantity(doc="targets", kind="ids")

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.pre) != len(self.post):
            message = f"pairs: {len(self.pre)} sources and {len(self.post)} targets: expected as many of each"
            raise ModelError(message, path=("post",))

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """How many there are."""
        return len(self.pre)


@dataclass(frozen=True, eq=False)
class from_file(Rule):
    """The edges that a file lists: CSV with a header, parquet, edges of SONATA, npz with a column each, or a matrix.

    The file is read when the network is compiled. `pre` and `post` are ids of the tables of neurons of the two
    populations, or neurons counted from 0 where a population has none. Edges from or onto neurons of a table that are
    not in the population, or not in the view, are left out; an id that is in no table is an error. The weight of an
    edge is the projection's weight x the column `weight` x the sign of its transmitter; its delay is the projection's
    delay x the column `delay`, rounded to steps, at least one. Edges that connect the same pair stay apart, and their
    weights add up where they arrive.
    """

    file: Any = quantity(None, "", "the edges", kind="file")
    pre: str | None = quantity(None, "", "column of the sources; pre, of SONATA source_node_id", kind="name")
    post: str | None = quantity(None, "", "column of the targets; post, of SONATA target_node_id", kind="name")
    weight: str | None = quantity(None, "", "column of the weight or number of synapses; 1 if not given", kind="name")
    delay: str | None = quantity(None, "", "column of the delay; 1 if not given", kind="name")
    transmitter: str | None = quantity(None, "", "column of the transmitter", kind="name")
    signs: Any = quantity(None, "", "transmitter: 1, -1, or 0, which leaves its edges out", kind="words")
    dale: bool = quantity(
        False, "", "whether the transmitter is one of the source neuron, a column of its table", kind="boolean"
    )
    where: Any = quantity((), "", 'the rows that are taken: comparisons such as "synapses >= 5"', kind="names")
    layout: str = quantity(
        "edges", "", "what a CSV is: a row for each edge, or a matrix", kind="word", words=("edges", "matrix")
    )
    key: str | None = quantity(None, "", "of HDF5: the population of edges", kind="name")
    types: Any = quantity(None, "", "of SONATA: the CSV with the attributes of edge types", kind="file")
    shuffle: str | None = quantity(
        None, "", "what is drawn anew, as a control", kind="word", words=("edges", "signs", "weights")
    )
    shuffle_seed: int = quantity(0, "", "of those draws", kind="integer", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.where:
            from neuro.model.wiring.tables import Condition

            for text in self.where:
                Condition(text)
        if (self.transmitter is None) != (self.signs is None):
            found, lacks = ("signs", "transmitter") if self.transmitter is None else ("transmitter", "signs")
            hint = "transmitter: nt, signs: {GABA: -1, acetylcholine: 1}"
            raise ModelError(f"from_file: found '{found}' without '{lacks}': expected both", hint=hint, path=(found,))
        if self.dale and self.transmitter is None:
            raise ModelError("from_file: found 'dale' without 'transmitter': expected both", path=("dale",))
        for word, sign in (self.signs or {}).items():
            if isinstance(sign, bool) or sign not in (-1, 0, 1):
                raise ModelError(f"from_file.signs: {word} = {sign}: expected 1, -1 or 0", path=("signs", word))


LEARNING_KERNELS = ("stdp", "stdp_dopa")
"""Rules of spike pairs that can teach a shared kernel."""

LEARNING_IN_TRIALS = ("stdp_dopa", "mstdpet")
"""Rules of spike pairs that can learn in trials: all that a synapse has learnt is its weight of now."""


@dataclass(frozen=True, eq=False)
class grid(Rule):
    """A sheet of neurons with one kernel per map, as a convolution.

    The source has the shape (channels, height, width) or (height, width), the target (maps, rows, columns).
    Target (m, r, c) is reached from channel k, row r stride + i - padding, column c stride + j - padding (or, there,
    `column_padding`) with the weight kernel[m, k, i, j]; its rows and columns may be `auto`. With padding `same` they
    are those of the source divided by the stride, rounded up, and the border is spread evenly, an odd line of it at the
    end. With `depthwise` each map is reached from one channel only, as many maps from each in order, with
    kernel[m, 0, i, j].

    `stdp` and `stdp_dopa` teach it: in a step the changes at all places of a weight are formed from the weight at the
    beginning of the step, added up (or averaged over the places that changed) and clipped once. They hold from the
    next step on.
    """

    kernel: tuple[int, ...] = quantity(doc="height and width, or a number for both", kind="shape", at_least=1)
    stride: int = quantity(1, "", "step of the kernel", kind="integer", at_least=1)
    padding: int | str = quantity(0, "", "silent border round the source", kind="integer", at_least=0, words=(SAME,))
    column_padding: int | None = quantity(
        None, "", "border left and right, if other than above and below", kind="integer", at_least=0
    )
    depthwise: bool = quantity(False, "", "whether a map is reached from one channel only", kind="boolean")
    changes: str = quantity(
        "sum", "", "what a weight that learns takes of the changes at its places", kind="word", words=("sum", "mean")
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.kernel) == 1:
            object.__setattr__(self, "kernel", self.kernel * 2)
        if len(self.kernel) != 2:
            raise ModelError(
                f"grid.kernel = {list(self.kernel)}: expected two numbers, height and width", path=("kernel",)
            )
        if self.column_padding is not None and not isinstance(self.padding, int):
            message = f"grid.column_padding = {self.column_padding} beside padding: {self.padding}: expected numbers"
            raise ModelError(message, path=("column_padding",), about=("padding",))

    @property
    def border(self) -> tuple[int, int] | None:
        """Lines of the border above and below, and left and right; None where the sheet keeps its size."""
        if not isinstance(self.padding, int):
            return None
        return self.padding, self.padding if self.column_padding is None else self.column_padding


RULES: Registry[type[Rule]] = Registry(
    "rule",
    (
        one_to_one,
        all_to_all,
        fixed_indegree,
        fixed_outdegree,
        fixed_total_number,
        pairwise_bernoulli,
        symmetric_pairwise_bernoulli,
        distance_dependent,
        pairs,
        from_file,
        grid,
    ),
    takes=lambda part: isinstance(part, type) and issubclass(part, Rule),
    group="neuro.rules",
    complete=lambda part: check_method(part, Rule, "connect", "says its pairs"),
)
"""All connection rules by name."""


Ints = NDArray[np.int64]
Two = tuple[int, int]


def out_size(size: Two, kernel: Two, stride: Two, padding: Two, dilation: Two) -> Two:
    """Rows and columns of a convolution of a sheet of some rows and columns."""
    rows, columns = (
        (n + 2 * p - d * (k - 1) - 1) // s + 1
        for n, k, s, p, d in zip(size, kernel, stride, padding, dilation, strict=True)
    )
    return rows, columns


def synapses_of(
    shape: tuple[int, int, int], kernel: NDArray[np.float64], stride: Two, padding: Two, dilation: Two, groups: int
) -> tuple[Ints, Ints, NDArray[np.float64]]:
    """Source, target and weight of each synapse, where the kernel is laid on the source as it is (a correlation).

    Args:
        shape: channels, rows and columns of the source.
        kernel: (maps, channels / groups, height, width).
        stride: of the kernel, down and across.
        padding: silent lines above and below, and left and right.
        dilation: steps from one entry of the kernel to the next, down and across.
        groups: into which channels and maps are divided in order.

    Returns:
        ids count channels, then rows, then columns; weights of 0 are left out.
    """
    _, height, width = shape
    maps, depth, *size = kernel.shape
    rows, columns = out_size((height, width), (size[0], size[1]), stride, padding, dilation)
    m, k, i, j = (index.ravel() for index in np.nonzero(kernel))
    r, c = (index.ravel() for index in np.indices((rows, columns)))
    y = r[None, :] * stride[0] + (i * dilation[0] - padding[0])[:, None]
    x = c[None, :] * stride[1] + (j * dilation[1] - padding[1])[:, None]
    inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
    channel = (m // (maps // groups) * depth + k)[:, None]
    pre = ((channel * height + y) * width + x)[inside]
    post = ((m[:, None] * rows + r[None, :]) * columns + c[None, :])[inside]
    weight = np.broadcast_to(kernel[m, k, i, j][:, None], inside.shape)[inside]
    return pre.astype(np.int64), post.astype(np.int64), weight
