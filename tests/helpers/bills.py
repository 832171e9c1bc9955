"""A network whose counts are known by heart, a placement written down, and the lines of a bill."""

import math
from dataclasses import dataclass, field

import numpy as np

import neuro


@dataclass(frozen=True)
class Moves:
    local: np.ndarray
    east_west: np.ndarray
    north_south: np.ndarray
    chip: np.ndarray


@dataclass(frozen=True)
class Tile:
    parts: tuple


@dataclass(frozen=True)
class Placed:
    """A placement written down."""

    moves: dict
    cores: tuple
    chips_used: int = 1
    tiles_used: int = 1
    problems: tuple = field(default=())

    def hops(self, index):
        return self.moves[index]


def ints(*values):
    return np.array(values, dtype=np.int64)


def pair(learns=True):
    """Two inputs, of which one spikes three times and one once; all to three neurons, of which each goes to one more.

    Every input spike makes all three of `a` fire one step later, and these make `b` fire.
    """
    lif = neuro.iaf_psc_delta(tau_m=math.inf, E_L=0.0, V_reset=0.0, V_th=1.0, t_ref=0.0)
    net = neuro.Network("pair", resolution=1.0)
    net.population("input", 2, neuro.spike_generator(spike_times=((1.0, 2.0, 3.0), (5.0,))))
    net.population("a", 3, lif)
    net.population("b", 3, lif)
    net.connect("input", "a", neuro.all_to_all(), weight=1.5, delay=1.0, name="in")
    rule = neuro.stdp(Wmax=10.0) if learns else neuro.static()
    net.connect("a", "b", neuro.one_to_one(), rule, weight=1.5, delay=1.0, name="ab")
    return net


STEPS = 10
# input: 4 spikes. a: 4 x 3 = 12 spikes in steps 2, 3, 4, 6. b: 12 spikes in steps 3, 4, 5, 7.
IN_OPS = 4 * 3
AB_OPS = 12
ACTIVE = 12  # neuron-steps of a, and of b: arrival and spike fall into one step
INACTIVE = 3 * STEPS - ACTIVE
LEARNT = 12 + 12  # a synapse one to one learns from each pre and each post spike


def placed(**words):
    """`a` and two of `b` on the first core, the last of `b` one tile east and two south of it."""
    moves = {
        0: Moves(ints(1, 1), ints(0, 0), ints(0, 0), ints(0, 0)),
        1: Moves(ints(1, 1, 0), ints(0, 0, 1), ints(0, 0, 2), ints(0, 0, 0)),
    }
    cores = (Tile(((1, 0, 3), (2, 0, 2))), Tile(((2, 2, 3),)))
    return Placed(moves, cores, **{"tiles_used": 2, **words})


def lines(energy):
    """The lines of a bill, without that of a host that has nothing to do."""
    items = (item for item in energy.items if (item.what, item.count) != ("host", 0.0))
    return {(item.what, item.of): (item.count, item.joules) for item in items}


def counted(learns=True):
    """The program of the pair and what it counts in its steps."""
    sim = neuro.compile(pair(learns), "reference")
    sim.run(float(STEPS))
    return sim.program, sim._engine.counts()
