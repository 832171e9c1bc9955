"""HOTS: a hierarchy of time surfaces whose prototypes are learnt online, layer by layer, and their histograms.

The time surface of event i has a value for each channel p and each pixel u within radius R. The value decays with the
time since the last event there, T_i: ``S_i(u, p) = exp(-(t_i - T_i(u, p)) / tau)``. It is 0 if there was no event. The
index ``k_i`` of the closest of N prototypes becomes the channel of the event in the next layer. From layer to layer, R,
tau and N are multiplied by ``K_R``, ``K_tau`` and ``K_N`` (eq. 119 of the thesis). A histogram counts the
prototypes of the last layer. `neuro_recognise.parts.readouts` has the paper's distances between histograms.

Source: Lagorce et al., "HOTS: A Hierarchy of Event-Based Time-Surfaces for Pattern Recognition", IEEE TPAMI 39:1346,
2017; thesis lines 2211-2259 with algorithm 13.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Part, Quantity, Registry, check, part, setting
from neuro_events import Events
from neuro_recognise.method import Answer, Course, Drawings, Learnt, Method, Progress
from neuro_recognise.parts.readouts import Readout, Svm
from neuro_recognise.shown import Evidence, Features, Floats, Ints, Lazy

if TYPE_CHECKING:
    from neuro_recognise.methods._hots_kernels import Seen

Report: TypeAlias = Callable[["Layers", int, int], None]


CODE = "github SpikeAI/HOTS, which replicates the paper for letters and digits"
RATE = "thesis algorithm 13"


@dataclass(frozen=True)
class Hierarchy(Part):
    """Layers of time surfaces whose prototypes are learnt online."""

    known_as = "time_surfaces"
    kind = "hierarchy"
    source = "Lagorce et al., IEEE TPAMI 39:1346, 2017; N 4, 8, 16, R 2, 4, 8, tau 10, 100, 1000 ms; thesis 2259"

    layers: int = setting(3, "", "number of layers", CODE, at_least=1)
    radius: int = setting(2, "px", "radius of the first layer's time surfaces", CODE, at_least=1)
    tau: float = setting(10.0, "ms", "time constant of the first layer", CODE, above=0)
    centres: int = setting(4, "", "number of prototypes of the first layer", CODE, at_least=1)
    radius_factor: int = setting(2, "", "factor on the radius per layer", CODE, at_least=1)
    tau_factor: float = setting(10.0, "", "factor on the time constant per layer", CODE, above=0)
    centres_factor: int = setting(2, "", "factor on the number of prototypes per layer", CODE, at_least=1)
    polarity: bool = setting(True, "", "whether ON and OFF are distinguished", CODE)
    first: str = setting(
        "first", "", "initial prototypes: the first surfaces, or ones drawn from up to 100 recordings", RATE,
        words=("first", "drawn"),
    )  # fmt: skip
    rate: float = setting(0.01, "", "initial learning rate of a prototype", RATE, above=0, below=1)
    slow: float = setting(20000.0, "", "number of wins that halve the rate", RATE, above=0)

    def radius_of(self, layer: int) -> int:
        """Return the radius of a layer, px; layers count from 0."""
        return int(self.radius * self.radius_factor**layer)

    def tau_of(self, layer: int) -> float:
        """Return the time constant of a layer, us."""
        return 1000.0 * self.tau * self.tau_factor**layer

    def centres_of(self, layer: int) -> int:
        """Return the number of prototypes of a layer."""
        return int(self.centres * self.centres_factor**layer)

    def channels_of(self, layer: int) -> int:
        """Return the number of channels of a layer's input events."""
        return self.centres_of(layer - 1) if layer else 2 if self.polarity else 1


Hierarchy.known = Registry("hierarchy", (Hierarchy,))

WHOLE = Quantity(kind="integer", at_least=0)
"""Allowed values of a seed or a side."""
SAMPLED = 100
"""Number of recordings from which initial prototypes are drawn."""


class Layers:
    """The layers with their prototypes.

    Layers learn one after the other, each from all recordings in an order that the seed determines, while lower layers
    stay constant. The same recordings, settings and seed give the same prototypes to the last bit, also when the
    training resumes from a `state`.

    Args:
        settings: settings of the hierarchy.
        sensor_size: width and height of the field, px; all events must be inside.
        seed: seed of the order of recordings and of the initial prototypes, >= 0.

    Attributes:
        centres: prototypes of each layer that has started, (rows, columns, channels, prototypes).
        wins: for each layer that has started, (prototypes,) int64 number of wins plus 1, p_k.
        learnt: number of layers that are complete.
        seen: number of recordings that the current layer has learnt from.
    """

    def __init__(self, settings: Hierarchy, sensor_size: tuple[int, int], *, seed: int = 0) -> None:
        self.settings = settings
        self.sensor_size = sensor_size
        self.seed = check(WHOLE, seed, "seed")
        self.centres: list[Floats] = []
        self.wins: list[Ints] = []
        self.learnt = 0
        self.seen = 0

    def learn(self, recordings: Sequence[Events], report: Report | None = None) -> None:
        """Run the rest of the training.

        Args:
            recordings: the same recordings in every call; the sequence may load each recording on access.
            report: function that is called after each recording, with the layers, the number of finished steps, and the
                number of all steps, which is layers times recordings. It may store the `state` of the layers.

        Raises:
            ModelError: there are fewer events than initial prototypes, or an event is outside of the field.
        """
        n = len(recordings)
        while self.learnt < self.settings.layers:
            layer = self.learnt
            order = np.random.default_rng([self.seed, layer]).permutation(n).tolist()
            if len(self.centres) == layer:
                self._begin(recordings, order)
            for k in order[self.seen :]:
                self._teach(recordings[k])
                self.seen += 1
                if report:
                    report(self, layer * n + self.seen, self.settings.layers * n)
            self.learnt, self.seen = layer + 1, 0

    def features(self, events: Events, *, cell: int = 0, layer: int | None = None) -> Ints:
        """Count the events for which each prototype is the closest.

        Args:
            events: a recording.
            cell: side of the square cells that have separate counts, px; 0 for a single cell, as in the paper.
            layer: index of the layer; None for the last layer.

        Returns:
            (rows, columns, prototypes) counts of each cell; (1, 1, prototypes) for a single cell.

        Raises:
            ModelError: the layers are not learnt, an event is outside of the field, or `cell` is not an integer >= 0.
        """
        from neuro_recognise.methods._hots_kernels import count

        last_layer = self.settings.layers - 1 if layer is None else layer
        side = check(WHOLE, cell, "cell") or max(self.sensor_size)
        columns, rows = (-(-length // side) for length in self.sensor_size)
        out = np.zeros((rows * columns, self.settings.centres_of(last_layer)), np.int64)
        count(events.x, events.y, self.assigned(events, last_layer), side, columns, out)
        return out.reshape(rows, columns, -1)

    def assigned(self, events: Events, layer: int) -> Ints:
        """Return the closest prototype of each event, (events,) int64.

        Args:
            events: a recording.
            layer: index of the layer.

        Raises:
            ModelError: the layer is not learnt, or an event is outside of the field.
        """
        if not 0 <= layer < self.learnt:
            raise ModelError(f"layer {layer}: {self.learnt} of {self.settings.layers} layers are learnt")
        return self._channels(events, layer + 1)

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return the state of the training as arrays by name, without settings and field."""
        arrays: dict[str, npt.NDArray[Any]] = {"place": np.array([self.learnt, self.seen, self.seed], np.int64)}
        for k, (centres, wins) in enumerate(zip(self.centres, self.wins, strict=True)):
            arrays |= {f"centres_{k}": centres.copy(), f"wins_{k}": wins.copy()}
        return arrays

    @classmethod
    def from_state(
        cls, settings: Hierarchy, sensor_size: tuple[int, int], state: Mapping[str, npt.NDArray[Any]]
    ) -> Layers:
        """Restore layers from a state. `learn` then continues the training with the same bits.

        Args:
            settings: settings with which the state was learnt.
            sensor_size: size of the field with which the state was learnt.
            state: result of `state`.

        Raises:
            ModelError: the state has other settings.
        """
        learnt, position, seed = (int(number) for number in state["place"])
        layers = cls(settings, sensor_size, seed=seed)
        layers.learnt, layers.seen = learnt, position
        for k in range(sum(name.startswith("centres_") for name in state)):
            centres = np.array(state[f"centres_{k}"], np.float64)
            if centres.shape != layers._shape(k):
                raise ModelError(f"prototypes of layer {k} are {centres.shape}, expected {layers._shape(k)}")
            layers.centres.append(centres)
            layers.wins.append(np.array(state[f"wins_{k}"], np.int64))
        return layers

    def _shape(self, layer: int) -> tuple[int, int, int, int]:
        side = 2 * self.settings.radius_of(layer) + 1
        return side, side, self.settings.channels_of(layer), self.settings.centres_of(layer)

    def _empty_map(self, layer: int, margin: int) -> Seen:
        """Return an empty map of a layer's last events.

        Args:
            layer: index of the layer.
            margin: width of the border around the field, px.
        """
        from neuro_recognise.methods._hots_kernels import Seen

        (width, height), s = self.sensor_size, self.settings
        channels, room = s.channels_of(layer), (height + 2 * margin) * (width + 2 * margin)
        return Seen(np.zeros(room * channels), width, s.radius_of(layer), channels, s.tau_of(layer))

    def _begin(self, recordings: Sequence[Events], order: Sequence[int]) -> None:
        """Initialise the prototypes of the next layer with time surfaces of events."""
        layer, n = len(self.centres), self.settings.centres_of(len(self.centres))
        sources = order[:SAMPLED] if self.settings.first == "drawn" else order
        lengths: list[int] = []
        for k in sources:
            lengths.append(len(recordings[k]))
            if self.settings.first == "first" and sum(lengths) >= n:
                break
        if sum(lengths) < n:
            raise ModelError(f"{sum(lengths)} events for the {n} prototypes of layer {layer}, expected one for each")
        chosen = np.arange(n)
        if self.settings.first == "drawn":
            rng = np.random.default_rng([self.seed, layer, 1])
            chosen = np.sort(rng.choice(sum(lengths), n, replace=False))
        surfaces, begin = [], 0
        for k, length in zip(sources, lengths, strict=False):
            own_events = chosen[(chosen >= begin) & (chosen < begin + length)] - begin
            if own_events.size:
                surfaces.append(self._surfaces(recordings[k], layer, own_events))
            begin += length
        self.centres.append(np.concatenate(surfaces, axis=1).reshape(self._shape(layer)))
        self.wins.append(np.ones(n, np.int64))

    def _surfaces(self, events: Events, layer: int, indices: Ints) -> Floats:
        """Return time surfaces of some events in a layer, (values, events)."""
        from neuro_recognise.methods._hots_kernels import surfaces

        out = np.empty((int(np.prod(self._shape(layer)[:3])), len(indices)))
        last_events = self._empty_map(layer, self.settings.radius_of(layer))
        surfaces(events.t, events.x, events.y, self._channels(events, layer), last_events, indices, out)
        return out

    def _teach(self, events: Events) -> None:
        """Learn the current layer from a recording."""
        from neuro_recognise.methods._hots_kernels import learn

        s, layer = self.settings, self.learnt
        centres = self.centres[layer].reshape(-1, s.centres_of(layer))
        learn(
            events.t, events.x, events.y, self._channels(events, layer), self._empty_map(layer, s.radius_of(layer)),
            centres, (centres**2).sum(axis=0), np.empty(s.centres_of(layer)), self.wins[layer], (s.rate, s.slow),
        )  # fmt: skip

    def _channels(self, events: Events, layers: int) -> Ints:
        """Return the channel of each event after the first `layers` layers."""
        from neuro_recognise.methods._hots_kernels import find

        width, height = self.sensor_size
        if len(events) and (int(events.x.max()) >= width or int(events.y.max()) >= height):
            raise ModelError(f"{events!r}: an event is outside of the field of {width}x{height}, expected all inside")
        s = self.settings
        channel = events.p.astype(np.int64) if s.polarity else np.zeros(len(events), np.int64)
        for layer in range(layers):
            centres, border, out = self.centres[layer], 2 * s.radius_of(layer), np.empty(len(events), np.int64)
            products = np.zeros((height + border) * (width + border) * s.centres_of(layer))
            turned = np.ascontiguousarray(centres[::-1, ::-1].transpose(2, 0, 1, 3)).reshape(s.channels_of(layer), -1)
            squares = (centres**2).sum(axis=(0, 1, 2))
            find(events.t, events.x, events.y, channel, self._empty_map(layer, 0), products, turned, squares, out)
            channel = out
        return channel


EVERY = 50
"""Number of recordings between two checkpoints."""


@dataclass(frozen=True)
class Hots(Method):
    """Histograms of prototypes: each event is assigned to the prototype that is closest to its time surface."""

    title = "hierarchy of time surfaces"
    source = "Lagorce et al., IEEE TPAMI 39:1346, 2017; thesis lines 2211-2259"
    needs = "recognise"
    unobserved = ("hierarchy", "learn_from", "cell", "readout")
    presets = {
        "cells": {"layers": 1, "centres": 64, "tau": 30.0, "cell": 7},
        "poker": {"size": [35, 35], "layers": 1, "centres": 32, "tau": 2.0, "cell": 12},
    }
    measured = {"N-MNIST": "72.6 %", "POKER-DVS": "97.3 %"}

    hierarchy: Hierarchy = part(Hierarchy, Hierarchy())
    learn_from: int = setting(
        0, "", "number of recordings drawn for prototypes; 0: all", "the paper's are few", at_least=0
    )
    cell: int = setting(0, "px", "side of cells with separate histograms; 0: the whole field", "the paper", at_least=0)
    readout: Readout = part(Readout, Svm())

    def observe(self, events: Events) -> Evidence:
        """Return the events inside the field."""
        inside = self.inside(events)
        return {"t": inside.t - (inside.t[0] if len(inside) else 0), "x": inside.x, "y": inside.y, "p": inside.p}

    def fit(self, features: Features, course: Course) -> Learnt:
        """Learn prototypes layer by layer, then train the readout."""
        layers = Layers(self.hierarchy, self.size, seed=course.seed)
        if state := course.resume():
            layers = Layers.from_state(self.hierarchy, self.size, state["layers"])
        chosen = np.arange(len(features))
        if 0 < self.learn_from < len(features):
            chosen = np.sort(np.random.default_rng([course.seed, 3]).permutation(len(features))[: self.learn_from])

        def tell(reached: Layers, done: int, total: int) -> None:
            if done % EVERY == 0 or done == total:
                course.keep(layers=reached.state())
            course.report(Progress("learning prototypes", done, total))

        layers.learn(self._events(features.take(chosen)), tell)
        x = self._histograms(layers, features)
        return {**layers.state(), **self.readout.fit(x, features.labels, len(features.classes), course)}

    def answer(self, learnt: Learnt, features: Features, backend: str = "event") -> Answer:
        """Compute the readout's scores; a recording without events is silent."""
        arrays = {name: part for name, part in learnt.items() if not isinstance(part, str)}
        x = self._histograms(Layers.from_state(self.hierarchy, self.size, arrays), features)
        return Answer(np.where(x.any(axis=1, keepdims=True), self.readout.scores(learnt, x), np.nan))

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """Draw the prototypes of each layer: both polarities in the first layer, else the maximum over channels."""
        from neuro_recognise.telling.pictures import images

        figures = {}
        for layer in range(self.hierarchy.layers):
            centres = np.asarray(learnt[f"centres_{layer}"]).transpose(3, 2, 0, 1)
            if layer == 0 and self.hierarchy.polarity:
                shades, caption = centres[:, 1] - centres[:, 0], "blue ON, orange OFF"
            else:
                shades, caption = centres.max(axis=1), "in any channel"
            title = f"The time surfaces of layer {layer + 1}"
            caption = f"one image per prototype; darker pixels had a later event: {caption}"
            figures[f"layer-{layer + 1}"] = images(shades, [""] * len(shades), title, caption)
        return figures

    def _histograms(self, layers: Layers, features: Features) -> Floats:
        """Return each recording's histogram divided by its number of events, (recordings, cells times prototypes)."""
        counts = [layers.features(events, cell=self.cell).ravel() for events in self._events(features)]
        histograms = np.stack(counts).astype(np.float64)
        return np.asarray(histograms / np.maximum(histograms.sum(axis=1, keepdims=True), 1.0))

    def _events(self, features: Features) -> Lazy[Events]:
        """Convert evidence to events, one recording at a time."""

        def item(k: int) -> Events:
            arrays = features.evidence[k]
            return Events(arrays["t"], arrays["x"], arrays["y"], arrays["p"], self.size)

        return Lazy(len(features), item)
