"""Teach the camera to follow the light, and test what it has learnt. Next: python -m pytest."""

from pathlib import Path

from world import Light

import neuro

NETWORK = Path(__file__).with_name("network.yaml")


def returns(steps=2000, dopamine=0.002, seed=1):
    """Return the mean return of 5 episodes with frozen weights, after some control steps of learning."""
    net = neuro.load(NETWORK, params={"dopamine": dopamine})
    loop = neuro.closed_loop(net, Light, seed=seed)
    loop.run(steps=steps)
    return neuro.closed_loop(loop.network(frozen=True), Light, learns=False).test(5).mean


if __name__ == "__main__":
    print(f"mean return {returns():.1f} of 200, without dopamine {returns(dopamine=0.0):.1f}")
