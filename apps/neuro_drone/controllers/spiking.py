"""The spiking network: rates in, spikes out, dopamine back."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import isclose, prod
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

import neuro
from neuro.apps import setting
from neuro_drone.controllers.simple import ControllerSettings, each_axis, pattern, shares
from neuro_drone.scenario import Scenario
from neuro_models import names, path as network_path

Floats = npt.NDArray[np.float64]
CELLS, MOTORS = "cells", "motors"
WAY = "a larger eta and a shorter tau_c let the network learn there"
SIDES = (1.0, -1.0)  # of each axis: the positive motor, the negative one


@dataclass(frozen=True)
class SpikingSettings(ControllerSettings):
    """Settings of the controller; any other name is a parameter of its network.

    Attributes:
        network: one of `neuro_models`, a YAML file, or the network itself.
        eta: dopamine of the positive motor for an error of 1 (64 px), 1/ms; the negative motor has the opposite.
        settle: time of the network after which dopamine is halved, ms; it falls as 1 / (1 + time / settle), so that
            weights come to rest instead of following the last moments (Robbins and Monro, 1951).
        gain: factor on the action of eq. 129.
        coding: shares (each cell has its field's share of the events, so that few events steer as well as many),
            rows (its share of its row's), peaks (for textured ground), both as in `fields.shares`, or counts (in
            proportion to the events).
        total: rate of all cells together unless the coding is counts, Hz.
        rate: of a cell for one event in its field when the coding is counts, Hz.
        rate_max: of a cell at most, in either, Hz.
        start: weights before learning: equal (the network's own), sign or linear, see `fields.pattern`.
        strength: mean of the weights by sign or linear, pA; they lie between 0 and twice that.
        backend: what runs the network while it learns.
        options: of that backend, by name; on loihi `signals` is eta if not said.
        learns: whether the network does; if not, its synapses are static.
        parameters: of the network.
    """

    network: str | neuro.Network = "drone"
    eta: float = setting(0.1)
    settle: float = setting(500_000.0, "ms", above=0)
    gain: float | tuple[float, ...] = setting(2.0, above=0)
    coding: str = setting("shares", words=("shares", "rows", "peaks", "counts"))
    total: float = setting(400.0, "Hz", above=0)
    rate: float = setting(20.0, "Hz", above=0)
    rate_max: float = setting(400.0, "Hz", above=0)
    start: str = setting("equal", words=("equal", "sign", "linear"))
    strength: float = setting(1500.0, "pA", above=0)
    backend: str = "event"
    options: Mapping[str, Any] = field(default_factory=dict)
    learns: bool = field(default=True, metadata={"fixed": True})
    parameters: Mapping[str, Any] = field(default_factory=dict, metadata={"fixed": True})

    def changed(self, values: Mapping[str, Any]) -> Self:
        """Return settings with some values changed; any other name is a parameter of the network."""
        own = {name: value for name, value in values.items() if self.takes(name)}
        rest = {name: value for name, value in values.items() if name not in own}
        return replace(super().changed(own), parameters={**self.parameters, **rest})

    def as_words(self) -> dict[str, Any]:
        """Return all values and parameters as plain data; a network that is no name and no file is left out."""
        words = super().as_words() | dict(self.parameters)
        return {name: value for name, value in words.items() if not isinstance(value, neuro.Network)}


class Spiking:
    """A network with 64 cells, whose rates follow the events in their fields, and two motors an axis.

    An action is the difference of a pair's spikes over the most that are possible. After each step the error of an
    axis is the dopamine of its positive motor and, with the opposite sign, of its negative one.

    Args:
        scenario: gives the time of a step and the sides of the fields.
        seed: of the network.
        settings: see there.

    Attributes:
        net: the network before learning.
        sim: it in execution.

    Raises:
        ModelError: the network has no fitting populations, or cannot be run as described.

    Source: thesis, sections 7.2.2, 7.3.4 and 7.3.5 (eq. 129) and section 7.3.7 (rewards linear in the distance,
        opposite in sign). Rates and eta are measured choices.
    """

    def __init__(self, scenario: Scenario, seed: int, settings: SpikingSettings) -> None:
        self._scenario, self._seed, self._settings = scenario, seed, settings
        self.net = net = _load(settings, scenario.axes)
        self._signals = [s.name for s in net.signals.values() if s.to == MOTORS] if settings.learns else []
        run = net if settings.learns else net.frozen()
        self.sim = _compile(run, settings, seed)
        if settings.start != "equal":
            self._start_from(pattern(scenario, settings.start))
        gains = each_axis("gain", settings.gain, scenario.axes)
        self._factor = (gains / _most_spikes(net, scenario.step)).tolist()
        self._rate, self._fired = self.sim.port(CELLS, "rate"), self.sim.port(MOTORS, "counts")
        self._rewards = [self.sim.port(name) for name in self._signals]
        self._counts = np.zeros(2 * scenario.axes, dtype=np.int64)

    def _start_from(self, wished: Floats) -> None:
        name = f"{CELLS}_{MOTORS}"
        weights = self._settings.strength * (1.0 + wished[:, :, None] * SIDES).ravel()
        projection = {p.name: p for p in self.sim.program.projections}.get(name)
        if projection is None or projection.size != weights.size:
            raise neuro.ModelError(
                f"start = {self._settings.start}: expected a projection '{name}' of all cells to all motors",
                hint="start = equal takes the network's own weights",
            )
        self.sim.set_weights(name, weights)

    def begin(self) -> None:
        """Take away the dopamine; without learning also begin at time 0, so that no episode depends on another."""
        for reward in self._rewards:
            reward.set(0.0)
        if not self._settings.learns:
            self.sim.reset()

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Run the network for a step; the action is the difference of the motors' spikes."""
        sim, s = self.sim, self._settings
        rates = s.rate * counts.ravel() if s.coding == "counts" else s.total * shares(counts, s.coding)
        self._rate.set(np.minimum(s.rate_max, rates))
        sim.forget(before=sim.time)
        sim.run(self._scenario.step)
        fired = self._fired.get(self._counts).tolist()
        pairs = zip(self._factor, fired[0::2], fired[1::2], strict=True)
        return np.array([max(-1.0, min(1.0, factor * (a - b))) for factor, a, b in pairs])

    def learn(self, info: Mapping[str, Any]) -> None:
        """Set the dopamine of the next step."""
        if self._signals:
            eta = self._settings.eta / (1.0 + self.sim.time / self._settings.settle)
            errors = info["supervised_error"].tolist()
            dopamine = np.array([side * eta * error for error in errors for side in SIDES])
            for reward in self._rewards:
                reward.set(dopamine)

    def network(self) -> neuro.Network:
        """The network with the weights of now."""
        return self.sim.network()

    def learnt(self) -> dict[str, npt.NDArray[Any]]:
        """The weights of each projection, in the form of `Simulation.weights`."""
        weights = {part.name: self.sim.weights(part.name) for part in self.sim.program.projections}
        return {name: np.array(each[2] if isinstance(each, tuple) else each) for name, each in weights.items()}

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """The whole state of the simulation, as the bytes of the file that it saves."""
        with tempfile.TemporaryDirectory() as folder:
            self.sim.save(Path(folder) / "state.h5")
            return {"simulation": np.fromfile(Path(folder) / "state.h5", np.uint8)}

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take up weights, or a whole state."""
        if "simulation" not in state:
            for name, weights in state.items():
                self.sim.set_weights(name, weights)
            return
        with tempfile.TemporaryDirectory() as folder:
            state["simulation"].tofile(Path(folder) / "state.h5")
            self.sim.restore(Path(folder) / "state.h5")

    def frozen(self, backend: str = "event") -> Spiking:
        """The network with the weights of now and static synapses: no dopamine, and nothing learns."""
        now: dict[str, Any] = {"network": self.network(), "start": "equal", "parameters": {}}
        settings = replace(self._settings, **now, learns=False, backend=backend, options={})
        return Spiking(self._scenario, self._seed, settings)


def _load(settings: SpikingSettings, axes: int) -> neuro.Network:
    """The network, if it has what a controller needs."""
    net = settings.network
    if not isinstance(net, neuro.Network):
        file = network_path(net) if net in names() else Path(net)
        net = neuro.load(file, params=settings.parameters)
    for name, size, what in ((CELLS, 64, "one a field of the picture"), (MOTORS, 2 * axes, "two an axis")):
        found = net.populations.get(name)
        if found is None or prod(n for n in found.shape if isinstance(n, int)) != size:
            has = "none" if found is None else f"one of shape {list(found.shape)}"
            raise neuro.ModelError(
                f"network '{net.name}': expected a population '{name}' of {size}, {what}: found {has}"
            )
    if not isinstance(net.populations[CELLS].model, neuro.poisson_generator):
        raise neuro.ModelError(f"network '{net.name}': expected '{CELLS}' to be a poisson_generator, whose rate is set")
    return net


def _compile(net: neuro.Network, settings: SpikingSettings, seed: int) -> neuro.Simulation:
    """The network in execution; Loihi gets the largest dopamine there will be, from which its units follow."""
    options, largest = dict(settings.options), abs(settings.eta)
    listening = [p.name for p in net.projections.values() if getattr(p.synapse, "signal", None)]
    if settings.backend != "loihi" or not listening or not largest:
        sim: neuro.Simulation = neuro.compile(net, backend=settings.backend, seed=seed, **options)
        return sim
    options.setdefault("signals", dict.fromkeys(listening, largest))
    try:
        sim = neuro.compile(net, backend="loihi", seed=seed, **options)
        return sim
    except neuro.ModelError as error:
        raise neuro.ModelError(f"learning with eta = {settings.eta:g}: {error}", hint=WAY) from None


def _most_spikes(net: neuro.Network, step: float) -> float:
    """How often a motor can fire in a step of so many ms, as its refractory time allows."""
    if not isclose(step / net.resolution, round(step / net.resolution), rel_tol=1e-9):
        found = f"network '{net.name}': resolution = {net.resolution:g} ms"
        raise neuro.ModelError(f"{found}: expected a whole part of the step of {step:g} ms")
    rest = getattr(net.populations[MOTORS].model, "t_ref", 0.0)
    return max(1.0, step / max(float(np.max(rest)), net.resolution))
