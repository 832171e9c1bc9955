"""Functions that are run at the points of a sweep, and the numbers that a run gives."""

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
"""Functions of a simulation that has run to a number, or to numbers by name."""

TOTALS = ("spikes", "synaptic_ops", "neuron_updates", "neuron_updates_active", "learning_updates")
_OF_POPULATIONS = ("rate", "spikes", "cv")
_OF_PROJECTIONS = ("weight", "weight_sd")
_OF_CHIPS = ("energy", "energy_real_time")
_OF_WORLDS = ("return", "episodes")
UNITS = {"rate": "Hz", "energy": "J", "energy_real_time": "J"}
"""Of metrics of one part, by their first word."""


def check_metrics(
    names: Iterable[str], populations: Collection[str], projections: Collection[str], world: bool = False
) -> None:
    """See whether metrics have a meaning, before the first run.

    Raises:
        ModelError: one has none.
    """
    for name in names:
        word, dot, of = name.partition(".")
        if dot and word in _OF_POPULATIONS and of not in populations:
            raise unknown(f"population of the metric '{name}':", of, populations, path=("metrics",))
        if dot and word in _OF_PROJECTIONS and of not in projections:
            raise unknown(f"projection of the metric '{name}':", of, projections, path=("metrics",))
        if dot and word in _OF_CHIPS:
            from neuro.chips import chip

            chip(of)
        if not (dot and word in (*_OF_POPULATIONS, *_OF_PROJECTIONS, *_OF_CHIPS)) and name not in (
            *TOTALS,
            *(_OF_WORLDS if world else ()),
            *METRICS,
        ):
            of_parts = [f"{each}.{part}" for each in _OF_POPULATIONS for part in populations]
            of_parts += [f"{each}.{part}" for each in _OF_PROJECTIONS for part in projections]
            known = (
                *TOTALS,
                *(_OF_WORLDS if world else ()),
                *of_parts,
                *(f"{each}.CHIP" for each in _OF_CHIPS),
                *METRICS,
            )
            raise unknown("metric", name, known, path=("metrics",))


def measured(
    sim: Simulation, names: Iterable[str], tables: Mapping[str, str] | None = None, log: Log | None = None
) -> dict[str, Any]:
    """Metrics of a simulation that has run, by name.

    Args:
        sim: the simulation.
        names: `spikes` and other totals; `rate.POPULATION` in Hz a neuron, `spikes.POPULATION`, `cv.POPULATION`, the
            mean coefficient of variation of the intervals; `weight.PROJECTION`, their mean at the end, and
            `weight_sd.PROJECTION`; `energy.CHIP` in J, as fast as the chip can, and `energy_real_time.CHIP`; or
            that of a registered function. In a world `return`, the mean of the last 100 episodes, and `episodes`.
        tables: of chips by name, where the sweep changes their figures.
        log: the episodes of a network in a world.
    """
    found: dict[str, Any] = {}
    for name in names:
        if log is not None and name in _OF_WORLDS:
            value: Any = log.mean(100) if name == "return" else len(log)
        else:
            value = METRICS[name](sim) if name in METRICS else _own(sim, name, tables or {})
        found |= numbers(value, name)
    return found


def numbers(value: Any, name: str) -> dict[str, Any]:
    """What a function returned, as plain values by name.

    Raises:
        ModelError: it is neither a number nor numbers by name.
    """
    each = value if isinstance(value, Mapping) else {name: value}
    return {str(word): _plain(one, str(word)) for word, one in each.items()}


def _plain(value: Any, name: str) -> Any:
    if isinstance(value, (np.generic, np.ndarray)) and value.ndim == 0:
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise ModelError(f"metric '{name}' = {shown(value)}: expected a number or a text")


def _own(sim: Simulation, name: str, tables: Mapping[str, str]) -> Any:
    word, dot, of = name.partition(".")
    if not dot:
        return getattr(sim.counts(), name)
    if word in _OF_CHIPS:
        bill = sim.energy(tables.get(of, of))
        return (bill if word == "energy" else bill.real_time).total_j
    if word in _OF_PROJECTIONS:
        weight = sim.get(of, "weight")
        return float((weight.mean() if word == "weight" else weight.std()) if weight.size else np.nan)
    if word == "cv":
        each = variation(*sim.spikes(of))
        return float(each.mean()) if each.size else np.nan
    spikes, size = sim.counts().populations[of].spikes, sim.handles.neurons(of).part.size
    return spikes if word == "spikes" else spikes / size / (sim.time / 1000.0) if size and sim.time else 0.0


IsWorse = Callable[[int, float], bool]
"""Gets a step and its value; whether the run is so much worse than others that it ends."""


class Pruned(Exception):
    """A run ends early: at this step others were better. Raised by `report_step`; to be let through."""


@dataclass
class ReportedSteps:
    """The steps that a run has reported.

    Attributes:
        worse: whether it ends; None where nothing is pruned.
        steps: value by step.
    """

    worse: IsWorse | None = None
    steps: dict[str, float] = field(default_factory=dict)


_heard: ContextVar[ReportedSteps | None] = ContextVar("heard", default=None)


def report_step(value: float, step: int) -> None:
    """Report how good a run is so far, so that a tuning which prunes can end it where others were better.

    Called by a function that `neuro.tune` calls, after each epoch say. It does nothing where nothing is pruned, so the
    function runs as well by itself.

    Args:
        value: of the objective, as far as it is known.
        step: of what grows in the run, from 0 on: the epoch; each at most once.

    Raises:
        Pruned: the run is to end. Not an error: let it through.
        ModelError: the value is no finite number, or the step none from 0 on.
    """
    if not is_number(value) or not math.isfinite(value):
        raise ModelError(f"report_step: value = {shown(value)}: expected a finite number")
    if isinstance(step, bool) or not isinstance(step, int) or step < 0:
        raise ModelError(f"report_step: step = {shown(step)}: expected a whole number >= 0")
    heard = _heard.get()
    if heard is None:
        return
    heard.steps[str(step)] = float(value)
    if heard.worse is not None and heard.worse(step, float(value)):
        raise Pruned(f"step {step}: {value:g}")


@contextmanager
def gathering_steps(worse: IsWorse | None) -> Iterator[ReportedSteps]:
    """Gather the steps that are reported inside."""
    heard = ReportedSteps(worse)
    token = _heard.set(heard)
    try:
        yield heard
    finally:
        _heard.reset(token)


STUDIES: Registry[Callable[..., Any]] = Registry("study", (), group="neuro.studies")
"""Functions of a point's values, by name, to metrics: those of apps, and what a file given with `--with` registers."""


@dataclass(frozen=True)
class FunctionRun:
    """What a sweep over a function calls at each point.

    Attributes:
        name: of the function in its module, or of the study.
        module: where it is defined; "" of a study.
        file: of the module, where that is a script.
        source: hash of what it is written as.
        set: values that are the same in all runs.
        paths: where modules are looked for.
        here: the function itself, in the process in which the sweep was begun.
    """

    name: str
    module: str = ""
    file: str = ""
    source: str = ""
    set: Mapping[str, Any] | None = None
    paths: tuple[str, ...] = ()
    here: Callable[..., Any] | None = None

    def same(self) -> dict[str, Any]:
        """What decides what comes of a run."""
        return {"function": self.name, "source": self.source, "set": dict(self.set or {})}

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain data, from which `from_dict` makes it."""
        words = {"name": self.name, "module": self.module, "file": self.file, "source": self.source}
        return {"kind": "function", **words, "set": dict(self.set or {}), "paths": list(self.paths)}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> FunctionRun:
        """What `as_dict` has written."""
        words = {name: value for name, value in content.items() if name != "kind"}
        return cls(**{**words, "paths": tuple(words["paths"])})

    def named_by_user(self) -> FunctionRun:
        """Return the same call of the function in a file that the user named by `--with`; a study stays as it is.

        Raises:
            ModelError: the user named no such file, or it defines no such function.
        """
        if not self.module:
            return self
        file = self.file or f"{self.module.replace('.', os.sep)}.py"
        module = Path(named_by_user(file)).stem
        run = replace(self, module=module, file="", paths=())
        # A name such as "os.system" leads to a function that the file has imported.
        if getattr(run.function, "__module__", None) != module:
            raise ModelError(f"{file}: defines no function '{self.name}'")
        return run

    @cached_property
    def function(self) -> Callable[..., Any]:
        """The function, found in another process by what it is called.

        Raises:
            ModelError: it is not there.
        """
        if self.here is not None:
            return self.here
        if not self.module:
            if self.name not in STUDIES:
                raise unknown("study", self.name, STUDIES)
            return STUDIES[self.name]
        sys.path[:] = [*self.paths, *(path for path in sys.path if path not in self.paths)]
        found: Any
        if self.file:
            found = runpy.run_path(self.file, run_name="__mp_main__")
            found = found.get(self.name.partition(".")[0])
        else:
            found = getattr(importlib.import_module(self.module), self.name.partition(".")[0], None)
        for word in self.name.split(".")[1:]:
            found = getattr(found, word, None)
        if not callable(found):
            raise ModelError(f"{self.file or self.module}: has no function '{self.name}'")
        function: Callable[..., Any] = found
        return function

    @property
    def files(self) -> Iterable[str]:
        """The file that the function is defined in."""
        try:
            file = inspect.getsourcefile(self.function)
        except TypeError:
            file = None
        return [os.path.abspath(file)] if file and Path(file).exists() else []

    def check_inputs(self) -> None:
        """See whether the function can be found here and is what it was when the sweep began.

        Raises:
            ModelError: it is not.
        """
        if self.here is None and _source(self.function) != self.source:
            message = f"'{self.name}' was edited since the sweep began: expected the function that it was"
            raise ModelError(message, hint="a new folder is a new sweep")

    def check(self, point: Mapping[str, Any], seeded: bool) -> None:
        """Refuse names that the function does not take.

        Raises:
            ModelError: it takes others.
        """
        try:
            taken = inspect.signature(self.function).parameters
        except ValueError:
            return
        if any(each.kind is each.VAR_KEYWORD for each in taken.values()):
            return
        names = [name for name, each in taken.items() if each.kind in (each.KEYWORD_ONLY, each.POSITIONAL_OR_KEYWORD)]
        given = [*(self.set or {}), *point, *(["seed"] if seeded else [])]
        for name in given:
            if name not in names:
                raise unknown(f"parameter of {self.name}", name, names)
        for name in names:
            if name not in given and taken[name].default is inspect.Parameter.empty:
                hint = "'seeds' gives it" if name == "seed" else ""
                raise ModelError(f"{self.name} needs '{name}', which the space does not have", hint=hint)

    def __call__(self, point: Mapping[str, Any], seed: int | None) -> tuple[dict[str, Any], None, dict[str, Any]]:
        """Call it: metrics, nothing more to write, and what the record of the run has to say."""
        seeded = {} if seed is None else {"seed": seed}
        return numbers(self.function(**{**(self.set or {}), **point, **seeded}), "value"), None, seeded


def function_run(function: Any, set: Mapping[str, Any] | None = None, here: bool = False) -> FunctionRun:
    """What calls a function in this process and in others.

    Args:
        function: of a module or of a script, or the name of a study.
        set: values that are the same in all runs.
        here: whether it is called in this process alone.

    Raises:
        ModelError: it is none, other processes cannot find it, or the values have no names.
    """
    if set is not None and not isinstance(set, Mapping):
        raise ModelError(f"set = {shown(set)}: expected values by name")
    if isinstance(function, str):
        found = FunctionRun(function, set=set)
        return FunctionRun(function, source=_source(found.function), set=set)
    if not callable(function) or not hasattr(function, "__qualname__"):
        raise ModelError(f"function = {shown(function)}: expected a function")
    name, module = function.__qualname__, function.__module__
    script = getattr(sys.modules.get("__main__"), "__file__", None) if module == "__main__" else None
    where = os.path.abspath(script) if script else ""
    paths = tuple(os.path.abspath(path) for path in sys.path)
    run = FunctionRun(name, module, where, _source(function), set, paths, function)
    if not here:
        _check_found_elsewhere(run)
    return run


def _check_found_elsewhere(run: FunctionRun) -> None:
    if "<" in run.name or (run.module == "__main__" and not run.file):
        where = "inside another function" if "<locals>" in run.name else "where it is typed in"
        if "<lambda>" in run.name:
            where = "without a name"
        hint = 'write it into a file with a name; or on="here" calls it in this process, one run after the other'
        raise ModelError(f"{run.name}: is defined {where}, so other processes cannot find it", hint=hint)


def _source(function: Callable[..., Any]) -> str:
    try:
        text = inspect.getsource(function)
    except (OSError, TypeError):
        text = repr(getattr(getattr(function, "__code__", None), "co_code", ""))
    return hashlib.sha256(text.encode()).hexdigest()
