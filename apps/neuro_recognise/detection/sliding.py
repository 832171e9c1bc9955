"""The dense way: the learnt layer slid over the whole sensor as one network, in which several neurons win.

Each winner stands for a class and a place, and keeps others around it from winning. The winners of a segment's frames
that stand for the same place are one object, and its box spans the events there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

import neuro
from neuro import ModelError
from neuro.apps import Part, Registry, setting
from neuro.events import Events
from neuro_recognise.detection.proposals import CHOSEN, Proposals, Region
from neuro_recognise.methods.framewise import Framewise
from neuro_recognise.parts.layers import RemusLayer
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.shown import Array, Floats

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
        self._sim = neuro.compile(self._network(), backend=backend, seed=0)

    def _network(self) -> neuro.Network:
        net = self._layer.network(self._method.inputs, self._classes)
        net.projections["c1_s2"] = replace(net.projections["c1_s2"], weight=self._learnt["c1_s2"])
        del net.groups["choice"]
        net.group("choice", neuro.local_winners(of="s2", radius=self._dense.blocking))
        assert net.trials_section is not None
        net.trials_section = replace(net.trials_section, duration=self._until)
        return net

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
        measured: Floats = np.divide(responses, measure, out=np.zeros_like(responses), where=measure > 0)
        return measured

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
