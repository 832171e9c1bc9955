"""Connection rules, which decide the connected pairs of neurons of two populations."""

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
"""Values of `draw`: the synapses of a rule are drawn by neuro or by the backend."""

SAME = "same"
"""Padding with which a target has as many rows and columns as its source, divided by the stride."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rule(Choice):
    """Base of the connection rules. A user-defined rule implements `connect`."""

    kind: ClassVar[str] = "rule"

    def connect(
        self, source: tuple[int, ...], target: tuple[int, ...], same: bool, rng: np.random.Generator
    ) -> tuple[ArrayLike, ArrayLike]:
        """Return the connected pairs of neurons, in any order. A pair may occur more than once.

        Args:
            source: sizes of the axes of the source population or view. Neurons are counted from 0 in C order.
            target: sizes of the axes of the target population or view.
            same: whether source and target are the same neurons.
            rng: random numbers that depend on the seed of the network only.

        Returns:
            Source and target of every synapse, whole numbers. An array of weights or delays has the same order.

        Raises:
            ModelError: the rule does not fit the populations.
        """
        raise NotImplementedError

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """Return the number of synapses, or None if the number is random.

        Args:
            source: number of source neurons.
            target: number of target neurons.
            same: whether source and target are the same population.
        """
        return None


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedRule(Rule):
    """A rule that simulators know by name, so that a backend may draw the synapses instead of neuro."""

    draw: str = quantity(
        HERE,
        "",
        "neuro draws the same synapses for every backend; backend draws by the rule of the same name in the backend, "
        "if there is one, with the same distribution",
        kind="word",
        words=(HERE, BACKEND),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class one_to_one(NamedRule):
    """Neuron i is connected to neuron i. Both populations have the same size."""

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """Return the number of synapses."""
        return source


@dataclass(frozen=True, kw_only=True, eq=False)
class all_to_all(NamedRule):
    """Every neuron is connected to every neuron, and to itself only with `autapses`."""

    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """Return the number of synapses."""
        return source * target - (source if same and not self.autapses else 0)


@dataclass(frozen=True, eq=False)
class fixed_indegree(NamedRule):
    """Every target has n sources drawn at random."""

    n: int = quantity(doc="sources of each target", kind="integer", at_least=1)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")
    multapses: bool = quantity(True, "", "whether a pair may be drawn twice", kind="boolean")

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """Return the number of synapses."""
        return self.n * target


@dataclass(frozen=True, eq=False)
class fixed_outdegree(NamedRule):
    """Every source has n targets drawn at random."""

    n: int = quantity(doc="targets of each source", kind="integer", at_least=1)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")
    multapses: bool = quantity(True, "", "whether a pair may be drawn twice", kind="boolean")

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """Return the number of synapses."""
        return source * self.n


@dataclass(frozen=True, eq=False)
class pairwise_bernoulli(NamedRule):
    """Every pair is connected with probability p."""

    p: float = quantity(doc="probability", at_least=0, at_most=1)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")


@dataclass(frozen=True, eq=False)
class fixed_total_number(NamedRule):
    """n synapses in total, each between a source and a target drawn at random. In NEST the parameter n is called N."""

    n: int = quantity(doc="number of synapses", kind="integer", at_least=0)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")
    multapses: bool = quantity(True, "", "whether a pair may be drawn twice", kind="boolean")


@dataclass(frozen=True, eq=False)
class symmetric_pairwise_bernoulli(Rule):
    """Neurons of one population are connected in both directions.

    Each neuron draws each other neuron with probability p, and each draw connects the pair in both directions. Two
    neurons that draw each other are connected twice. In a population of n neurons, a neuron has 2 p (n - 1) sources on
    average. Both directions have the same weight, which is drawn once.
    Source: NEST, symmetric_pairwise_bernoulli with make_symmetric
    """

    p: float = quantity(doc="probability", at_least=0, at_most=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class distance_dependent(Rule):
    """Every pair is connected with a probability that depends on the distance between the two neurons.

    Targets outside the mask around the source are not connected.
    """

    p: Any = quantity(
        1.0, "", "probability, or a function of the distance", kind="choice", choice=Profile, at_least=0, at_most=1
    )
    mask: Any = quantity(None, "", "region of possible targets; unlimited if not given", kind="choice", choice=Mask)
    autapses: bool = quantity(True, "", "whether a neuron may reach itself", kind="boolean")


@dataclass(frozen=True, eq=False)
class pairs(Rule):
    """Listed pairs: source pre[k] is connected to target post[k]. A pair may be listed more than once."""

    pre: Any = quantity(doc="ids of the sources", kind="ids")
    post: Any = quantity(doc="ids of the targets", kind="ids")

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.pre) != len(self.post):
            message = f"pairs: {len(self.pre)} sources and {len(self.post)} targets: expected as many of each"
            raise ModelError(message, path=("post",))

    def synapses(self, source: int, target: int, same: bool) -> int | None:
        """Return the number of synapses."""
        return len(self.pre)


@dataclass(frozen=True, eq=False)
class from_file(Rule):
    """Edges listed in a file: CSV with a header, Parquet, SONATA edges, NPZ with an array per column, or a matrix.

    The file is read when the network is compiled. `pre` and `post` have the ids of source and target
    neurons. Ids are those of the population's table of neurons, or are counted from 0 if the population has no table.
    Edges of neurons that are in the table but not in the population or view are left out. Other ids are errors. The
    weight of an edge is the projection's weight x the column `weight` x the sign of its transmitter. Its delay is the
    projection's delay x the column `delay`, rounded to steps, at least one. Several edges between the same pair remain
    separate synapses.
    """

    file: Any = quantity(None, "", "file of the edges", kind="file")
    pre: str | None = quantity(None, "", "column of the source ids; default pre, in SONATA source_node_id", kind="name")
    post: str | None = quantity(
        None, "", "column of the target ids; default post, in SONATA target_node_id", kind="name"
    )
    weight: str | None = quantity(None, "", "column of the weights or numbers of synapses; 1 if not given", kind="name")
    delay: str | None = quantity(None, "", "column of the delays; 1 if not given", kind="name")
    transmitter: str | None = quantity(None, "", "column of the transmitters", kind="name")
    signs: Any = quantity(None, "", "sign of each transmitter: 1, -1, or 0 to leave out its edges", kind="words")
    dale: bool = quantity(
        False,
        "",
        "whether the transmitter is a column of the source neurons' table instead of the edges",
        kind="boolean",
    )
    where: Any = quantity((), "", 'conditions on the rows to read, such as "synapses >= 5"', kind="names")
    layout: str = quantity(
        "edges", "", "content of a CSV file: a row per edge, or a matrix", kind="word", words=("edges", "matrix")
    )
    key: str | None = quantity(None, "", "population of edges in an HDF5 file", kind="name")
    types: Any = quantity(None, "", "CSV file with the attributes of SONATA edge types", kind="file")
    shuffle: str | None = quantity(
        None, "", "property that is shuffled, as a control", kind="word", words=("edges", "signs", "weights")
    )
    shuffle_seed: int = quantity(0, "", "seed of the shuffle", kind="integer", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.where:
            from neuro.model.wiring.tables import Condition

            for text in self.where:
                Condition(text)
        if (self.transmitter is None) != (self.signs is None):
            set_word, missing = ("signs", "transmitter") if self.transmitter is None else ("transmitter", "signs")
            hint = "transmitter: nt, signs: {GABA: -1, acetylcholine: 1}"
            message = f"from_file: found '{set_word}' without '{missing}': expected both"
            raise ModelError(message, hint=hint, path=(set_word,))
        if self.dale and self.transmitter is None:
            raise ModelError("from_file: found 'dale' without 'transmitter': expected both", path=("dale",))
        for word, sign in (self.signs or {}).items():
            if isinstance(sign, bool) or sign not in (-1, 0, 1):
                raise ModelError(f"from_file.signs: {word} = {sign}: expected 1, -1 or 0", path=("signs", word))


LEARNING_KERNELS = ("stdp", "stdp_dopa")
"""Plasticity rules of spike pairs that can train a shared kernel."""

LEARNING_IN_TRIALS = ("stdp_dopa", "mstdpet")
"""Plasticity rules of spike pairs that can learn in trials, because a synapse stores only its current weight between
trials."""


@dataclass(frozen=True, eq=False)
class grid(Rule):
    """A convolution of a sheet of neurons, with one kernel per map.

    The source has the shape (channels, height, width) or (height, width), the target (maps, rows, columns). Target
    (m, r, c) receives from channel k, row r stride + i - padding, column c stride + j - padding with the weight
    kernel[m, k, i, j]. If `column_padding` is set, it replaces `padding` for columns. Rows and columns of the target
    may be `auto`. With padding `same`, the target has as many rows and columns as the source, divided by the stride and
    rounded up. The border is then split evenly, with the extra line of an odd border at the end. With `depthwise`, each
    map receives from one channel only, with kernel[m, 0, i, j], and each channel has the same number of consecutive
    maps.

    `stdp` and `stdp_dopa` train the kernel. In a step, the changes at all places that share a weight are computed from
    the weight at the beginning of the step, added up (or averaged over the places that changed) and clipped once. The
    new weight applies from the next step on.
    """

    kernel: tuple[int, ...] = quantity(
        doc="height and width of the kernel, or a number for both", kind="shape", at_least=1
    )
    stride: int = quantity(1, "", "step of the kernel", kind="integer", at_least=1)
    padding: int | str = quantity(0, "", "silent border around the source", kind="integer", at_least=0, words=(SAME,))
    column_padding: int | None = quantity(
        None, "", "border left and right, if different from above and below", kind="integer", at_least=0
    )
    depthwise: bool = quantity(False, "", "whether a map receives from one channel only", kind="boolean")
    changes: str = quantity(
        "sum", "", "sum or mean of the changes at all places of a weight", kind="word", words=("sum", "mean")
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
        """Width of the border above and below, and left and right, or None for the padding `same`."""
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
    complete=lambda part: check_method(part, Rule, "connect", "returns the connected pairs"),
)
"""All connection rules by name."""


Ints = NDArray[np.int64]
Two = tuple[int, int]
"""A number for rows and a number for columns."""


def out_size(size: Two, kernel: Two, stride: Two, padding: Two, dilation: Two) -> Two:
    """Return the rows and columns of the result of a convolution.

    Args:
        size: rows and columns of the input.
        kernel: height and width of the kernel.
        stride: step of the kernel, down and across.
        padding: silent lines above and below, and left and right.
        dilation: distance between entries of the kernel, down and across.
    """
    rows, columns = (
        (n + 2 * p - d * (k - 1) - 1) // s + 1
        for n, k, s, p, d in zip(size, kernel, stride, padding, dilation, strict=True)
    )
    return rows, columns


def synapses_of(
    shape: tuple[int, int, int], kernel: NDArray[np.float64], stride: Two, padding: Two, dilation: Two, groups: int
) -> tuple[Ints, Ints, NDArray[np.float64]]:
    """Return source, target and weight of each synapse of a convolution, without flipping the kernel (a correlation).

    Args:
        shape: channels, rows and columns of the source.
        kernel: weights, shape (maps, channels / groups, height, width).
        stride: step of the kernel, down and across.
        padding: silent lines above and below, and left and right.
        dilation: distance between entries of the kernel, down and across.
        groups: number of groups into which channels and maps are divided in order.

    Returns:
        Ids of sources and targets in C order of (channels, rows, columns), and weights. Weights of 0 are left out.
    """
    _, height, width = shape
    maps, depth, *size = kernel.shape
    rows, columns = out_size((height, width), (size[0], size[1]), stride, padding, dilation)
    m, k, i, j = (index.ravel() for index in np.nonzero(kernel))
    r, c = (index.ravel() for index in np.indices((rows, columns)))
    y = r[None, :] * stride[0] + (i * dilation[0] - padding[0])[:, None]
    x = c[None, :] * stride[1] + (j * dilation[1] - padding[1])[:, None]
    is_inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
    channel = (m // (maps // groups) * depth + k)[:, None]
    pre = ((channel * height + y) * width + x)[is_inside]
    post = ((m[:, None] * rows + r[None, :]) * columns + c[None, :])[is_inside]
    weight = np.broadcast_to(kernel[m, k, i, j][:, None], is_inside.shape)[is_inside]
    return pre.astype(np.int64), post.astype(np.int64), weight
