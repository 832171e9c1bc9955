"""Functions that a sweep runs at its points, and the metrics of a run."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import math
import os
import runpy
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro import ModelError
from neuro.apps import Registry, is_number, named_by_user, shown, unknown, variation

if TYPE_CHECKING:
    from neuro import Simulation
    from neuro.apps import Log

Metric = Callable[["Simulation"], Any]

METRICS: Registry[Metric] = Registry("metric", (), group="neuro.metrics")
"""User functions that compute a number, or numbers by name, from a simulation that has run."""

TOTALS = ("spikes", "synaptic_ops", "neuron_updates", "neuron_updates_active", "learning_updates")
_OF_POPULATIONS = ("rate", "spikes", "cv")
_OF_PROJECTIONS = ("weight", "weight_sd")
_OF_CHIPS = ("energy", "energy_real_time")
_OF_WORLDS = ("return", "episodes")
UNITS = {"rate": "Hz", "energy": "J", "energy_real_time": "J"}
"""Units of metrics of a part, by the first word of the metric."""


def check_metrics(
    names: Iterable[str], populations: Collection[str], projections: Collection[str], world: bool = False
) -> None:
    """Check the names of metrics before the first run.

    Raises:
        ModelError: a metric, or the part that its name contains, is unknown.
    """
    parts = {**dict.fromkeys(_OF_POPULATIONS, populations), **dict.fromkeys(_OF_PROJECTIONS, projections)}
    totals = (*TOTALS, *(_OF_WORLDS if world else ()))
    for name in names:
        word, dot, part = name.partition(".")
        if dot and word in parts and part not in parts[word]:
            kind = "population" if word in _OF_POPULATIONS else "projection"
            raise unknown(f"{kind} of the metric '{name}':", part, parts[word], path=("metrics",))
        if dot and word in _OF_CHIPS:
            from neuro.chips import chip

            chip(part)
        elif name not in (*totals, *METRICS) and not (dot and word in parts):
            part_names = [f"{word}.{part}" for word, members in parts.items() for part in members]
            chip_names = [f"{word}.CHIP" for word in _OF_CHIPS]
            raise unknown("metric", name, (*totals, *part_names, *chip_names, *METRICS), path=("metrics",))


def measure(
    sim: Simulation, names: Iterable[str], tables: Mapping[str, str] | None = None, log: Log | None = None
) -> dict[str, Any]:
    """Return metrics of a simulation that has run, by name.

    Args:
        sim: the simulation.
        names: names of metrics: `spikes` and other totals; `rate.POPULATION` in Hz per neuron; `spikes.POPULATION`;
            `cv.POPULATION`, the mean coefficient of variation of the intervals; `weight.PROJECTION` and
            `weight_sd.PROJECTION`, mean and standard deviation of the weights at the end; `energy.CHIP` in J, if the
            chip runs as fast as it can, and `energy_real_time.CHIP`; the name of a registered function. In a world also
            `return`, the mean of the last 100 episodes, and `episodes`.
        tables: files of chip tables by name of the chip, if the sweep changes their figures.
        log: episodes of a network in a world.
    """
    metrics: dict[str, Any] = {}
    for name in names:
        if log is not None and name in _OF_WORLDS:
            value: Any = log.mean(100) if name == "return" else len(log)
        else:
            value = METRICS[name](sim) if name in METRICS else _built_in_metric(sim, name, tables or {})
        metrics |= numbers(value, name)
    return metrics


def numbers(value: Any, name: str) -> dict[str, Any]:
    """Return the result of a function as plain values by name. `name` is the name of a single value.

    Raises:
        ModelError: the result is neither a number or text, nor a mapping to numbers and texts.
    """
    values = value if isinstance(value, Mapping) else {name: value}
    return {str(word): _plain(item, str(word)) for word, item in values.items()}


def _plain(value: Any, name: str) -> Any:
    if isinstance(value, (np.generic, np.ndarray)) and value.ndim == 0:
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise ModelError(f"metric '{name}' = {shown(value)}: expected a number or a text")


def _built_in_metric(sim: Simulation, name: str, tables: Mapping[str, str]) -> Any:
    word, dot, part = name.partition(".")
    if not dot:
        return getattr(sim.counts(), name)
    if word in _OF_CHIPS:
        bill = sim.energy(tables.get(part, part))
        return (bill if word == "energy" else bill.real_time).total_j
    if word in _OF_PROJECTIONS:
        weight = sim.get(part, "weight")
        return float((weight.mean() if word == "weight" else weight.std()) if weight.size else np.nan)
    if word == "cv":
        per_neuron = variation(*sim.spikes(part))
        return float(per_neuron.mean()) if per_neuron.size else np.nan
    spikes, size = sim.counts().populations[part].spikes, sim.handles.neurons(part).part.size
    return spikes if word == "spikes" else spikes / size / (sim.time / 1000.0) if size and sim.time else 0.0


IsWorse = Callable[[int, float], bool]
"""Function of a step and its value that returns True if the run is so much worse than others that it has to end."""


class Pruned(Exception):
    """Raised by `report_step` to end a run early, since other runs were better at this step. Do not catch it."""


@dataclass
class ReportedSteps:
    """The steps that a run reports.

    Attributes:
        is_worse: function that decides whether the run ends; None without pruning.
        steps: values by step.
    """

    is_worse: IsWorse | None = None
    steps: dict[str, float] = field(default_factory=dict)


_reported: ContextVar[ReportedSteps | None] = ContextVar("reported", default=None)


def report_step(value: float, step: int) -> None:
    """Report the objective of a run so far. A tuning with pruning may end the run if other runs were better.

    A function that `neuro.tune` runs calls `report_step` e.g. after each epoch. Outside of a tuning, and without
    pruning, the call does nothing.

    Args:
        value: value of the objective so far.
        step: number of the step, from 0, e.g. the epoch. Report each step at most once.

    Raises:
        Pruned: the run has to end. This is not an error: do not catch it.
        ModelError: the value is not a finite number, or the step is not a whole number >= 0.
    """
    if not is_number(value) or not math.isfinite(value):
        raise ModelError(f"report_step: value = {shown(value)}: expected a finite number")
    if isinstance(step, bool) or not isinstance(step, int) or step < 0:
        raise ModelError(f"report_step: step = {shown(step)}: expected a whole number >= 0")
    reported = _reported.get()
    if reported is None:
        return
    reported.steps[str(step)] = float(value)
    if reported.is_worse is not None and reported.is_worse(step, float(value)):
        raise Pruned(f"step {step}: {value:g}")


@contextmanager
def gather_steps(is_worse: IsWorse | None) -> Iterator[ReportedSteps]:
    """Collect the steps that are reported inside the context."""
    reported = ReportedSteps(is_worse)
    token = _reported.set(reported)
    try:
        yield reported
    finally:
        _reported.reset(token)


STUDIES: Registry[Callable[..., Any]] = Registry("study", (), group="neuro.studies")
"""Functions by name that compute metrics at a point: those of apps, and those that a file of `--with` registers."""


@dataclass(frozen=True)
class FunctionRun:
    """The call of a function at a point.

    Attributes:
        name: name of the function in its module, or of the study.
        module: module that defines the function; "" for a study.
        file: file of a module that is a script; else "".
        source: hash of the function's source text.
        set: values that are the same in all runs.
        paths: folders in which modules are searched.
        here: the function itself, in the process that began the sweep; None in other processes.
    """

    name: str
    module: str = ""
    file: str = ""
    source: str = ""
    set: Mapping[str, Any] | None = None
    paths: tuple[str, ...] = ()
    here: Callable[..., Any] | None = None

    def identity(self) -> dict[str, Any]:
        """Return all inputs of a run but point and seed. Equal identities give equal results."""
        return {"function": self.name, "source": self.source, "set": dict(self.set or {})}

    def as_dict(self) -> dict[str, Any]:
        """Return the call as plain data, for `from_dict`."""
        content = {"name": self.name, "module": self.module, "file": self.file, "source": self.source}
        return {"kind": "function", **content, "set": dict(self.set or {}), "paths": list(self.paths)}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> FunctionRun:
        """Return the call for the data of `as_dict`."""
        fields = {name: value for name, value in content.items() if name != "kind"}
        return cls(**{**fields, "paths": tuple(fields["paths"])})

    def named_by_user(self) -> FunctionRun:
        """Return the call of the same function in a file that the user named by `--with`. Studies are returned as is.

        Raises:
            ModelError: the user did not name the file, or the file does not define the function.
        """
        if not self.module:
            return self
        file = self.file or f"{self.module.replace('.', os.sep)}.py"
        module = Path(named_by_user(file)).stem
        run = replace(self, module=module, file="", paths=())
        # Refuse a function that the file only imports, e.g. one with the name "os.system".
        if getattr(run.function, "__module__", None) != module:
            raise ModelError(f"{file}: defines no function '{self.name}'")
        return run

    @cached_property
    def function(self) -> Callable[..., Any]:
        """The function. Other processes find the function by name.

        Raises:
            ModelError: there is no function of that name.
        """
        if self.here is not None:
            return self.here
        if not self.module:
            if self.name not in STUDIES:
                raise unknown("study", self.name, STUDIES)
            return STUDIES[self.name]
        sys.path[:] = [*self.paths, *(path for path in sys.path if path not in self.paths)]
        value: Any
        if self.file:
            value = runpy.run_path(self.file, run_name="__mp_main__").get(self.name.partition(".")[0])
        else:
            value = getattr(importlib.import_module(self.module), self.name.partition(".")[0], None)
        for word in self.name.split(".")[1:]:
            value = getattr(value, word, None)
        if not callable(value):
            raise ModelError(f"{self.file or self.module}: has no function '{self.name}'")
        function: Callable[..., Any] = value
        return function

    @property
    def files(self) -> Iterable[str]:
        """The file that defines the function, if any."""
        try:
            file = inspect.getsourcefile(self.function)
        except TypeError:
            file = None
        return [os.path.abspath(file)] if file and Path(file).exists() else []

    def check_inputs(self) -> None:
        """Check that the function is found, and is unchanged since the sweep began.

        Raises:
            ModelError: the function is not found, or was edited.
        """
        if self.here is None and _source(self.function) != self.source:
            message = f"'{self.name}' was edited since the sweep began: expected the unchanged function"
            raise ModelError(message, hint="use a new folder")

    def check(self, point: Mapping[str, Any], seeded: bool) -> None:
        """Check that the function has the parameters of the space, and no others without a default.

        Raises:
            ModelError: the parameters differ.
        """
        try:
            signature = inspect.signature(self.function).parameters
        except ValueError:
            return
        if any(parameter.kind is parameter.VAR_KEYWORD for parameter in signature.values()):
            return
        kinds = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        names = [name for name, parameter in signature.items() if parameter.kind in kinds]
        arguments = [*(self.set or {}), *point, *(["seed"] if seeded else [])]
        for name in arguments:
            if name not in names:
                raise unknown(f"parameter of {self.name}", name, names)
        for name in names:
            if name not in arguments and signature[name].default is inspect.Parameter.empty:
                hint = "set 'seeds'" if name == "seed" else ""
                raise ModelError(f"{self.name} needs '{name}', which the space does not have", hint=hint)

    def __call__(self, point: Mapping[str, Any], seed: int | None) -> tuple[dict[str, Any], None, dict[str, Any]]:
        """Call the function. Return the metrics, None (no files to write), and entries for the run's provenance."""
        seeded = {} if seed is None else {"seed": seed}
        return numbers(self.function(**{**(self.set or {}), **point, **seeded}), "value"), None, seeded


def function_run(function: Any, set: Mapping[str, Any] | None = None, here: bool = False) -> FunctionRun:
    """Return the call of a function.

    Args:
        function: a function of a module or a script, or the name of a study.
        set: values that are the same in all runs.
        here: only this process calls the function.

    Raises:
        ModelError: this is not a function, other processes cannot find it, or `set` is not a mapping.
    """
    if set is not None and not isinstance(set, Mapping):
        raise ModelError(f"set = {shown(set)}: expected values by name")
    if isinstance(function, str):
        run = FunctionRun(function, set=set)
        return FunctionRun(function, source=_source(run.function), set=set)
    if not callable(function) or not hasattr(function, "__qualname__"):
        raise ModelError(f"function = {shown(function)}: expected a function")
    name, module = function.__qualname__, function.__module__
    script = getattr(sys.modules.get("__main__"), "__file__", None) if module == "__main__" else None
    script_path = os.path.abspath(script) if script else ""
    paths = tuple(os.path.abspath(path) for path in sys.path)
    run = FunctionRun(name, module, script_path, _source(function), set, paths, function)
    if not here:
        _check_found_elsewhere(run)
    return run


def _check_found_elsewhere(run: FunctionRun) -> None:
    """Raise an error if other processes cannot find a function by its name."""
    if "<" in run.name or (run.module == "__main__" and not run.file):
        place = "inside another function" if "<locals>" in run.name else "interactively"
        if "<lambda>" in run.name:
            place = "without a name"
        hint = 'define it in a file, with a name; or on="here" calls it in this process, one run after the other'
        raise ModelError(f"{run.name}: is defined {place}, so other processes cannot find it", hint=hint)


def _source(function: Callable[..., Any]) -> str:
    """Return the hash of the source text of a function, or of its bytecode if there is no text."""
    try:
        text = inspect.getsource(function)
    except (OSError, TypeError):
        text = repr(getattr(getattr(function, "__code__", None), "co_code", ""))
    return hashlib.sha256(text.encode()).hexdigest()
