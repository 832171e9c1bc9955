"""Frozen agents: `Frozen` for backends with random spikes, and `Deployed` for chips.

`Frozen` keeps the circuits in which the agent learnt. `Deployed` has a race to threshold in place of a softmax.

On a chip a control step has two phases. While the active places spike, the potential of each actor approaches the
preference for its action, less the mean over all actors. Then a ramp of spikes raises all potentials equally until the
first actor reaches its threshold and inhibits the others. So the chip's spikes decide, and the host only reads which
neuron spiked.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro import ModelError
from neuro.chips import HostWork
from neuro.coding import PERIOD, on_numbers
from neuro_agent.network import STEP, TAU, circuit

if TYPE_CHECKING:
    from neuro.extend import Program
    from neuro_agent.learner import Learner


DRAWING = ("event", "reference")
"""Backends with neurons that spike at random."""

RAMP = 24
"""Ticks in which the ramp rises from 0 to the threshold. Actors that would spike within the same tick tie."""
TICKS = STEP + RAMP
"""Ticks of a control step."""
HOST = ("encode: which place of each grid holds the observation", "decide: which neuron of each circuit spiked first")
"""Computations of the host in a control step."""
INHIBITION = 3.0
"""Number of thresholds by which a spike lowers the potentials of the other actors."""

Ints = npt.NDArray[np.int64]


def draws_of(agent: Learner, seed: int) -> np.random.Generator | None:
    """Return the random generator of the places' spikes; None if they spike regularly."""
    return np.random.default_rng([seed, 2]) if agent.settings.spikes == "poisson" else None


def ramp_size() -> tuple[int, float]:
    """Return the number of the ramp's neurons, and the share of the linear rise per tick that one spike adds."""
    loss = 1.0 - math.exp(-1.0 / TAU)
    return math.ceil(1.0 / loss) + RAMP, loss


def ramp_spikes() -> tuple[Ints, Ints]:
    """Return ticks and ids of the ramp, one neuron more at each tick."""
    counts = ramp_size()[0] - RAMP + np.arange(RAMP)
    return np.repeat(np.arange(STEP, TICKS), counts), np.concatenate([np.arange(count) for count in counts])


def deployed(agent: Learner) -> neuro.Network:
    """Return the network of a frozen agent, without random draws.

    Raises:
        ModelError: the agent has not been trained, so its preferences are not known.
    """
    if not len(agent.last_vectors):
        raise ModelError("the agent has not been trained: expected one that has seen its environment", hint="train it")
    size, share = ramp_size()
    net = neuro.Network("deployed_actor", resolution=1.0)
    places = net.population("places", agent.places.size, neuro.spike_generator())
    ramp = net.population("ramp", size, neuro.spike_generator())
    weights = agent.weights
    for k, n in enumerate(agent.actions.sizes):
        weight = weights[f"policy{k}"] - weights[f"policy{k}"].mean(axis=1, keepdims=True)
        top = 1.2 * max(1e-6, _largest(agent, weight))
        actor = net.population(
            circuit(k), n, neuro.iaf_psc_delta(tau_m=TAU, E_L=0.0, V_reset=0.0, V_th=top, t_ref=float(RAMP))
        )
        net.connect(places, actor, neuro.all_to_all(), weight=weight.ravel(), delay=1.0, name=f"policy{k}")
        net.connect(ramp, actor, neuro.all_to_all(), weight=share * top / RAMP, delay=1.0, name=f"rise{k}")
        if n > 1:
            to_others = neuro.all_to_all(autapses=False)
            net.connect(actor, actor, to_others, weight=-INHIBITION * top, delay=1.0, name=f"inhibition{k}")
    return net


def _largest(agent: Learner, weight: npt.NDArray[np.float64]) -> float:
    """Return the potential of the largest preference over the last observations, just after the active places spike."""
    sums = [float((amounts @ weight[cells]).max()) for cells, amounts in map(agent.places.activity, agent.last_vectors)]
    return max(sums) / (1.0 - math.exp(-PERIOD / TAU))


class Frozen:
    """A frozen agent on the circuits in which it learnt.

    Attributes:
        sim: the simulation of the network.
    """

    ticks = STEP
    trigger: tuple[str, Any] = ("ask", ([STEP - 1], [0]))
    """Population that triggers the decision, and its spikes by tick and id."""

    def __init__(self, agent: Learner, seed: int, backend: str, **options: Any) -> None:
        self._places, self._draws = agent.places, draws_of(agent, seed)
        circuits = [circuit(k) for k in range(len(agent.actions.sizes))]
        self.sim = neuro.compile(self.network(agent), backend=backend, seed=seed, **options)
        places = self._places.work(self.ticks, self._draws is not None)
        neurons = sum(agent.actions.sizes)
        for name, work in (("places", places), ("decision", on_numbers(neurons, neurons + len(circuits)))):
            self.sim.host_work.append(HostWork(name, work, steps=self.ticks))
        self._stepper = self.sim.stepper(float(self.ticks), emit=["places", self.trigger[0]], count=circuits)

    def network(self, agent: Learner) -> neuro.Network:
        """Return the network that decides for an agent."""
        return agent.network(learns=False)

    def decide(self, observations: npt.NDArray[np.float64]) -> Ints:
        """Return the neuron of each circuit that spiked, (1, circuits), for one observation, (1, dimensions)."""
        _, ticks, ids = self._places.spikes(observations, self.ticks, self._draws)
        chosen = self._stepper.step((ticks, ids), self.trigger[1])
        return np.stack([winner.argmax(axis=1) for winner in chosen], axis=1)


class Deployed(Frozen):
    """A frozen agent with the network for chips.

    Attributes:
        sim: the simulation of the network.
    """

    ticks = TICKS
    trigger = ("ramp", ramp_spikes())

    def __init__(self, agent: Learner, backend: str, seed: int = 0, **options: Any) -> None:
        super().__init__(agent, seed, backend, **options)

    @property
    def program(self) -> Program:
        """The compiled network."""
        program: Program = self.sim.program
        return program

    def network(self, agent: Learner) -> neuro.Network:
        """Return the network that decides for an agent."""
        return deployed(agent)
