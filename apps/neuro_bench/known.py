"""Tasks and methods by name: ours, those of installed packages, and those that a program registers."""

from __future__ import annotations

from typing import Any

from neuro.apps import Registry
from neuro_bench.artificial import CNN, GRU, QuantisedCNN
from neuro_bench.converted import Converted
from neuro_bench.event_cameras import NMNIST, DVSGesture, PokerDVS
from neuro_bench.features import HATS, GradientBoosting, LogisticRegression
from neuro_bench.local import ReMuS
from neuro_bench.mackey_glass import MackeyGlass
from neuro_bench.method import Method
from neuro_bench.population_code import PopulationCode
from neuro_bench.primate_reaching import PrimateReaching
from neuro_bench.regression import LIFReadout, Perceptron, Wiener
from neuro_bench.reservoir import EchoState, SeriesMean, TanhRidge
from neuro_bench.shd import SHD
from neuro_bench.sounds import Sounds
from neuro_bench.speech_commands import SpeechCommands
from neuro_bench.spiking import Delays, Dense, Recurrent
from neuro_bench.spoken_digits import SpokenDigits
from neuro_bench.task import Task


def _whole(base: type[Any], method: str, words: tuple[str, ...]) -> Any:
    """What refuses a class that lacks a word or a method."""

    def complete(part: Any) -> Any:
        for word in words:
            if not getattr(part, word):
                raise TypeError(f"{base.__name__.lower()} '{part.__name__}' has no {word}: expected a text")
        if getattr(part, method) is getattr(base, method):
            raise TypeError(f"{base.__name__.lower()} '{part.__name__}' has no method {method}")
        return part

    return complete


def _takes(base: type[Any]) -> Any:
    return lambda part: isinstance(part, type) and issubclass(part, base)


TASKS: Registry[type[Task]] = Registry(
    "bench task",
    (SpokenDigits, Sounds, SpeechCommands, SHD, NMNIST, PokerDVS, DVSGesture, MackeyGlass, PrimateReaching),
    takes=_takes(Task),
    group="neuro.bench_tasks",
    complete=_whole(Task, "folds", ("called_by", "title", "licence", "source")),
)
"""The tasks by name; a package registers its own by the entry points `neuro.bench_tasks`."""

METHODS: Registry[type[Method]] = Registry(
    "bench method",
    (
        Converted,
        Recurrent,
        Delays,
        Dense,
        CNN,
        QuantisedCNN,
        GRU,
        LogisticRegression,
        GradientBoosting,
        HATS,
        ReMuS,
        PopulationCode,
        TanhRidge,
        EchoState,
        SeriesMean,
        LIFReadout,
        Wiener,
        Perceptron,
    ),
    takes=_takes(Method),
    group="neuro.bench_methods",
    complete=_whole(Method, "fit", ("called_by", "title")),
)
"""The methods by name; a package registers its own by the entry points `neuro.bench_methods`."""
