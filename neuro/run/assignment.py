"""Labels for neurons that learnt without any: each stands for what it answers most."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from neuro.core.errors import ModelError
from neuro.program.program import Ints


def assign_labels(decided: ArrayLike, labels: ArrayLike, size: int) -> Ints:
    """The label for which each neuron stands: the one whose trials it decided most often, by share.

    A share is taken of the trials of a label, so that a frequent label has no advantage; of equal shares the smaller
    label counts. Use trials of the training data, presented without learning.

    Args:
        decided: who decided each trial, -1 where none did: `told.winner`, or `told.label` for the maps of a network
            without labels; shape (trials,).
        labels: the right label of each trial, from 0, shape (trials,).
        size: how many neurons, or maps, there are.

    Returns:
        The label of each, -1 where one never decided, shape (size,).

    Raises:
        ModelError: the arrays are not whole numbers of one shape, or beyond their bounds.
    """
    who, right = _whole(decided, "decided"), _whole(labels, "labels")
    if who.shape != right.shape:
        raise ModelError(f"assign_labels: {who.size} decided and {right.size} labels: expected as many of each")
    _check_bounds("assign_labels", "decided", who, size)
    if right.min(initial=0) < 0:
        raise ModelError(f"assign_labels: labels has {right.min()}: expected labels from 0")
    answers = np.zeros((size, int(right.max(initial=0)) + 1))
    np.add.at(answers, (who[who >= 0], right[who >= 0]), 1.0)
    shown = np.bincount(right, minlength=answers.shape[1])
    found: Ints = (answers / np.maximum(shown, 1)).argmax(axis=1)
    return np.where(answers.any(axis=1), found, -1)


def read_labels(decided: ArrayLike, assigned: ArrayLike) -> Ints:
    """What the decisions of some trials mean.

    Args:
        decided: who decided each trial, -1 where none did, shape (trials,).
        assigned: of `assign_labels`.

    Returns:
        The label of each trial, -1 where nobody decided or one that has no label, shape (trials,).

    Raises:
        ModelError: the arrays are not whole numbers, or one decided who is not assigned.
    """
    who, told = _whole(decided, "decided"), _whole(assigned, "assigned")
    _check_bounds("read_labels", "decided", who, told.size)
    return np.append(told, -1)[who]


def _whole(values: ArrayLike, what: str) -> Ints:
    array = np.asarray(values)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ModelError(f"{what}: {array.dtype} of shape {list(array.shape)}: expected a row of whole numbers")
    return array.astype(np.int64)


def _check_bounds(where: str, what: str, who: Ints, size: int) -> None:
    bad = np.flatnonzero((who < -1) | (who >= size))
    if bad.size:
        raise ModelError(f"{where}: {what}[{bad[0]}] = {who[bad[0]]}: expected -1 to {size - 1}")
