"""Non-spiking classifiers on features: logistic regression and boosting on all frames, and HATS."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from neuro import ModelError
from neuro_bench.costs import UNKNOWN, Costs, product_costs
from neuro_bench.task import Examples, Method, check_installed
from neuro_events import Events
from neuro_events.representations import hats


def _rows(data: Examples, pooled: int = 1) -> Any:
    """Return the frames of each example as a row, averaged over squares of `pooled` x `pooled` pixels."""
    n, channels, rows, columns = data.frames.shape
    whole_squares = data.frames[:, :, : rows - rows % pooled, : columns - columns % pooled]
    means = whole_squares.reshape(n, channels, rows // pooled, pooled, columns // pooled, pooled).mean(axis=(3, 5))
    return means.reshape(n, -1)


class LogisticRegression(Method):
    """Logistic regression: a weight for each feature and class."""

    called_by = "logistic"
    title = "logistic regression on all frames (scikit-learn)"
    settings = {"C": 0.01, "pooled": 1, "versions": 2}
    space = {"C": (0.001, 0.003, 0.01, 0.03, 0.1, 1.0), "pooled": (1, 2), "versions": (1, 2, 4)}

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> _Classifier:
        """Learn from examples; see `Method`."""
        check_installed(self, "sklearn")
        from sklearn.linear_model import LogisticRegression as Logistic
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        # Only the first versions of each recording: with more, training is much slower and hardly more accurate.
        train = train.take(np.arange(train.recordings), min(settings["versions"], train.versions))
        learner = make_pipeline(StandardScaler(), Logistic(C=settings["C"], max_iter=1000, random_state=seed))
        learner.fit(_rows(train, settings["pooled"]), train.labels)
        return _Classifier(learner, settings["pooled"], learner[-1].coef_)


class GradientBoosting(Method):
    """Gradient-boosted decision trees."""

    called_by = "boosting"
    title = "gradient boosting on pooled frames (scikit-learn)"
    settings = {"rate": 0.1, "trees": 60, "leaves": 15, "pooled": 4, "versions": 2}
    space = {
        "rate": (0.05, 0.1, 0.2),
        "trees": (40, 60, 100),
        "leaves": (7, 15, 31),
        "pooled": (4, 8),
        "versions": (1, 2, 4),
    }

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> _Classifier:
        """Learn from examples; see `Method`."""
        check_installed(self, "sklearn")
        from sklearn.ensemble import HistGradientBoostingClassifier as Boosting

        # Only the first versions of each recording: with more, training is much slower and hardly more accurate.
        train = train.take(np.arange(train.recordings), min(settings["versions"], train.versions))
        options = {"learning_rate": settings["rate"], "max_iter": settings["trees"], "early_stopping": False}
        learner = Boosting(max_leaf_nodes=settings["leaves"], random_state=seed, **options)
        learner.fit(_rows(train, settings["pooled"]), train.labels)
        return _Classifier(learner, settings["pooled"])


class HATS(Method):
    """Histograms of averaged time surfaces (HATS) over cells of neurons, and a linear support vector machine.

    The features are those of `neuro recognise --method hats`. Each sheet of the input holds one polarity.
    """

    called_by = "hats"
    title = "histograms of averaged time surfaces, linear support vector machine (scikit-learn)"
    settings = {"C": 100.0, "cell": 7, "radius": 3, "tau": 100.0}
    space = {"C": (10.0, 30.0, 100.0), "cell": (5, 7, 9), "radius": (2, 3, 4), "tau": (30.0, 100.0)}

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> _HATS:
        """Learn from examples; see `Method`."""
        check_installed(self, "sklearn")
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import Normalizer
        from sklearn.svm import LinearSVC

        if train.spikes.shape[0] > 2:
            message = f"method 'hats': the input has {train.spikes.shape[0]} sheets"
            raise ModelError(f"{message}: expected the two polarities of an event camera, or one sheet")
        learner = make_pipeline(Normalizer(), LinearSVC(C=settings["C"], max_iter=10_000, random_state=seed))
        return _HATS(learner.fit(surfaces(train, settings), train.labels), settings)


def recordings(data: Examples) -> Iterator[Events]:
    """Yield the spikes of each example as camera events. A sheet is a polarity; all events of a step have one time."""
    spikes = data.spikes
    p, y, x = (coordinate.astype(np.uint16) for coordinate in np.unravel_index(spikes.neuron, spikes.shape))
    t, size = (1e3 * spikes.step * spikes.at).astype(np.int64), spikes.shape[:0:-1]
    ends = np.searchsorted(spikes.example, np.arange(len(data) + 1)).tolist()
    for rows in (slice(*bounds) for bounds in pairwise(ends)):
        yield Events(t=t[rows], x=x[rows], y=y[rows], p=p[rows].astype(np.uint8), sensor_size=size)


def surfaces(data: Examples, settings: Mapping[str, Any]) -> Any:
    """Return the histograms of each example as a row, shape (examples, features); see `HATS`."""
    tau = round(1e3 * settings["tau"])
    options: Any = {"cell": settings["cell"], "radius": settings["radius"], "window_us": tau, "tau_us": tau}
    return np.stack([hats(events, **options).ravel() for events in recordings(data)])


class _HATS:
    def __init__(self, learner: Any, settings: Mapping[str, Any]) -> None:
        self.settings, self._learner = settings, learner

    def predict(self, data: Examples) -> Any:
        """Return the class of each example."""
        return self._learner.predict(surfaces(data, self.settings))

    def costs(self, data: Examples) -> Costs:
        """Count the products of the classifier, and one product for each pixel around each spike."""
        weights = self._learner[-1].coef_
        neighbours = len(data.spikes.at) / len(data) * (2 * self.settings["radius"] + 1) ** 2
        effective = neighbours + float((surfaces(data, self.settings) != 0).sum() / len(data)) * len(weights)
        dense = neighbours + weights.size
        size = weights.size + len(weights)
        return product_costs(size, 8 * size, effective, dense)


class _Classifier:
    def __init__(self, learner: Any, pooled: int, weights: Any = None) -> None:
        self._learner, self._pooled, self._weights = learner, pooled, weights

    def predict(self, data: Examples) -> Any:
        """Return the class of each example."""
        return self._learner.predict(_rows(data, self._pooled))

    def costs(self, data: Examples) -> Costs:
        """Count the products of a linear classifier; the costs of trees are unknown."""
        if self._weights is None:
            return UNKNOWN
        size = self._weights.size + len(self._weights)
        products = (self._weights != 0).sum(axis=0)  # of each feature
        effective = float(((_rows(data, self._pooled) != 0) * products).sum() / len(data))
        zeros = 1.0 - np.count_nonzero(self._weights) / self._weights.size
        footprint, dense = self._weights.itemsize * size, float(self._weights.size)
        return product_costs(size, footprint, effective, dense, connection_sparsity=zeros)
