"""The runs of sweeps, over known points, and of searches for the best points; from YAML or from Python."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from neuro import ModelError
from neuro.apps import (
    Node,
    about,
    argument,
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
from neuro_sweeps.folder import SWEEP, TUNING, Folder, FolderKind
from neuro_sweeps.function import METRICS, FunctionRun, function_run
from neuro_sweeps.network import NetworkRun, network_run
from neuro_sweeps.plan import SearchPlan, plan_of
from neuro_sweeps.space import RunItem, SearchSpace, key_of, space_of

Run = NetworkRun | FunctionRun
# Words of a definition: of networks only, of all definitions, of the space of a sweep, of the plan of a search.
_OF_NETWORKS = ("for", "backend", "threads", "metrics", "keep")
_OF_ALL = ("name", "network", "study", "set", *_OF_NETWORKS, "time_limit", "memory_limit")
_SPACE = ("parameters", "list", "sampling", "runs", "draw", "seeds")
_PLAN = ("parameters", "objectives", "trials", "sampler", "draw", "seeds", "folds", "prune")
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
class Runs:
    """The runs of a sweep, over known points, or of a search for the best points.

    Attributes:
        name: name for messages and pages.
        run: the function or network that is run at each point.
        limits: limits of a run.
        points: the known points, or the plan of the search.
    """

    name: str
    run: Run
    limits: Limits
    points: SearchSpace | SearchPlan

    @property
    def kind(self) -> FolderKind:
        """The kind of the folder of the runs."""
        return TUNING if isinstance(self.points, SearchPlan) else SWEEP

    @cached_property
    def identity(self) -> dict[str, Any]:
        """All inputs that the runs share. Equal identities give equal results."""
        files = {Path(file).name: digest_of(file) for file in extensions()}
        return self.run.identity() | ({"with": files} if files else {})

    @cached_property
    def key_prefix(self) -> str:
        """All inputs of a run, except point and seed, as text for `key_of`."""
        return json.dumps({"run": self.identity, "version": 1}, sort_keys=True)

    @cached_property
    def items(self) -> tuple[RunItem, ...]:
        """All runs of a sweep in the order of the space."""
        points = self.points.points() if isinstance(self.points, SearchSpace) else ()
        return tuple(RunItem(key_of(self.key_prefix, point, seed), point, seed) for point, seed in points)

    @property
    def inputs(self) -> tuple[str, ...]:
        """All files that are inputs of the runs."""
        return (*self.run.files, *extensions())

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the folder's file, without provenance."""
        names, run, points = self.points.names, self.run, self.points
        content = {
            "name": self.name,
            "same": self.identity,
            "limits": asdict(self.limits),
            "what": run.as_dict(),
            "with": {file: digest_of(file) for file in extensions()},
            "units": run.units((*names, *run.metrics)) if isinstance(run, NetworkRun) else {},
        }
        if isinstance(points, SearchPlan):
            shared = self.identity | points.identity()
            return content | {"same": shared, "plan": points.as_dict(), "before": self.key_prefix}
        runs = [[item.key, item.point, item.seed] for item in self.items]
        digest = hashlib.sha256(json.dumps(runs).encode()).hexdigest()[:32]
        return content | {"parameters": list(names), "digest_of_runs": digest, "runs": runs}

    def check(self) -> None:
        """Check the names, and the first point of a sweep, before the first run.

        Raises:
            ModelError: a parameter or a metric is unknown, a value is out of bounds, or the plan of a search has a
                word that this kind of run cannot use.
        """
        point, points = self.items[0].point if self.items else {}, self.points
        if isinstance(points, SearchPlan):
            if points.folds and isinstance(self.run, NetworkRun):
                raise ModelError("folds: only functions have folds: expected seeds for a network")
            if "at" in (points.prune or ()) and not isinstance(self.run, NetworkRun):
                raise ModelError("prune.at: only for networks: a function calls neuro.report_step itself")
            point = points.items("", {axis.name: axis.at(0.5) for axis in points.axes})[0].point
        self.run.check(point, bool(points.seeds))


def run_from_dict(what: Mapping[str, Any]) -> Run:
    """Return the run for the data in a folder's file. The data may name any code, so this user must have begun it."""
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


def search_of(folder: Folder) -> Runs:
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
    return Runs(content["name"], run, Limits(**content["limits"]), SearchPlan.from_dict(content["plan"]))


def load_runs(path: Path, kind: FolderKind) -> Runs:
    """Read and check a sweep or a search from a YAML file.

    Raises:
        ModelError: the file has an error. The message names the line.
    """
    root = read(path, f"a {kind.what}", "network: net.yaml")
    record_input(path)
    allowed, required = (_PLAN, ("parameters", "objectives", "trials")) if kind == TUNING else (_SPACE, ())
    nodes = words(root, (*_OF_ALL, *allowed), f"a {kind.what}", needs=required)
    values = {word: plain(node) for word, node in nodes.items()}
    with _located(root, nodes):
        if ("network" in nodes) == ("study" in nodes):
            raise mistake(root, f"a {kind.what} needs either 'network', a file, or 'study', a function")
        name = values.get("name", path.stem)
        if not isinstance(name, str):
            raise ModelError(f"name = {shown(name)}: expected a name", path=("name",))
        points = {word: values[word] for word in allowed if word in values}
        space = plan_of(**points) if kind == TUNING else _space(points)
        limits = limits_of(values.get("time_limit"), values.get("memory_limit"))
        runs = Runs(name, _run(path.parent, nodes, values, space), limits, space)
        runs.check()
    return runs


@contextmanager
def _located(root: Node, nodes: Mapping[str, Node]) -> Iterator[None]:
    """Add the line of the word that an error is about, or else the line of the space."""
    try:
        yield
    except ModelError as error:
        if error.where is not None:
            raise
        word = "backend" if error.kind == "unknown backend" else next(iter(error.path), "")
        alternatives = ("metrics", "objectives") if word == "metrics" else (word,)
        lines = (nodes[each] for each in (*alternatives, "list", "parameters", "seeds") if each in nodes)
        with about(next(lines, root)):
            raise


def _space(values: dict[str, Any]) -> SearchSpace:
    listed_points = values.pop("list", None)
    if listed_points is None:
        return space_of(values.pop("parameters", {}), **values)
    if "parameters" in values:
        raise ModelError("list: expected either 'parameters' or 'list'", path=("list",))
    for word in ("sampling", "runs", "draw"):
        if word in values:
            raise ModelError(f"{word}: not used with a list of points", path=(word,))
    return space_of(listed_points, **values)


def _run(folder: Path, nodes: Mapping[str, Node], values: Mapping[str, Any], points: SearchSpace | SearchPlan) -> Run:
    """Return the run at a point."""
    fixed_values = values.get("set", {})
    if not isinstance(fixed_values, dict):
        raise ModelError(f"set = {shown(fixed_values)}: expected values by name", path=("set",))
    if "study" in values:
        for word in _OF_NETWORKS:
            if word in values:
                raise ModelError(f"{word}: only for networks: a study sets it itself", path=(word,))
        with about(nodes["study"]):
            return function_run(str(values["study"]), fixed_values)
    metrics, backend, duration = values.get("metrics"), str(values.get("backend", "event")), values.get("for", 1000.0)
    metrics = [metrics] if isinstance(metrics, str) else metrics
    if "metrics" in values and not (metrics and isinstance(metrics, list) and all(isinstance(m, str) for m in metrics)):
        raise ModelError(f"metrics = {shown(values['metrics'])}: expected a list of names", path=("metrics",))
    if isinstance(points, SearchPlan):
        # A registered function may return objectives by name.
        has_functions = any(name in METRICS for name in metrics or ())
        objectives = (name for name in points.objectives if name in METRICS or not has_functions or "." in name)
        metrics = list(dict.fromkeys((*(metrics or ()), *objectives)))
    if backend.endswith((".yaml", ".yml")):
        backend = str((folder / backend).absolute())
    settings = {
        "backend": backend,
        "duration": duration,
        "threads": argument("threads", values.get("threads", 1), kind="integer", at_least=1),
        "set": fixed_values,
        "metrics": tuple(metrics or ["spikes"]),
        "keep": argument("keep", values.get("keep", "metrics"), words=("metrics", "results")),
        **_reports(duration, points),
    }
    file = argument("network", values["network"], kind="name")
    with about(nodes["network"]):
        return network_run(folder / file, **settings)


def _reports(duration: Any, points: SearchSpace | SearchPlan) -> dict[str, Any]:
    """Return the times at which a network reports its objective, and the objective, if the plan of a search prunes."""
    if not isinstance(points, SearchPlan) or not points.prune:
        return {}
    times, problem, end = tuple(points.prune.get("at", ())), "", float(in_ms(duration, "for"))
    if points.runs == 1 and not times:
        problem = "prune: a network needs 'at', the times of comparison: {by: median, at: [100 ms]}"
    elif points.runs > 1 and times:
        problem = "prune.at: with seeds, trials are compared after each seed: expected no 'at'"
    elif times and times[-1] >= end:
        problem = f"prune.at = {times[-1]:g} ms: expected times before the end of the run, {end:g} ms"
    if problem:
        raise ModelError(problem, path=("prune",))
    return {"at": times, "reports": next(iter(points.objectives))}


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
        message = f"time_limit = {shown(value)}: expected a time > 0, such as 60 s"
        raise ModelError(message, path=("time_limit",))
    return float(number)


def size(value: Any) -> int:
    """Return a memory limit in bytes, from a text with a unit, e.g. 2000000000 for "2 GB".

    Raises:
        ModelError: the text has another form.
    """
    match = _BYTES.fullmatch(value) if isinstance(value, str) else None
    if match is None or float(match[1]) <= 0:
        message = f"memory_limit = {shown(value)}: expected a size, such as 500 MB or 2 GB"
        raise ModelError(message, path=("memory_limit",))
    return int(float(match[1]) * _SCALE[match[2]])
