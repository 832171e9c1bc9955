"""Tools for learning: normalised weights, errors of reward and temporal differences, and labels of neurons."""

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
    """Scale the weights onto each target neuron to a given sum. Call it at intervals while the network learns.

    The weights are the ones that `sim.weights` returns. For `stdp` and similar rules these are the last weights that
    were sent, so changes by later postsynaptic spikes are not included.

    Args:
        sim: the simulation.
        projection: the projection or its name; for a grid the weights of each map are scaled.
        total: sum in the unit of the weights: a number, or a number for each target neuron (for a grid: map).

    Raises:
        ModelError: there is no such projection, the weights onto a neuron cannot be scaled to the sum, or a weight
            would exceed the bounds of its rule. No weight is changed in this case.

    Source: Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015; von der Malsburg, Kybernetik 14:85, 1973.
    """
    rows = sim.weights(projection)
    part = sim.program.projections[sim.handles.projection(projection)]
    shared = not isinstance(rows, tuple)
    weights = rows.reshape(-1) if shared else rows[2]
    target_of = np.repeat(np.arange(len(rows)), rows[0].size) if shared else rows[1]
    sums = np.bincount(target_of, weights)
    totals = finite(total, "total")
    size = len(rows) if shared else sim.program.populations[part.target].size
    if totals.shape not in ((), (size,)):
        raise ModelError(f"total has the shape {list(totals.shape)}, expected a number or [{size}]", path=("total",))
    totals = np.broadcast_to(totals, size)[: sums.size]
    has_synapses = np.bincount(target_of, minlength=sums.size) > 0
    bad = np.flatnonzero(has_synapses & (sums * totals <= 0.0))
    if bad.size:
        target = "map" if shared else "neuron"
        raise ModelError(
            f"normalise: the weights of '{part.name}' onto {target} {bad[0]} have the sum {sums[bad[0]]:g}: "
            f"expected a sum that can be scaled to {totals[bad[0]]:g}, of its sign and not 0"
        )
    scale = np.divide(totals, sums, out=np.ones(sums.size), where=has_synapses)
    sim.set_weights(projection, (weights * scale[target_of]).reshape(rows.shape if shared else -1))


def reward_error(reward: ArrayLike, baseline: ArrayLike, rate: float) -> tuple[Any, Any]:
    """Return the reward minus its baseline, and the updated baseline, a running mean: (R - b, b + rate (R - b)).

    Args:
        reward: reward R, a number or an array, in any unit.
        baseline: present baseline b; 0 before the first reward.
        rate: share of the error that is added to the baseline, 0 to 1.

    Raises:
        ModelError: a value is not finite, or the rate is out of bounds.

    Source: R - b of the thesis' eq. 116; Williams, Mach. Learn. 8:229, 1992 (REINFORCE).
    """
    share = argument("rate", rate, at_least=0, at_most=1)
    expected = finite(baseline, "baseline")
    error = finite(reward, "reward") - expected
    return error[()], (expected + share * error)[()]


def td_error(reward: ArrayLike, value: ArrayLike, next_value: ArrayLike, discount: float) -> Any:
    """Return the temporal-difference error of one step: reward + discount x next_value - value.

    Args:
        reward: reward in the step.
        value: the critic's value of the state before the step.
        next_value: the critic's value of the state after the step; 0 at the end of an episode.
        discount: weight of a reward one step later, 0 to 1.

    Raises:
        ModelError: a value is not finite, or the discount is out of bounds.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., eq. 6.5.
    """
    worth = argument("discount", discount, at_least=0, at_most=1)
    return (finite(reward, "reward") + worth * finite(next_value, "next_value") - finite(value, "value"))[()]


def td_error_rate(reward: ArrayLike, value: ArrayLike, slope: ArrayLike, tau_r: float) -> Any:
    """Return the temporal-difference error in continuous time: V' - V / tau_r + r.

    Args:
        reward: reward r per ms.
        value: value V of the critic.
        slope: change V' of V per ms.
        tau_r: time constant in ms over which rewards are discounted.

    Returns:
        The error per ms.

    Raises:
        ModelError: a value is not finite, or tau_r is not above 0.

    Source: Doya, Neural Comput. 12:219, 2000; Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013.
    """
    discounted = finite(value, "value") / argument("tau_r", tau_r, above=0)
    return (finite(slope, "slope") - discounted + finite(reward, "reward"))[()]


def assign_labels(decided: ArrayLike, labels: ArrayLike, size: int) -> Ints:
    """Return the label of each neuron: the label with the largest share of trials that the neuron decided.

    A share is relative to the trials of its label, so a frequent label has no advantage. For equal shares the smaller
    label is taken. Use trials of the training data, presented without learning.

    Args:
        decided: the neuron that decided each trial, or -1: `results.winner`, or `results.label` for the maps of a
            network without labels; shape (trials,).
        labels: the correct label of each trial, from 0, shape (trials,).
        size: number of neurons or maps.

    Returns:
        The label of each neuron, -1 for a neuron that never decided, shape (size,).

    Raises:
        ModelError: the arrays are not whole numbers of one shape, or out of bounds.
    """
    neurons, correct = _whole_numbers(decided, "decided"), _whole_numbers(labels, "labels")
    if neurons.shape != correct.shape:
        raise ModelError(f"assign_labels: {neurons.size} decided and {correct.size} labels: expected as many of each")
    _check_bounds("assign_labels", "decided", neurons, size)
    if correct.min(initial=0) < 0:
        raise ModelError(f"assign_labels: labels has {correct.min()}: expected labels from 0")
    decisions = np.zeros((size, int(correct.max(initial=0)) + 1))
    np.add.at(decisions, (neurons[neurons >= 0], correct[neurons >= 0]), 1.0)
    trials_of_label = np.bincount(correct, minlength=decisions.shape[1])
    best_labels: Ints = (decisions / np.maximum(trials_of_label, 1)).argmax(axis=1)
    return np.where(decisions.any(axis=1), best_labels, -1)


def read_labels(decided: ArrayLike, assigned: ArrayLike) -> Ints:
    """Return the labels for the decisions of some trials.

    Args:
        decided: the neuron that decided each trial, or -1, shape (trials,).
        assigned: the result of `assign_labels`.

    Returns:
        The label of each trial, -1 if no neuron decided or the neuron has no label, shape (trials,).

    Raises:
        ModelError: the arrays are not whole numbers, or a neuron decided that is not in `assigned`.
    """
    neurons, label_of = _whole_numbers(decided, "decided"), _whole_numbers(assigned, "assigned")
    _check_bounds("read_labels", "decided", neurons, label_of.size)
    return np.append(label_of, -1)[neurons]


def _whole_numbers(values: ArrayLike, what: str) -> Ints:
    array = np.asarray(values)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ModelError(f"{what}: {array.dtype} of shape {list(array.shape)}: expected a row of whole numbers")
    return array.astype(np.int64)


def _check_bounds(caller: str, what: str, neurons: Ints, size: int) -> None:
    bad = np.flatnonzero((neurons < -1) | (neurons >= size))
    if bad.size:
        raise ModelError(f"{caller}: {what}[{bad[0]}] = {neurons[bad[0]]}: expected -1 to {size - 1}")
