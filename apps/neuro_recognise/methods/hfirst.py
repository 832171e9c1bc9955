"""HFirst: the first of oriented neurons to fire at a place silences the others; classes are counts of such spikes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial, reduce
from operator import add
from typing import TYPE_CHECKING, Any

import numpy as np

import neuro
from neuro.events import Events
from neuro_recognise.hfirst import (
    READINGS,
    HFirstSettings,
    LayerSpikes,
    c1_alone,
    c1_counts,
    c1_spikes,
    decisive,
    network,
    s1_spikes,
    s2_alone,
    s2_heard,
    show,
    shown,
    templates,
)
from neuro_recognise.method import Answer, Course, Learnt, Method, Run
from neuro_recognise.settings import setting
from neuro_recognise.shown import Evidence, Features

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OF_S2 = ("s2_threshold", "s2_leak", "below", "unseen", "reading")
"""Settings that what is observed, the spikes of C1, does not depend on."""
INPUTS = ("on_events", "off_events")


@dataclass(frozen=True)
class HFirst(Method, HFirstSettings):
    """Layers S1 and C1 look at a recording once; S2 has a neuron with a template of their spikes for each class."""

    title = "first spikes of oriented neurons with linear leak, templates of their counts"
    source = "Orchard et al., IEEE TPAMI 37:2028, 2015; github gorchard/HFIRST; thesis lines 2181-2191"
    spikes = True
    presets = {"poker": {"size": [35, 35], "c1_resets": True, "reading": "hard"}}
    measured = {"N-MNIST": "88.3 %", "POKER-DVS": "88.5 %"}

    reading: str = setting(
        "potentials", "", "how S2 is read: spikes, their shares or summed V_m of each class", "the authors': hard",
        words=READINGS,
    )  # fmt: skip

    def observing(self) -> Mapping[str, Any]:
        """All that S1 and C1 depend on."""
        return {name: value for name, value in self.as_words().items() if name not in OF_S2}

    def observe(self, events: Events) -> Evidence:
        """What the network is shown, and what its layers S1 and C1 make of it.

        Returns:
            Of C1 ``times`` in ms and ``ids``, (spikes,); of each input ``on_events`` and ``off_events``, (spikes, 2)
            the step and the neuron.
        """
        inputs = shown(self, self.inside(events))
        c1 = c1_spikes(_c1(self), self, s1_spikes(self, inputs))
        steps = {name: np.rint(spikes.times / self.resolution) for name, spikes in inputs.items()}
        return c1._asdict() | {
            name: np.stack([steps[name], spikes.ids], axis=1).astype(np.uint32) for name, spikes in inputs.items()
        }

    def fit(self, shown: Features, course: Course) -> Learnt:
        """Sum what C1 sent for each class."""
        counts = c1_counts(self, [_spikes(one) for one in shown.evidence])
        return {"templates": templates(self, counts, shown.labels, len(shown.classes))}

    def answer(self, learnt: Learnt, shown: Features, backend: str = "event") -> Answer:
        """Let S2 hear the spikes of C1; a recording without any is silent. For the bill the whole network runs."""
        return self.asker(learnt, backend)(shown)

    def asker(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Answer]:
        """With S2 compiled once; it starts anew with each recording."""
        sim = neuro.compile(s2_alone(self, np.asarray(learnt["templates"])), backend=backend)

        def ask(shown: Features) -> Answer:
            heard = [s2_heard(sim, self, _spikes(one)) for one in shown.evidence]
            votes = {reading: np.stack([decisive(one, reading) for one in heard]) for reading in READINGS}
            return Answer(votes[self.reading], votes, partial(self.run_whole, learnt, shown, backend))

        return ask

    def run_whole(self, learnt: Learnt, shown: Features, backend: str = "event") -> Run:
        """Let the network, with all of its layers, hear recordings; what that took."""
        sim = neuro.compile(self.network(learnt), backend=backend)
        taken = []
        for one in shown.evidence:
            steps = {name: (one[name][:, 0], one[name][:, 1].astype(np.int64)) for name in INPUTS}
            show(sim, self, {name: LayerSpikes(at * self.resolution, ids) for name, (at, ids) in steps.items()})
            taken.append(sim.taken())
        return sim, reduce(add, taken)

    def network(self, learnt: Learnt) -> neuro.Network:
        """All layers, with what was learnt."""
        known = np.asarray(learnt["templates"])
        return network(self, len(known), known)

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Mapping[str, Figure]:
        """The template of each class."""
        from neuro_recognise.telling.pictures import images, reconstructed

        known = np.asarray(learnt["templates"])
        drawn = reconstructed(known.reshape(len(known), *self.shape), self.gabors, self.pool)
        about = "a picture a class: the filters of S1, each as strong as its weight"
        return {"templates": images(drawn, classes, "The templates of S2", about)}


@lru_cache(maxsize=1)
def _c1(method: HFirst) -> neuro.Simulation:
    """Layer C1, which starts anew with each recording."""
    return neuro.compile(c1_alone(method))


def _spikes(one: Evidence) -> LayerSpikes:
    return LayerSpikes(one["times"], one["ids"])
