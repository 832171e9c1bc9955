"""The training curve: how well a controller would fly if it learnt no more; exploration and dopamine hide that."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_drone.controllers import Learner
from neuro_drone.env import DroneEnv
from neuro_drone.paths import drawn
from neuro_drone.scenario import Scenario

__all__ = ["EVERY", "Curve"]

EVERY = 1000
"""Steps of training from one test to the next."""

FLIGHTS, STEPS = 2, 60
"""Of a test: an eighth of the steps that are learnt from. The first half of a flight is the way to the target."""

SEED = 2_000_016
"""Of starts, paths and noise: the same in every test, and not those of a training or of `neuro drone test`.

It is the first from 2,000,000 on with which the two balls begin in opposite quarters of the picture, more than 25 px
off on each axis, and the two lines on opposite sides, more than 10 px off, one in each direction.
"""

_KINDS = {"steps": np.int64, "error_px": np.float64, "lost": np.int64}


class Curve:
    """Tests of frozen weights along a training, which neither it nor its randomness is touched by.

    The error is that in the picture, as in the history of a training: of a line that of its column, and where the drone
    climbs that of the ball's place. The other axes tell in the flights that are lost.

    Args:
        scenario: of the training.
        found: what `arrays` gave, to go on from there.
    """

    def __init__(self, scenario: Scenario, found: Mapping[str, npt.NDArray[Any]] | None = None) -> None:
        self._env, self._line = DroneEnv(scenario), scenario.kind == "line"
        self._points: dict[str, list[Any]] = {name: found[name].tolist() if found else [] for name in _KINDS}

    def follow(self, learner: Learner, done: int) -> None:
        """Test once if a test was due since the last.

        Args:
            learner: as it is after so many steps.
            done: steps of the training.
        """
        last = self._points["steps"][-1] if self._points["steps"] else 0
        if done // EVERY == last // EVERY:
            return
        pilot = learner.frozen()
        flown = [self._fly(pilot, index) for index in range(FLIGHTS)]
        errors, lost = zip(*flown, strict=True)
        for name, value in zip(_KINDS, (done, float(np.mean(errors)), sum(lost)), strict=True):
            self._points[name].append(value)

    def _fly(self, pilot: Any, index: int) -> tuple[float, bool]:
        """Mean error of the second half of a flight, and whether the target was lost; then the last error stays."""
        rng = np.random.default_rng((SEED, index))
        _, info = self._env.reset(seed=int(rng.integers(2**31)), options={"path": drawn(rng, self._line)})
        pilot.begin()
        errors: list[float] = []
        lost = over = False
        while len(errors) < STEPS and not (lost or over):
            _, _, lost, over, info = self._env.step(pilot.act(info["counts"], info))
            errors.append(info["error_px"])
        errors += errors[-1:] * (STEPS - len(errors))
        return float(np.mean(errors[STEPS // 2 :])), lost

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """One value a test: steps of the training, error_px (mean of the flights) and lost (how many)."""
        return {name: np.array(self._points[name], kind) for name, kind in _KINDS.items()}

    def close(self) -> None:
        """No test follows."""
        self._env.close()
