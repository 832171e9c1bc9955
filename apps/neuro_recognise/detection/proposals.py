"""Where objects may be: events are counted, the counts smoothed, what stands out of the background is cut and joined.

Objects that touch make one component, and one object may make several. What decides is how large objects are: a
grouping costs the less, the nearer the larger side of each of its boxes is to that of an object, and a cut costs what
it cuts through. Both steps are greedy: the best cut while one pays, then the best join while one pays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from neuro.apps import Part, Registry, setting
from neuro.events import Events
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
        cost: Array = (off**2).min(axis=-1)
        return cost

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
            gains = [self._gain(parts[i], parts[j]) for i, j in pairs]
            if not gains or max(gains) <= 0.0:
                return parts
            i, j = pairs[int(np.argmax(gains))]
            parts[j] = parts[j].with_(parts[i])
            del parts[i]

    def _gain(self, a: Blob, b: Blob) -> float:
        """By how much it costs less to have two parts as one."""
        apart = max(a.gap(b), 0.0)
        sides = np.maximum(a.box[2:], b.box[2:]) - np.minimum(a.box[:2], b.box[:2])
        less = self._cost(a.larger) + self._cost(b.larger) + self.more - self._cost(float(sides.max()))
        return float(less) - self.join * apart

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
    larger: Ints = sides.max(axis=0)
    return larger
