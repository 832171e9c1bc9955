"""Edges between neurons of two populations, listed in a file: reading, filtering, and shuffling as a control."""

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
from neuro.model.wiring.neurons import NOT_IN_TABLE, Ids, Neurons
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
_LARGEST = 2**31 - 1
_NAMES = {"pre": "source_node_id", "post": "target_node_id"}


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Edges in the order of the file.

    Attributes:
        pre, post: indices of source and target neurons, shape (edges,).
        weight, delay: factors of weight and delay, shape (edges,). None stands for 1 for all edges.
        sign: sign of the transmitter of each source neuron, shape (sources,), or None if transmitters belong to edges.
    """

    pre: NDArray[np.int32]
    post: NDArray[np.int32]
    weight: Floats | None
    delay: Floats | None
    sign: Floats | None


class End(Protocol):
    """Protocol of the neurons at one end of the edges: the sources or the targets."""

    @property
    def ids(self) -> Ids:
        """Ids of the neurons."""

    @property
    def size(self) -> int:
        """Number of neurons."""

    def find(self, ids: Column, places: bool) -> NDArray[np.int64]:
        """Return the index of the neuron with each id. With `places` the ids are these indices already."""


class Counted:
    """Neurons of a population without a table. Their ids are counted from 0."""

    def __init__(self, n: int, name: str) -> None:
        self.ids, self.size = Ids(None, n, f"'{name}', whose ids are 0 to {n - 1}"), n

    def find(self, ids: Column, places: bool) -> NDArray[np.int64]:
        """Return the index of the neuron with each id, or `NOT_IN_TABLE` for an unknown id."""
        return self.ids.find(ids)


def read_edges(rule: from_file, source: End, target: End) -> Edges:
    """Read the edges of a rule from its file.

    Args:
        rule: the rule, which names the columns.
        source: the source neurons.
        target: the target neurons.

    Raises:
        ModelError: the file cannot be read or is damaged, or a cell is not valid. The message names file, row and
            column.
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
        is_sonata = any(name in self.table.names for name in _NAMES.values())
        self.pre, self.post = (getattr(rule, end) or (_NAMES[end] if is_sonata else end) for end in _NAMES)
        self.conditions = [Condition(text) for text in rule.where]
        weight = rule.weight or ("weight" if self.table.names == MATRIX else None)
        self.weight = weight
        self.sign = self._sign_of_sources() if rule.dale else None

    def parts(self) -> Iterator[tuple[Any, ...]]:
        """Yield the sources, targets, factors of weights and factors of delays of each piece of the file."""
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
            row_selection = self._matching_rows(piece)
            ends = [
                self._find(piece, row_selection, w, e) for w, e in ((self.pre, self.source), (self.post, self.target))
            ]
            factor = None if self.weight is None else np.asarray(_select(piece.columns[self.weight], row_selection))
            sign = self._sign(piece, row_selection, ends[0])
            delay = None if rule.delay is None else self._delays(piece, row_selection)
            is_used = (ends[0] >= 0) & (ends[1] >= 0)
            if sign is not None:
                is_used &= sign != 0.0
                factor = sign if factor is None else factor * sign
            used_rows = slice(None) if is_used.all() else is_used
            numbers = [None if values is None else values[used_rows] for values in (factor, delay)]
            yield (*(end[used_rows].astype(np.int32) for end in ends), *numbers)

    def _matching_rows(self, piece: Piece) -> NDArray[np.int64] | slice:
        """Return the rows for which all conditions hold."""
        if not self.conditions:
            return slice(None)
        return np.flatnonzero(np.logical_and.reduce([condition.holds(piece.columns) for condition in self.conditions]))

    def _find(self, piece: Piece, row_selection: Any, word: str, end: End) -> NDArray[np.int64]:
        ids = _select(piece.columns[word], row_selection)
        neurons = end.find(ids, bool(self.table.places))
        unknown_ids = np.flatnonzero(neurons == NOT_IN_TABLE)
        if unknown_ids.size:
            at = int(unknown_ids[0])
            id_text = ids.words[ids.codes[at]] if isinstance(ids, Texts) else int(ids[at])
            hint = "" if isinstance(end, Neurons) else "neurons=neuro.neuron_table(file, id=...) gives ids to neurons"
            raise cell(
                self.table, _row(piece, row_selection, at), word, id_text, f"the id of a neuron of {end.ids.what}", hint
            )
        return neurons

    def _sign(self, piece: Piece, row_selection: Any, pre: NDArray[np.int64]) -> Floats | None:
        """Return the sign of each edge, or None without transmitters."""
        if not self.rule.transmitter:
            return None
        if self.sign is None:
            assert self.rule.transmitter
            words = _select(piece.columns[self.rule.transmitter], row_selection)
            assert isinstance(words, Texts)
            sign = words.each(_signs(words, self.rule))
            without_sign = np.flatnonzero(np.isnan(sign))
            if without_sign.size:
                word = words.words[words.codes[without_sign[0]]]
                row = _row(piece, row_selection, int(without_sign[0]))
                place = f"{self.table.path}: row {row}, column '{self.rule.transmitter}'"
                raise _no_sign(word, self.rule).at(None, place)
            return sign
        sign = np.where(pre >= 0, self.sign[pre], 0.0)
        without_sign = np.flatnonzero(np.isnan(sign))
        if without_sign.size:
            assert isinstance(self.source, Neurons)
            neuron = int(pre[without_sign[0]])
            column = self.source.column(self.rule.transmitter)
            assert isinstance(column, Texts)
            word = column.words[column.codes[self.source.population_rows[neuron]]]
            who = f"neuron {self.source.shown_id(neuron)} of {self.source.ids.what}"
            raise _no_sign(word, self.rule).at(None, who)
        return sign

    def _sign_of_sources(self) -> Floats:
        """Return the sign of each source neuron, shape (sources,), NaN for a transmitter without a sign."""
        if not isinstance(self.source, Neurons):
            message = "from_file.dale: the source has no table of neurons: expected one with a column of transmitters"
            raise ModelError(message, hint="neurons=neuro.neuron_table(file, id=...)", path=("dale",))
        assert self.rule.transmitter
        column = self.source.column(self.rule.transmitter)
        if not isinstance(column, Texts):
            message = f"{self.source.ids.what}: column '{self.rule.transmitter}' holds numbers: expected transmitters"
            raise ModelError(message, path=("transmitter",))
        signs: Floats = column.each(_signs(column, self.rule))[self.source.population_rows]
        return signs

    def _delays(self, piece: Piece, row_selection: Any) -> Floats:
        assert self.rule.delay
        delays = np.asarray(_select(piece.columns[self.rule.delay], row_selection))
        negative = np.flatnonzero(delays < 0)
        if negative.size:
            at = int(negative[0])
            raise cell(self.table, _row(piece, row_selection, at), self.rule.delay, float(delays[at]), "a number >= 0")
        return delays


def _select(column: Column, row_selection: Any) -> Column:
    return Texts(column.codes[row_selection], column.words) if isinstance(column, Texts) else column[row_selection]


def _row(piece: Piece, row_selection: Any, at: int) -> int:
    """Return the number in the file of the selected row at index `at`."""
    return piece.row(at if isinstance(row_selection, slice) else int(row_selection[at]))


def _signs(column: Texts, rule: from_file) -> Floats:
    return np.array([rule.signs.get(word, np.nan) for word in column.words], dtype=np.float64)


def _no_sign(word: str, rule: from_file) -> ModelError:
    hint = f"write signs: {{{shown(word)}: 0}} to leave out its edges"
    return unknown("transmitter", word, rule.signs).but(hint=hint)


_ROUNDS = 200


def shuffle_edges(edges: Edges, what: str, rng: np.random.Generator, same: bool) -> Edges:
    """Return edges with one property shuffled.

    Args:
        edges: the edges of the file.
        what: "edges": edges keep source, weight, sign and delay and exchange their targets, so that the numbers of
            inputs and outputs of every neuron stay the same. No pair is connected twice and no neuron is connected to
            itself, unless the file has such edges. "signs": source neurons exchange their transmitters, or edges
            exchange signs if transmitters belong to edges. "weights": edges exchange absolute weights and keep signs.
        rng: random numbers.
        same: whether source and target are the same population.

    Raises:
        ModelError: the file has no signs or weights, or there are too few pairs to exchange targets.
    """
    if what == "edges":
        return replace(edges, post=_exchange_targets(edges.pre, edges.post, rng, same))
    if edges.weight is None:
        raise ModelError(f"shuffle: {what}: found none in the file: expected a column 'weight' or 'transmitter'")
    if what == "weights":
        return replace(edges, weight=np.sign(edges.weight) * rng.permutation(np.abs(edges.weight)))
    if edges.sign is None:
        return replace(edges, weight=np.abs(edges.weight) * rng.permutation(np.sign(edges.weight)))
    sources = np.unique(edges.pre)
    shuffled_signs = edges.sign.copy()
    shuffled_signs[sources] = rng.permutation(edges.sign[sources])
    weight = edges.weight * edges.sign[edges.pre] * shuffled_signs[edges.pre]
    return replace(edges, weight=weight, sign=shuffled_signs)


def _exchange_targets(
    pre: NDArray[np.int32], post: NDArray[np.int32], rng: np.random.Generator, same: bool
) -> NDArray[np.int32]:
    """Return the targets in another order.

    All targets are permuted. Then each edge that repeats a pair, or connects a neuron to itself, exchanges its target
    with a random edge, until no edge does so. Source: Maslov & Sneppen, Science 296:910, 2002, for the exchange.
    """
    allowed_twice = bool(_repeats(pre, post).size)
    allowed_self = not same or bool((pre == post).any())
    new_targets = rng.permutation(post)
    for _ in range(_ROUNDS):
        to_exchange = np.zeros(0, dtype=np.int64) if allowed_twice else _repeats(pre, new_targets)
        if not allowed_self:
            to_exchange = np.union1d(to_exchange, np.flatnonzero(pre == new_targets))
        if not to_exchange.size:
            return new_targets
        for edge, other in zip(to_exchange.tolist(), rng.integers(0, pre.size, to_exchange.size).tolist(), strict=True):
            new_targets[edge], new_targets[other] = new_targets[other], new_targets[edge]
    raise ModelError(
        f"shuffle: edges: {to_exchange.size} of {pre.size} edges still repeat a pair: expected fewer edges"
    )


def _repeats(pre: NDArray[np.int32], post: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the indices of edges that repeat a pair of neurons. The first edge of each pair is not included."""
    pairs = pre.astype(np.int64) << 32 | post
    order = np.argsort(pairs)
    pairs = pairs[order]
    repeats: NDArray[np.int64] = order[1:][pairs[1:] == pairs[:-1]]
    return repeats


def shuffled(net: Network, what: str, *, seed: int = 0) -> Network:
    """Return a control: a copy of a network in which one property of each wiring diagram is shuffled.

    Args:
        net: the network. It does not change.
        what: "edges": edges exchange targets, so that the numbers of inputs and outputs of every neuron, and the
            weights and signs of its outputs, stay the same. "signs": neurons exchange their transmitters with `dale`,
            otherwise edges exchange signs. "weights": edges exchange absolute weights and keep their signs.
        seed: seed of the shuffle. Another seed gives another control.

    Returns:
        A copy with `shuffle` and `shuffle_seed` set in its rules `from_file`. The copy can be saved.

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
