"""Benchmarks: spiking networks and non-spiking methods on public tasks, each tuned with the same number of tries.

from neuro_bench import Examples, Fold, Request, Task, run

A new task or method is a subclass of `Task` or `Method`, registered by `neuro.register`.
"""

from neuro_bench.costs import Costs
from neuro_bench.running import METHODS, TASKS, Request, run
from neuro_bench.task import Examples, Fold, Method, Model, Recording, Series, Spikes, Task

__all__ = [
    "METHODS",
    "TASKS",
    "Costs",
    "Examples",
    "Fold",
    "Method",
    "Model",
    "Recording",
    "Request",
    "Series",
    "Spikes",
    "Task",
    "run",
]
