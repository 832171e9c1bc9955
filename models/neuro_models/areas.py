"""Many cortical microcircuits, connected with delays by distance: a stand-in for multi-area models.

The connectivity between areas is generated, not measured. Size, delays and number of projections are those of
multi-area models, but the network is no model of any brain.

- Areas lie anywhere on a sphere, and are numbered from the back to the front. The number is the rank of an area.
- A share of all pairs of areas is connected, in both directions. Pairs are drawn, near pairs with higher probability.
- A part of each neuron's input from outside its microcircuit comes from other areas: forward from L23E to L4, back from
  L5E and L6E to all other layers. Near areas contribute more.
- The remaining Poisson input keeps the mean input of each neuron at the rates of the single microcircuit, so the rates
  of each area are near those rates.

Source: the microcircuit as in microcircuit.yaml (Potjans & Diesmann 2014). 32 areas, speed and spread of delays, and
weights as within an area: the ground state of Schmidt et al., PLoS Comput. Biol. 14:e1006359, 2018, with numbers as in
INM-6/multi-area-model. Density, and strengths that fall exponentially with distance: Ercsey-Ravasz et al., Neuron
80:184, 2013. Layers: Felleman & Van Essen, Cereb. Cortex 1:1, 1991. A fifth of the connections of cortex is between
areas (Markov et al., Science 342:1238406, 2013), which is half of the inputs from outside a microcircuit. Our choices:
the sphere, on which areas are 27 mm apart on average, and the decay of strengths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

import neuro
from neuro import ModelError
from neuro_models import path

__all__ = ["LAYERS", "Wiring", "network", "wiring"]

Floats = NDArray[np.float64]

LAYERS = ("L23E", "L23I", "L4E", "L4I", "L5E", "L5I", "L6E", "L6I")
"""Populations of an area; those of the third area are named A03_L23E and so on."""

_FORWARD = (("L23E",), ("L4E", "L4I"))
_BACK = (("L5E", "L6E"), ("L23E", "L23I", "L5E", "L5I", "L6E", "L6I"))
_RATES = {"L23E": 0.903, "L5E": 7.569, "L6E": 1.105}  # Hz, of the single microcircuit
_INPUT_RATE = 8.0  # Hz, of each Poisson input
_DECAY = 0.188  # 1/mm, of strengths with distance
_DELAY_SPREAD = 0.5  # standard deviation of delays over their mean
_SHORTEST_DELAY = 0.05  # ms: half a step, so that no delay is rounded to 0


@dataclass(frozen=True)
class Wiring:
    """Positions of the areas, and the connected pairs.

    Attributes:
        centres: mm, shape (areas, 3), from the back (lowest rank) to the front.
        distances: mm, shape (areas, areas).
        connected: whether two areas are connected, symmetric, shape (areas, areas).
    """

    centres: Floats
    distances: Floats
    connected: NDArray[np.bool_]

    def shares(self, target: int, sources: NDArray[np.int64]) -> Floats:
        """Return the share of each source area in the input from all of them."""
        strength = np.exp(-_DECAY * self.distances[target, sources])
        shares: Floats = strength / strength.sum()
        return shares


def wiring(areas: int = 32, density: float = 0.66, radius: float = 20.0, seed: int = 1) -> Wiring:
    """Draw positions of the areas, and the connected pairs.

    Args:
        areas: number of areas, at least 2.
        density: connected pairs over all pairs, from 0 to 1.
        radius: radius of the sphere, mm; at most 1000.
        seed: seed of the draws, independent of a simulation's seed.

    Raises:
        ModelError: an argument is out of range; the message names it.
    """
    _check("areas", areas, isinstance(areas, int) and 2 <= areas <= 99, "a whole number from 2 to 99")
    _check("density", density, _is_number(density) and 0.0 <= density <= 1.0, "a number from 0 to 1")
    # Strengths over longer distances underflow to 0.
    fits = _is_number(radius) and 0.0 < radius <= 1000.0
    _check("radius", radius, fits, "a number > 0 and at most 1000, in mm")
    _check("seed", seed, isinstance(seed, int) and seed >= 0, "a whole number >= 0")
    rng = np.random.default_rng(seed)
    centres = rng.normal(size=(areas, 3))
    centres *= radius / np.linalg.norm(centres, axis=1, keepdims=True)
    centres = centres[np.argsort(centres[:, 0])]
    distances = np.linalg.norm(centres[:, None] - centres, axis=2)
    first, second = np.triu_indices(areas, 1)
    likely = np.exp(-_DECAY * distances[first, second])
    chosen = rng.choice(first.size, round(density * first.size), replace=False, p=likely / likely.sum())
    connected = np.zeros((areas, areas), dtype=np.bool_)
    connected[first[chosen], second[chosen]] = connected[second[chosen], first[chosen]] = True
    return Wiring(centres, distances, connected)


def network(
    areas: int = 32,
    scale: float = 0.02,
    indegree: float = 0.1,
    between: float = 0.5,
    speed: float = 3.5,
    density: float = 0.66,
    radius: float = 20.0,
    seed: int = 1,
) -> neuro.Network:
    """Return the areas, microcircuits with populations A01_L23E and so on, and projections such as A01_L23E_A02_L4E.

    Args:
        areas: number of areas, from 2 to 99.
        scale: share of the number of neurons; 1.0 is 77,169 per area.
        indegree: share of the inputs of each neuron. With fewer inputs weights are larger, and a current replaces the
            lost mean input, as in the microcircuit; below 0.1 rates fall.
        between: share of the inputs from outside a microcircuit that comes from other areas, from 0 to 1.
        speed: speed of spikes between areas, mm/ms.
        density: connected pairs of areas over all pairs.
        radius: radius of the sphere of areas, mm.
        seed: seed of positions and connected pairs; the simulation's seed draws the synapses.

    Raises:
        ModelError: an argument is out of range; the message names it.
    """
    for word, share in (("scale", scale), ("indegree", indegree)):
        _check(word, share, _is_number(share) and 0.0 < share < np.inf, "a number > 0")
    _check("between", between, _is_number(between) and 0.0 <= between <= 1.0, "a number from 0 to 1")
    _check("speed", speed, _is_number(speed) and 0.0 < speed < np.inf, "a number > 0, in mm/ms")
    wired = wiring(areas, density, radius, seed)
    circuit = neuro.load(path("microcircuit"), {"scale": scale, "indegree": indegree})
    net = neuro.Network("areas", resolution=circuit.resolution)
    inputs = [_inputs(circuit, wired, area, between) for area in range(areas)]
    for area in range(areas):
        _add_area(net, circuit, area, inputs[area])
    weight = circuit.projections["L23E_L23E"].weight
    for area in range(areas):
        for (area_from, source, target), n in inputs[area].items():
            mean_delay = wired.distances[area, area_from] / speed
            pre, post = _name(area_from, source), _name(area, target)
            delay = neuro.normal(mean=mean_delay, std=_DELAY_SPREAD * mean_delay, low=_SHORTEST_DELAY)
            net.connect(pre, post, neuro.fixed_total_number(n=n), weight=weight, delay=delay)
    return net


def _check(word: str, value: object, fits: bool, expected: str) -> None:
    if not fits:
        raise ModelError(f"areas: {word} = {value!r}: expected {expected}")


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, (int, float))


def _name(area: int, population: str) -> str:
    return f"A{area + 1:02d}_{population}"


def _size(circuit: neuro.Network, population: str) -> int:
    (size,) = circuit.populations[population].shape
    return int(size)


def _poisson(circuit: neuro.Network, population: str) -> neuro.poisson_generator:
    model = circuit.populations[f"{population}_in"].model
    assert isinstance(model, neuro.poisson_generator)
    return model


def _inputs(circuit: neuro.Network, wired: Wiring, area: int, between: float) -> dict[tuple[int, str, str], int]:
    """Return the number of synapses from other areas, by source area, source population and target population."""
    numbers_by_source = {}
    linked = np.flatnonzero(wired.connected[area])
    for (sources, targets), ranks in ((_FORWARD, linked[linked < area]), (_BACK, linked[linked > area])):
        neurons = np.array([_size(circuit, source) for source in sources])
        shares = np.outer(wired.shares(area, ranks), neurons / neurons.sum())
        for target in targets:
            n_inputs = between * _poisson(circuit, target).rate / _INPUT_RATE
            numbers = np.rint(n_inputs * _size(circuit, target) * shares).astype(np.int64)
            for (i, j), n in np.ndenumerate(numbers):
                if n:
                    numbers_by_source[int(ranks[i]), sources[j], target] = int(n)
    return numbers_by_source


def _add_area(net: neuro.Network, circuit: neuro.Network, area: int, inputs: dict[tuple[int, str, str], int]) -> None:
    """Add a microcircuit, with the Poisson input reduced by the input from other areas."""
    rates_from_areas = dict.fromkeys(LAYERS, 0.0)
    for (_, source, target), n in inputs.items():
        rates_from_areas[target] += n / _size(circuit, target) * _RATES[source]
    for name in LAYERS:
        part, poisson = circuit.populations[name], _poisson(circuit, name)
        net.population(_name(area, name), part.shape, part.model, initial=part.initial)
        reduced = replace(poisson, rate=poisson.rate - rates_from_areas[name])
        net.population(_name(area, f"{name}_in"), part.shape, reduced)
    for wires in circuit.projections.values():
        pre, post = _name(area, wires.source), _name(area, wires.target)
        net.connect(pre, post, wires.rule, wires.synapse, weight=wires.weight, delay=wires.delay)
