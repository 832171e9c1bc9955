"""Definitions of sweeps, over known points, and of searches for the best points; from YAML or from Python."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from neuro import ModelError
from neuro.apps import (
    Node,
    about,
    digest_of,
    extensions,
    in_ms,
    mistake,
    named_by_user,
    plain,
    read,
    record_input,
    shown,
    words,
)
from neuro_sweeps.folder import Folder
from neuro_sweeps.function import METRICS, FunctionRun, function_run
from neuro_sweeps.network import NetworkRun, network_run
from neuro_sweeps.plan import SearchPlan, plan_of
from neuro_sweeps.space import RunItem, SearchSpace, key_of, space_of

Run = NetworkRun | FunctionRun
_OF_NETWORKS = ("for", "backend", "threads", "metrics", "keep")
_OF_ALL = ("name", "network", "study", "set", *_OF_NETWORKS, "time_limit", "memory_limit")
_SPACE = ("parameters", "list", "sampling", "runs", "draw", "seeds")
_PLAN = ("parameters", "objectives", "trials", "sampler", "draw", "seeds", "folds", "prune")
KEEP = ("metrics", "results")
_BYTES = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(MB|GB|MiB|GiB)\s*")
_SCALE = {"MB": 1e6, "GB": 1e9, "MiB": 2.0**20, "GiB": 2.0**30}


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of a run; None for no limit.

    Attributes:
        seconds: wall-clock time in seconds.
        bytes: memory in bytes, beyond the memory of the process before the run.
    """

    seconds: float | None = None
    bytes: int | None = None


@dataclass(frozen=True)
class Definition:
    """Base class of sweeps and searches.

    Attributes:
        name: name for messages and pages.
        run: the function or network that is run at each point.
        limits: limits of a run.
    """

    name: str
    run: Run
    limits: Limits

    @cached_property
    def identity(self) -> dict[str, Any]:
        """All inputs that the runs share. Equal identities give equal results."""
        files = {Path(file).name: digest_of(file) for file in extensions()}
        return self.run.identity() | ({"with": files} if files else {})

    @cached_property
    def key_prefix(self) -> str:
        """All inputs of a run but point and seed as text, for `key_of`."""
        return json.dumps({"run": self.identity, "version": 1}, sort_keys=True)

    @property
    def inputs(self) -> tuple[str, ...]:
        """All files that are inputs of the runs."""
        return (*self.run.files, *extensions())

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the folder's file, without provenance."""
        return {
            "name": self.name,
            "same": self.identity,
            "limits": asdict(self.limits),
            "what": self.run.as_dict(),
            "with": {file: digest_of(file) for file in extensions()},
        }

    def units(self, names: Iterable[str]) -> dict[str, str]:
        """Return the known units of parameters and metrics of a network by name."""
        return self.run.units((*names, *self.run.metrics)) if isinstance(self.run, NetworkRun) else {}


@dataclass(frozen=True)
class Sweep(Definition):
    """A sweep over known points.

    Attributes:
        space: the points.
    """

    space: SearchSpace

    @cached_property
    def items(self) -> tuple[RunItem, ...]:
        """All runs in the order of the space."""
        return tuple(RunItem(key_of(self.key_prefix, point, seed), point, seed) for point, seed in self.space.points())

    def as_dict(self) -> dict[str, Any]:
        """Return the content of `sweep.json`, without provenance."""
        runs = [[item.key, item.point, item.seed] for item in self.items]
        digest = hashlib.sha256(json.dumps(runs).encode()).hexdigest()[:32]
        words = {"parameters": list(self.space.names), "units": self.units(self.space.names)}
        return super().as_dict() | words | {"digest_of_runs": digest, "runs": runs}

    def check(self) -> None:
        """Check the names and the first point before the first run.

        Raises:
            ModelError: a parameter or a metric is unknown, or a value is out of bounds.
        """
        self.run.check(self.items[0].point, bool(self.space.seeds))


@dataclass(frozen=True)
class Search(Definition):
    """A search for the best points.

    Attributes:
        plan: the plan.
    """

    plan: SearchPlan

    def as_dict(self) -> dict[str, Any]:
        """Return the content of `tune.json`, without provenance."""
        same = {"same": self.identity | self.plan.identity(), "plan": self.plan.as_dict(), "before": self.key_prefix}
        return super().as_dict() | {"units": self.units(self.plan.names)} | same

    def check(self) -> None:
        """Check the names before the first run.

        Raises:
            ModelError: a parameter or a metric is unknown.
        """
        plan = self.plan
        if plan.folds and isinstance(self.run, NetworkRun):
            raise ModelError("folds: only functions have folds: expected seeds for a network")
        point = plan.items("", {axis.name: axis.at(0.5) for axis in plan.axes})[0].point
        self.run.check(point, bool(plan.seeds))


def run_from_dict(what: Mapping[str, Any]) -> Run:
    """Return the run for the data in the file of a folder that this user began. The data may name any code."""
    kinds: dict[str, Any] = {"network": NetworkRun, "function": FunctionRun}
    run: Run = kinds[what["kind"]].from_dict(what)
    return run


def recorded_run(folder: Folder, content: Mapping[str, Any]) -> Run:
    """Return the run of a folder from an unknown source. Only files that the user named by `--with` may contain code.

    Raises:
        ModelError: the user has to name a file by `--with`, or the folder's file is damaged.
    """
    try:
        for file in content["with"]:
            named_by_user(file)
        run = run_from_dict(content["what"])
    except (KeyError, TypeError, AttributeError) as error:
        raise ModelError(f"{folder.path / folder.kind.file}: damaged: {error}") from None
    return run.named_by_user() if isinstance(run, FunctionRun) else run


def search_of(folder: Folder) -> Search:
    """Return the search of a folder, after a check that all inputs are unchanged.

    Raises:
        ModelError: the folder has no search, a file was edited, or the user has to name a file by `--with` again.
    """
    content = folder.read()
    run = recorded_run(folder, content)
    for file, digest in content["with"].items():
        if digest_of(named_by_user(file)) != digest:
            raise ModelError(f"{file}: was edited since the tuning began: expected the unchanged file")
    run.check_inputs()
    return Search(content["name"], run, Limits(**content["limits"]), SearchPlan.from_dict(content["plan"]))


def python_sweep(function: Any, space: SearchSpace, limits: Limits, set: Mapping[str, Any] | None, here: bool) -> Sweep:
    """Return a sweep of a function. With `here`, only this process calls the function.

    Raises:
        ModelError: the function has not the parameters of the space, or other processes cannot find it.
    """
    run = function_run(function, set, here)
    sweep = Sweep(run.name, run, limits, space)
    sweep.check()
    return sweep


def python_search(function: Any, plan: SearchPlan, limits: Limits, set: Mapping[str, Any] | None, here: bool) -> Search:
    """Return a search with a function. With `here`, only this process calls the function.

    Raises:
        ModelError: see `python_sweep`.
    """
    run = function_run(function, set, here)
    if plan.prune and "at" in plan.prune:
        raise ModelError("prune.at: only for networks: a function calls neuro.report_step itself")
    search = Search(run.name, run, limits, plan)
    search.check()
    return search


def load_sweep(path: Path) -> Sweep:
    """Read and check a sweep from a YAML file.

    Raises:
        ModelError: the file has an error. The message names the line.
    """
    file = _DefinitionFile(path, "sweep", (*_OF_ALL, *_SPACE))
    run = file.run()
    sweep = Sweep(file.name(), run, file.limits(), file.space())
    with file.locate_errors():
        sweep.check()
    return sweep


def load_search(path: Path) -> Search:
    """Read and check a search from a YAML file.

    Raises:
        ModelError: the file has an error. The message names the line.
    """
    file = _DefinitionFile(path, "tuning", (*_OF_ALL, *_PLAN), ("parameters", "objectives", "trials"))
    plan = file.plan()
    if "network" in file.values:
        file.values["metrics"] = _with_objectives(file.values.get("metrics", []), plan)
    name, run = file.name(), file.run()
    search = Search(name, file.with_reports(run, plan), file.limits(), plan)
    with file.locate_errors():
        search.check()
    return search


class _DefinitionFile:
    """A YAML file with a definition.

    Args:
        path: name of the file.
        what: "sweep" or "tuning", for messages.
        names: all valid words.
        needs: the required words.

    Attributes:
        root: root node.
        nodes: nodes with their lines, by word.
        values: plain data, by word.
    """

    def __init__(self, path: Path, what: str, names: tuple[str, ...], needs: tuple[str, ...] = ()) -> None:
        self._path, self._what = path, what
        self.root = read(path, f"a {what}", "network: net.yaml")
        record_input(path)
        self.nodes: Mapping[str, Node] = words(self.root, names, f"a {what}", needs=needs)
        self.values: dict[str, Any] = {word: plain(node) for word, node in self.nodes.items()}

    def error(self, word: str, message: str) -> ModelError:
        """Return an error at the line of a word."""
        return mistake(self.nodes[word], message)

    @contextmanager
    def locate_errors(self) -> Iterator[None]:
        """Add the line of the word that an error is about, or else the line of the space."""
        try:
            yield
        except ModelError as error:
            word = "backend" if error.kind == "unknown backend" else next(iter(error.path), "")
            alternatives = ("metrics", "objectives") if word == "metrics" else (word,)
            nodes = (self.nodes[each] for each in (*alternatives, "list", "parameters", "seeds") if each in self.nodes)
            with about(next(nodes, self.root)):
                raise

    def name(self) -> str:
        """Return the name of the definition, or else of the file."""
        name = self.values.get("name", self._path.stem)
        if not isinstance(name, str):
            raise self.error("name", f"name = {shown(name)}: expected a name")
        return name

    def limits(self) -> Limits:
        """Return the limits of a run."""
        limits: dict[str, Any] = {}
        for word, name, parse in (("time_limit", "seconds", seconds), ("memory_limit", "bytes", size)):
            if word in self.nodes:
                with about(self.nodes[word]):
                    limits[name] = parse(self.values[word])
        return Limits(**limits)

    def space(self) -> SearchSpace:
        """Return the points of a sweep."""
        if "parameters" in self.nodes and "list" in self.nodes:
            raise self.error("list", "list: expected either 'parameters' or 'list'")
        for word in ("sampling", "runs", "draw"):
            if word in self.nodes and "list" in self.nodes:
                raise self.error(word, f"{word}: not used with a list of points")
        settings = {word: self.values[word] for word in ("sampling", "runs", "seeds", "draw") if word in self.values}
        with self.locate_errors():
            return space_of(self.values.get("list", self.values.get("parameters", {})), **settings)

    def plan(self) -> SearchPlan:
        """Return the plan of a search."""
        with self.locate_errors():
            return plan_of(**{word: self.values[word] for word in _PLAN if word in self.values})

    def run(self) -> Run:
        """Return the run at a point."""
        if ("network" in self.nodes) == ("study" in self.nodes):
            raise mistake(self.root, f"a {self._what} needs either 'network', a file, or 'study', a function")
        fixed_values = self.values.get("set", {})
        if not isinstance(fixed_values, dict):
            raise self.error("set", f"set = {shown(fixed_values)}: expected values by name")
        if "study" in self.nodes:
            for word in _OF_NETWORKS:
                if word in self.nodes:
                    raise self.error(word, f"{word}: only for networks: a study sets it itself")
            with about(self.nodes["study"]):
                return function_run(str(self.values["study"]), fixed_values)
        return self._network(fixed_values)

    def _network(self, fixed_values: dict[str, Any]) -> NetworkRun:
        file, values = self.values["network"], self.values
        if not isinstance(file, str):
            raise self.error("network", f"network = {shown(file)}: expected the name of a file")
        metrics = values.get("metrics", ["spikes"])
        metrics = [metrics] if isinstance(metrics, str) else metrics
        if not isinstance(metrics, list) or not metrics or not all(isinstance(each, str) for each in metrics):
            raise self.error("metrics", f"metrics = {shown(metrics)}: expected a list of names")
        if values.get("keep", "metrics") not in KEEP:
            raise self.error("keep", f"keep = {shown(values['keep'])}: expected one of {', '.join(KEEP)}")
        threads = values.get("threads", 1)
        if not isinstance(threads, int) or isinstance(threads, bool) or threads < 1:
            raise self.error("threads", f"threads = {shown(threads)}: expected a whole number >= 1")
        settings: dict[str, Any] = {word: values[word] for word in ("backend", "keep") if word in values}
        if str(settings.get("backend", "")).endswith((".yaml", ".yml")):
            settings["backend"] = str((self._path.parent / settings["backend"]).absolute())
        settings |= {"duration": values.get("for", 1000.0), "threads": threads}
        settings |= {"set": fixed_values, "metrics": tuple(metrics)}
        with about(self.nodes["network"]):
            return network_run(self._path.parent / file, **settings)

    def with_reports(self, run: Run, plan: SearchPlan) -> Run:
        """Return the run of a network with the times at which it reports its objective, if the plan prunes."""
        if not plan.prune or not isinstance(run, NetworkRun):
            return run
        times = tuple(plan.prune.get("at", ()))
        if plan.runs == 1 and not times:
            message = "prune: a network needs 'at', the times of comparison: {by: median, at: [100 ms]}"
            raise self.error("prune", message)
        if plan.runs > 1 and times:
            message = "prune.at: with seeds, trials are compared after each seed: expected no 'at'"
            raise self.error("prune", message)
        end = float(in_ms(run.duration, "for"))
        if times and times[-1] >= end:
            message = f"prune.at = {times[-1]:g} ms: expected times before the end of the run, {end:g} ms"
            raise self.error("prune", message)
        return replace(run, at=times, reports=next(iter(plan.objectives)))


def _with_objectives(metrics: Any, plan: SearchPlan) -> Any:
    """Add the objectives to the metrics, except objectives that a registered function may return by name."""
    names = [metrics] if isinstance(metrics, str) else metrics
    if not isinstance(names, list):
        return names
    has_functions = any(isinstance(name, str) and name in METRICS for name in names)
    objectives = (name for name in plan.objectives if name in METRICS or not has_functions or "." in name)
    return [*names, *(name for name in objectives if name not in names)]


def limits_of(time_limit: Any, memory_limit: Any) -> Limits:
    """Return the limits for the arguments of a call; None for no limit.

    Raises:
        ModelError: see `seconds` and `size`.
    """
    return Limits(
        None if time_limit is None else seconds(time_limit), None if memory_limit is None else size(memory_limit)
    )


def seconds(value: Any) -> float:
    """Return a time limit in seconds, from a number of seconds or a text with a unit.

    Raises:
        ModelError: the value has another form, or is not > 0.
    """
    number = in_ms(value, "time_limit") / 1000.0 if isinstance(value, str) and in_ms(value, "") != value else value
    if isinstance(number, bool) or not isinstance(number, (int, float)) or not 0 < number < float("inf"):
        raise ModelError(f"time_limit = {shown(value)}: expected a time > 0, such as 60 s")
    return float(number)


def size(value: Any) -> int:
    """Return a memory limit in bytes, from a text with a unit, e.g. 2000000000 for "2 GB".

    Raises:
        ModelError: the text has another form.
    """
    match = _BYTES.fullmatch(value) if isinstance(value, str) else None
    if match is None or float(match[1]) <= 0:
        raise ModelError(f"memory_limit = {shown(value)}: expected a size, such as 500 MB or 2 GB")
    return int(float(match[1]) * _SCALE[match[2]])
