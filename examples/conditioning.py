"""Which spikes were rewarded? Dopamine comes seconds later, among thousands of others, and still finds the synapse.

Whenever one neuron fires within 20 ms after another, whose synapse onto it begins at 0, a reward follows 1 to 3 s
later. The twin network has the same spikes to begin with and no reward. Source: Izhikevich, Cereb. Cortex 17:2443,
2007, experiment 1. The network and its reward are `conditioning.yaml` of `neuro_models`, with a tenth of the
paper's neurons; `--neurons 1000 --seconds 3600` is the paper's. Writes conditioning.png.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

import neuro
import neuro_models

DOSE = 0.5  # what a reward adds to dopamine
EVERY = 10_000.0  # ms between two looks at the weights


def network(neurons: int, dose: float) -> neuro.Network:
    """The published network with its reward; a neuron of a smaller one has a fifth of all as targets."""
    targets = 100 if neurons == 1000 else neurons // 5
    sizes = {"excitatory": neurons * 4 // 5, "inhibitory": neurons // 5}
    fans = {"to_excitatory": targets * 4 // 5, "to_inhibitory": targets // 5, "from_inhibitory": targets}
    return neuro.load(neuro_models.path("conditioning"), {**sizes, **fans, "dose": dose})


def experiment(seed: int, neurons: int, seconds: float, dose: float) -> npt.NDArray[np.float64]:
    """The rewarded weight and the mean of the others, mV, every 10 s."""
    sim = neuro.compile(network(neurons, dose), seed=seed)
    found = []
    while sim.time < 1000.0 * seconds:
        sim.run(EVERY)
        sim.forget(before=sim.time)
        found.append([sim.get(name, "weight").mean() for name in ("pair", "learning")])
    return np.array(found)


def figure(rewarded: npt.NDArray[np.float64], twin: npt.NDArray[np.float64]) -> Figure:
    """The weights over time."""
    drawing, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
    minutes = (np.arange(len(rewarded)) + 1) * EVERY / 60_000.0
    axes.plot(minutes, rewarded[:, 0], label="the rewarded synapse")
    axes.plot(minutes, rewarded[:, 1], label="mean of the others")
    axes.plot(minutes, twin[:, 0], "--", label="the same synapse without reward")
    axes.set(xlabel="time (min)", ylabel="weight (mV)", ylim=(-0.1, 4.2))
    drawing.legend(frameon=False, ncols=3, loc="outside upper center", fontsize=9)
    return drawing


def main() -> None:
    """Run the network and its twin for each seed; draw the first."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--neurons", type=int, default=100)
    options.add_argument("--seconds", type=float, default=1800.0)
    options.add_argument("--seeds", type=int, default=1)
    asked = options.parse_args()
    ends = []
    for seed in range(1, asked.seeds + 1):
        with_reward, without = (experiment(seed, asked.neurons, asked.seconds, dose) for dose in (DOSE, 0.0))
        if seed == 1:
            figure(with_reward, without).savefig("conditioning.png", dpi=150)
        late = len(with_reward) * 5 // 6
        ends.append([with_reward[late:, 0].mean(), with_reward[late:, 1].mean(), without[late:, 0].mean()])
        print("seed {}: {:.2f} mV, others {:.2f} mV, without reward {:.3f} mV".format(seed, *ends[-1]), flush=True)
    median, least = np.median(np.array(ends)[:, 0]), min(with_ / max(twin, 1e-9) for with_, _, twin in ends)
    print(f"median {median:.2f} mV in the last sixth; at least {least:.0f} times the twin without reward")


if __name__ == "__main__":
    main()
