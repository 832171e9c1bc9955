"""Opponents on plain features: the values of all frames in a row."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import install
from neuro_bench.costs import Costs, arithmetic
from neuro_bench.method import Method
from neuro_bench.task import Examples


def _sklearn(method: Method) -> None:
    try:
        import sklearn  # noqa: F401
    except ImportError:
        message = f"method '{method.called_by}' needs scikit-learn, which is not installed"
        raise ModelError(message, hint=install("bench")) from None


def _versions(train: Examples, count: int) -> Examples:
    """The first versions of all recordings; an exact learner shown many of them takes long, and gains little."""
    return train.take(np.arange(train.recordings), min(count, train.versions))


def _rows(shown: Examples, pooled: int = 1) -> Any:
    """The features of each example, means of squares of so many rows and columns."""
    n, channels, rows, columns = shown.frames.shape
    cut = shown.frames[:, :, : rows - rows % pooled, : columns - columns % pooled]
    means = cut.reshape(n, channels, rows // pooled, pooled, columns // pooled, pooled).mean(axis=(3, 5))
    return means.reshape(n, -1)


class LogisticRegression(Method):
    """A weight for each feature and class."""

    called_by = "logistic"
    title = "logistic regression on all frames (scikit-learn)"
    settings = {"C": 0.01, "pooled": 1, "versions": 2}
    space = {"C": (0.001, 0.003, 0.01, 0.03, 0.1, 1.0), "pooled": (1, 2), "versions": (1, 2, 4)}

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> _Classifier:
        """Learn from examples; see `Method`."""
        _sklearn(self)
        from sklearn.linear_model import LogisticRegression as Logistic
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        train = _versions(train, settings["versions"])
        learner = make_pipeline(StandardScaler(), Logistic(C=settings["C"], max_iter=1000, random_state=seed))
        learner.fit(_rows(train, settings["pooled"]), train.labels)
        return _Classifier(learner, settings["pooled"], learner[-1].coef_)


class GradientBoosting(Method):
    """Trees that correct each other."""

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
        _sklearn(self)
        from sklearn.ensemble import HistGradientBoostingClassifier as Boosting

        train = _versions(train, settings["versions"])
        words = {"learning_rate": settings["rate"], "max_iter": settings["trees"], "early_stopping": False}
        learner = Boosting(max_leaf_nodes=settings["leaves"], random_state=seed, **words)
        learner.fit(_rows(train, settings["pooled"]), train.labels)
        return _Classifier(learner, settings["pooled"])


class _Classifier:
    def __init__(self, learner: Any, pooled: int, weights: Any = None) -> None:
        self._learner, self._pooled, self._weights = learner, pooled, weights

    def predict(self, shown: Examples) -> Any:
        """The class of each."""
        return self._learner.predict(_rows(shown, self._pooled))

    def costs(self, shown: Examples) -> Costs:
        """Of a linear one its products; of trees only the bytes are known."""
        size = len(pickle.dumps(self._learner))
        if self._weights is None:
            return Costs(parameters=0, footprint_bytes=size)
        used = (self._weights != 0).sum(axis=0)
        effective = float(((_rows(shown, self._pooled) != 0) * used).sum() / len(shown))
        zeros = 1.0 - np.count_nonzero(self._weights) / self._weights.size
        words: Any = {"connection_sparsity": zeros, "effective_macs": effective, "dense": float(self._weights.size)}
        words |= {"joules": arithmetic("float32", effective, float(self._weights.size))}
        return Costs(parameters=self._weights.size + len(self._weights), footprint_bytes=size, **words)
