"""Prediction of the chaotic Mackey-Glass series, computed from NeuroBench's equation."""

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
"""Lyapunov time and constant history for each tau, from NeuroBench's datasets/mackey_glass_parameters.csv."""
POINTS = 75
"""Number of points in a Lyapunov time."""
TRAIN, TEST = 10, 10
"""Length of the training and of the test part in Lyapunov times, as in NeuroBench."""
TUNING, APART = 3, 24
"""Number of additional series of the same tau for the choice of settings, and the Lyapunov time at which they begin."""
POINTS_OF_ALL = (APART + TRAIN * TUNING + TEST) * POINTS
"""Number of points of a computed series: for the folds, then for the choice of settings."""
REPEATS = 5
"""Number of series for each tau, which begin half a Lyapunov time apart. NeuroBench has 30 such series."""
SUBSTEPS = 20
"""Number of integration steps in a unit of time."""


class MackeyGlass(Task):
    """Autoregressive prediction of a series for ten Lyapunov times.

    By default the series are computed from NeuroBench's equation and parameters, because its files are not shipped.
    With ``--data FOLDER`` they are read from NeuroBench's files mg_TAU.npy. Only then is a result comparable with
    NeuroBench's leaderboard.
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
        """Return five folds for each tau, which share the validation series.

        Raises:
            ModelError: a data file is missing or too short.
        """
        taus = list(PARAMETERS) if self.split == "all" else [int(self.split.removeprefix("tau"))]
        train, test, folds = TRAIN * POINTS, TEST * POINTS, []
        for tau in taus:
            values, tuning_values = self._series(tau), solution(tau, POINTS_OF_ALL)[APART * POINTS :]
            tuning_train = [tuning_values[k * train : (k + 1) * train] for k in range(TUNING)]
            tuning_test = [tuning_values[k * train :][:test] for k in range(1, TUNING + 1)]
            for repeat in range(REPEATS):
                series, name = values[repeat * POINTS // 2 :], f"tau {tau} series {repeat + 1}"
                folds.append(Fold(name, tuning_train, tuning_test, series[:train], series[train : train + test]))
        return folds

    def _series(self, tau: int) -> Series:
        n_points = (TRAIN + TEST) * POINTS + (REPEATS - 1) * POINTS // 2 + 1
        if self.data is None:
            return solution(tau, POINTS_OF_ALL)[:n_points]
        file = self.data / f"mg_{tau}.npy"
        try:
            values: Series = np.asarray(np.load(file, allow_pickle=False), dtype=np.float64).reshape(-1)
        except (OSError, ValueError) as error:
            raise ModelError(f"{file}: cannot be read: {error}: expected a series of NeuroBench") from None
        if len(values) < n_points:
            raise ModelError(f"{file}: {len(values)} values: expected at least {n_points}")
        return values

    def score(self, predicted: Any, expected: Any) -> float:
        """Return the symmetric mean absolute percentage error, 200 mean(|p - e| / (|p| + |e|)), from 0 to 200."""
        p, e = np.asarray(predicted, dtype=np.float64), np.asarray(expected)
        if p.shape != e.shape or not np.isfinite(p).all():
            return 200.0
        return 200.0 * float(np.mean(np.abs(p - e) / (np.abs(p) + np.abs(e))))


@cache
def solution(tau: int, points: int, substeps: int = SUBSTEPS) -> Series:
    """Integrate x' = 0.2 x(t - tau) / (1 + x(t - tau)^10) - 0.1 x from t = 0.

    The method is Runge-Kutta of fourth order with a step that divides the delay. Delayed values between two steps, and
    the returned points, are read from the cubic Hermite interpolant, so the error falls with the fourth power of the
    step.

    Args:
        tau: the delay, a key of `PARAMETERS`.
        points: number of points.
        substeps: number of integration steps in a unit of time.

    Returns:
        x at equal intervals from t = 0, `POINTS` of them in a Lyapunov time, shape (points,).
    """
    lyapunov, past = PARAMETERS[tau]
    h, lag = 1.0 / substeps, tau * substeps
    steps = int(np.ceil((points - 1) * lyapunov / POINTS * substeps)) + 2
    x, slope = np.empty(steps + 1), np.empty(steps + 1)
    x[0] = past

    def delayed_values(k: int) -> tuple[float, float, float]:
        """Return the delayed value at the beginning, middle and end of step k."""
        a = k - lag
        if a < 0:
            return past, past, past
        return x[a], (x[a] + x[a + 1]) / 2.0 + h * (slope[a] - slope[a + 1]) / 8.0, x[a + 1]

    def rate(value: float, delayed: float) -> float:
        return float(0.2 * delayed / (1.0 + delayed**10) - 0.1 * value)

    for k in range(steps):
        first, middle, last = delayed_values(k)
        slope[k] = k1 = rate(x[k], first)
        k2 = rate(x[k] + h / 2.0 * k1, middle)
        k3 = rate(x[k] + h / 2.0 * k2, middle)
        k4 = rate(x[k] + h * k3, last)
        x[k + 1] = x[k] + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    positions = np.arange(points) * lyapunov / POINTS * substeps  # in steps
    n = positions.astype(np.int64)
    s = positions - n
    slope[steps] = rate(x[steps], x[steps - lag])
    a, b, c, d = x[n], x[n + 1], h * slope[n], h * slope[n + 1]
    values: Series = a * (1 + 2 * s) * (1 - s) ** 2 + b * s**2 * (3 - 2 * s) + c * s * (1 - s) ** 2 - d * s**2 * (1 - s)
    return values
