"""An actor and a critic that learn the way through a grid, from one corner to the opposite.

Each place has cells that fire regularly while the agent is there. After 100 ms the action whose actor neurons fired
most is taken. The critic's rate above a baseline is the value V of the place, and the error of a move,
r + discount x V' - V, teaches both: the critic what places are worth, and the actor to do again what turned out better
than expected. Source of the idea: Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013; the design and
its numbers are measured choices.

Without the baseline, or with V below 0, moves that lead nowhere become attractive; without a smallest weight neurons
fall silent and never learn again; if what was not done learnt nothing, all actions would grow together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import neuro
from neuro import ModelError

__all__ = ["DISCOUNT", "MOVE", "Agent", "World", "network"]

Floats = NDArray[np.float64]
Place = tuple[int, int]

MOVE = 100.0
"""ms of a move."""
DISCOUNT = 0.9
"""Worth of a reward one move later."""

_ACTIONS = ((0, 1), (1, 0), (0, -1), (-1, 0))
_CELLS, _EVERY = 10, 10.0  # of a place; ms between two spikes of one
_OF_ACTION, _CRITICS = 5, 40
_BASELINE = 25.4  # Hz, of the critic before it has learnt
_NOT_DONE = -0.33  # share of the error for the actions that were not taken


@dataclass(frozen=True)
class World:
    """A square of places with walls around; the agent begins at (0, 0).

    Args:
        side: places in a row.
        goal: reward in the last corner, in Hz of the critic.
        wall: reward of a move against a wall, which leads nowhere.
    """

    side: int = 5
    goal: float = 60.0
    wall: float = -5.0

    def step(self, place: Place, action: int) -> tuple[Place, float, bool]:
        """The place after an action (0 right, 1 down, 2 left, 3 up), the reward, and whether it is the goal."""
        y, x = place[0] + _ACTIONS[action][0], place[1] + _ACTIONS[action][1]
        if not (0 <= y < self.side and 0 <= x < self.side):
            return place, self.wall, False
        there = y == x == self.side - 1
        return (y, x), self.goal if there else 0.0, there


def network(side: int = 5, actor_eta: float = 0.06, critic_eta: float = 0.04) -> neuro.Network:
    """Cells of `places`, shape (y, x, cell), all to the `actor`, shape (action, neuron), and to the `critic`.

    Args:
        side: places in a row.
        actor_eta: learning rate of the projection `policy`, pA/Hz.
        critic_eta: that of `value`.

    Raises:
        ModelError: side is below 2.
    """
    if side < 2:
        raise ModelError(f"grid_world: side = {side}: expected at least 2")
    cells = neuro.srm0(tau_m=10.0, tau_syn_ex=2.0, E_L=0.0, V_th=16.0, eta_0=5.0, t_ref=0.0, lambda_0=60.0, Delta_V=2.0)
    net = neuro.Network("grid_world", resolution=1.0)
    net.population("places", (side, side, _CELLS), neuro.spike_generator())
    learners = (("actor", (len(_ACTIONS), _OF_ACTION), "policy", actor_eta), ("critic", _CRITICS, "value", critic_eta))
    for name, shape, learnt, eta in learners:
        error = f"{name}_error"
        net.population(name, shape, cells)
        net.signal(error, to=name)
        rule = neuro.td_moves(signal=error, tau_m=10.0, tau_s=2.0, move=MOVE, eta=eta, Wmin=60.0, Wmax=600.0)
        net.connect("places", name, neuro.all_to_all(), rule, weight=190.0, delay=1.0, name=learnt)
    return net


@dataclass(frozen=True)
class _Move:
    """A move whose error is not known yet."""

    value: float
    reward: float
    action: int
    ends: bool


class Agent:
    """Plays episodes in a world, and learns.

    Args:
        sim: of `network`, with the world's side.
        world: where it is.
        seed: of the choices between equal numbers of spikes.
        critic: whether it expects anything; if not, V is 0 and the error is the reward alone.

    Attributes:
        values: V where the agent was last, in Hz, shape (y, x); not a number where it has never been.
    """

    def __init__(self, sim: neuro.Simulation, world: World, seed: int, critic: bool = True) -> None:
        self.values: Floats = np.full((world.side, world.side), np.nan)
        self._sim, self._world, self._critic = sim, world, critic
        self._rng = np.random.default_rng(seed)
        self._last: _Move | None = None
        self._times = np.add.outer(1.0 + np.arange(_CELLS), np.arange(0.0, MOVE, _EVERY))

    def episode(self, limit: int = 2000) -> int:
        """Go from the start to the goal; return the number of moves, `limit` if it was not reached."""
        place, moves, ends = (0, 0), 0, False
        while not ends and moves < limit:
            action, value = self._perceive(place)
            self._teach(value)
            place, reward, ends = self._world.step(place, action)
            self._last = _Move(value, reward, action, ends)
            moves += 1
        if not ends:
            self._last = None
        return moves

    def _perceive(self, place: Place) -> tuple[int, float]:
        """A move of the network: the action, and the value of the place."""
        sim = self._sim
        begin = sim.time
        first = (place[0] * self._world.side + place[1]) * _CELLS
        cells = np.repeat(first + np.arange(_CELLS), self._times.shape[1])
        sim.inject("places", (begin + self._times).ravel(), cells)
        sim.run(MOVE)
        votes = np.bincount(sim.spikes("actor", since=begin)[1] // _OF_ACTION, minlength=len(_ACTIONS))
        rate = 1000.0 * sim.spikes("critic", since=begin)[0].size / (_CRITICS * MOVE)
        sim.forget(before=sim.time)
        value = max(0.0, rate - _BASELINE) if self._critic else 0.0
        self.values[place] = value
        return int(self._rng.choice(np.flatnonzero(votes == votes.max()))), value

    def _teach(self, value: float) -> None:
        """The value of the present place tells how good the last move was."""
        if self._last is None:
            error, done = 0.0, np.zeros(len(_ACTIONS))
        else:
            last = self._last
            error = neuro.td_error(last.reward, last.value, 0.0 if last.ends else value, DISCOUNT)
            done = np.where(np.arange(len(_ACTIONS)) == last.action, 1.0, _NOT_DONE)
        self._sim.signal("critic_error", error)
        self._sim.signal("actor_error", error * np.repeat(done, _OF_ACTION))
