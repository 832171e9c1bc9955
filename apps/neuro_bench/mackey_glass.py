"""Mackey-Glass: a chaotic series that goes on by itself, on an own series by NeuroBench's equations."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from neuro import ModelError
from neuro_bench.task import Fold, Series, Task

PARAMETERS = {
    17: (197, 0.7206597), 18: (138, 0.7744313), 19: (315, 0.7783468), 20: (131, 0.9225991), 21: (191, 0.9479431),
    22: (119, 0.5455960), 23: (106, 0.8622247), 24: (97, 0.3259660), 25: (98, 0.8297825), 26: (104, 1.0033490),
    27: (112, 0.6491406), 28: (119, 1.0957495), 29: (131, 0.9256179), 30: (139, 0.2713639),
}  # fmt: skip
"""By tau the Lyapunov time and the constant past, as NeuroBench lists them (datasets/mackey_glass_parameters.csv)."""
POINTS = 75
"""Of a Lyapunov time."""
TRAIN, TEST = 10, 10
"""Lyapunov times to learn from, and to go on for, as NeuroBench splits."""
TUNING, APART = 3, 24
"""Further series of the same tau that settings are chosen by, and the Lyapunov time from which they begin."""
POINTS_OF_ALL = (APART + TRAIN * TUNING + TEST) * POINTS
"""Of a series that is computed."""
REPEATS = 5
"""Series a tau, each half a Lyapunov time later than the one before, as NeuroBench's, which has 30."""
SUBSTEPS = 20
"""Of the integration, in a unit of time."""


class MackeyGlass(Task):
    """How a series goes on: the method continues it for ten Lyapunov times by itself.

    The series are our own, by NeuroBench's equations and parameters, since its files are not shipped; with ``--data``
    a folder of its mg_TAU.npy, they are its own. A figure is comparable with its leaderboard only then.
    """

    kind = "series"
    called_by = "mackey-glass"
    title = "Mackey-Glass, ten Lyapunov times ahead, own series by NeuroBench's equations"
    licence = "none needed: computed from an equation (NeuroBench's files: Apache-2.0)"
    source = "Yik et al., Nature Communications 16:1545, 2025; Mackey and Glass, Science 197:287, 1977"
    metric = "sMAPE, %"
    higher = False
    needs_data = False
    splits = (*(f"tau{tau}" for tau in PARAMETERS), "all")

    def folds(self) -> Sequence[Fold]:
        """Five series for each tau, with the same further series to choose settings by.

        Raises:
            ModelError: a file of the data is missing or too short.
        """
        taus = list(PARAMETERS) if self.split == "all" else [int(self.split.removeprefix("tau"))]
        train, test, folds = TRAIN * POINTS, TEST * POINTS, []
        for tau in taus:
            values, own = self._series(tau), solution(tau, POINTS_OF_ALL)[APART * POINTS :]
            tuned = [own[k * train : (k + 1) * train] for k in range(TUNING)]
            asked = [own[k * train :][:test] for k in range(1, TUNING + 1)]
            for repeat in range(REPEATS):
                seen, name = values[repeat * POINTS // 2 :], f"tau {tau} series {repeat + 1}"
                folds.append(Fold(name, tuned, asked, seen[:train], seen[train : train + test]))
        return folds

    def _series(self, tau: int) -> Series:
        wanted = (TRAIN + TEST) * POINTS + (REPEATS - 1) * POINTS // 2 + 1
        if self.data is None:
            return solution(tau, POINTS_OF_ALL)[:wanted]
        file = self.data / f"mg_{tau}.npy"
        try:
            values: Series = np.asarray(np.load(file, allow_pickle=False), dtype=np.float64).reshape(-1)
        except (OSError, ValueError) as error:
            raise ModelError(f"{file}: cannot be read: {error}: expected a series of NeuroBench") from None
        if len(values) < wanted:
            raise ModelError(f"{file}: {len(values)} values: expected at least {wanted}")
        return values

    def score(self, predicted: Any, wanted: Any) -> float:
        """Symmetric mean absolute percentage error: 200 mean(|p - w| / (|p| + |w|)), 0 to 200."""
        p, w = np.asarray(predicted, dtype=np.float64), np.asarray(wanted)
        if p.shape != w.shape or not np.isfinite(p).all():
            return 200.0
        return 200.0 * float(np.mean(np.abs(p - w) / (np.abs(p) + np.abs(w))))


@cache
def solution(tau: int, points: int, substeps: int = SUBSTEPS) -> Series:
    """The solution of x' = 0.2 x(t - tau) / (1 + x(t - tau)^10) - 0.1 x, 75 points in a Lyapunov time, from t = 0.

    Runge-Kutta of fourth order with an even step that divides the delay; the delayed value between two steps is the
    cubic through their values and slopes, so the error falls with the fourth power of the step. The points are read by
    the same cubic.

    Args:
        tau: the delay, one of `PARAMETERS`.
        points: how many.
        substeps: steps in a unit of time.
    """
    lyapunov, past = PARAMETERS[tau]
    h, lag = 1.0 / substeps, tau * substeps
    steps = int(np.ceil((points - 1) * lyapunov / POINTS * substeps)) + 2
    x, slope = np.empty(steps + 1), np.empty(steps + 1)
    x[0] = past

    def delayed(k: int) -> tuple[float, float, float]:
        """At the beginning, middle and end of the step from k, the value a delay ago."""
        a = k - lag
        if a < 0:
            return past, past, past
        return x[a], (x[a] + x[a + 1]) / 2.0 + h * (slope[a] - slope[a + 1]) / 8.0, x[a + 1]

    def rate(value: float, before: float) -> float:
        return float(0.2 * before / (1.0 + before**10) - 0.1 * value)

    for k in range(steps):
        first, middle, last = delayed(k)
        slope[k] = k1 = rate(x[k], first)
        k2 = rate(x[k] + h / 2.0 * k1, middle)
        k3 = rate(x[k] + h / 2.0 * k2, middle)
        k4 = rate(x[k] + h * k3, last)
        x[k + 1] = x[k] + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    at = np.arange(points) * lyapunov / POINTS * substeps
    n = at.astype(np.int64)
    s = at - n
    slope[steps] = rate(x[steps], x[steps - lag])
    a, b, c, d = x[n], x[n + 1], h * slope[n], h * slope[n + 1]
    values: Series = a * (1 + 2 * s) * (1 - s) ** 2 + b * s**2 * (3 - 2 * s) + c * s * (1 - s) ** 2 - d * s**2 * (1 - s)
    return values
