"""Episodes of a closed loop: their log, the ends of a run, and tests without learning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from neuro.core.checks import check
from neuro.core.errors import ModelError
from neuro.core.quantities import Quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]


def episode_seed(seed: int, number: int) -> int:
    """Return the seed of an episode of an environment, 32 bits."""
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


class Log:
    """Log of the episodes of a training, in the order of their ends.

    Attributes:
        returns: sum of the rewards of each episode, (episodes,).
        lengths: number of control steps of each episode, (episodes,).
        steps: number of control steps of all environments up to the end of each episode, (episodes,).
        solved: True if the requested mean return was reached, False if not, None if the training had no such goal.
    """

    def __init__(self, returns: Any = (), lengths: Any = (), steps: Any = (), solved: bool | None = None) -> None:
        self._returns, self._lengths, self._steps = list(returns), list(lengths), list(steps)
        self.solved = solved

    def __repr__(self) -> str:
        n = len(self)
        if not n:
            return "Log(no episode)"
        solved = {None: "", False: ", not solved", True: ", solved"}[self.solved]
        mean = f"mean return of the last {min(n, 100)}: {self.mean(100):g}"
        return f"Log({n} episodes, {self._steps[-1]:,} steps, {mean}{solved})"

    def __len__(self) -> int:
        return len(self._returns)

    @property
    def returns(self) -> Floats:
        """Sum of the rewards of each episode."""
        return np.array(self._returns, dtype=np.float64)

    @property
    def lengths(self) -> Ints:
        """Number of control steps of each episode."""
        return np.array(self._lengths, dtype=np.int64)

    @property
    def steps(self) -> Ints:
        """Number of control steps of all environments up to the end of each episode."""
        return np.array(self._steps, dtype=np.int64)

    def add(self, total: float, length: int, step: int) -> None:
        """Add a finished episode."""
        self._returns.append(total)
        self._lengths.append(length)
        self._steps.append(step)

    def mean(self, window: int) -> float:
        """Return the mean return of the last episodes; NaN without episodes."""
        return float(np.mean(self._returns[-window:])) if self._returns else float("nan")

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all entries and the outcome as arrays for a file."""
        solved = np.array([-1 if self.solved is None else self.solved], dtype=np.int8)
        return {"returns": self.returns, "lengths": self.lengths, "steps": self.steps, "solved": solved}

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Log:
        """Return the log in `arrays`. Older files lack the outcome."""
        returns, lengths, steps = (arrays[name].tolist() for name in ("returns", "lengths", "steps"))
        solved = int(arrays["solved"][0]) if "solved" in arrays else -1
        return cls(returns, lengths, steps, None if solved < 0 else bool(solved))

    def plot(self, bar: float | None = None) -> Figure:
        """Draw the return of each episode, the mean of 100 episodes, and a bar to reach."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7, 3.2), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(self.returns, ".", markersize=2, color="0.6", label="episode")
        if len(self) >= 2:
            window = min(100, len(self))
            mean = np.convolve(self.returns, np.full(window, 1 / window), "valid")
            axes.plot(np.arange(window - 1, len(self)), mean, label=f"mean of {window}")
        if bar is not None:
            axes.axhline(bar, linestyle=":", color="0.3", label=f"{bar:g}")
        axes.set_xlabel("episode")
        axes.set_ylabel("return")
        axes.legend(frameon=False)
        return figure


class Test:
    """Episodes without learning.

    Attributes:
        returns: sum of the rewards of each episode, (episodes,).
        lengths: number of control steps of each episode, (episodes,).
    """

    __test__ = False  # pytest must not collect this class

    def __init__(self, returns: Floats, lengths: Ints) -> None:
        self.returns, self.lengths = returns, lengths

    @property
    def mean(self) -> float:
        """Mean return."""
        return float(self.returns.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the mean by the normal distribution; NaN for a single episode."""
        n = len(self.returns)
        half_width = 1.96 * float(self.returns.std(ddof=1)) / float(np.sqrt(n)) if n > 1 else float("nan")
        return self.mean - half_width, self.mean + half_width

    def __repr__(self) -> str:
        if len(self.returns) == 1:
            return f"Test(1 episode, return {self.mean:g})"
        low, high = self.interval
        return f"Test({len(self.returns)} episodes, mean return {self.mean:g}, 95 % {low:g} to {high:g})"


@dataclass(frozen=True, slots=True)
class End:
    """Conditions that end a training. The first condition that holds ends the training.

    Attributes:
        until: mean return of the last `window` episodes.
        steps, episodes: largest number of steps or episodes.
        window: number of episodes of the mean.
    """

    until: float | None = None
    steps: int | None = None
    episodes: int | None = None
    window: int = 100

    def __post_init__(self) -> None:
        if self.until is None and self.steps is None and self.episodes is None:
            raise ModelError("found no end: expected until, steps or episodes", hint="e.g. until=475.0")
        if self.until is not None:
            object.__setattr__(self, "until", check(Quantity(), self.until, "until"))
        for name, value in (("steps", self.steps), ("episodes", self.episodes), ("window", self.window)):
            if value is not None:
                object.__setattr__(self, name, check(Quantity(kind="integer", at_least=1), value, name))

    def reached(self, log: Log) -> bool:
        """Return True if the episodes so far end a training."""
        if self.until is not None and not log.solved:
            log.solved = len(log) >= self.window and log.mean(self.window) >= self.until
        return bool(log.solved) or (self.episodes is not None and len(log) >= self.episodes)


class Sums:
    """Returns and lengths of the episodes in progress.

    Args:
        n: number of parallel episodes.
    """

    def __init__(self, n: int) -> None:
        self._total, self._now, self._begun = np.zeros(n), 0, [0] * n

    def add(self, log: Log, steps: int, reward: Floats, over: Bools) -> bool:
        """Count a control step of all episodes, move finished ones to the log, and return whether there are any.

        The step after the end of an episode only begins the next one.
        """
        self._total += reward
        self._now += 1
        if not np.count_nonzero(over):
            return False
        for k in np.flatnonzero(over):
            log.add(float(self._total[k]), self._now - self._begun[k], steps)
            self._total[k], self._begun[k] = 0.0, self._now + 1
        return True
