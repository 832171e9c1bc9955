"""Weights whose sum onto each neuron is held, as by a neuron with a limited resource."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from neuro.core.checks import argument, finite
from neuro.core.errors import ModelError
from neuro.model.parts import Projection
from neuro.program.program import Ints
from neuro.run.simulation import Simulation


def normalise(sim: Simulation, projection: Projection | str, total: ArrayLike) -> None:
    """Scale the weights onto each post neuron so that they have a given sum; call it now and then while it learns.

    The weights are those that `sim.weights` shows: of `stdp` and its like those sent last, so what post spikes have
    added to a weight since is left out.

    Args:
        sim: the simulation.
        projection: the projection or its name; of a grid the weights of each map are scaled.
        total: the sum, in the unit of the weights: a number, or one for each post neuron (of a grid: map).

    Raises:
        ModelError: there is no such projection, the weights onto a neuron cannot be scaled to the sum, or a weight
            would pass the bounds of its rule. No weight is changed then.

    Source: Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015; von der Malsburg, Kybernetik 14:85, 1973.
    """
    found = sim.weights(projection)
    part = sim.program.projections[sim.handles.projection(projection)]
    shared = not isinstance(found, tuple)
    weights = found.reshape(-1) if shared else found[2]
    onto = np.repeat(np.arange(len(found)), found[0].size) if shared else found[1]
    sums = np.bincount(onto, weights)
    wanted = finite(total, "total")
    size = len(found) if shared else sim.program.populations[part.target].size
    if wanted.shape not in ((), (size,)):
        raise ModelError(f"total has the shape {list(wanted.shape)}, expected a number or [{size}]", path=("total",))
    wanted = np.broadcast_to(wanted, size)[: sums.size]
    reached = np.bincount(onto, minlength=sums.size) > 0
    bad = np.flatnonzero(reached & (sums * wanted <= 0.0))
    if bad.size:
        what = "map" if shared else "neuron"
        raise ModelError(
            f"normalise: the weights of '{part.name}' onto {what} {bad[0]} have the sum {sums[bad[0]]:g}: "
            f"expected a sum that can be scaled to {wanted[bad[0]]:g}, of its sign and not 0"
        )
    scale = np.divide(wanted, sums, out=np.ones(sums.size), where=reached)
    sim.set_weights(projection, (weights * scale[onto]).reshape(found.shape if shared else -1))


def reward_error(reward: ArrayLike, baseline: ArrayLike, rate: float) -> tuple[Any, Any]:
    """Reward less its baseline, and the baseline after it, a running mean: (R - b, b + rate (R - b)).

    Args:
        reward: R, a number or an array, in any unit.
        baseline: b so far; 0 before the first reward.
        rate: share of the error by which the baseline follows, 0 to 1; 0 keeps it.

    Raises:
        ModelError: something is not finite, or the rate is out of its bounds.

    Source: R - b of the thesis' eq. 116; Williams, Mach. Learn. 8:229, 1992 (REINFORCE).
    """
    follows = argument("rate", rate, at_least=0, at_most=1)
    expected = finite(baseline, "baseline")
    error = finite(reward, "reward") - expected
    return error[()], (expected + follows * error)[()]


def td_error(reward: ArrayLike, value: ArrayLike, next_value: ArrayLike, discount: float) -> Any:
    """The temporal-difference error of one step: reward + discount x next_value - value.

    Args:
        reward: got in the step.
        value: what the critic expected of the state before it.
        next_value: what it expects of the state after it; 0 where an episode ends.
        discount: worth of a reward one step later, 0 to 1.

    Raises:
        ModelError: something is not finite, or the discount is out of its bounds.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., eq. 6.5.
    """
    worth = argument("discount", discount, at_least=0, at_most=1)
    return (finite(reward, "reward") + worth * finite(next_value, "next_value") - finite(value, "value"))[()]


def td_error_rate(reward: ArrayLike, value: ArrayLike, slope: ArrayLike, tau_r: float) -> Any:
    """The temporal-difference error in continuous time: V' - V / tau_r + r.

    Args:
        reward: r, reward per ms.
        value: V, what the critic expects.
        slope: V', change of it per ms.
        tau_r: time in ms over which rewards are discounted.

    Returns:
        The error per ms.

    Raises:
        ModelError: something is not finite, or tau_r is not above 0.

    Source: Doya, Neural Comput. 12:219, 2000; Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013.
    """
    lost = finite(value, "value") / argument("tau_r", tau_r, above=0)
    return (finite(slope, "slope") - lost + finite(reward, "reward"))[()]


def assign_labels(decided: ArrayLike, labels: ArrayLike, size: int) -> Ints:
    """The label for which each neuron stands: the one whose trials it decided most often, by share.

    A share is taken of the trials of a label, so that a frequent label has no advantage; of equal shares the smaller
    label counts. Use trials of the training data, presented without learning.

    Args:
        decided: the neuron that decided each trial, -1 where none did: `results.winner`, or `results.label`
            for the maps of a network without labels; shape (trials,).
        labels: the right label of each trial, from 0, shape (trials,).
        size: how many neurons, or maps, there are.

    Returns:
        The label of each, -1 where one never decided, shape (size,).

    Raises:
        ModelError: the arrays are not whole numbers of one shape, or beyond their bounds.
    """
    neurons, right = _whole(decided, "decided"), _whole(labels, "labels")
    if neurons.shape != right.shape:
        raise ModelError(f"assign_labels: {neurons.size} decided and {right.size} labels: expected as many of each")
    _check_bounds("assign_labels", "decided", neurons, size)
    if right.min(initial=0) < 0:
        raise ModelError(f"assign_labels: labels has {right.min()}: expected labels from 0")
    answers = np.zeros((size, int(right.max(initial=0)) + 1))
    np.add.at(answers, (neurons[neurons >= 0], right[neurons >= 0]), 1.0)
    shown = np.bincount(right, minlength=answers.shape[1])
    found: Ints = (answers / np.maximum(shown, 1)).argmax(axis=1)
    return np.where(answers.any(axis=1), found, -1)


def read_labels(decided: ArrayLike, assigned: ArrayLike) -> Ints:
    """What the decisions of some trials mean.

    Args:
        decided: the neuron that decided each trial, -1 where none did, shape (trials,).
        assigned: of `assign_labels`.

    Returns:
        The label of each trial, -1 where no neuron decided, or one without a label, shape (trials,).

    Raises:
        ModelError: the arrays are not whole numbers, or a neuron decided that has no label.
    """
    neurons, given = _whole(decided, "decided"), _whole(assigned, "assigned")
    _check_bounds("read_labels", "decided", neurons, given.size)
    return np.append(given, -1)[neurons]


def _whole(values: ArrayLike, what: str) -> Ints:
    array = np.asarray(values)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ModelError(f"{what}: {array.dtype} of shape {list(array.shape)}: expected a row of whole numbers")
    return array.astype(np.int64)


def _check_bounds(where: str, what: str, neurons: Ints, size: int) -> None:
    bad = np.flatnonzero((neurons < -1) | (neurons >= size))
    if bad.size:
        raise ModelError(f"{where}: {what}[{bad[0]}] = {neurons[bad[0]]}: expected -1 to {size - 1}")
