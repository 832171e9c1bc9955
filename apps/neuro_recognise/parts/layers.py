"""Networks that are shown the frames of recordings as trials, and how they are taught."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import neuro
from neuro.apps import Part, Registry, setting
from neuro_models import path as network_path
from neuro_recognise.method import Learnt
from neuro_recognise.shown import Ints

TABLE_3 = "thesis table 3, lines 2450-2463"
BEST = "benchmarks/recognisers.py"
FOLLOWS = {"maps": "the classes and per_class", "rows": "the field and the pool", "columns": "the field and the pool"}
"""Parameters of networks that cannot be set, and what they follow from."""


@dataclass(frozen=True, slots=True)
class Inputs:
    """What a network is shown.

    Attributes:
        shape: channels, rows and columns of the ids.
        window: length of a frame's code, ms.
        resolution: grid of its times, ms.
    """

    shape: tuple[int, int, int]
    window: float
    resolution: float


@dataclass(frozen=True, slots=True)
class Shares:
    """How the frames of an epoch were decided while they were learnt from; the rest were silent.

    Attributes:
        right: share of all frames.
        wrong: likewise.
    """

    right: float
    wrong: float


@dataclass(frozen=True)
class Layer(Part):
    """Base of these networks. Fields are parameters of the network's file, but for those of `teaching`.

    Class attributes:
        file: the network, in `neuro_models`.
        teaching: fields that are no parameters of the network.
        supervised: whether maps have classes, which it learns by; else it learns without labels.
        batch: frames that are shown between two calls of `pace`.
    """

    kind = "network"
    file: ClassVar[str]
    teaching: ClassVar[tuple[str, ...]] = ()
    supervised: ClassVar[bool] = True
    batch: ClassVar[int] = 1000

    @classmethod
    def called(cls) -> str:
        """The name of its file."""
        return cls.file

    def network(self, inputs: Inputs, classes: int) -> neuro.Network:
        """The network for a number of classes, before learning.

        Raises:
            ModelError: a value is out of the network's bounds.
        """
        values = {name: value for name, value in self.as_words().items() if name not in self.teaching}
        return neuro.load(network_path(self.file), params=values | self.following(inputs, classes))

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Parameters that follow from the input and the classes."""
        channels, rows, columns = inputs.shape
        words = {"orientations": channels, "rows": rows, "columns": columns}
        return words | {"window": inputs.window, "resolution": inputs.resolution}

    def begin(self, sim: neuro.Simulation, epoch: int, last: Shares | None) -> None:
        """What is done before each epoch.

        Args:
            sim: is taught.
            epoch: from 0.
            last: of the epoch before; None before the first.
        """

    def pace(self, sim: neuro.Simulation, seen: int) -> None:
        """What is done before each batch of frames.

        Args:
            sim: is taught.
            seen: how many frames it has been taught, in all epochs.
        """

    def decided(self, results: neuro.TrialResults) -> Ints:
        """(frames,) the class that was decided for while it was taught, -1 for none."""
        return results.label

    def also(self, sim: neuro.Simulation) -> dict[str, Any]:
        """What has been learnt beside weights, as arrays by name."""
        return {}

    def settled(self, net: neuro.Network, learnt: Learnt) -> neuro.Network:
        """The network that is asked, once it has its weights."""
        return net


@dataclass(frozen=True)
class Labelled(Layer):
    """Base of networks in which each class has equally many maps, one after the other."""

    per_class: int = setting(1, "", "maps of each class", at_least=1)

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Also the number of maps."""
        return super().following(inputs, classes) | {"maps": classes * self.per_class}


@dataclass(frozen=True)
class RemusLayer(Labelled):
    """Grids of neurons without leak that share a kernel; the first to fire names the class and is rewarded for it."""

    source = "thesis 6.2.4, table 3; what it leaves open stands in models/neuro_models/remus.yaml"
    file = "remus"
    teaching = ("rate_decay",)

    per_class: int = setting(8, "", "grids of each class", f"{BEST}; {TABLE_3}: 2", at_least=1)
    field: int = setting(11, "cells", "side of the receptive field", TABLE_3, at_least=1)
    theta: float = setting(60.0, "mV", "threshold", f"{BEST}; {TABLE_3}: 30, of fewer spikes", above=0)
    weight: float = setting(0.8, "", "mean of the first weights", "ours; open in the thesis")
    spread: float = setting(0.05, "", "deviation of the first weights", "ours; open in the thesis", at_least=0)
    Ar_plus: float = setting(0.075, "", "rate on reward, input before the decision", TABLE_3)
    Ar_minus: float = setting(-0.025, "", "rate on reward, other inputs", TABLE_3)
    Ap_plus: float = setting(0.005, "", "rate on punishment, other inputs", TABLE_3)
    Ap_minus: float = setting(-0.04, "", "rate on punishment, input before the decision", TABLE_3)
    epsilon: float = setting(
        2e-4, "", "growth of the right class' weights after a mistake, without rescue",
        f"ours; {TABLE_3}: 0.004, which drives all weights to 1",
    )  # fmt: skip
    rescue: bool = setting(True, "", "whether a mistake rewards the best-excited grid of the right class", BEST)
    dropout: float = setting(0.5, "", "share of the grids that are silent in a recording", f"{BEST}; {TABLE_3}: 0.25")
    decay: float = setting(0.8, "", "factor on dropout from epoch to epoch", f"{BEST}; {TABLE_3}: 0.7")
    rate_decay: float = setting(1.0, "", "factor on rates, epoch by epoch", "none in the thesis", above=0, at_most=1)

    def begin(self, sim: neuro.Simulation, epoch: int, last: Shares | None) -> None:
        """Let the rates decay."""
        rates = {name: getattr(self, name) for name in ("Ar_plus", "Ar_minus", "Ap_plus", "Ap_minus", "epsilon")}
        sim.set("c1_s2", **{name: rate * self.rate_decay**epoch for name, rate in rates.items()})


Layer.known = Registry("network", (RemusLayer,))


def taught(net: neuro.Network) -> list[str]:
    """The projections that learn from trials."""
    return [name for name, projection in net.projections.items() if projection.synapse.learns == "trials"]


def to_text(net: neuro.Network) -> str:
    """A network without large arrays as YAML text."""
    with tempfile.TemporaryDirectory() as folder:
        net.save(Path(folder) / "network.yaml")
        return (Path(folder) / "network.yaml").read_text("utf-8")


def from_text(text: str) -> neuro.Network:
    """The network that a YAML text describes; its parts have no places, as there is no file to look into."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "network.yaml").write_text(text, "utf-8")
        net = neuro.load(Path(folder) / "network.yaml")
    parts: tuple[dict[str, Any], ...] = (net.populations, net.projections, net.signals, net.groups, net.probes)
    for group in parts:
        group.update({name: replace(part, origin=None) for name, part in group.items()})
    net.trials_origin = None
    return net
