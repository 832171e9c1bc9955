"""What is to be done: a sweep over points that are known, or a search for the best; described in YAML or in Python."""

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
    """How much one run may take; None: no limit.

    Attributes:
        seconds: of wall-clock time.
        bytes: of memory, beyond what its process has before it.
    """

    seconds: float | None = None
    bytes: int | None = None


@dataclass(frozen=True)
class Definition:
    """What sweeps and searches share.

    Attributes:
        name: for people.
        run: what is run at each point.
        limits: of one run.
    """

    name: str
    run: Run
    limits: Limits

    @cached_property
    def same(self) -> dict[str, Any]:
        """What decides the outcome of all runs."""
        files = {Path(file).name: digest_of(file) for file in extensions()}
        return self.run.same() | ({"with": files} if files else {})

    @cached_property
    def before(self) -> str:
        """What decides the outcome of a run, beside its point and seed, as `key_of` takes it."""
        return json.dumps({"run": self.same, "version": 1}, sort_keys=True)

    @property
    def inputs(self) -> tuple[str, ...]:
        """All files that decide the outcome of runs."""
        return (*self.run.files, *extensions())

    def as_dict(self) -> dict[str, Any]:
        """What the file of its folder has, beside where it comes from."""
        return {
            "name": self.name,
            "same": self.same,
            "limits": asdict(self.limits),
            "what": self.run.as_dict(),
            "with": {file: digest_of(file) for file in extensions()},
        }

    def units(self, names: Iterable[str]) -> dict[str, str]:
        """The units of parameters and of the metrics of a network, by name, as far as they are known."""
        return self.run.units((*names, *self.run.metrics)) if isinstance(self.run, NetworkRun) else {}


@dataclass(frozen=True)
class Sweep(Definition):
    """A sweep.

    Attributes:
        space: the points.
    """

    space: SearchSpace

    @cached_property
    def items(self) -> tuple[RunItem, ...]:
        """All runs, in the order of the space."""
        return tuple(RunItem(key_of(self.before, point, seed), point, seed) for point, seed in self.space.points())

    def as_dict(self) -> dict[str, Any]:
        """What `sweep.json` has, beside where it comes from."""
        runs = [[item.key, item.point, item.seed] for item in self.items]
        digest = hashlib.sha256(json.dumps(runs).encode()).hexdigest()[:32]
        words = {"parameters": list(self.space.names), "units": self.units(self.space.names)}
        return super().as_dict() | words | {"digest_of_runs": digest, "runs": runs}

    def check(self) -> None:
        """Refuse unknown names and the values of the first point, before anything runs.

        Raises:
            ModelError: a parameter or a metric is unknown, or a value is out of bounds.
        """
        self.run.check(self.items[0].point, bool(self.space.seeds))


@dataclass(frozen=True)
class Search(Definition):
    """A search.

    Attributes:
        plan: how it goes.
    """

    plan: SearchPlan

    def as_dict(self) -> dict[str, Any]:
        """What `tune.json` has, beside where it comes from."""
        same = {"same": self.same | self.plan.same(), "plan": self.plan.as_dict(), "before": self.before}
        return super().as_dict() | {"units": self.units(self.plan.names)} | same

    def check(self) -> None:
        """Refuse unknown names before anything runs.

        Raises:
            ModelError: a parameter or a metric is unknown.
        """
        plan = self.plan
        if plan.folds and isinstance(self.run, NetworkRun):
            raise ModelError("folds: are arguments of a function: expected seeds for a network")
        point = plan.items("", {axis.name: axis.at(0.5) for axis in plan.axes})[0].point
        self.run.check(point, bool(plan.seeds))


def run_of(what: Mapping[str, Any]) -> Run:
    """What is run, from the plain data in the file of a folder that this user has begun."""
    kinds: dict[str, Any] = {"network": NetworkRun, "function": FunctionRun}
    made: Run = kinds[what["kind"]].from_dict(what)
    return made


def recorded_run(folder: Folder, content: Mapping[str, Any]) -> Run:
    """Return what a folder runs, which anybody may have written: code is only that of files which the user named.

    Raises:
        ModelError: a file of the folder has to be named by `--with`, or what it says is damaged.
    """
    try:
        for file in content["with"]:
            named_by_user(file)
        run = run_of(content["what"])
    except (KeyError, TypeError, AttributeError) as error:
        raise ModelError(f"{folder.path / folder.holding.file}: damaged: {error}") from None
    return run.named_by_user() if isinstance(run, FunctionRun) else run


def search_of(folder: Folder) -> Search:
    """The search of a folder, once all its inputs are what they were when it began.

    Raises:
        ModelError: there is none, or a file of it was edited, or has to be named by `--with` again.
    """
    content = folder.read()
    run = recorded_run(folder, content)
    for file, digest in content["with"].items():
        if digest_of(named_by_user(file)) != digest:
            raise ModelError(f"{file}: was edited since the tuning began: expected the file that it was")
    run.check_inputs()
    return Search(content["name"], run, Limits(**content["limits"]), SearchPlan.from_dict(content["plan"]))


def python_sweep(function: Any, space: SearchSpace, limits: Limits, set: Mapping[str, Any] | None, here: bool) -> Sweep:
    """A sweep over a function.

    Raises:
        ModelError: the function does not take what the space has, or other processes cannot find it.
    """
    run = function_run(function, set, here)
    sweep = Sweep(run.name, run, limits, space)
    sweep.check()
    return sweep


def python_search(function: Any, plan: SearchPlan, limits: Limits, set: Mapping[str, Any] | None, here: bool) -> Search:
    """A search over a function.

    Raises:
        ModelError: as of `python_sweep`.
    """
    run = function_run(function, set, here)
    if plan.prune and "at" in plan.prune:
        raise ModelError("prune.at: is of networks: a function calls neuro.report_step itself")
    search = Search(run.name, run, limits, plan)
    search.check()
    return search


def load_sweep(path: Path) -> Sweep:
    """Read a sweep from a YAML file, and check whether it can be run.

    Raises:
        ModelError: with the place of the first mistake.
    """
    file = _DefinitionFile(path, "sweep", (*_OF_ALL, *_SPACE))
    run = file.run()
    sweep = Sweep(file.name(), run, file.limits(), file.space())
    with file.blaming():
        sweep.check()
    return sweep


def load_search(path: Path) -> Search:
    """Read a search from a YAML file, and check whether it can be run.

    Raises:
        ModelError: with the place of the first mistake.
    """
    file = _DefinitionFile(path, "tuning", (*_OF_ALL, *_PLAN), ("parameters", "objectives", "trials"))
    plan = file.plan()
    if "network" in file.values:
        file.values["metrics"] = _with_objectives(file.values.get("metrics", []), plan)
    name, run = file.name(), file.run()
    search = Search(name, file.reporting(run, plan), file.limits(), plan)
    with file.blaming():
        search.check()
    return search


class _DefinitionFile:
    """The words of a YAML file.

    Args:
        path: of the file.
        what: it describes, for messages.
        known: all words that have a meaning.
        needs: those that must be there.

    Attributes:
        root: of the nodes.
        nodes: by word, with their places.
        values: the same as plain data.
    """

    def __init__(self, path: Path, what: str, known: tuple[str, ...], needs: tuple[str, ...] = ()) -> None:
        self._path, self._what = path, what
        self.root = read(path, f"a {what}", "network: net.yaml")
        record_input(path)
        self.nodes: Mapping[str, Node] = words(self.root, known, f"a {what}", needs=needs)
        self.values: dict[str, Any] = {word: plain(node) for word, node in self.nodes.items()}

    def wrong(self, word: str, message: str) -> ModelError:
        """The error for a word."""
        return mistake(self.nodes[word], message)

    @contextmanager
    def blaming(self) -> Iterator[None]:
        """Give an error the place of the word that it is about, else that of the space."""
        try:
            yield
        except ModelError as error:
            word = "backend" if error.kind == "unknown backend" else next(iter(error.path), "")
            alike = ("metrics", "objectives") if word == "metrics" else (word,)
            chosen = (self.nodes[each] for each in (*alike, "list", "parameters", "seeds") if each in self.nodes)
            with about(next(chosen, self.root)):
                raise

    def name(self) -> str:
        """The name that is given, else that of the file."""
        name = self.values.get("name", self._path.stem)
        if not isinstance(name, str):
            raise self.wrong("name", f"name = {shown(name)}: expected a name")
        return name

    def limits(self) -> Limits:
        """The limits of a run."""
        found: dict[str, Any] = {}
        for word, name, checked in (("time_limit", "seconds", seconds), ("memory_limit", "bytes", size)):
            if word in self.nodes:
                with about(self.nodes[word]):
                    found[name] = checked(self.values[word])
        return Limits(**found)

    def space(self) -> SearchSpace:
        """The points of a sweep."""
        if "parameters" in self.nodes and "list" in self.nodes:
            raise self.wrong("list", "list: expected either 'parameters' or 'list'")
        for word in ("sampling", "runs", "draw"):
            if word in self.nodes and "list" in self.nodes:
                raise self.wrong(word, f"{word}: has no meaning with a list of points")
        given = {word: self.values[word] for word in ("sampling", "runs", "seeds", "draw") if word in self.values}
        with self.blaming():
            return space_of(self.values.get("list", self.values.get("parameters", {})), **given)

    def plan(self) -> SearchPlan:
        """How a search goes."""
        with self.blaming():
            return plan_of(**{word: self.values[word] for word in _PLAN if word in self.values})

    def run(self) -> Run:
        """What is run at each point."""
        if ("network" in self.nodes) == ("study" in self.nodes):
            raise mistake(self.root, f"a {self._what} needs 'network', a file, or 'study', a function of a point")
        held = self.values.get("set", {})
        if not isinstance(held, dict):
            raise self.wrong("set", f"set = {shown(held)}: expected values by name")
        if "study" in self.nodes:
            for word in _OF_NETWORKS:
                if word in self.nodes:
                    raise self.wrong(word, f"{word}: a study says for itself how it runs")
            with about(self.nodes["study"]):
                return function_run(str(self.values["study"]), held)
        return self._network(held)

    def _network(self, held: dict[str, Any]) -> NetworkRun:
        file, values = self.values["network"], self.values
        if not isinstance(file, str):
            raise self.wrong("network", f"network = {shown(file)}: expected the name of a file")
        metrics = values.get("metrics", ["spikes"])
        metrics = [metrics] if isinstance(metrics, str) else metrics
        if not isinstance(metrics, list) or not metrics or not all(isinstance(each, str) for each in metrics):
            raise self.wrong("metrics", f"metrics = {shown(metrics)}: expected a list of names")
        if values.get("keep", "metrics") not in KEEP:
            raise self.wrong("keep", f"keep = {shown(values['keep'])}: expected one of {', '.join(KEEP)}")
        threads = values.get("threads", 1)
        if not isinstance(threads, int) or isinstance(threads, bool) or threads < 1:
            raise self.wrong("threads", f"threads = {shown(threads)}: expected a whole number >= 1")
        rest: dict[str, Any] = {word: values[word] for word in ("backend", "keep") if word in values}
        if str(rest.get("backend", "")).endswith((".yaml", ".yml")):
            rest["backend"] = str((self._path.parent / rest["backend"]).absolute())
        rest |= {"duration": values.get("for", 1000.0), "threads": threads, "set": held, "metrics": tuple(metrics)}
        with about(self.nodes["network"]):
            return network_run(self._path.parent / file, **rest)

    def reporting(self, run: Run, plan: SearchPlan) -> Run:
        """A run with the times at which it reports its objective, where it is a network that may be pruned."""
        if not plan.prune or not isinstance(run, NetworkRun):
            return run
        times = tuple(plan.prune.get("at", ()))
        if plan.runs == 1 and not times:
            message = "prune: a network needs 'at', when it is compared: {by: median, at: [100 ms]}"
            raise self.wrong("prune", message)
        if plan.runs > 1 and times:
            message = "prune.at: with seeds, trials are compared after each seed: expected no 'at'"
            raise self.wrong("prune", message)
        end = float(in_ms(run.duration, "for"))
        if times and times[-1] >= end:
            message = f"prune.at = {times[-1]:g} ms: expected times before the end of the run, {end:g} ms"
            raise self.wrong("prune", message)
        return replace(run, at=times, reports=next(iter(plan.objectives)))


def _with_objectives(given: Any, plan: SearchPlan) -> Any:
    """What is kept of a network: also the objectives, but those that a registered function may bring."""
    many = [given] if isinstance(given, str) else given
    if not isinstance(many, list):
        return many
    brought = any(isinstance(name, str) and name in METRICS for name in many)
    wanted = (name for name in plan.objectives if name in METRICS or not brought or "." in name)
    return [*many, *(name for name in wanted if name not in many)]


def limits_of(time_limit: Any, memory_limit: Any) -> Limits:
    """The limits that a call gives; None: no limit.

    Raises:
        ModelError: as `seconds` and `size`.
    """
    return Limits(
        None if time_limit is None else seconds(time_limit), None if memory_limit is None else size(memory_limit)
    )


def seconds(value: Any) -> float:
    """A limit of time: a number of s, or a text with its unit, in s.

    Raises:
        ModelError: it is neither, or not > 0.
    """
    number = in_ms(value, "time_limit") / 1000.0 if isinstance(value, str) and in_ms(value, "") != value else value
    if isinstance(number, bool) or not isinstance(number, (int, float)) or not 0 < number < float("inf"):
        raise ModelError(f"time_limit = {shown(value)}: expected a time > 0, such as 60 s")
    return float(number)


def size(value: Any) -> int:
    """A limit of memory: a text with its unit, in bytes.

    Raises:
        ModelError: it is none.
    """
    found = _BYTES.fullmatch(value) if isinstance(value, str) else None
    if found is None or float(found[1]) <= 0:
        raise ModelError(f"memory_limit = {shown(value)}: expected a size, such as 500 MB or 2 GB")
    return int(float(found[1]) * _SCALE[found[2]])
