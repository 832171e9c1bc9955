"""HFirst: the first oriented neuron to fire at a place silences the others there, and spike counts decide the class.

This module has the network `hfirst` as a whole and layer by layer, its input, its templates and its decisions. S1 has
nearly all neurons of the network. Its event-driven simulation here takes a tenth of the time of a backend that computes
every step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial, reduce
from operator import add
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

import neuro
import neuro_models
from neuro import ModelError
from neuro.apps import Settings, allocating, setting
from neuro.chips import HostWork, mean_work
from neuro.coding import Work, Works, on_numbers
from neuro_events import Events
from neuro_events.filters import BackgroundActivity
from neuro_recognise.method import Answer, Course, Drawings, Learnt, Method, Run
from neuro_recognise.parts.banks import gabor_bank
from neuro_recognise.shown import Evidence, Features, Floats, Ints

CODE = "HFIRST.m of the authors' code"
READINGS = ("hard", "soft", "potentials")


@dataclass(frozen=True)
class HFirstSettings(Settings):
    """Settings of HFirst.

    Source: Orchard et al., IEEE TPAMI 37:2028, 2015, with the values of the authors' code, github.com/gorchard/HFIRST.
    """

    size: tuple[int, int] = setting((34, 34), "px", "width and height of the camera", "N-MNIST's", at_least=1)
    noise_us: int = setting(
        10_000, "us", "noise filter: longest time since a neighbour's event", "full_NMINST_example.m", above=0
    )
    orientations: int = setting(12, "", "number of Gabor orientations, equally spaced from 0 degrees", CODE, at_least=1)
    field: int = setting(7, "px", "side of the Gabor filters, odd", CODE, at_least=1)
    sigma: float = setting(2.8, "px", "width of the Gabor filters", CODE, above=0)
    wavelength: float = setting(5.0, "px", "wavelength of the Gabor filters", CODE, above=0)
    gamma: float = setting(0.3, "", "aspect ratio of the Gabor filters", CODE, above=0)
    norm: float = setting(100.0, "mV", "L2 norm of each filter, whose mean is 0, and of each template", CODE, above=0)
    s1_threshold: float = setting(150.0, "mV", "threshold of S1", CODE, above=0)
    s1_leak: float = setting(25.0, "mV/ms", "linear leak of S1", CODE, at_least=0)
    pool: int = setting(4, "px", "side of a C1 cell", CODE, at_least=1)
    c1_resets: bool = setting(False, "", "whether a C1 spike resets all orientations of its cell", "an option of ours")
    s2_threshold: float = setting(150.0, "mV", "threshold of S2", CODE, above=0)
    s2_leak: float = setting(1.0, "mV/ms", "linear leak of S2", CODE, at_least=0)
    t_ref: float = setting(5.0, "ms", "refractory period of all layers", CODE, at_least=0)
    below: float = setting(1.0, "mV", "template weights below this are replaced by `unseen`", CODE)
    unseen: float = setting(-1.0, "mV", "weight of a C1 neuron that hardly spikes for a class", CODE)
    resolution: float = setting(
        0.1, "ms", "time step of the network", "ours; the authors' code rounds down to 1 ms", above=0
    )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Orientations, rows and columns of C1, whose neurons are numbered in C order."""
        width, height = self.size
        return self.orientations, math.ceil(height / self.pool), math.ceil(width / self.pool)

    @cached_property
    def gabors(self) -> Floats:
        """The filters, (orientations, field, field) in mV."""
        degrees = [180.0 * k / self.orientations for k in range(self.orientations)]
        bank = gabor_bank((self.field,), (self.sigma,), (self.wavelength,), self.gamma, degrees)
        return np.asarray(self.norm * bank[0])

    def parameters(self, classes: int, templates: Floats | None = None) -> dict[str, Any]:
        """Return the parameters of the network `hfirst`.

        Args:
            classes: number of classes.
            templates: (classes, C1 neurons) in mV; None before they are learnt.
        """
        names = ("orientations", "field", "s1_threshold", "s1_leak", "pool", "s2_threshold", "s2_leak", "t_ref")
        base = {name: getattr(self, name) for name in names}
        width, height = self.size
        sizes = {"height": height, "width": width, "classes": classes, "resolution": self.resolution}
        return base | sizes | {"gabors": self.gabors, "templates": self.unseen if templates is None else templates.T}


class LayerSpikes(NamedTuple):
    """Spikes of one population in the order of time: times in ms, and indices of the neurons."""

    times: Floats
    ids: Ints


class LayerResponse(NamedTuple):
    """Response of layer S2 to the C1 spikes of a recording.

    Attributes:
        spikes: spikes of S2; each class has one neuron.
        potentials: (C1 spikes, classes) V_m after each C1 spike, mV.
    """

    spikes: LayerSpikes
    potentials: Floats


def input_spikes(settings: HFirstSettings, events: Events) -> dict[str, LayerSpikes]:
    """Return the spikes of the network's inputs.

    Args:
        settings: settings of the network.
        events: the recording. Events without a recent neighbour are dropped. Times are rounded to steps and count from
            the first remaining event.

    Returns:
        Spikes by the name of the population.

    Raises:
        ModelError: an event lies outside of the camera.
    """
    events = _without_noise(events, settings)
    steps = 1 + np.rint((events.t - (events.t[0] if len(events) else 0)) / (1000.0 * settings.resolution))
    places = events.y.astype(np.int64) * settings.size[0] + events.x
    masks = {"on_events": events.p == 1, "off_events": events.p == 0}
    return {name: LayerSpikes(steps[mask] * settings.resolution, places[mask]) for name, mask in masks.items()}


def s1_spikes(settings: HFirstSettings, inputs: dict[str, LayerSpikes]) -> dict[str, LayerSpikes]:
    """Return the spikes of layer S1.

    The network has the same spikes, except if several orientations reach the threshold with the same potential: here
    the first fires, in the network a random orientation.

    Args:
        settings: settings of the network.
        inputs: result of `input_spikes`.

    Returns:
        Spikes by the name of the population.
    """
    h, (width, height) = settings.resolution, settings.size
    bank = np.ascontiguousarray(settings.gabors.transpose(1, 2, 0))
    spikes_by_layer = {}
    for layer, source in (("s1_on", "on_events"), ("s1_off", "off_events")):
        source_spikes = inputs[source]
        arrive = 1 + np.rint(source_spikes.times / h).astype(np.int64)
        rows, columns = np.divmod(source_spikes.ids, width)
        refractory_steps = round(settings.t_ref / h)
        numbers = (settings.s1_leak * h, settings.s1_threshold, refractory_steps, height, width)
        steps, ids = first_spikes(arrive, rows, columns, bank, *numbers)
        spikes_by_layer[layer] = LayerSpikes(steps * h, ids)
    return spikes_by_layer


def _without_noise(events: Events, settings: HFirstSettings) -> Events:
    width, height = settings.size
    if len(events) and (events.x.max() >= width or events.y.max() >= height):
        raise ModelError(
            f"an event at ({events.x.max()}, {events.y.max()}): expected a sensor of at most {width} x {height} px",
            hint="set size",
        )
    return BackgroundActivity(sensor_size=events.sensor_size, dt_us=settings.noise_us)(events)


@allocating
def first_spikes(
    steps: Ints,
    rows: Ints,
    columns: Ints,
    bank: Floats,
    leak: float,
    threshold: float,
    refractory: int,
    height: int,
    width: int,
) -> Ints:
    """Simulate layer S1. At each place the first orientation to reach the threshold fires, and resets the others.

    A place is updated only when an event reaches it. Of several orientations, the one with the largest potential fires.
    Of equal potentials, the first one fires.

    steps: int64[n], ascending, steps in which events arrive; rows, columns: int64[n]; bank: float64[side, side,
    orientations], mV; leak: mV per step; refractory: steps after a spike. Returns int64[2, spikes]: steps and
    neurons, (orientation, row, column) in C order.
    """
    side, orientations = bank.shape[0], bank.shape[2]
    half = side // 2
    v = np.zeros((height, width, orientations))
    updated = np.zeros((height, width), np.int64)
    end_of_rest = np.zeros((height, width), np.int64)
    reached = np.empty((height * width, 2), np.int64)
    spikes = np.empty((2, 256), np.int64)
    n, k = 0, 0
    while k < steps.size:
        step, touched = steps[k], 0
        while k < steps.size and steps[k] == step:
            y, x = rows[k], columns[k]
            for r in range(max(0, y - half), min(height, y + half + 1)):
                for c in range(max(0, x - half), min(width, x + half + 1)):
                    if step < end_of_rest[r, c]:
                        continue
                    neuron, taps = v[r, c], bank[half + y - r, half + x - c]
                    if updated[r, c] != step:
                        lost = leak * (step - updated[r, c])
                        for o in range(orientations):
                            neuron[o] -= min(max(neuron[o], -lost), lost)
                        updated[r, c] = step
                        reached[touched, 0], reached[touched, 1] = r, c
                        touched += 1
                    for o in range(orientations):
                        neuron[o] += taps[o]
            k += 1
        for place in range(touched):
            r, c = reached[place]
            winner = v[r, c].argmax()
            if v[r, c, winner] < threshold:
                continue
            if n == spikes.shape[1]:
                larger = np.empty((2, 2 * n), np.int64)
                larger[:, :n] = spikes
                spikes = larger
            spikes[0, n], spikes[1, n] = step, (winner * height + r) * width + c
            n += 1
            v[r, c] = 0.0
            end_of_rest[r, c] = step + refractory + 1
    return spikes[:, :n].copy()


def c1_counts(settings: HFirstSettings, recordings: Sequence[LayerSpikes]) -> Ints:
    """Return the number of spikes of each C1 neuron in each recording, (recordings, C1 neurons)."""
    size = int(np.prod(settings.shape))
    return np.stack([np.bincount(spikes.ids, minlength=size) for spikes in recordings])


def templates(settings: HFirstSettings, counts: Ints, labels: npt.ArrayLike, classes: int) -> Floats:
    """Return the weights of S2, in mV.

    The template of a class is the sum of the counts of its recordings, scaled to the L2 norm `settings.norm`.
    Weights below `settings.below` are replaced by `settings.unseen`.

    Args:
        settings: settings of the network.
        counts: result of `c1_counts`.
        labels: class of each recording.
        classes: number of classes; all weights of a class without recordings are `unseen`.

    Returns:
        (classes, C1 neurons).

    Source: `full_NMINST_example.m` and `HFIRST.m` of the authors' code.
    """
    sums = np.stack([counts[np.asarray(labels) == label].sum(axis=0) for label in range(classes)])
    norms = np.linalg.norm(sums, axis=1, keepdims=True)
    scaled = settings.norm * sums / np.where(norms > 0.0, norms, 1.0)
    return np.where(scaled < settings.below, settings.unseen, scaled)


def network(settings: HFirstSettings, classes: int, templates: Floats | None = None) -> neuro.Network:
    """Return the network `hfirst`.

    Args:
        settings: settings of the network.
        classes: number of classes.
        templates: (classes, C1 neurons) weights of S2 in mV; None before they are learnt.

    Raises:
        ModelError: a setting is out of its bounds.
    """
    net = neuro.load(neuro_models.path("hfirst"), settings.parameters(classes, templates))
    if settings.c1_resets:
        net.group("first_in_cell", neuro.lateral_reset(of="c1"))
    return net


def c1_alone(settings: HFirstSettings) -> neuro.Network:
    """Return layer C1 of `hfirst` as a network whose inputs are S1 spikes.

    Args:
        settings: settings of the network.
    """
    width, height = settings.size
    s1 = (settings.orientations, height, width)
    return _behind(network(settings, 1), {"s1_on": s1, "s1_off": s1}, "c1")


def s2_alone(settings: HFirstSettings, templates: Floats) -> neuro.Network:
    """Return layer S2 of `hfirst` as a network whose inputs are C1 spikes.

    Args:
        settings: settings of the network.
        templates: (classes, C1 neurons) weights in mV.
    """
    return _behind(network(settings, len(templates), templates), {"c1": settings.shape}, "s2")


def show(sim: neuro.Simulation, settings: HFirstSettings, inputs: Mapping[str, LayerSpikes]) -> None:
    """Reset a network, inject spikes, and run it until the last spike that they can cause.

    Args:
        sim: simulation of one of these networks.
        settings: settings of the network.
        inputs: spikes by the name of the population.
    """
    sim.reset()
    last_time = 0.0
    for name, spikes in inputs.items():
        sim.inject(name, spikes.times, spikes.ids)
        last_time = max(last_time, spikes.times.max(initial=0.0))
    layers = len(sim.network().populations)  # each layer adds a delay of one step
    sim.run(last_time + layers * settings.resolution)


def c1_spikes(sim: neuro.Simulation, settings: HFirstSettings, s1: Mapping[str, LayerSpikes]) -> LayerSpikes:
    """Return the C1 spikes of one recording.

    Args:
        sim: simulation of `c1_alone`.
        settings: settings of the network.
        s1: result of `s1_spikes`.
    """
    show(sim, settings, s1)
    return LayerSpikes(*sim.spikes("c1"))


def s2_heard(sim: neuro.Simulation, settings: HFirstSettings, spikes: LayerSpikes) -> LayerResponse:
    """Return the response of S2 to the C1 spikes of one recording.

    Args:
        sim: simulation of `s2_alone`.
        settings: settings of the network.
        spikes: result of `c1_spikes`.
    """
    sim.reset()
    sim.inject("c1", spikes.times, spikes.ids)
    arrivals = 1 + np.rint(spikes.times / settings.resolution).astype(np.int64)
    moments, moment_of = np.unique(arrivals, return_inverse=True)
    potentials = np.empty((moments.size, sim.get("s2", "V_m").size))
    for k, steps in enumerate(np.diff(moments, prepend=0)):
        sim.run(float(steps) * settings.resolution)
        potentials[k] = sim.get("s2", "V_m")
    return LayerResponse(LayerSpikes(*sim.spikes("s2")), potentials[moment_of])


def _behind(net: neuro.Network, shapes: Mapping[str, tuple[int, ...]], layer: str) -> neuro.Network:
    """Return one layer of a network, with spike generators in place of its source populations.

    Args:
        net: the whole network.
        shapes: shapes of the source populations, by name.
        layer: name of the population.
    """
    sources = {
        name: replace(net.populations[name], model=neuro.spike_generator(), shape=shape)
        for name, shape in shapes.items()
    }
    alone = neuro.Network(f"{net.name}_{layer}", resolution=net.resolution)
    alone.populations.update({**sources, layer: net.populations[layer]})
    alone.projections.update({name: part for name, part in net.projections.items() if part.target == layer})
    alone.groups.update({name: part for name, part in net.groups.items() if part.choice.of == layer})
    return alone


def scores(response: LayerResponse, reading: str = "hard") -> Floats:
    """Return the score of each class, (classes,).

    Args:
        response: result of `s2_heard`.
        reading: "hard": spikes of the class; "soft": its share of all spikes; "potentials": V_m summed over the C1
            spikes, mV.

    Raises:
        ModelError: there is no such reading.
    """
    if reading not in READINGS:
        raise ModelError(f"reading = {reading!r}: expected one of {', '.join(READINGS)}")
    if reading == "potentials":
        return np.asarray(response.potentials.sum(axis=0))
    counts = np.bincount(response.spikes.ids, minlength=response.potentials.shape[1]).astype(np.float64)
    return counts / max(1.0, counts.sum()) if reading == "soft" else counts


def decisive(response: LayerResponse, reading: str = "hard") -> Floats:
    """Return `scores` without ties. Of classes with equal spikes, a class with larger summed potentials scores higher.

    The added difference is less than a spike. The authors' code chooses the first of such classes. Without C1 spikes
    all scores are NaN.

    Args:
        response: result of `s2_heard`.
        reading: see `scores`.
    """
    totals = scores(response, reading)
    if not len(response.potentials):
        return np.full_like(totals, np.nan)
    if reading == "potentials":
        return totals
    ranks = scores(response, "potentials").argsort().argsort() / len(totals)
    return np.asarray(totals + ranks / (1 if reading == "hard" else max(1, response.spikes.ids.size)))


def decide(response: LayerResponse, reading: str = "hard") -> int:
    """Return the class of a recording by `decisive`, -1 without C1 spikes.

    Args:
        response: result of `s2_heard`.
        reading: see `scores`.
    """
    totals = decisive(response, reading)
    return -1 if np.isnan(totals).all() else int(totals.argmax())


INPUTS = ("on_events", "off_events")


@dataclass(frozen=True)
class HFirst(Method, HFirstSettings):
    """Layers S1 and C1 process a recording once; S2 has one neuron per class, with a template of the C1 spikes."""

    title = "first spikes of oriented neurons with linear leak, templates of their counts"
    source = "Orchard et al., IEEE TPAMI 37:2028, 2015; github gorchard/HFIRST; thesis lines 2181-2191"
    spikes = True
    unobserved = ("s2_threshold", "s2_leak", "below", "unseen", "reading")
    presets = {"poker": {"size": [35, 35], "c1_resets": True, "reading": "hard"}}
    measured = {"N-MNIST": "88.3 %", "POKER-DVS": "88.5 %"}

    reading: str = setting(
        "potentials", "", "score of a class: S2 spikes, their share, or summed V_m", "the authors': hard",
        words=READINGS,
    )  # fmt: skip

    def observe(self, events: Events) -> Evidence:
        """Return the input of the network and the spikes of C1.

        Returns:
            C1 spikes: ``times`` in ms and ``ids``, (spikes,); inputs ``on_events`` and ``off_events``, (spikes, 2) step
            and neuron; ``lasts`` (1,) us from the first event to the last; ``events`` (1,) number of events.
        """
        inputs = input_spikes(self, self.inside(events))
        c1 = c1_spikes(_c1(self), self, s1_spikes(self, inputs))
        steps = {name: np.rint(spikes.times / self.resolution) for name, spikes in inputs.items()}
        return (
            c1._asdict()
            | {"lasts": events.t[-1:] - events.t[:1], "events": np.array([len(events)])}
            | {name: np.stack([steps[name], spikes.ids], axis=1).astype(np.uint32) for name, spikes in inputs.items()}
        )

    def fit(self, features: Features, course: Course) -> Learnt:
        """Compute the templates from the summed C1 spikes of each class."""
        counts = c1_counts(self, [LayerSpikes(item["times"], item["ids"]) for item in features.evidence])
        return {"templates": templates(self, counts, features.labels, len(features.classes))}

    def answer(self, learnt: Learnt, features: Features, backend: str = "event") -> Answer:
        """Run S2 on the C1 spikes. Recordings without C1 spikes are silent. `Answer.run` runs the whole network."""
        return self.asker(learnt, backend)(features)

    def asker(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Answer]:
        """Compile S2 once. The simulation is reset before each recording."""
        sim = neuro.compile(s2_alone(self, np.asarray(learnt["templates"])), backend=backend)

        def ask(features: Features) -> Answer:
            responses = [s2_heard(sim, self, LayerSpikes(item["times"], item["ids"])) for item in features.evidence]
            votes = {reading: np.stack([decisive(item, reading) for item in responses]) for reading in READINGS}
            run = partial(self.run_whole, learnt, features, backend)
            host = self.host(features, sum(item.spikes.ids.size for item in responses))
            return Answer(votes[self.reading], votes, run, None, features.duration_s(), host)

        return ask

    def host(self, features: Features, spikes: int) -> tuple[HostWork, ...]:
        """Return the operations outside of the network.

        For each event the noise filter takes 7 comparisons for the newest of 8 neighbours, a difference and a
        comparison, and the conversion to a tick takes 3 operations. At each C1 spike the potentials of all classes are
        added up. S2 spikes are counted only if the score needs them.

        Args:
            features: evidence of the recordings.
            spikes: S2 spikes in all recordings.
        """
        classes, counting = len(features.classes), self.reading != "potentials"
        works: dict[str, Works] = {"noise filter": {"event": on_numbers(7 + 2 + 3, 14)}}
        ties = classes * (2 + math.ceil(math.log2(max(1, classes)))) * counting + classes * (self.reading == "soft")
        works[f"reading {self.reading}"] = {
            "c1": on_numbers(classes, 2 * classes),
            "s2": on_numbers(1, 2) if counting else Work(),
            "recording": on_numbers(classes + ties, 2 * classes),
        }
        c1 = float(sum(len(item["ids"]) for item in features.evidence))
        uses = {"event": features.total("events"), "c1": c1, "s2": float(spikes), "recording": float(len(features))}
        return mean_work(works, uses, len(features))

    def run_whole(self, learnt: Learnt, features: Features, backend: str = "event") -> Run:
        """Run the network with all its layers on recordings, and return the simulation and its counts."""
        sim = neuro.compile(self.network(learnt), backend=backend)
        counts = []
        for item in features.evidence:
            steps = {name: (item[name][:, 0], item[name][:, 1].astype(np.int64)) for name in INPUTS}
            show(sim, self, {name: LayerSpikes(k * self.resolution, ids) for name, (k, ids) in steps.items()})
            counts.append(sim.taken())
        return sim, reduce(add, counts)

    def network(self, learnt: Learnt) -> neuro.Network:
        """Return the network with its learnt templates."""
        learnt_templates = np.asarray(learnt["templates"])
        return network(self, len(learnt_templates), learnt_templates)

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """Draw the template of each class."""
        from neuro_recognise.telling.pictures import images, reconstructed

        learnt_templates = np.asarray(learnt["templates"])
        pictures = reconstructed(learnt_templates.reshape(len(learnt_templates), *self.shape), self.gabors, self.pool)
        caption = "one image per class: the filters of S1, scaled by the weights"
        return {"templates": images(pictures, classes, "The templates of S2", caption)}


@lru_cache(maxsize=1)
def _c1(method: HFirst) -> neuro.Simulation:
    """Compile layer C1. Callers reset the simulation before each recording."""
    return neuro.compile(c1_alone(method))
