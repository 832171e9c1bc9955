"""What a method is: settings, a space to choose from, and `fit`, whose model predicts and has costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import Any, ClassVar, Protocol

import numpy as np

from neuro import ModelError
from neuro.apps import install
from neuro_bench.costs import Costs
from neuro_bench.task import Kind


class Model(Protocol):
    """What was learnt."""

    def predict(self, shown: Any) -> Any:
        """The class of each of `Examples`, so many next values of a series, or the values of each step."""

    def costs(self, shown: Any) -> Costs:
        """What an example of these takes."""


class Method:
    """Base of the methods.

    Class attributes:
        kind: of the tasks that it suits.
        called_by: the name on the command line.
        title: in one line.
        spiking: whether it is a spiking network.
        settings: what may be chosen, with the values of the first try.
        space: of some settings the values that further tries are drawn from.
    """

    kind: ClassVar[Kind] = "classes"
    called_by: ClassVar[str] = ""
    title: ClassVar[str] = ""
    spiking: ClassVar[bool] = False
    settings: ClassVar[Mapping[str, Any]] = {}
    space: ClassVar[Mapping[str, Sequence[Any]]] = {}

    @classmethod
    def called(cls) -> str:
        """The name on the command line."""
        return cls.called_by

    def fit(self, train: Any, settings: Mapping[str, Any], seed: int) -> Model:
        """Learn from `Examples`, a `Series` or a `Recording`.

        Args:
            train: what to learn from.
            settings: a value for each of `settings`.
            seed: of all that is random.
        """
        raise NotImplementedError


NEEDED = {"torch": ("PyTorch", "torch"), "sklearn": ("scikit-learn", "bench")}
"""By module what it is called, and the extra that has it."""


def check_installed(method: Method, module: str) -> None:
    """Refuse a method where a module that it learns by is not installed.

    Args:
        method: the method.
        module: a name of `NEEDED`.

    Raises:
        ModelError: it is not.
    """
    if find_spec(module) is None:
        title, extra = NEEDED[module]
        raise ModelError(f"method '{method.called_by}' learns by {title}, which is not installed", hint=install(extra))


def tries(method: Method, changes: Mapping[str, Any], count: int, seed: int) -> list[dict[str, Any]]:
    """The settings of each try: the first as they are, the others drawn from the space, none twice in a small space.

    Args:
        method: whose settings they are.
        changes: settings that are otherwise than the method's, in all tries.
        count: how many tries.
        seed: of the draws.
    """
    rng = np.random.default_rng((seed, 7))
    found = [{**method.settings, **changes}]
    for _ in range(100 * count):
        if len(found) == count:
            break
        drawn = {name: values[int(rng.integers(len(values)))] for name, values in method.space.items()}
        if (one := {**method.settings, **drawn, **changes}) not in found:
            found.append(one)
    return found
