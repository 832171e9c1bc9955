"""Imitation: a controller learns the oracle's actions from the camera's events."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.apps import needed, setting
from neuro_drone.controllers.deep import Dense, Flier, Floats, Singles, alone, observed
from neuro_drone.controllers.simple import Gain, Oracle
from neuro_drone.scenario import Scenario

RIDGE = 1e-3
"""Ridge penalty of the least-squares fit, which keeps the weights of fields with few events small."""


@dataclass(frozen=True)
class ImitationSettings(Gain):
    """Settings of imitation; `gain` is the oracle's.

    Attributes:
        expert: factor by which the share of steps that the oracle flies changes after each round. The oracle flies the
            whole first round. 1 is behavioural cloning, a smaller factor is DAgger.
        round: steps between two fits.
        coding: shares, rows or peaks, see `simple.shares`.
        hidden: units of each of two hidden layers, which need torch; 0 is a linear readout by least squares.
        updates: updates of the hidden layers in a fit; each fit begins with new weights.
        batch: steps per update.
        rate: learning rate of Adam.
    """

    expert: float = setting(1.0, at_least=0, at_most=1)
    round: int = setting(1000, at_least=1)
    coding: str = setting("shares", words=("shares", "rows", "peaks"))
    hidden: int = setting(0, at_least=0)
    updates: int = setting(2000, at_least=1)
    batch: int = setting(64, at_least=1)
    rate: float = setting(1e-3, above=0)


class Imitation:
    """A controller that records inputs with the oracle's actions, and fits a function from the inputs to the actions.

    In each step of round i, the oracle flies with probability `expert`^(i - 1). In all other steps, the fit of all
    previous rounds flies.

    Args:
        scenario: scenario of the flights; only its number of axes matters.
        seed: seed of the choice between oracle and fit, and of the hidden layers.
        settings: see `ImitationSettings`.

    Source: thesis, section 4.8.1 and algorithm 11; S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation
        learning and structured prediction to no-regret online learning", AISTATS 2011.
    """

    def __init__(self, scenario: Scenario, seed: int, settings: ImitationSettings) -> None:
        self._settings, self._seed, self._axes = settings, seed, scenario.axes
        self._oracle = Oracle(scenario, seed, settings)
        self._rng = np.random.default_rng((seed, 5))
        self._inputs: list[Singles] = []
        self._actions: list[Floats] = []
        self._learnt: dict[str, npt.NDArray[Any]] = {}
        self._begin_round()

    def _begin_round(self) -> None:
        """Fit the steps of the previous rounds, unless the oracle flies all steps of this round."""
        rounds, n_left = divmod(len(self._inputs), self._settings.round)
        self._share = self._settings.expert**rounds
        if self._share < 1.0:
            self._flier = self._make_flier(self._fit(len(self._inputs) - n_left))

    def _make_flier(self, arrays: Mapping[str, npt.NDArray[Any]]) -> Flier:
        """Return the controller without learning, with the layers of `_fit`."""
        dense = Dense(arrays, sorted({name.split(".")[0] for name in arrays}))
        return Flier(dense, lambda out: np.clip(out.astype(np.float64), -1.0, 1.0), self._settings.coding)

    def begin(self) -> None:
        """Begin an episode; raise an error if the settings need torch and torch is not installed."""
        if self._settings.hidden:
            needed("torch", "torch", f"{self._settings.place()}: hidden = {self._settings.hidden} needs torch")

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the action of the oracle or, by chance, of the fit. The oracle's action is stored for the next fit."""
        self._last_step = observed(counts, self._settings.coding), self._oracle.act(counts, info)
        return self._last_step[1] if self._rng.random() < self._share else self._flier.act(counts, info)

    def learn(self, info: Mapping[str, Any]) -> None:
        """Record the input and the oracle's action of the step, and fit all steps at the end of a round."""
        inputs, actions = self._last_step
        self._inputs.append(inputs)
        self._actions.append(actions)
        if len(self._inputs) % self._settings.round == 0:
            self._begin_round()

    def _fit(self, steps: int) -> dict[str, npt.NDArray[Any]]:
        """Return weights and biases of each layer, fitted to the first `steps` steps."""
        inputs = np.array(self._inputs[:steps], np.float32).reshape(-1, 64)
        actions = np.array(self._actions[:steps]).reshape(-1, self._axes)
        s = self._settings
        if not s.hidden:
            exact = inputs.astype(np.float64)
            # einsum runs in one thread; a threaded matrix product waits for its slowest thread on busy cores.
            gram, products = np.einsum("ki,kj->ij", exact, exact), np.einsum("ki,ka->ia", exact, actions)
            weights = np.linalg.solve(gram + RIDGE * np.eye(64), products).T
            return {"0.weight": weights.astype(np.float32), "0.bias": np.zeros(self._axes, np.float32)}
        import torch

        with alone(self._seed):
            nn = torch.nn
            first, second = nn.Linear(64, s.hidden), nn.Linear(s.hidden, s.hidden)
            net = nn.Sequential(first, nn.ReLU(), second, nn.ReLU(), nn.Linear(s.hidden, self._axes))
            adam = torch.optim.Adam(net.parameters(), lr=s.rate, fused=True)
            x, y = torch.from_numpy(inputs), torch.from_numpy(actions.astype(np.float32))
            for batch in torch.randint(max(steps, 1), (s.updates if steps else 0, s.batch)):
                adam.zero_grad()
                loss: Any = nn.functional.mse_loss(net(x[batch]), y[batch])
                loss.backward()
                adam.step()
            return {name: tensor.numpy().copy() for name, tensor in net.state_dict().items()}

    def learnt(self) -> dict[str, npt.NDArray[Any]]:
        """Return weights and biases of the layers, fitted to all steps, or the restored ones before the first step."""
        return self._fit(len(self._inputs)) if self._inputs or not self._learnt else self._learnt

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return the inputs and the oracle's actions of all steps, and the state of the random generator."""
        rng = json.dumps(self._rng.bit_generator.state).encode()
        return {
            "inputs": np.array(self._inputs, np.float32).reshape(-1, 64),
            "actions": np.array(self._actions).reshape(-1, self._axes),
            "rng": np.frombuffer(rng, np.uint8),
        }

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Restore layers or a whole state. With layers only, the rounds begin again."""
        if "rng" not in state:
            self._learnt = dict(state)
            return
        self._inputs, self._actions = list(state["inputs"]), list(state["actions"])
        self._rng.bit_generator.state = json.loads(state["rng"].tobytes())
        self._begin_round()

    def frozen(self) -> Flier:
        """Return the fit of all steps, without the oracle."""
        return self._make_flier(self.learnt())
