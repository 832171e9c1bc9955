"""Regions of objects in a segment of events, by proposals, or by a network that slides over the whole sensor.

Proposals: event counts are smoothed, and connected components of the foreground are cut and joined. Objects that touch
form one component, and one object may form several components. The size of objects decides between cutting and joining.
The larger side of each box is compared with the side of an object: the closer they are, the smaller the cost. A cut
costs more if it passes through more events. Both steps are greedy: first the best cut is made until no cut reduces the
cost, then the best join until no join reduces it.

Dense: the learnt layer slides over the whole sensor as one network with several winners. Each winner represents a class
and a position, and inhibits the neurons around it. Winners at about the same position in the frames of a segment are
one object. Its box contains the events near this position.
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
"""Directions, rad. Cuts perpendicular to each are tried."""
CHOSEN = "chosen on scenes of one fold of N-MNIST"
FIELD = 1.5
"""Side of a field relative to that of its object: N-MNIST's digits have 23 of 34 px."""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A region of a segment that may contain an object.

    Attributes:
        events: events of the region.
        box: (4,) box of these events, px.
        centre: (2,) mean position of the events, px.
        scores: (classes,) score of each class; None if the detection gives no scores, as with proposals.
    """

    events: Events
    box: Floats
    centre: Floats
    scores: Floats | None = None


@dataclass(frozen=True)
class Proposals(Part):
    """Connected components of smoothed counts, cut and joined to boxes of the size of objects."""

    kind = "proposals"
    source = "components of smoothed counts; cutting and joining by size is our own"

    side: float = setting(23.0, "px", "larger side of an object's box", "N-MNIST's training part: 21 to 25", above=0)
    scales: tuple[float, ...] = setting((1.0,), "", "sizes of objects, in units of side", "thesis line 2543", above=0)
    spread: float = setting(3.0, "px", "variation of the side for an object of scale 1", "N-MNIST's, twice", above=0)
    radius: int = setting(1, "px", "radius of the square of the moving average", CHOSEN, at_least=0)
    contrast: float = setting(5.0, "", "threshold of the foreground in deviations of the background", CHOSEN, above=0)
    least: float = setting(0.3, "events", "smallest mean of a foreground pixel", CHOSEN, above=0)
    cut: float = setting(80.0, "", "cost of a cut through all events of a component", CHOSEN, above=0)
    more: float = setting(3.0, "", "cost of another object", CHOSEN, at_least=0)
    speck: int = setting(15, "events", "fewest events of a component above the background", CHOSEN, at_least=0)
    join: float = setting(0.5, "1/px", "cost of a join per distance of the boxes", CHOSEN, at_least=0)
    fewest: int = setting(60, "events", "fewest events of an object in a segment", CHOSEN, at_least=1)
    smallest: float = setting(0.6, "", "least larger side of an object, in units of side", CHOSEN, at_least=0)
    percentile: float = setting(1.0, "%", "share of events outside of a box at each side", CHOSEN, at_least=0, below=50)

    def regions(self, events: Events, counts: Floats) -> list[Region]:
        """Return the regions that may contain objects, in any order.

        Args:
            events: events of a segment.
            counts: (height, width) event counts of the segment, which may include earlier events.
        """
        parts = [part for component in self._components(counts) for part in self._cut(component)]
        places = np.zeros(counts.shape, np.int64)
        for number, part in enumerate(self._joined(parts), 1):
            places[part.y, part.x] = number
        part_of_event = places[events.y, events.x]
        regions = (self.region(events[part_of_event == number]) for number in range(1, int(places.max()) + 1))
        return [region for region in regions if region is not None]

    @property
    def field(self) -> tuple[int, int]:
        """Width and height of the field for the crop of an object of scale 1, with a margin, px."""
        side = round(FIELD * self.side)
        return side, side

    def scale_of(self, regions: Sequence[Region]) -> float:
        """Return the scale, one of `scales`, that is closest to an object's size.

        Args:
            regions: regions of the object in some segments.
        """
        larger = float(np.median([max(region.box[2:] - region.box[:2]) for region in regions]))
        return min(self.scales, key=lambda scale: abs(np.log(larger / (self.side * scale))))

    def foreground(self, counts: Floats) -> tuple[Array, float]:
        """Return a mask of the foreground pixels, (height, width), and the mean count of the background, events.

        Most pixels show background, so the median of the smoothed counts estimates its mean. Counts of independent
        events have a variance equal to their mean. Averaging divides the variance by the number of averaged pixels.
        """
        from scipy.ndimage import uniform_filter

        smooth = uniform_filter(counts, 2 * self.radius + 1, mode="constant")
        background = float(np.median(smooth))
        above = self.contrast * np.sqrt(background / (2 * self.radius + 1) ** 2)
        return smooth > max(self.least, background + above), background

    def _components(self, counts: Floats) -> Iterator[Blob]:
        """Yield the connected components of the foreground."""
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
        """Return the cost of boxes whose larger sides are `larger`, px."""
        scales = np.array(self.scales)
        deviation = (np.asarray(larger)[..., None] - self.side * scales) / (self.spread * scales)
        return np.asarray((deviation**2).min(axis=-1))

    def _cut(self, part: Blob) -> list[Blob]:
        """Cut a part recursively as long as a cut reduces the cost."""
        cost_before = float(self._cost(part.larger))
        best_cut, gain = None, 0.0
        for angle in ANGLES if cost_before > 1.0 and part.larger > self.side * min(self.scales) else ():
            cut = part.cuts(angle)
            cost = self._cost(cut.larger_before) + self._cost(cut.larger_after) + self.cut * cut.share + self.more
            k = int(cost.argmin())
            if cost_before - float(cost[k]) > gain:
                best_cut, gain = (cut, k), cost_before - float(cost[k])
        if best_cut is None:
            return [part]
        cut, k = best_cut
        first, second = cut.at(k)
        return [*self._cut(first), *self._cut(second)]

    def _joined(self, parts: list[Blob]) -> list[Blob]:
        """Join the parts as long as a join reduces the cost."""
        parts = list(parts)
        while True:
            pairs = [(i, j) for i in range(len(parts)) for j in range(i)]
            gains = []  # reduction of the cost by joining two parts
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
        """Return the region of these events; None if there are too few events or their box is too small."""
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
"""A position outside of any sensor, px; an integer like all positions, because `ufunc.at` is slow for mixed types."""


class Blob:
    """Pixels of one component.

    Args:
        x, y: (pixels,) columns and rows.
        weight: (pixels,) events above the background.

    Attributes:
        box: (4,) left, top, right and bottom, px.
        larger: larger side of the box, px.
    """

    def __init__(self, x: Ints, y: Ints, weight: Floats) -> None:
        self.x, self.y, self.weight = x, y, weight
        self.box = np.array([x.min(), y.min(), x.max() + 1, y.max() + 1])
        self.larger = float(max(self.box[2] - self.box[0], self.box[3] - self.box[1]))

    def with_(self, other: Blob) -> Blob:
        """Return the union with another blob."""
        x, y = np.concatenate((self.x, other.x)), np.concatenate((self.y, other.y))
        return Blob(x, y, np.concatenate((self.weight, other.weight)))

    def gap(self, other: Blob) -> float:
        """Return the distance of the boxes, px; negative if they overlap."""
        return float(np.maximum(self.box[:2] - other.box[2:], other.box[:2] - self.box[2:]).max())

    def cuts(self, angle: float) -> Cuts:
        """Return all straight cuts perpendicular to a direction."""
        along = self.x * np.cos(angle) + self.y * np.sin(angle)
        return Cuts(self, np.floor(along - along.min()).astype(np.int64))


class Cuts:
    """All cuts of a blob perpendicular to a direction.

    Pixels are grouped into columns along the direction. Cut k separates columns 0 ... k from the other columns.

    Args:
        blob: blob to cut.
        column: (pixels,) index of each pixel along the direction, from 0.

    Attributes:
        larger_before, larger_after: (cuts,) larger side of the box of the first and of the second piece, px.
        share: (cuts,) events in the two columns next to the cut, as a share of the blob's events.
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
        """Return both pieces of a cut."""
        is_first = self._column <= k
        blob = self._blob
        first, second = (Blob(blob.x[chosen], blob.y[chosen], blob.weight[chosen]) for chosen in (is_first, ~is_first))
        return first, second


def _larger(low: Ints, high: Ints) -> Ints:
    """Return the larger side of the box around the first 1, 2, ... n columns, (n,) px."""
    sides = np.maximum.accumulate(high, axis=1) - np.minimum.accumulate(low, axis=1) + 1
    return np.asarray(sides.max(axis=0))


LATE = 0.5
"""Weight of a winner at the last tick; at the first tick the weight is 1."""


@dataclass(frozen=True)
class Dense(Part):
    """Winners of a network that slides over the whole sensor."""

    kind = "dense"
    source = "thesis section 6.2.7"

    blocking: int = setting(9, "cells", "radius of inhibition around a winner", CHOSEN, at_least=0)
    frames: int = setting(3, "", "number of frames with equally many events per segment", CHOSEN, at_least=1)
    theta: float = setting(35.0, "mV", "threshold of a neuron", f"thesis section 6.2.7; {CHOSEN}", above=0)
    until: float = setting(
        0.5625, "", "share of the code's window that is used: strong responses", CHOSEN, above=0, at_most=1
    )
    around: int = setting(
        25, "cells", "side of the square whose strongest response normalises the others",
        "a little more than a field of 34 px, the whole of a recording of N-MNIST", at_least=1,
    )  # fmt: skip
    weakest: float = setting(
        0.4, "", "least normaliser, relative to the strongest response of the frame", CHOSEN, above=0, at_most=1
    )
    same: float = setting(8.0, "px", "largest distance between winners of one object", CHOSEN, at_least=0)
    winners: float = setting(0.6, "", "least weight of an object's winners in a segment", CHOSEN, at_least=0)
    reach: float = setting(12.0, "px", "largest distance of an event from its object's centre", CHOSEN, above=0)


Dense.known = Registry("dense", (Dense,))


class Sliding:
    """A recogniser's layer over a whole sensor.

    Args:
        recogniser: recogniser of the method `remus`.
        dense: settings of the detection.
        proposals: settings of the foreground and of the smallest box.
        sensor: width and height of the sensor, px.
        backend: backend that runs the network.

    Raises:
        ModelError: the recogniser has another method, or the sensor is smaller than a receptive field.
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
            smallest = field * method.pool.side
            raise ModelError(f"a sensor of {sensor[0]}x{sensor[1]} px: expected at least {smallest} px each, a field")
        self._shape = (self._classes * self._layer.per_class, rows - field + 1, columns - field + 1)
        net = self._layer.network(self._method.inputs, self._classes)
        net.projections["c1_s2"] = replace(net.projections["c1_s2"], weight=self._learnt["c1_s2"])
        del net.groups["choice"]
        net.group("choice", neuro.local_winners(of="s2", radius=dense.blocking))
        assert net.trials_section is not None
        net.trials_section = replace(net.trials_section, duration=self._until)
        self._sim = neuro.compile(net, backend=backend, seed=0)

    def regions(self, events: Events, counts: Floats) -> list[Region]:
        """Return the regions of a segment's objects with the scores of the classes.

        Args:
            events: events of the segment.
            counts: (height, width) event counts of the segment, which may include earlier events.
        """
        objects = list(self._objects(*self._wins(events)))
        is_foreground, _ = self._proposals.foreground(counts)
        foreground = events[np.flatnonzero(is_foreground[events.y, events.x])]
        if not objects or not len(foreground):
            return []
        middles = np.array([middle for middle, _ in objects])
        offsets = np.stack([foreground.x, foreground.y], axis=1).astype(float) + 0.5 - middles[:, None]
        nearest = (offsets**2).sum(axis=2).argmin(axis=0)
        inside = np.abs(offsets).max(axis=2) <= self._dense.reach
        regions = []
        for k, (_, scores) in enumerate(objects):
            region = self._proposals.region(foreground[np.flatnonzero((nearest == k) & inside[k])])
            if region is not None:
                regions.append(replace(region, scores=scores))
        return regions

    def _wins(self, events: Events) -> tuple[Array, Array, Array]:
        """Return all winners in the frames of a segment.

        Returns:
            (wins,) class of each winner; (wins, 2) column and row of the centre of its receptive field, px; (wins,) its
            weight, which is smaller for a later win.
        """
        bounds = np.linspace(0, len(events), self._dense.frames + 1).astype(np.int64)
        method = self._method
        responses = method.bank.responses(events, bounds, method.pool.side)
        passed = self._measured(method.pool.passed(responses, method.bank.sizes))
        codes, ids, lengths = method.encoder.encode(passed)
        times = method.encoder.times(codes, self._learnt)
        in_time = np.flatnonzero(times < self._until)
        frame = np.repeat(np.arange(len(lengths)), lengths)[in_time]
        results = self._sim.trials(times[in_time], ids[in_time], np.searchsorted(frame, np.arange(len(lengths) + 1)))
        self._sim.forget(before=self._sim.time)
        maps, rows, columns = np.unravel_index(results.wins.neurons, self._shape)
        middle: Array = (np.stack([columns, rows], axis=1) + self._layer.field / 2.0) * method.pool.side
        lateness = results.wins.steps * method.encoder.resolution / self._until
        label: Array = maps // self._layer.per_class
        weight: Array = 1.0 - (1.0 - LATE) * lateness
        return label, middle, weight

    def _measured(self, responses: Floats) -> Floats:
        """Divide responses by the strongest response nearby, so that faint objects are detected next to strong ones."""
        from scipy.ndimage import maximum_filter

        strongest = responses.max(axis=(1, 2))
        near = maximum_filter(strongest, (1, self._dense.around, self._dense.around), mode="constant")
        measure = np.maximum(near, self._dense.weakest * strongest.max(axis=(1, 2), keepdims=True))[:, None, None]
        return np.asarray(np.divide(responses, measure, out=np.zeros_like(responses), where=measure > 0))

    def _objects(self, label: Array, middle: Array, weight: Array) -> Iterator[tuple[Floats, Floats]]:
        """Yield centre and scores of each object, i.e. each group of winners at one position, by descending weight."""
        near = np.abs(middle[:, None] - middle).max(axis=2) <= self._dense.same
        is_free = np.ones(len(label), bool)
        while is_free.any():
            support = np.where(is_free, near @ (weight * is_free), -1.0)
            strongest = int(support.argmax())
            if support[strongest] < self._dense.winners:
                return
            group = np.flatnonzero(near[strongest] & is_free)
            scores: Floats = np.bincount(label[group], weight[group], self._classes).astype(np.float64)
            yield np.average(middle[group], axis=0, weights=weight[group]), scores
            is_free[group] = False
