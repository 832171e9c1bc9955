"""Benchmarks of the field: tasks, spiking networks and what is not spiking, each tuned with the same tries.

from neuro_bench import Examples, Fold, Request, Task, run

A task or a method of one's own is a subclass of `Task` or `Method`, registered by `neuro.register`.
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
