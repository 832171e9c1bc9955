"""Digits are learnt without labels: neurons that inhibit each other come to stand for different shapes.

A spike of a neuron strengthens the synapses that were active before it and weakens the others; a threshold that grows
with each spike lets all neurons take part; the weights of a neuron keep their sum. Labels only name the neurons at the
end. Source: Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015; here on event-camera recordings of N-MNIST, at half
their resolution, held out in 5 folds. Writes diehl_cook_2015.png.

    python examples/diehl_cook_2015.py nmnist_train1000_bin.zip
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import neuro
from neuro.events import Events, recordings

SIDE, LASTS, RESTS = 17, 310.0, 200.0  # px, after two by two are joined; ms of a recording, and after it
SUM, LARGEST, RIVALRY = 1600.0, 20.0, -1000.0  # mV: all weights of a neuron, one of them, those between neurons

adaptive = neuro.equations(
    "adaptive",
    equations={"V_m": "(E_L - V_m) / tau_m + (g + h) / tau_m", "theta": "-theta / tau_theta"},
    receptors={"g": {"kernel": "exp", "tau": "tau_syn"}, "h": {"kernel": "exp", "tau": "tau_syn"}},
    threshold="V_m >= V_th + theta",
    reset={"V_m": "V_reset", "theta": "theta + theta_plus"},
    refractory={"time": "t_ref", "hold": ["V_m"]},
    parameters={
        "E_L": "-65 mV", "V_reset": "-60 mV", "V_th": "-52 mV", "tau_m": "100 ms", "tau_syn": "2 ms", "t_ref": "5 ms",
        "tau_theta": "1e7 ms", "theta_plus": "0.5 mV",
    },
)  # fmt: skip
after_spikes = neuro.equations(
    "after_spikes",
    traces={"x": {"of": "pre", "tau": "tau_plus", "nearest": True}},
    on_post={"w": "min(Wmax, max(0, w + rate * (x - target) * (Wmax - w)))"},
    parameters={"tau_plus": "20 ms", "rate": 0.01, "target": 0.3, "Wmax": LARGEST},
)


def network(neurons: int) -> neuro.Network:
    """Inputs by polarity, row and column onto neurons that inhibit each other."""
    net = neuro.Network("diehl-cook", resolution=1.0)
    net.population("input", (2, SIDE, SIDE), neuro.spike_generator(spike_times=[]))
    net.population("cells", neurons, adaptive())
    start = neuro.uniform(low=0.0, high=0.3)
    net.connect("input", "cells", neuro.all_to_all(), after_spikes(), weight=start, delay=1.0, name="learnt")
    net.connect("cells", "cells", neuro.all_to_all(autapses=False), weight=RIVALRY, delay=1.0)
    return net


class Cells:
    """A network and what its neurons stand for."""

    def __init__(self, neurons: int, seed: int) -> None:
        self.neurons, self.rng = neurons, np.random.default_rng(seed)
        self.sim = neuro.compile(network(neurons), seed=seed)

    def normalise(self) -> None:
        """Let the weights of each neuron have their sum."""
        _, post, weight = self.sim.weights("learnt")
        self.sim.set_weights("learnt", weight * (SUM / np.bincount(post, weight))[post])

    def show(self, spikes: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """How often each neuron fires at a recording."""
        begin = self.sim.time
        self.sim.inject("input", begin + spikes[0], spikes[1])
        self.sim.run(LASTS)
        _, ids = self.sim.spikes("cells", since=begin)
        self.sim.run(RESTS)
        self.sim.forget(before=self.sim.time)
        return np.bincount(ids, minlength=self.neurons)

    def learn(self, shown: list[tuple[np.ndarray, np.ndarray]], labels: np.ndarray, epochs: int) -> None:
        """See all recordings some times; then, frozen, once more, and name each neuron by the label it answers most."""
        for _ in range(epochs):
            for each in self.rng.permutation(len(shown)):
                self.normalise()
                self.show(shown[each])
        self.normalise()
        self.sim.set("learnt", rate=0.0)
        self.sim.set("cells", theta_plus=0.0)
        found = np.array([self.show(each) for each in shown])
        self.stands_for = np.array([found[labels == label].mean(0) for label in range(10)]).argmax(0)

    def answer(self, spikes: tuple[np.ndarray, np.ndarray]) -> int:
        """The label whose neurons fire most, in their mean."""
        fired, votes = self.show(spikes), np.bincount(self.stands_for, minlength=10)
        return int((np.bincount(self.stands_for, fired, 10) / np.maximum(votes, 1)).argmax())


def spikes_of(events: Events) -> tuple[np.ndarray, np.ndarray]:
    """Times in ms and numbers of inputs; at most one spike of an input in a ms."""
    row, column = np.minimum(events.y // 2, SIDE - 1), np.minimum(events.x // 2, SIDE - 1)
    source = (events.p.astype(int) * SIDE + row) * SIDE + column
    step = np.clip((events.t - events.t[0]) // 1000 + 1, 1, int(LASTS))
    once = np.unique(step * 2 * SIDE * SIDE + source)
    return (once // (2 * SIDE * SIDE)).astype(float), once % (2 * SIDE * SIDE)


options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
options.add_argument("path", help="recordings of digits, as N-MNIST has them")
options.add_argument("--neurons", type=int, default=400)
options.add_argument("--epochs", type=int, default=3)
options.add_argument("--folds", type=int, default=5, help="of the five, how many are tested")
options.add_argument("--recordings", type=int, default=100, help="of each digit at most")
asked = options.parse_args()

data = recordings(asked.path)
labels = np.array(data.labels)
chosen = np.concatenate([np.flatnonzero(labels == label)[: asked.recordings] for label in range(10)])
shown, labels = [spikes_of(data[each].load()) for each in chosen], labels[chosen]
order = np.random.default_rng(7).permutation(len(shown))
right = []
for fold in range(asked.folds):
    test = order[fold::5]
    train = np.setdiff1d(order, test)
    cells = Cells(asked.neurons, seed=1 + fold)
    cells.learn([shown[each] for each in train], labels[train], asked.epochs)
    right.append(np.mean([cells.answer(shown[each]) == labels[each] for each in test]))
    print(f"fold {fold + 1}: {right[-1]:.1%} of {len(test)}", flush=True)
print(f"{asked.neurons} neurons: {np.mean(right):.1%} +- {np.std(right):.1%} of recordings held out")
print("Diehl & Cook on MNIST: 82.9 % by 100 neurons, 87.0 % by 400, 95.0 % by 6,400")

pre, post, weight = cells.sim.weights("learnt")
fields = np.zeros((asked.neurons, 2 * SIDE * SIDE))
fields[post, pre] = weight
figure, axes = plt.subplots(6, 12, figsize=(10, 5.4), layout="constrained")
for axis, each in zip(
    axes.flat, np.argsort(cells.stands_for, kind="stable")[:: max(1, asked.neurons // 72)], strict=False
):
    axis.imshow(fields[each].reshape(2, SIDE, SIDE).sum(0), cmap="gray_r")
    axis.set_title(cells.stands_for[each], fontsize=8, pad=2)
for axis in axes.flat:
    axis.axis("off")
figure.savefig("diehl_cook_2015.png", dpi=100)
