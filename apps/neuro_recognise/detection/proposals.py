"""Where objects may be in a segment of events, by two ways: places first, or a network slid over the whole sensor.

Proposals: events are counted, the counts smoothed, what stands out of the background is cut and joined. Objects that
touch make one component, and one object may make several. What decides is how large objects are: a grouping costs the
less, the nearer the larger side of each of its boxes is to that of an object, and a cut costs what it cuts through.
Both steps are greedy: the best cut while one pays, then the best join while one pays.

Dense: the learnt layer slid over the whole sensor as one network, in which several neurons win. Each winner stands for
a class and a place, and keeps others around it from winning. The winners of a segment's frames that stand for the same
place are one object, and its box spans the events there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

import neuro
from neuro import ModelError
from neuro.apps import Part, Registry, setting
from neuro_events import Events
from neuro_recognise.methods.framewise import Framewise, RemusLayer
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.shown import Array, Floats, Ints

ANGLES = np.pi * np.arange(8) / 8
"""Directions across which cuts are tried."""
CHOSEN = "chosen on scenes of one fold of N-MNIST"
FIELD = 1.5
"""Sides of an object in a field: N-MNIST's digits have 23 of 34 px."""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A place where an object may be, in a segment of events.

    Attributes:
        events: those in it.
        box: (4,) of these, px.
        centre: (2,) their mean, px.
        scores: (classes,) what speaks for each class, where the way of finding it gives that; else None.
    """

    events: Events
    box: Floats
    centre: Floats
    scores: Floats | None = None


@dataclass(frozen=True)
class Proposals(Part):
    """Components of smoothed counts, cut and joined to boxes of the size of objects."""

    kind = "proposals"
    source = "components of smoothed counts; cutting and joining by size is our own"

    side: float = setting(23.0, "px", "larger side of an object's box", "N-MNIST's, of training: 21 to 25", above=0)
    scales: tuple[float, ...] = setting((1.0,), "", "sizes of objects, in units of side", "thesis line 2543", above=0)
    spread: float = setting(3.0, "px", "by which sides differ, of an object of scale 1", "N-MNIST's, twice", above=0)
    radius: int = setting(1, "px", "of the square that is averaged: the low pass", CHOSEN, at_least=0)
    contrast: float = setting(5.0, "", "by how many deviations a pixel stands out of the background", CHOSEN, above=0)
    least: float = setting(0.3, "events", "in the mean of a pixel that stands out", CHOSEN, above=0)
    cut: float = setting(80.0, "", "cost of a cut through all events of a component", CHOSEN, above=0)
    more: float = setting(3.0, "", "cost of another object", CHOSEN, at_least=0)
    speck: int = setting(15, "events", "above the background that a component must have", CHOSEN, at_least=0)
    join: float = setting(0.5, "1/px", "cost of joining what is so far apart", CHOSEN, at_least=0)
    fewest: int = setting(60, "events", "of an object in a segment", CHOSEN, at_least=1)
    smallest: float = setting(0.6, "", "larger side of an object, in units of the side", CHOSEN, at_least=0)
    percentile: float = setting(1.0, "%", "of events that a box leaves out at each side", CHOSEN, at_least=0, below=50)

    def regions(self, events: Events, counts: Floats) -> list[Region]:
        """The places where objects may be, without an order.

        Args:
            events: of a segment.
            counts: (height, width) of events, in the segment and as much before as shall count.
        """
        parts = [part for component in self._components(counts) for part in self._cut(component)]
        places = np.zeros(counts.shape, np.int64)
        for number, part in enumerate(self._joined(parts), 1):
            places[part.y, part.x] = number
        of = places[events.y, events.x]
        found = (self.region(events[of == number]) for number in range(1, int(places.max()) + 1))
        return [region for region in found if region is not None]

    @property
    def field(self) -> tuple[int, int]:
        """Width and height in which an object of scale 1 has room for what it does in a piece, px."""
        side = round(FIELD * self.side)
        return side, side

    def scale_of(self, regions: Sequence[Region]) -> float:
        """The scale that an object is nearest to.

        Args:
            regions: of the object, in some segments.
        """
        larger = float(np.median([max(region.box[2:] - region.box[:2]) for region in regions]))
        return min(self.scales, key=lambda scale: abs(np.log(larger / (self.side * scale))))

    def foreground(self, counts: Floats) -> tuple[Array, float]:
        """Which pixels stand out of the background, (height, width), and the mean of this.

        Most pixels show the background, so the median of the smoothed counts is its mean; as counts of single
        events its variance is the same, over the pixels that are averaged.
        """
        from scipy.ndimage import uniform_filter

        smooth = uniform_filter(counts, 2 * self.radius + 1, mode="constant")
        background = float(np.median(smooth))
        above = self.contrast * np.sqrt(background / (2 * self.radius + 1) ** 2)
        return smooth > max(self.least, background + above), background

    def _components(self, counts: Floats) -> Iterator[Blob]:
        """What stands out of the background and hangs together."""
        from scipy import ndimage

        stands, background = self.foreground(counts)
        numbers, _ = ndimage.label(stands, np.ones((3, 3)))
        for number, place in enumerate(ndimage.find_objects(numbers), 1):
            y, x = np.nonzero(numbers[place] == number)
            y, x = y + place[0].start, x + place[1].start
            part = Blob(x, y, np.maximum(counts[y, x] - background, 0.0))
            if part.weight.sum() >= self.speck:
                yield part

    def _cost(self, larger: Ints | float) -> Array:
        """Of boxes with these larger sides."""
        scales = np.array(self.scales)
        off = (np.asarray(larger)[..., None] - self.side * scales) / (self.spread * scales)
        return np.asarray((off**2).min(axis=-1))

    def _cut(self, part: Blob) -> list[Blob]:
        """A part, in as many pieces as cost the least."""
        whole = float(self._cost(part.larger))
        best, gain = None, 0.0
        for angle in ANGLES if whole > 1.0 and part.larger > self.side * min(self.scales) else ():
            cut = part.cuts(angle)
            cost = self._cost(cut.larger_before) + self._cost(cut.larger_after) + self.cut * cut.share + self.more
            k = int(cost.argmin())
            if whole - float(cost[k]) > gain:
                best, gain = (cut, k), whole - float(cost[k])
        if best is None:
            return [part]
        cut, k = best
        first, second = cut.at(k)
        return [*self._cut(first), *self._cut(second)]

    def _joined(self, parts: list[Blob]) -> list[Blob]:
        """The parts, joined to as few as cost the least."""
        parts = list(parts)
        while True:
            pairs = [(i, j) for i in range(len(parts)) for j in range(i)]
            gains = []  # by how much it costs less to have two parts as one
            for a, b in ((parts[i], parts[j]) for i, j in pairs):
                sides = np.maximum(a.box[2:], b.box[2:]) - np.minimum(a.box[:2], b.box[:2])
                less = self._cost(a.larger) + self._cost(b.larger) + self.more - self._cost(float(sides.max()))
                gains.append(float(less) - self.join * max(a.gap(b), 0.0))
            if not gains or max(gains) <= 0.0:
                return parts
            i, j = pairs[int(np.argmax(gains))]
            parts[j] = parts[j].with_(parts[i])
            del parts[i]

    def region(self, events: Events) -> Region | None:
        """The place of an object that makes these events, None where they are too few or their box is too small."""
        if len(events) < self.fewest:
            return None
        ends = self.percentile, 100.0 - self.percentile
        (left, top), (right, bottom) = np.percentile([events.x, events.y], ends, axis=1)
        box = np.array([left, top, right + 1.0, bottom + 1.0])
        if max(box[2] - box[0], box[3] - box[1]) < self.smallest * self.side * min(self.scales):
            return None
        return Region(events, box, np.array([events.x.mean(), events.y.mean()]))


Proposals.known = Registry("proposals", (Proposals,))


FAR = 1 << 32
"""A place outside of any sensor, px; a whole number as places are, since `ufunc.at` is slow between types."""


class Blob:
    """Pixels that belong together.

    Args:
        x, y: (pixels,) columns and rows.
        weight: (pixels,) events above the background.

    Attributes:
        box: (4,) left, top, right and bottom.
        larger: side of the box, px.
    """

    def __init__(self, x: Ints, y: Ints, weight: Floats) -> None:
        self.x, self.y, self.weight = x, y, weight
        self.box = np.array([x.min(), y.min(), x.max() + 1, y.max() + 1])
        self.larger = float(max(self.box[2] - self.box[0], self.box[3] - self.box[1]))

    def with_(self, other: Blob) -> Blob:
        """Both as one."""
        x, y = np.concatenate((self.x, other.x)), np.concatenate((self.y, other.y))
        return Blob(x, y, np.concatenate((self.weight, other.weight)))

    def gap(self, other: Blob) -> float:
        """How far the boxes are apart, px; negative where they overlap."""
        return float(np.maximum(self.box[:2] - other.box[2:], other.box[:2] - self.box[2:]).max())

    def cuts(self, angle: float) -> Cuts:
        """All straight cuts across a direction."""
        along = self.x * np.cos(angle) + self.y * np.sin(angle)
        return Cuts(self, np.floor(along - along.min()).astype(np.int64))


class Cuts:
    """The cuts of a blob into its first columns of pixels, across any direction, and the others.

    Args:
        blob: is cut.
        column: (pixels,) of each pixel, from 0.

    Attributes:
        larger_before, larger_after: (cuts,) larger sides of the boxes of both pieces, px.
        share: (cuts,) the blob's events at the cut, in the columns on both sides, over all of them.
    """

    def __init__(self, blob: Blob, column: Ints) -> None:
        self._blob, self._column = blob, column
        n = int(column.max()) + 1
        low, high = np.full((2, n), FAR), np.full((2, n), -FAR)
        for axis, values in enumerate((blob.x, blob.y)):
            np.minimum.at(low[axis], column, values)
            np.maximum.at(high[axis], column, values)
        self.larger_before = _larger(low, high)[:-1]
        self.larger_after = _larger(low[:, ::-1], high[:, ::-1])[::-1][1:]
        events = np.bincount(column, blob.weight, n)
        total = max(float(events.sum()), 1e-9)
        self.share = (events[:-1] + events[1:]) / total

    def at(self, k: int) -> tuple[Blob, Blob]:
        """Both pieces of a cut."""
        before = self._column <= k
        blob = self._blob
        first, second = (Blob(blob.x[of], blob.y[of], blob.weight[of]) for of in (before, ~before))
        return first, second


def _larger(low: Ints, high: Ints) -> Ints:
    """Larger side of the box of the first columns, for each number of columns."""
    sides = np.maximum.accumulate(high, axis=1) - np.minimum.accumulate(low, axis=1) + 1
    return np.asarray(sides.max(axis=0))


LATE = 0.5
"""What a winner at the last tick weighs; one at the first weighs 1."""


@dataclass(frozen=True)
class Dense(Part):
    """Winners of a network that is slid over the whole sensor."""

    kind = "dense"
    source = "thesis section 6.2.7"

    blocking: int = setting(9, "cells", "rows and columns around a winner in which no other wins", CHOSEN, at_least=0)
    frames: int = setting(3, "", "of equally many events, into which a segment is cut", CHOSEN, at_least=1)
    theta: float = setting(35.0, "mV", "threshold of a neuron", f"thesis section 6.2.7; {CHOSEN}", above=0)
    until: float = setting(
        0.5625, "", "share of the code's window that is shown: strong responses", CHOSEN, above=0, at_most=1
    )
    around: int = setting(
        25, "cells", "side of the square in which the strongest response is the measure of others",
        "a little more than a field of 34 px, the whole of a recording of N-MNIST", at_least=1,
    )  # fmt: skip
    weakest: float = setting(
        0.4, "", "least such measure, in strongest responses of a frame", CHOSEN, above=0, at_most=1
    )
    same: float = setting(8.0, "px", "by which winners of one object differ at most", CHOSEN, at_least=0)
    winners: float = setting(0.6, "", "of an object in a segment, late ones counted half", CHOSEN, at_least=0)
    reach: float = setting(12.0, "px", "from the middle of an object to its farthest event", CHOSEN, above=0)


Dense.known = Registry("dense", (Dense,))


class Sliding:
    """A recogniser's layer over a whole sensor.

    Args:
        recogniser: of the method `remus`.
        dense: how objects are found.
        proposals: find what stands out of the background, and which boxes are too small.
        sensor: width and height, px.
        backend: runs the network.

    Raises:
        ModelError: the recogniser is of another method, or the sensor is smaller than a neuron's field.
    """

    def __init__(
        self,
        recogniser: Recogniser,
        dense: Dense,
        proposals: Proposals,
        sensor: tuple[int, int],
        backend: str = "event",
    ) -> None:
        method = recogniser.method
        if not isinstance(method, Framewise) or not isinstance(method.layer, RemusLayer):
            raise ModelError(f"the dense way slides the layer of method 'remus', found '{method.called()}'")
        self._dense, self._proposals, self._classes = dense, proposals, len(recogniser.classes)
        self._layer = replace(method.layer, theta=dense.theta)
        self._method = replace(method, size=sensor, layer=self._layer)
        self._learnt = recogniser.learnt
        encoder = method.encoder
        self._until = encoder.resolution * max(1, round(dense.until * (encoder.last + 1)))
        _, rows, columns = self._method.inputs.shape
        field = self._layer.field
        if min(rows, columns) < field:
            least = field * method.pool.side
            raise ModelError(f"a sensor of {sensor[0]}x{sensor[1]} px: expected at least {least} px each, a field")
        self._shape = (self._classes * self._layer.per_class, rows - field + 1, columns - field + 1)
        net = self._layer.network(self._method.inputs, self._classes)
        net.projections["c1_s2"] = replace(net.projections["c1_s2"], weight=self._learnt["c1_s2"])
        del net.groups["choice"]
        net.group("choice", neuro.local_winners(of="s2", radius=dense.blocking))
        assert net.trials_section is not None
        net.trials_section = replace(net.trials_section, duration=self._until)
        self._sim = neuro.compile(net, backend=backend, seed=0)

    def regions(self, events: Events, counts: Floats) -> list[Region]:
        """The objects of a segment, with what speaks for each class.

        Args:
            events: of the segment.
            counts: (height, width) of events, in the segment and as much before as shall count.
        """
        found = list(self._objects(*self._wins(events)))
        stands, _ = self._proposals.foreground(counts)
        seen = events[np.flatnonzero(stands[events.y, events.x])]
        if not found or not len(seen):
            return []
        middles = np.array([middle for middle, _ in found])
        off = np.stack([seen.x, seen.y], axis=1).astype(float) + 0.5 - middles[:, None]
        nearest = (off**2).sum(axis=2).argmin(axis=0)
        inside = np.abs(off).max(axis=2) <= self._dense.reach
        regions = []
        for k, (_, scores) in enumerate(found):
            region = self._proposals.region(seen[np.flatnonzero((nearest == k) & inside[k])])
            if region is not None:
                regions.append(replace(region, scores=scores))
        return regions

    def _wins(self, events: Events) -> tuple[Array, Array, Array]:
        """All winners in the frames of a segment.

        Returns:
            (wins,) classes; (wins, 2) column and row of the middle of each winner's field, px; (wins,) what each
            weighs, the less the later it won.
        """
        bounds = np.linspace(0, len(events), self._dense.frames + 1).astype(np.int64)
        method = self._method
        responses = method.bank.responses(events, bounds, method.pool.side)
        passed = self._measured(method.pool.passed(responses, method.bank.sizes))
        codes, ids, lengths = method.encoder.encode(passed)
        times = method.encoder.times(codes, self._learnt)
        shown = np.flatnonzero(times < self._until)
        frame = np.repeat(np.arange(len(lengths)), lengths)[shown]
        results = self._sim.trials(times[shown], ids[shown], np.searchsorted(frame, np.arange(len(lengths) + 1)))
        self._sim.forget(before=self._sim.time)
        maps, rows, columns = np.unravel_index(results.wins.neurons, self._shape)
        middle: Array = (np.stack([columns, rows], axis=1) + self._layer.field / 2.0) * method.pool.side
        late = results.wins.steps * method.encoder.resolution / self._until
        label: Array = maps // self._layer.per_class
        weight: Array = 1.0 - (1.0 - LATE) * late
        return label, middle, weight

    def _measured(self, responses: Floats) -> Floats:
        """Responses in units of the strongest around them, so that a faint object is seen beside a strong one."""
        from scipy.ndimage import maximum_filter

        strongest = responses.max(axis=(1, 2))
        near = maximum_filter(strongest, (1, self._dense.around, self._dense.around), mode="constant")
        measure = np.maximum(near, self._dense.weakest * strongest.max(axis=(1, 2), keepdims=True))[:, None, None]
        return np.asarray(np.divide(responses, measure, out=np.zeros_like(responses), where=measure > 0))

    def _objects(self, label: Array, middle: Array, weight: Array) -> Iterator[tuple[Floats, Floats]]:
        """Middle and scores of each object: winners near one place, those of the most weight first."""
        near = np.abs(middle[:, None] - middle).max(axis=2) <= self._dense.same
        left = np.ones(len(label), bool)
        while left.any():
            support = np.where(left, near @ (weight * left), -1.0)
            best = int(support.argmax())
            if support[best] < self._dense.winners:
                return
            of = np.flatnonzero(near[best] & left)
            scores: Floats = np.bincount(label[of], weight[of], self._classes).astype(np.float64)
            yield np.average(middle[of], axis=0, weights=weight[of]), scores
            left[of] = False
