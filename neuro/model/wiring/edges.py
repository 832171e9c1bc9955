"""The edges that a file lists, between neurons of two populations: read, filtered, and shuffled as a control."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from neuro.core.checks import argument
from neuro.core.errors import ModelError, unknown
from neuro.core.values import shown
from neuro.model.network import Network
from neuro.model.rules import from_file
from neuro.model.wiring.formats import open_table
from neuro.model.wiring.neurons import NOWHERE, Ids, Neurons
from neuro.model.wiring.tables import (
    MATRIX,
    NUMBER,
    TEXT,
    Column,
    Condition,
    Piece,
    Table,
    Texts,
    cell,
    rows,
)

Floats = NDArray[np.float64]
_MOST = 2**31 - 1
_NAMES = {"pre": "source_node_id", "post": "target_node_id"}


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Edges in the order of the file: neurons of source and target, and factors of weight and delay; None: 1 for all.

    `sign` is that of the transmitter of each neuron of the source, where that decides.
    """

    pre: NDArray[np.int32]
    post: NDArray[np.int32]
    weight: Floats | None
    delay: Floats | None
    sign: Floats | None


class End(Protocol):
    """The neurons at an end of the edges."""

    @property
    def ids(self) -> Ids:
        """Their ids."""

    @property
    def size(self) -> int:
        """How many they are."""

    def find(self, ids: Column, places: bool) -> NDArray[np.int64]:
        """The neuron with each id."""


class Counted:
    """Neurons of a population without a table: their ids count from 0."""

    def __init__(self, n: int, name: str) -> None:
        self.ids, self.size = Ids(None, n, f"'{name}', whose ids are 0 to {n - 1}"), n

    def find(self, ids: Column, places: bool) -> NDArray[np.int64]:
        """The neuron with each id, `NOWHERE` where there is none."""
        return self.ids.find(ids)


def read_edges(rule: from_file, source: End, target: End) -> Edges:
    """Read the file of a rule.

    Args:
        rule: says which columns are what.
        source: the neurons of the source.
        target: of the target.

    Raises:
        ModelError: the file cannot be read or is damaged, or a cell is wrong: file, row and column are named.
    """
    if rule.file is None:
        raise ModelError("from_file needs 'file': expected the name of a file", missing="file")
    reader = _Reader(rule, source, target)
    columns = list(zip(*reader.parts(), strict=True)) or [(np.zeros(0, dtype=np.int32),)] * 2 + [(None,)] * 2
    pre, post, weight, delay = (None if column[0] is None else np.concatenate(column) for column in columns)
    assert pre is not None
    assert post is not None
    return Edges(pre, post, weight, delay, reader.sign)


class _Reader:
    def __init__(self, rule: from_file, source: End, target: End) -> None:
        self.rule, self.source, self.target = rule, source, target
        self.table: Table = open_table(rule.file, rule.key, rule.layout == "matrix", rule.types)
        shape = (source.size, target.size)
        if self.table.places and self.table.places != shape:
            message = f"{rule.file}: a matrix of shape {list(self.table.places)}: expected {list(shape)}"
            raise ModelError(f"{message}, a row for each source and a column for each target")
        sonata = any(name in self.table.names for name in _NAMES.values())
        self.pre, self.post = (getattr(rule, end) or (_NAMES[end] if sonata else end) for end in _NAMES)
        self.conditions = [Condition(text) for text in rule.where]
        weight = rule.weight or ("weight" if self.table.names == MATRIX else None)
        self.weight = weight
        self.sign = self._sign_of_sources() if rule.dale else None

    def parts(self) -> Iterator[tuple[Any, ...]]:
        """Source, target, factor of the weight and of the delay, piece by piece."""
        rule, places = self.rule, bool(self.table.places)
        kinds = {name: NUMBER for condition in self.conditions for name in condition.names}
        kinds |= {name: NUMBER for name in (self.weight, rule.delay) if name}
        if rule.transmitter and not rule.dale:
            kinds[rule.transmitter] = TEXT
        for word, end in ((self.pre, self.source), (self.post, self.target)):
            if kinds.get(word, NUMBER) != NUMBER or word in (self.weight, rule.delay):
                raise ModelError(f"from_file: column '{word}' is named twice: expected another one", path=("pre",))
            kinds[word] = "int64" if places else end.ids.kind
        for condition in self.conditions:
            if texts := [name for name in condition.names if kinds[name] == TEXT]:
                raise ModelError(f"where: column '{texts[0]}' is read as text: expected numbers", path=("where",))
        for piece in rows(self.table, kinds):
            kept = self._kept(piece)
            ends = [self._find(piece, kept, w, e) for w, e in ((self.pre, self.source), (self.post, self.target))]
            factor = None if self.weight is None else np.asarray(_some(piece.columns[self.weight], kept))
            sign = self._sign(piece, kept, ends[0])
            delay = None if rule.delay is None else self._delays(piece, kept)
            inside = (ends[0] >= 0) & (ends[1] >= 0)
            if sign is not None:
                inside &= sign != 0.0
                factor = sign if factor is None else factor * sign
            some = slice(None) if inside.all() else inside
            numbers = [None if values is None else values[some] for values in (factor, delay)]
            yield (*(end[some].astype(np.int32) for end in ends), *numbers)

    def _kept(self, piece: Piece) -> NDArray[np.int64] | slice:
        """The rows for which all conditions hold."""
        if not self.conditions:
            return slice(None)
        return np.flatnonzero(np.logical_and.reduce([each.holds(piece.columns) for each in self.conditions]))

    def _find(self, piece: Piece, kept: Any, word: str, end: End) -> NDArray[np.int64]:
        ids = _some(piece.columns[word], kept)
        found = end.find(ids, bool(self.table.places))
        lost = np.flatnonzero(found == NOWHERE)
        if lost.size:
            at = int(lost[0])
            shown_ = ids.words[ids.codes[at]] if isinstance(ids, Texts) else int(ids[at])
            hint = "" if isinstance(end, Neurons) else "neurons=neuro.neuron_table(file, id=...) gives ids to neurons"
            raise cell(self.table, _row(piece, kept, at), word, shown_, f"the id of a neuron of {end.ids.what}", hint)
        return found

    def _sign(self, piece: Piece, kept: Any, pre: NDArray[np.int64]) -> Floats | None:
        """The sign of each edge; None where there are no transmitters."""
        if not self.rule.transmitter:
            return None
        if self.sign is None:
            assert self.rule.transmitter
            words = _some(piece.columns[self.rule.transmitter], kept)
            assert isinstance(words, Texts)
            sign = words.each(_signs(words, self.rule))
            lost = np.flatnonzero(np.isnan(sign))
            if lost.size:
                word = words.words[words.codes[lost[0]]]
                place = f"{self.table.path}: row {_row(piece, kept, int(lost[0]))}, column '{self.rule.transmitter}'"
                raise _no_sign(word, self.rule).at(None, place)
            return sign
        sign = np.where(pre >= 0, self.sign[pre], 0.0)
        lost = np.flatnonzero(np.isnan(sign))
        if lost.size:
            assert isinstance(self.source, Neurons)
            neuron = int(pre[lost[0]])
            column = self.source.column(self.rule.transmitter)
            assert isinstance(column, Texts)
            word = column.words[column.codes[self.source.taken[neuron]]]
            who = f"neuron {self.source.shown_id(neuron)} of {self.source.ids.what}"
            raise _no_sign(word, self.rule).at(None, who)
        return sign

    def _sign_of_sources(self) -> Floats:
        """The sign of each neuron of the source; NaN where its transmitter has none."""
        if not isinstance(self.source, Neurons):
            message = "from_file.dale: the source has no table of neurons: expected one with the transmitter of each"
            raise ModelError(message, hint="neurons=neuro.neuron_table(file, id=...)", path=("dale",))
        assert self.rule.transmitter
        column = self.source.column(self.rule.transmitter)
        if not isinstance(column, Texts):
            message = f"{self.source.ids.what}: column '{self.rule.transmitter}' holds numbers: expected transmitters"
            raise ModelError(message, path=("transmitter",))
        found: Floats = column.each(_signs(column, self.rule))[self.source.taken]
        return found

    def _delays(self, piece: Piece, kept: Any) -> Floats:
        assert self.rule.delay
        delays = np.asarray(_some(piece.columns[self.rule.delay], kept))
        early = np.flatnonzero(delays < 0)
        if early.size:
            at = int(early[0])
            raise cell(self.table, _row(piece, kept, at), self.rule.delay, float(delays[at]), "a number >= 0")
        return delays


def _some(column: Column, kept: Any) -> Column:
    return Texts(column.codes[kept], column.words) if isinstance(column, Texts) else column[kept]


def _row(piece: Piece, kept: Any, at: int) -> int:
    """The number of a row of those that were kept."""
    return piece.row(at if isinstance(kept, slice) else int(kept[at]))


def _signs(column: Texts, rule: from_file) -> Floats:
    return np.array([rule.signs.get(word, np.nan) for word in column.words], dtype=np.float64)


def _no_sign(word: str, rule: from_file) -> ModelError:
    hint = f"signs: {{{shown(word)}: 0}} leaves its edges out"
    return unknown("transmitter", word, rule.signs).but(hint=hint)


_ROUNDS = 200


def shuffle_edges(edges: Edges, what: str, rng: np.random.Generator, same: bool) -> Edges:
    """The same number of edges, with one property drawn anew.

    Args:
        edges: of the file.
        what: "edges": each keeps source, weight, sign and delay, and edges exchange their targets, so that every neuron
            keeps its numbers of inputs and outputs; no pair is connected twice and no neuron reaches itself, unless
            the diagram has such edges. "signs": neurons of the source exchange their transmitters where these are
            theirs, else edges exchange signs. "weights": edges exchange the sizes of their weights, and keep signs.
        rng: draws.
        same: whether source and target are one population.

    Raises:
        ModelError: there are no signs or weights, or too few pairs to exchange targets.
    """
    if what == "edges":
        return replace(edges, post=_exchanged(edges.pre, edges.post, rng, same))
    if edges.weight is None:
        raise ModelError(f"shuffle: {what}: found none in the file: expected a column 'weight' or 'transmitter'")
    if what == "weights":
        return replace(edges, weight=np.sign(edges.weight) * rng.permutation(np.abs(edges.weight)))
    if edges.sign is None:
        return replace(edges, weight=np.abs(edges.weight) * rng.permutation(np.sign(edges.weight)))
    connected = np.unique(edges.pre)
    exchanged = edges.sign.copy()
    exchanged[connected] = rng.permutation(edges.sign[connected])
    weight = edges.weight * edges.sign[edges.pre] * exchanged[edges.pre]
    return replace(edges, weight=weight, sign=exchanged)


def _exchanged(
    pre: NDArray[np.int32], post: NDArray[np.int32], rng: np.random.Generator, same: bool
) -> NDArray[np.int32]:
    """The targets in another order.

    All are permuted; then each edge that repeats a pair, or reaches its source, exchanges its target with a random
    edge, until there is none. Source: Maslov & Sneppen, Science 296:910, 2002, whose step this exchange is.
    """
    allowed_twice = bool(_repeats(pre, post).size)
    allowed_self = not same or bool((pre == post).any())
    found = rng.permutation(post)
    for _ in range(_ROUNDS):
        wrong = np.zeros(0, dtype=np.int64) if allowed_twice else _repeats(pre, found)
        if not allowed_self:
            wrong = np.union1d(wrong, np.flatnonzero(pre == found))
        if not wrong.size:
            return found
        for edge, other in zip(wrong.tolist(), rng.integers(0, pre.size, wrong.size).tolist(), strict=True):
            found[edge], found[other] = found[other], found[edge]
    raise ModelError(
        f"shuffle: edges: {wrong.size} of {pre.size} edges still repeat a pair: expected fewer edges among the neurons"
    )


def _repeats(pre: NDArray[np.int32], post: NDArray[np.int32]) -> NDArray[np.int64]:
    """The edges that connect a pair which another, before them in order of pairs, connects."""
    pairs = pre.astype(np.int64) << 32 | post
    order = np.argsort(pairs)
    pairs = pairs[order]
    found: NDArray[np.int64] = order[1:][pairs[1:] == pairs[:-1]]
    return found


def shuffled(net: Network, what: str, *, seed: int = 0) -> Network:
    """A control: the same network, in which one property of each wiring diagram is drawn anew.

    Args:
        net: the network; it is not changed.
        what: "edges": edges exchange targets, and every neuron keeps its numbers of inputs and outputs, the sizes and
            signs of its outputs; "signs": neurons exchange their transmitters (with `dale`; else edges exchange signs);
            "weights": edges exchange the sizes of their weights and keep their signs.
        seed: of the draws; another one gives another control.

    Returns:
        A network that differs in `shuffle` and `shuffle_seed` of its rules `from_file`, so that it can be saved.

    Raises:
        ModelError: the network has no edges from a file.
    """
    if not isinstance(net, Network):
        raise ModelError(f"shuffled: found {net!r:.60}: expected a Network", hint="neuro.load reads one from YAML")
    argument("shuffled: what", what, words=("edges", "signs", "weights"))
    argument("shuffled: seed", seed, kind="integer", at_least=0)
    if not any(isinstance(part.rule, from_file) for part in net.projections.values()):
        hint = "net.wiring(neurons=..., edges=...), or the rule neuro.from_file(...)"
        raise ModelError(
            f"shuffled: network '{net.name}' has no edges from a file: expected a rule from_file", hint=hint
        )
    control = copy.copy(net)
    control.projections = {
        name: replace(part, rule=replace(part.rule, shuffle=what, shuffle_seed=seed))
        if isinstance(part.rule, from_file)
        else part
        for name, part in net.projections.items()
    }
    return control
