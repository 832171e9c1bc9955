"""Random numbers as a function of a key only.

A draw depends on (seed, purpose, name of the part, neuron, step) alone: it is the same on every backend, for
any number of threads, for any division of a run, and when another part is added to the network.
The mixing function is the finaliser of SplitMix64: Steele, Lea & Flood, OOPSLA 2014, figure 16.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

# Odd factors of step and neuron in the input of `mix`.
STEP_STRIDE = 0x9E3779B97F4A7C15
NEURON_STRIDE = 0xD1B54A32D192ED03
LARGEST_MEAN = 500.0
"""Largest mean of `poisson_table`."""
NTH_STRIDE = 1 << 48
"""Larger than the largest number of steps."""


def key(seed: int, purpose: str, name: str) -> int:
    """Return a 64-bit key for one purpose of a named part."""
    text = f"{seed}/{purpose}/{name}".encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "little")


def generator(seed: int, purpose: str, name: str) -> np.random.Generator:
    """Return a NumPy generator for draws at compilation (connections, weights, initial states)."""
    return np.random.Generator(np.random.PCG64(key(seed, purpose, name)))


def mix(z: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Scramble 64-bit words."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def uniform(part_key: int, step: int, neurons: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return a uniform number in [0, 1) for each neuron in one step, with 53 random bits."""
    base = mix(np.array([(part_key + step * STEP_STRIDE) & 0xFFFFFFFFFFFFFFFF], dtype=np.uint64))
    bits = mix(base + neurons.astype(np.uint64) * np.uint64(NEURON_STRIDE))
    return (bits >> np.uint64(11)).astype(np.float64) * 2.0**-53


def nth(step: int, n: int) -> int:
    """Return the number to use instead of the step in draws for the n-th event of a step; n starts at 0."""
    return step + n * NTH_STRIDE


def uniform_table(part_key: int, steps: NDArray[np.int64], neurons: int) -> NDArray[np.float64]:
    """Return the numbers of `uniform` for many steps and the first `neurons` neurons, shape (steps, neurons)."""
    base = mix(np.uint64(part_key) + steps.astype(np.uint64) * np.uint64(STEP_STRIDE))
    bits = mix(base[:, None] + np.arange(neurons, dtype=np.uint64) * np.uint64(NEURON_STRIDE))
    return (bits >> np.uint64(11)).astype(np.float64) * 2.0**-53


def uniform_pairs(part_key: int, pre: NDArray[np.int64], post: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return a uniform number in [0, 1) for each pair: the number of `uniform` for neuron `post` at step `pre`."""
    base = mix(np.uint64(part_key) + pre.astype(np.uint64) * np.uint64(STEP_STRIDE))
    bits = mix(base + post.astype(np.uint64) * np.uint64(NEURON_STRIDE))
    return (bits >> np.uint64(11)).astype(np.float64) * 2.0**-53


@lru_cache(maxsize=1024)
def poisson_table(mean: float) -> NDArray[np.float64]:
    """Return the cumulative probabilities of a Poisson variable, until they no longer increase.

    The number drawn for a uniform u is the count of entries <= u. `mean` must not exceed `LARGEST_MEAN`.
    """
    term = total = float(np.exp(-mean))
    table = [total]
    while True:
        term = term * (mean / len(table))
        if total + term == total and len(table) > mean:
            probabilities = np.array(table)
            probabilities.flags.writeable = False
            return probabilities
        total += term
        table.append(total)


def normal_table(part_key: int, steps: NDArray[np.int64], neurons: int) -> NDArray[np.float64]:
    """Return standard normal numbers for many steps and the first `neurons` neurons, shape (steps, neurons)."""
    from scipy.special import ndtri

    u = uniform_table(part_key, steps, neurons)
    normal: NDArray[np.float64] = ndtri(np.maximum(u, 2.0**-54, out=u), out=u)  # for u = 0 the result would be infinite
    return normal
