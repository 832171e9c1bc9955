"""Spiking neurons learn what a reward is worth from each place on the way to it.

An animal runs along a track of 4 s, again and again, to a reward of 100 at the end. A critic of 20 neurons, which hear
the cells of places, learns by the temporal-difference error. Its value should become 100 exp(-(T - t) / tau_r).
Source: Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013. Network and
world are `linear_track.yaml` of `neuro_models`. Writes linear_track.png.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

import neuro
import neuro_models
from neuro_models import worlds

TOGETHER = 20  # runs of which the mean is taken


def learn(seed: int, runs: int) -> npt.NDArray[np.float64]:
    """The value along the track, of each run."""
    loop = neuro.closed_loop(neuro.load(neuro_models.path("linear_track")), seed=seed, record=True)
    loop.run(episodes=runs)
    return worlds.values(loop)


def error(values: npt.NDArray[np.float64]) -> float:
    """Root of the mean square of the mean run's difference from the expected value, over that of the expected value."""
    expected = worlds.Track.expected()
    return float(np.sqrt(np.mean((values.mean(axis=0) - expected) ** 2) / np.mean(expected**2)))


def figure(values: npt.NDArray[np.float64]) -> Figure:
    """The value after more and more runs."""
    drawing, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    times = np.arange(20.0, 4001.0, 20.0)
    blocks = range(0, len(values), TOGETHER)
    for begin, shade in zip(blocks, np.linspace(0.2, 0.9, len(blocks)), strict=True):
        end = min(begin + TOGETHER, len(values))
        colour = plt.cm.viridis_r(shade)
        axes.plot(times / 1000.0, values[begin:end].mean(axis=0), color=colour, label=f"runs {begin + 1} to {end}")
    axes.plot(times / 1000.0, worlds.Track.expected(), "k--", label="expected")
    axes.set(xlabel="time on the track (s)", ylabel="value")
    axes.legend(frameon=False)
    return drawing


def main() -> None:
    """Learn with each seed; draw the first."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=100)
    options.add_argument("--seeds", type=int, default=1)
    asked = options.parse_args()
    for seed in range(1, asked.seeds + 1):
        values = learn(seed, asked.runs)
        if seed == 1:
            figure(values).savefig("linear_track.png", dpi=150)
        print(f"seed {seed}: relative rms of the mean of the last {TOGETHER} runs: {error(values[-TOGETHER:]):.3f}")


if __name__ == "__main__":
    main()
