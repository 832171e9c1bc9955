"""The spiking network: rates in, spikes out, dopamine back, as its world says."""

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

CELLS, MOTORS, USUAL = "cells", "motors", "drone"
SIDES = (1.0, -1.0)  # of each axis: the positive motor, the negative one
WORLD = ("eta", "settle", "gain", "coding", "total")
"""Parameters of the usual world, which a network that has none gets."""

EPISODES = {"ball": 100, "line": 1000}
"""Most steps of an episode of training: 20,000 steps then begin at 200 places round the ball, so that all fields learn;
on a line the first corner is 400 steps away."""

LINE = {"gain": [8.0, 4.0], "coding": "rows", "total": 800.0, "eta": 0.03}
"""Parameters that differ for a line: a drone that turns too quickly swings its picture to the side; the lean is read
from differences between rows, hence their equal say and more spikes."""


@dataclass(frozen=True)
class SpikingSettings(ControllerSettings):
    """Settings of the controller; any other name is a parameter of its network.

    Attributes:
        network: one of `neuro_models`, a YAML file, or the network itself. One without a world gets that of the network
            `drone`, whose parameters `WORLD` are then settings, too.
        start: weights before learning: equal (the network's own), sign or linear, see `simple.pattern`.
        strength: mean of the weights by sign or linear, pA; they lie between 0 and twice that.
        backend: what runs the network while it learns.
        options: of that backend, by name.
        parameters: of the network.
    """

    network: str | neuro.Network = USUAL
    start: str = setting("equal", words=("equal", "sign", "linear"))
    strength: float = setting(1500.0, "pA", above=0)
    backend: str = "event"
    options: Mapping[str, Any] = field(default_factory=dict)
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

    An action is the difference of a pair's spikes over the most that are possible (eq. 129), times a gain that the
    thesis does not have, cut at -1 and 1. After each step the error of an
    axis is the dopamine of its positive motor and, with the opposite sign, of its negative one: so says its world.

    Args:
        scenario: gives the time of a step and the sides of the fields.
        seed: of the network.
        settings: see there.

    Attributes:
        net: the network before learning.
        world: of it.
        settings: as given.

    Raises:
        ModelError: there is no such network or parameter.

    Source: thesis, sections 7.2.2, 7.3.4 and 7.3.5 (eq. 129) and section 7.3.7 (rewards linear in the distance,
        opposite in sign). Rates and eta are measured choices.
    """

    def __init__(self, scenario: Scenario, seed: int, settings: SpikingSettings) -> None:
        self.settings, net = settings, _described(scenario, settings)
        self.net = net if settings.start == "equal" else _started(net, scenario, settings)
        assert self.net.world_section is not None
        self.world = self.net.world_section = replace(self.net.world_section, step=scenario.step)

    def loop(self, env: Any, **words: Any) -> neuro.ClosedLoop:
        """Return the closed loop in which the network learns; the words are those of `neuro.closed_loop`."""
        return neuro.closed_loop(self.net, env, backend=self.settings.backend, **words, **self.settings.options)


def _described(scenario: Scenario, settings: SpikingSettings) -> neuro.Network:
    """The network with its world, or the usual one."""
    usual, said = network_path(USUAL), dict(settings.parameters)
    defaults = {"episode": EPISODES[scenario.kind], "scenario": scenario.name, "axes": scenario.axes}
    defaults |= LINE if scenario.kind == "line" else {}
    net = settings.network
    if net == USUAL:
        return neuro.load(usual, params=defaults | said)
    if not isinstance(net, neuro.Network):
        file = network_path(net) if net in names() else Path(net)
        net = neuro.load(file, params={name: value for name, value in said.items() if name not in WORLD})
        if net.world_section is not None:
            return neuro.load(file, params=said)
        net.world_origin = Where(str(file))
    if net.world_section is None:
        world = neuro.load(usual, params=defaults | {name: said[name] for name in WORLD if name in said}).world_section
        assert world is not None
        (teacher,) = world.reward.values()
        taught = {signal.name: teacher for signal in net.signals.values() if signal.to == MOTORS}
        net.world_section = replace(world, reward=taught or None)
    return net


def _started(net: neuro.Network, scenario: Scenario, settings: SpikingSettings) -> neuro.Network:
    """The network with weights by the sides of the fields."""
    name, sim = f"{CELLS}_{MOTORS}", neuro.compile(net)
    wished = pattern(scenario, settings.start)
    weights = settings.strength * (1.0 + wished[:, :, None] * SIDES).ravel()
    projection = {p.name: p for p in sim.program.projections}.get(name)
    if projection is None or projection.size != weights.size:
        raise neuro.ModelError(
            f"start = {settings.start}: expected a projection '{name}' of all cells to all motors",
            hint="start = equal takes the network's own weights",
        )
    sim.set_weights(name, weights)
    return sim.network()
