"""An actor and a critic of spiking neurons learn the way through a grid of places.

The critic learns what each place is worth, and the actor to do again what turned out better than expected. Its twin
expects nothing, so it learns by reward alone. Network and world are `grid_world.yaml` of `neuro_models`. Writes
grid_world.png.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

import neuro
import neuro_models

NOTHING = 1e12  # spikes that would stand for a value of 1: whatever the critic says is 0


def play(side: int, seed: int, episodes: int, critic: bool) -> tuple[list[int], npt.NDArray[np.float64]]:
    """Moves of each episode, and the mean weight onto the critic from each place at the end, pA."""
    net = neuro.load(neuro_models.path("grid_world"), {"side": side} | ({} if critic else {"gain": NOTHING}))
    loop = neuro.closed_loop(net, seed=seed)
    moves = loop.run(episodes=episodes).lengths.tolist()
    return moves, loop.sim.weights("value")[2].reshape(side, side, -1).mean(axis=2)


def figure(moves: list[int], twin: list[int], values: npt.NDArray[np.float64]) -> Figure:
    """How long the way was, and what the critic thinks of the places."""
    drawing, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    left.semilogy(1 + np.arange(len(twin)), twin, "o", markersize=3, color="0.7", label="without a critic")
    left.semilogy(1 + np.arange(len(moves)), moves, "o", markersize=3, color="C0", label="with a critic")
    last = len(values) - 1
    left.axhline(2 * last, color="k", linewidth=0.8, label="the shortest way")
    left.set(xlabel="episode", ylabel="moves")
    left.legend(frameon=False)
    shown = right.imshow(values, cmap="viridis")
    drawing.colorbar(shown, ax=right, label="weight onto the critic (pA)")
    right.text(0, 0, "start", ha="center", va="center", color="white")
    right.text(last, last, "goal", ha="center", va="center")
    right.set(title="worth of the places", xticks=[], yticks=[])
    return drawing


def main() -> None:
    """Play with each seed, with a critic and without; draw the first."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--side", type=int, default=5)
    options.add_argument("--episodes", type=int, default=60)
    options.add_argument("--seeds", type=int, default=1)
    asked = options.parse_args()
    for seed in range(1, asked.seeds + 1):
        (moves, values), (twin, _) = (play(asked.side, seed, asked.episodes, critic) for critic in (True, False))
        if seed == 1:
            figure(moves, twin, values).savefig("grid_world.png", dpi=150)
        late = [float(np.median(each[-len(each) // 3 :])) for each in (moves, twin)]
        print("seed {}: median of moves in the last third: {:g}, without a critic {:g}".format(seed, *late), flush=True)


if __name__ == "__main__":
    main()
