"""Classifiers of vectors: linear and RBF support vector machines, ridge regression, and the nearest class mean.

scikit-learn trains the support vector machines. Scoring does not need scikit-learn: the parameters are arrays.
"""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import Part, Registry, install, setting
from neuro.coding import Work, on_numbers
from neuro_recognise.method import Course, Learnt
from neuro_recognise.shown import Array, Floats, Ints


def standard(x: Array, means: Array) -> Floats:
    """Return Euclidean distances of vectors (recordings, values) from class means, (recordings, classes)."""
    return np.stack([np.sqrt(((x - mean) ** 2).sum(axis=1)) for mean in means], axis=1)


def normalised(x: Array, means: Array) -> Floats:
    """Return Euclidean distances of vectors that are first divided by their sums."""
    return standard(_shares(x), _shares(means))


def bhattacharyya(x: Array, means: Array) -> Floats:
    """Return Bhattacharyya distances, ``-ln sum_k sqrt(x_k m_k)``, of vectors divided by their sums; 0 to infinity.

    Values must be >= 0, e.g. histograms.
    """
    with np.errstate(divide="ignore"):
        return np.asarray(-np.log(np.sqrt(_shares(x)) @ np.sqrt(_shares(means)).T))


DISTANCES: Mapping[str, Callable[[Array, Array], Floats]] = {
    "standard": standard,
    "normalised": normalised,
    "bhattacharyya": bhattacharyya,
}
"""The distances by name."""


def _shares(x: Array) -> Floats:
    """Divide each vector by its sum. A vector of zeros is unchanged."""
    total = x.sum(axis=1, keepdims=True)
    return np.asarray(x / np.where(total > 0, total, 1.0))


@dataclass(frozen=True)
class Readout(Part):
    """Base of the readouts of vectors."""

    kind = "readout"

    @property
    def takes_sparse(self) -> bool:
        """Whether `x` may be a sparse matrix."""
        return False

    @abstractmethod
    def fit(self, x: Array, labels: Ints, classes: int, course: Course) -> Learnt:
        """Train the classifier.

        Args:
            x: (recordings, values) vectors.
            labels: (recordings,) classes, from 0 to classes - 1.
            classes: number of classes; some may have no recordings.
            course: conditions of the training, of which only the seed is used.

        Raises:
            ModelError: an optional dependency is not installed.
        """

    @abstractmethod
    def scores(self, learnt: Learnt, x: Array) -> Floats:
        """Return scores (recordings, classes), larger for a more likely class."""

    def work(self, learnt: Learnt, values: int, classes: int) -> Work | None:
        """Return the operations of `scores` for a vector of `values` values; None if they are not counted."""
        return None


@dataclass(frozen=True)
class Svm(Readout):
    """A linear support vector machine, one class against the others."""

    source = "Cortes and Vapnik, Machine Learning 20:273, 1995; LinearSVC of scikit-learn (liblinear)"

    C: float = setting(0.01, "", "weight of errors against a wide margin", "chosen inside one training split", above=0)
    scale: str = setting(
        "standard", "", "standard: values to mean 0, deviation 1; length: vectors to length 1; none", "usual",
        words=("standard", "length", "none"),
    )  # fmt: skip

    @property
    def takes_sparse(self) -> bool:
        """Whether `x` may be a sparse matrix, which holds only if values are not scaled."""
        return self.scale == "none"

    def fit(self, x: Array, labels: Ints, classes: int, course: Course) -> Learnt:
        """Learn weights and thresholds."""
        svm = _learner("LinearSVC")
        middle, spread = _scale(x) if self.scale == "standard" else (np.zeros(1), np.ones(1))
        machine = svm(C=self.C, dual="auto", random_state=course.seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a warning about convergence: the last iterate is used
            machine.fit(_standard(x, middle, spread) if self.scale == "standard" else self._scaled(x), labels)
        planes, offsets = machine.coef_, machine.intercept_
        if len(machine.classes_) == 2:  # scikit-learn has a single plane for two classes
            planes, offsets = np.concatenate([-planes, planes]), np.concatenate([-offsets, offsets])
        weights, thresholds = np.zeros((classes, planes.shape[1])), np.full(classes, -np.inf)
        weights[machine.classes_], thresholds[machine.classes_] = planes, offsets
        # Planes are converted to unscaled values, so that scoring needs no standardisation.
        shift = weights @ (middle / spread) if self.scale == "standard" else 0.0
        return {"weights": weights / spread, "thresholds": thresholds - shift}

    def scores(self, learnt: Learnt, x: Array) -> Floats:
        """Return signed distances from the planes, in units of the margin."""
        m: Any = learnt
        return np.asarray(self._scaled(x) @ m["weights"].T + m["thresholds"])

    def _scaled(self, x: Array) -> Array:
        """Scale vectors to length 1 if `scale` is "length". A vector of zeros is unchanged."""
        if self.scale != "length":
            return x
        length = np.sqrt((x**2).sum(axis=1, keepdims=True))
        return np.asarray(np.divide(x, length, out=np.zeros_like(x), where=length > 0))

    def work(self, learnt: Learnt, values: int, classes: int) -> Work:
        """Return a multiply-add for each weight, and a threshold. A length takes squares, a root and divisions."""
        length = (2 * values + 1) * (self.scale == "length")
        return on_numbers(classes * (values + 1) + length, values + classes * (values + 2))


@dataclass(frozen=True)
class Rbf(Readout):
    """A support vector machine with a Gaussian kernel, one class against the others, on standardised values."""

    source = "Cortes and Vapnik, Machine Learning 20:273, 1995; SVC of scikit-learn (libsvm)"

    C: float = setting(10.0, "", "weight of errors against a wide margin", "scikit-learn's 1, times 10", above=0)
    gamma: float = setting(1.0, "", "1 / width^2 of the kernel, times the number of values", "scikit-learn", above=0)

    def fit(self, x: Array, labels: Ints, classes: int, course: Course) -> Learnt:
        """Learn the support vectors and their weights."""
        svc = _learner("SVC")
        middle, spread = _scale(x)
        scaled = _standard(x, middle, spread)
        weights, thresholds = np.zeros((classes, len(x))), np.full(classes, -np.inf)
        for label in np.unique(labels):
            machine = svc(C=self.C, gamma=self.gamma / x.shape[1]).fit(scaled, labels == label)
            weights[label, machine.support_] = machine.dual_coef_[0]
            thresholds[label] = machine.intercept_[0]
        is_support = weights.any(axis=0)
        parameters = {"vectors": scaled[is_support], "weights": weights[:, is_support], "thresholds": thresholds}
        return {"middle": middle, "spread": spread, **parameters}

    def scores(self, learnt: Learnt, x: Array) -> Floats:
        """Return the decision function of each machine, in units of the margin."""
        m: Any = learnt
        scaled = (x - m["middle"]) / m["spread"]
        squares = (scaled**2).sum(1)[:, None] + (m["vectors"] ** 2).sum(1) - 2.0 * scaled @ m["vectors"].T
        kernel = np.exp(-self.gamma / x.shape[1] * np.maximum(squares, 0.0))
        return np.asarray(kernel @ m["weights"].T + m["thresholds"])

    def work(self, learnt: Learnt, values: int, classes: int) -> Work:
        """Return the operations: 3 per value, products with each vector and its squares, 6 per kernel, and weights."""
        vectors = len(np.asarray(learnt["weights"])[0])
        macs = 3 * values + 2 * vectors * values + 6 * vectors + classes * (vectors + 1)
        return on_numbers(macs, 3 * values + vectors * (values + classes) + 2 * classes)


@dataclass(frozen=True)
class Ridge(Readout):
    """Ridge regression, one class against the others, on standardised values; fast to train."""

    source = "Rifkin and Klautau, JMLR 5:101, 2004, section 3.2 (regularised least squares classification)"

    penalty: float = setting(
        1000.0, "", "cost of weights against errors", "best of 300, 1000, 3000 on N-MNIST", above=0
    )

    def fit(self, x: Array, labels: Ints, classes: int, course: Course) -> Learnt:
        """Solve for the weights in closed form, in the smaller of the primal and the dual space."""
        middle, spread = _scale(x)
        scaled = _standard(x, middle, spread)
        targets = np.where(labels[:, None] == np.arange(classes), 1.0, -1.0)
        mean_targets = targets.mean(axis=0)
        if len(x) <= x.shape[1]:
            inner = scaled @ scaled.T + self.penalty * np.eye(len(x))
            weights = scaled.T @ np.linalg.solve(inner, targets - mean_targets)
        else:
            inner = scaled.T @ scaled + self.penalty * np.eye(x.shape[1])
            weights = np.linalg.solve(inner, scaled.T @ (targets - mean_targets))
        weights = np.ascontiguousarray(weights.T / spread)  # same memory order as when read from a file, for equal bits
        has_recordings = np.isin(np.arange(classes), labels)
        return {"weights": weights, "thresholds": np.where(has_recordings, mean_targets - weights @ middle, -np.inf)}

    def scores(self, learnt: Learnt, x: Array) -> Floats:
        """Return scores from about -1 to about 1."""
        m: Any = learnt
        return np.asarray(x @ m["weights"].T + m["thresholds"])

    def work(self, learnt: Learnt, values: int, classes: int) -> Work:
        """Return a product with a sum for each weight, and the threshold of each class."""
        return on_numbers(classes * (values + 1), values + classes * (values + 2))


@dataclass(frozen=True)
class Nearest(Readout):
    """The class with the nearest mean."""

    source = "Lagorce et al., IEEE TPAMI 39:1346, 2017, section 3.3"

    distance: str = setting(
        "standard", "", "distance from the mean: Euclidean, or between shares Euclidean or Bhattacharyya's",
        "the paper has all three; values that are shares, as those of HOTS, make the first two one",
        words=(*DISTANCES,),
    )  # fmt: skip

    def fit(self, x: Array, labels: Ints, classes: int, course: Course) -> Learnt:
        """Compute the mean of each class."""
        means = np.full((classes, x.shape[1]), np.inf)
        for label in np.unique(labels):
            means[label] = x[labels == label].mean(axis=0)
        return {"means": means}

    def scores(self, learnt: Learnt, x: Array) -> Floats:
        """Return negative distances; -inf for a class without recordings."""
        means = np.asarray(learnt["means"])
        has_recordings = np.isfinite(means).all(axis=1)
        scores = np.full((len(x), len(means)), -np.inf)
        scores[:, has_recordings] = -DISTANCES[self.distance](x, means[has_recordings])
        return scores


Readout.known = Registry("readout", (Svm, Rbf, Ridge, Nearest))


def _scale(x: Array) -> tuple[Floats, Floats]:
    """Return mean and standard deviation of each value. The deviation of a constant value is set to 1."""
    spread = x.std(axis=0)
    return x.mean(axis=0), np.where(spread > 0, spread, 1.0)


def _standard(x: Array, middle: Floats, spread: Floats) -> Floats:
    """Standardise values with a single copy, because there may be tens of thousands of vectors."""
    scaled: Floats = x - middle
    scaled /= spread
    return scaled


def _learner(name: str) -> Any:
    """Return a class of scikit-learn.

    Raises:
        ModelError: scikit-learn is not installed.
    """
    try:
        from sklearn import svm
    except ImportError:
        raise ModelError(
            "this readout is trained by scikit-learn, which is not installed", hint=install("recognise")
        ) from None
    return getattr(svm, name)
