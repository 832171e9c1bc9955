"""The spiking network as a controller: event rates in, spikes out, dopamine back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import neuro
from neuro.apps import Where, setting
from neuro_drone.controllers.simple import ControllerSettings, pattern
from neuro_drone.scenario import Scenario
from neuro_models import names, path as network_path

CELLS, MOTORS, DEFAULT_NETWORK = "cells", "motors", "drone"
SIDES = (1.0, -1.0)  # signs of the two motors of an axis
WORLD = ("eta", "settle", "gain", "coding", "total")
"""Parameters of the default world, which a network without a world gets."""

EPISODES = {"ball": 100, "line": 1000}
"""Longest training episode, steps. For a ball, 20,000 steps have 200 episodes with different starts, so all fields
learn. Along a line, the first corner is 400 steps away."""

LINE = {"gain": [8.0, 4.0], "coding": "rows", "total": 800.0, "eta": 0.03}
"""Parameters that differ for a line. The gain of turning is smaller, since a fast turn swings the picture to the side.
The lean shows in differences between rows, so rows have equal weight and more spikes."""


@dataclass(frozen=True)
class SpikingSettings(ControllerSettings):
    """Settings of the controller. Any other name is a parameter of its network.

    Attributes:
        network: a name of `neuro_models`, a YAML file, or the network. A network without a world gets the world of the
            network `drone`, whose parameters `WORLD` are then settings, too.
        start: initial weights: equal (those of the network's file), sign or linear, see `simple.pattern`.
        strength: mean initial weight for sign and linear, pA; weights are between 0 and twice the mean.
        backend: backend of the network while it learns.
        options: options of the backend by name.
        parameters: parameters of the network by name.
    """

    network: str | neuro.Network = DEFAULT_NETWORK
    start: str = setting("equal", words=("equal", "sign", "linear"))
    strength: float = setting(1500.0, "pA", above=0)
    backend: str = "event"
    options: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict, metadata={"fixed": True})

    def changed(self, values: Mapping[str, Any]) -> Self:
        """Return settings with some values changed. Any other name is a parameter of the network."""
        setting_values = {name: value for name, value in values.items() if self.takes(name)}
        parameters = {name: value for name, value in values.items() if name not in setting_values}
        return replace(super().changed(setting_values), parameters={**self.parameters, **parameters})

    def as_words(self) -> dict[str, Any]:
        """Return all values and parameters as plain data, without a `Network` object."""
        values = super().as_words() | dict(self.parameters)
        return {name: value for name, value in values.items() if not isinstance(value, neuro.Network)}


class Spiking:
    """A network with 64 cells, whose rates follow the events in their fields, and two motors per axis.

    An action is the difference between the spike counts of an axis' two motors, divided by the largest possible count
    (eq. 129) and multiplied by a gain, then clipped to [-1, 1]. The thesis has no gain. After each step, the dopamine
    of the positive motor is the error of the axis, and the dopamine of the negative motor is the negated error. The
    network's world defines actions and dopamine.

    Args:
        scenario: scenario of the flights.
        seed: seed of the network.
        settings: see `SpikingSettings`.

    Attributes:
        net: the network before learning.
        world: the network's world.
        settings: the settings.

    Raises:
        ModelError: there is no such network or parameter.

    Source: thesis, sections 7.2.2, 7.3.4 and 7.3.5 (eq. 129) and section 7.3.7 (rewards linear in the distance,
        opposite in sign). Rates and eta are measured choices.
    """

    def __init__(self, scenario: Scenario, seed: int, settings: SpikingSettings) -> None:
        self.settings, net = settings, _load_network(scenario, settings)
        self.net = net if settings.start == "equal" else _set_initial_weights(net, scenario, settings)
        assert self.net.world_section is not None
        self.world = self.net.world_section = replace(self.net.world_section, step=scenario.step)

    def loop(self, env: Any, **options: Any) -> neuro.ClosedLoop:
        """Return the closed loop in which the network learns, with keyword arguments of `neuro.closed_loop`."""
        return neuro.closed_loop(self.net, env, backend=self.settings.backend, **options, **self.settings.options)


def _load_network(scenario: Scenario, settings: SpikingSettings) -> neuro.Network:
    """Load the network, and add the default world to a network without a world."""
    default_file, parameters = network_path(DEFAULT_NETWORK), dict(settings.parameters)
    defaults = {"episode": EPISODES[scenario.kind], "scenario": scenario.name, "axes": scenario.axes}
    defaults |= LINE if scenario.kind == "line" else {}
    net = settings.network
    if net == DEFAULT_NETWORK:
        return neuro.load(default_file, params=defaults | parameters)
    if not isinstance(net, neuro.Network):
        file = network_path(net) if net in names() else Path(net)
        net = neuro.load(file, params={name: value for name, value in parameters.items() if name not in WORLD})
        if net.world_section is not None:
            return neuro.load(file, params=parameters)
        net.world_origin = Where(str(file))
    if net.world_section is None:
        world_parameters = {name: parameters[name] for name in WORLD if name in parameters}
        world = neuro.load(default_file, params=defaults | world_parameters).world_section
        assert world is not None
        (teacher,) = world.reward.values()
        teachers = {signal.name: teacher for signal in net.signals.values() if signal.to == MOTORS}
        net.world_section = replace(world, reward=teachers or None)
    return net


def _set_initial_weights(net: neuro.Network, scenario: Scenario, settings: SpikingSettings) -> neuro.Network:
    """Return the network with initial weights from the positions of the fields, see `simple.pattern`."""
    name, sim = f"{CELLS}_{MOTORS}", neuro.compile(net)
    preference = pattern(scenario, settings.start)
    weights = settings.strength * (1.0 + preference[:, :, None] * SIDES).ravel()
    projection = {p.name: p for p in sim.program.projections}.get(name)
    if projection is None or projection.size != weights.size:
        raise neuro.ModelError(
            f"start = {settings.start}: expected a projection '{name}' of all cells to all motors",
            hint="start = equal keeps the network's own weights",
        )
    sim.set_weights(name, weights)
    return sim.network()
