"""Let two inputs compete, with and without inhibition. Next: python -m pytest."""

from pathlib import Path

import neuro

NETWORK = Path(__file__).with_name("network.yaml")


def rates(left, right, seed=1, **parameters):
    """Return the rates of both groups in Hz. `left` and `right` are the rates of their inputs in Hz."""
    net = neuro.load(NETWORK, params={"left": left, "right": right, **parameters})
    sim = neuro.compile(net, seed=seed)
    sim.run(1000.0)  # ms, so the number of spikes is a rate in Hz
    return tuple(len(sim.spikes(name)[0]) / 20 for name in ("left", "right"))


if __name__ == "__main__":
    for left, right in ((40.0, 32.0), (32.0, 40.0)):
        won = "left {:.0f} Hz, right {:.0f} Hz".format(*rates(left, right))
        alone = "left {:.0f} Hz, right {:.0f} Hz".format(*rates(left, right, inhibition=0.0))
        print(f"inputs {left:g} and {right:g} Hz: {won}; without inhibition {alone}")
