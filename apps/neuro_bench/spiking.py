"""Spiking networks for classes, trained by the parts of `neuro train`; tested as trained or on a backend."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

import neuro
from neuro.apps import Showing
from neuro_bench.costs import Costs, spiking_costs
from neuro_bench.method import Method, check_installed
from neuro_bench.task import Examples

PRICED = 50
"""Examples that the bill is the mean of."""
INPUT, OUTPUT, CHIP = "input", "out", "loihi"


class Spiking(Method):
    """Base of these: an input, a hidden layer and a neuron a class, of which the one that fires most decides.

    An epoch shows each recording once, so many versions of it are as many epochs.
    """

    spiking = True
    back: ClassVar[bool] = False
    delayed: ClassVar[bool] = False
    settings = {
        "hidden": 128, "tau": 20.0, "epochs": 40, "rate": 0.01, "decay": 0.05, "temperature": 2.0, "slope": 1.0,
        "batch": 20, "shift": 1, "backend": "torch",
    }  # fmt: skip
    space: ClassVar[Mapping[str, Any]] = {
        "hidden": (128, 256),
        "tau": (20.0, 40.0, 80.0),
        "epochs": (40, 60),
        "rate": (0.005, 0.01, 0.02),
        "decay": (0.02, 0.05, 0.1),
        "temperature": (1.5, 2.0, 3.0),
        "slope": (1.0, 2.0, 4.0),
        "shift": (1, 2),
    }

    def network(self, train: Examples, settings: Mapping[str, Any], seed: int) -> neuro.Network:
        """The network before it learns; weights are drawn for the spikes that come in a step."""
        spikes, h = train.spikes, train.spikes.step
        cell = neuro.iaf_psc_delta(tau_m=settings["tau"], t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0)
        net = neuro.Network(self.called_by, resolution=h)
        net.population(INPUT, spikes.shape, neuro.spike_generator())
        net.population("hidden", settings["hidden"], cell)
        net.population(OUTPUT, len(train.classes), cell)
        each = max(1.0, len(spikes.at) / (len(train) * spikes.steps))

        def connect(name: str, source: str, target: str, std: float, delay: Any = h) -> None:
            weight = neuro.normal(mean=0.0, std=std)
            net.connect(source, target, neuro.all_to_all(), weight=weight, delay=delay, name=name)

        span = neuro.uniform(low=h, high=10.0 * h) if self.delayed else h
        connect("in_hidden", INPUT, "hidden", 0.8 / each**0.5, span)
        if self.back:
            connect("hidden_hidden", "hidden", "hidden", settings["back"] / settings["hidden"] ** 0.5)
        connect("hidden_out", "hidden", OUTPUT, 0.1)
        return net

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> Any:
        """Learn by surrogate gradients; see `Method`."""
        check_installed(self, "torch")
        from neuro_train.trainer import learn

        plan = self.plan(train, settings, seed)
        trained = learn(self.network(train, settings, seed), batch_data(train), plan)
        return _Trained(trained, plan, settings["backend"])

    def plan(self, train: Examples, settings: Mapping[str, Any], seed: int) -> Any:
        """The settings as `neuro train` has them."""
        from neuro_train.plan import TrainingPlan

        words: Any = {name: settings[name] for name in ("rate", "decay", "temperature", "slope", "batch", "shift")}
        words["epochs"] = -(-settings["epochs"] // train.versions)
        learns = ("in_hidden=weight,delay", "hidden_out=weight") if self.delayed else ()
        duration = train.spikes.steps * train.spikes.step
        return TrainingPlan(input=INPUT, output=OUTPUT, trainable=learns, duration=duration, seed=seed, **words)


def batch_data(shown: Examples) -> Any:
    """Examples as `neuro train` has recordings."""
    from neuro_torch import Events
    from neuro_train.data import BatchData

    spikes = shown.spikes
    events = Events(len(shown), spikes.steps, {INPUT: (spikes.example, spikes.at, spikes.neuron)})
    return BatchData(events, shown.labels, shown.classes, spikes.shape, "")


class _Trained:
    """What learnt; it is asked itself, on "torch", or its network on a backend."""

    def __init__(self, trained: Any, plan: Any, backend: str) -> None:
        self.net, self._module, self._plan, self._backend = trained.net, trained.module, plan, backend

    def predict(self, shown: Examples) -> Any:
        """The class of each, -1 for silence."""
        from neuro_train.tested import by_module, on_backend

        data = batch_data(shown)
        if self._backend == "torch":
            return by_module(self._module, data, self._plan).decided
        return on_backend(self.net, self._backend, data, self._plan).decided

    def costs(self, shown: Examples) -> Costs:
        """By NeuroBench's counts, and the bills of chips, of the first examples."""
        some = shown.take(np.arange(min(PRICED, len(shown))))
        events = batch_data(some).events
        sim = neuro.compile(self.net, backend=CHIP, seed=self._plan.seed)
        showing = Showing(sim, INPUT, OUTPUT)
        for k in range(len(some)):
            train = events.trains[INPUT].of([k])
            showing.show(train.step, train.neuron, events.steps)
        return spiking_costs(sim, showing.taken, len(some))


class Recurrent(Spiking):
    """A hidden layer that sees the input and itself.

    Its surrogate is narrow: along recurrent synapses the derivative of a wide one reaches neurons that are far from a
    spike, step after step, and what it says is no gradient of anything.
    """

    called_by = "recurrent"
    title = "recurrent spiking network, by surrogate gradients"
    back = True
    settings = {**Spiking.settings, "slope": 4.0, "back": 0.5, "batch": 50, "rate": 0.02}
    space = {**Spiking.space, "slope": (4.0, 8.0), "back": (0.25, 0.5, 1.0), "rate": (0.01, 0.02, 0.04)}


class Dense(Spiking):
    """A hidden layer that sees the input."""

    called_by = "dense"
    title = "spiking network with one hidden layer, by surrogate gradients"


class Delays(Spiking):
    """A hidden layer to which spikes take times that learn as weights do."""

    called_by = "delays"
    title = "spiking network with learnt delays, by surrogate gradients"
    delayed = True
    settings = {**Spiking.settings, "hidden": 256, "tau": 50.0}
