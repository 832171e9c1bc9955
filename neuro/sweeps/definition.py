"""What a sweep is: what is run, over which space, with which limits; said in YAML or in Python."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.extension import extensions
from neuro.core.inputs import digest_of, record_input
from neuro.core.measures import in_ms
from neuro.core.values import shown
from neuro.model.language.nodes import about, mistake, plain, words
from neuro.model.language.reader import Node, read
from neuro.sweeps.function import FunctionRun, files_of, function_run
from neuro.sweeps.network import NetworkRun, network_run
from neuro.sweeps.space import Point, SearchSpace, space_of

Run = NetworkRun | FunctionRun
OF_NETWORKS = ("for", "backend", "threads", "metrics", "keep")
_SPACE = ("parameters", "list", "sampling", "runs", "draw", "seeds")
OF_LIMITS = ("time_limit", "memory_limit")
OF_ALL = ("name", "network", "study", "set", *OF_NETWORKS, *OF_LIMITS)
WORDS = (*OF_ALL, *_SPACE)
KEEP = ("metrics", "results")
_BYTES = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(MB|GB|MiB|GiB)\s*")
_SCALE = {"MB": 1e6, "GB": 1e9, "MiB": 2.0**20, "GiB": 2.0**30}


@dataclass(frozen=True, slots=True)
class Limits:
    """How much one run may take; None: as much as it does.

    Attributes:
        seconds: by the clock on the wall.
        bytes: of memory, beyond what its process has before it.
    """

    seconds: float | None = None
    bytes: int | None = None


@dataclass(frozen=True, slots=True)
class RunItem:
    """One run that there is to do.

    Attributes:
        key: hash of its inputs, its name in the folder.
        point, seed: what it is told.
        trial: of a tuning, of which it may be pruned.
    """

    key: str
    point: Point
    seed: int | None
    trial: int | None = None


@dataclass(frozen=True)
class Sweep:
    """A sweep.

    Attributes:
        name: for people.
        run: what is run at each point.
        space: the points.
        limits: of one run.
    """

    name: str
    run: Run
    space: SearchSpace
    limits: Limits = Limits()

    @cached_property
    def items(self) -> tuple[RunItem, ...]:
        """All runs, in the order of the space."""
        before = before_of(self.run)
        return tuple(RunItem(key_of(before, point, seed), point, seed) for point, seed in self.space.points())

    def told(self) -> dict[str, Any]:
        """What `sweep.json` has, beside where it comes from."""
        limits = {"seconds": self.limits.seconds, "bytes": self.limits.bytes}
        runs = [[item.key, item.point, item.seed] for item in self.items]
        same = same_of(self.run)
        return {
            "name": self.name,
            "same": same,
            "parameters": list(self.space.names),
            "limits": limits,
            "what": self.run.told(),
            "with": {file: digest_of(file) for file in extensions()},
            "digest_of_runs": hashlib.sha256(json.dumps(runs).encode()).hexdigest()[:32],
            "runs": runs,
        }

    @property
    def inputs(self) -> tuple[str, ...]:
        """All files that decide what comes of it."""
        return inputs_of(self.run)


def same_of(run: Run) -> dict[str, Any]:
    """What decides what comes of all runs."""
    files = {Path(file).name: digest_of(file) for file in extensions()}
    return run.same() | ({"with": files} if files else {})


def before_of(run: Run) -> str:
    """What decides what comes of a run, beside its point and seed, as `key_of` takes it."""
    return json.dumps({"run": same_of(run), "version": 1}, sort_keys=True)


def inputs_of(run: Run) -> tuple[str, ...]:
    """All files that decide what comes of runs."""
    own = run.files if isinstance(run, NetworkRun) else files_of(run)
    return (*own, *extensions())


def key_of(before: str, point: Mapping[str, Any], seed: int | None) -> str:
    """The hash of what a run is told, 32 hexadecimal digits."""
    try:
        text = json.dumps([point, seed], sort_keys=True)
    except TypeError as error:
        raise ModelError(f"point {shown(dict(point))}: expected numbers, texts and lists: {error}") from None
    return hashlib.sha256(f"{before}\n{text}".encode()).hexdigest()[:32]


def run_of(what: Mapping[str, Any]) -> Run:
    """What is run, from the plain data of `sweep.json`."""
    kinds: dict[str, Any] = {"network": NetworkRun, "function": FunctionRun}
    made: Run = kinds[what["kind"]].of(what)
    return made


def load_sweep(path: Path) -> Sweep:
    """Read a sweep from a YAML file, and see whether it can be run.

    Raises:
        ModelError: with the place of the first mistake.
    """
    root = read(path, "a sweep", "network: net.yaml")
    record_input(path)
    said = words(root, WORDS, "a sweep")
    given = {word: plain(node) for word, node in said.items()}
    run = run_said(root, said, given, path)
    space = _space(root, said, given)
    sweep = Sweep(name_said(said, given, path), run, space, limits_said(said))
    with blaming(said, said.get("parameters") or said.get("list") or root):
        check_sweep(sweep)
    return sweep


@contextmanager
def blaming(said: Mapping[str, Node], other: Node) -> Iterator[None]:
    """Give an error the place of the word that it is about, as far as it tells; else that of another one."""
    try:
        yield
    except ModelError as error:
        word = "backend" if error.kind == "unknown backend" else next(iter(error.path), "")
        words = {"metrics": ("metrics", "objectives"), "backend": ("backend",), "for": ("for",)}.get(word, ())
        with about(next((said[word] for word in words if word in said), other)):
            raise


def python_sweep(function: Any, space: SearchSpace, limits: Limits, set: Mapping[str, Any] | None, here: bool) -> Sweep:
    """A sweep over a function.

    Raises:
        ModelError: it does not take what the space has, or other processes cannot find it.
    """
    run = function_run(function, set, here)
    sweep = Sweep(run.name, run, space, limits)
    check_sweep(sweep)
    return sweep


def check_sweep(sweep: Sweep) -> None:
    """Refuse what no run can be: names that nothing bears, and the first point, before anything runs."""
    first = sweep.items[0]
    if isinstance(sweep.run, NetworkRun):
        sweep.run.check(first.point)
    else:
        sweep.run.check(first.point, bool(sweep.space.seeds))


def run_said(root: Node, said: Mapping[str, Node], given: Mapping[str, Any], path: Path, what: str = "sweep") -> Run:
    """What is run, from the words of a file.

    Raises:
        ModelError: with the place of a mistake.
    """
    if ("network" in said) == ("study" in said):
        raise mistake(root, f"a {what} needs 'network', a file, or 'study', a function of a point")
    held = given.get("set", {})
    if not isinstance(held, dict):
        raise mistake(said["set"], f"set = {shown(held)}: expected values by name")
    if "study" in said:
        for word in OF_NETWORKS:
            if word in said:
                raise mistake(said[word], f"{word}: a study says for itself how it runs")
        with about(said["study"]):
            return function_run(str(given["study"]), held)
    if not isinstance(given["network"], str):
        raise mistake(said["network"], f"network = {shown(given['network'])}: expected the name of a file")
    metrics = given.get("metrics", ["spikes"])
    metrics = [metrics] if isinstance(metrics, str) else metrics
    if not isinstance(metrics, list) or not metrics or not all(isinstance(each, str) for each in metrics):
        raise mistake(said["metrics"], f"metrics = {shown(metrics)}: expected a list of names")
    if given.get("keep", "metrics") not in KEEP:
        raise mistake(said["keep"], f"keep = {shown(given['keep'])}: expected one of {', '.join(KEEP)}")
    threads = given.get("threads", 1)
    if not isinstance(threads, int) or isinstance(threads, bool) or threads < 1:
        raise mistake(said["threads"], f"threads = {shown(threads)}: expected a whole number >= 1")
    rest = {word: given[word] for word in ("backend", "keep") if word in given}
    if str(rest.get("backend", "")).endswith((".yaml", ".yml")):
        rest["backend"] = str((path.parent / rest["backend"]).absolute())
    with about(said["network"]):
        return network_run(
            path.parent / given["network"],
            duration=given.get("for", 1000.0),
            threads=threads,
            set=held,
            metrics=tuple(metrics),
            **rest,
        )


def _space(root: Node, said: Mapping[str, Node], given: Mapping[str, Any]) -> SearchSpace:
    if "parameters" in said and "list" in said:
        raise mistake(said["list"], "list: expected either 'parameters' or 'list'")
    for word in ("sampling", "runs", "draw"):
        if word in said and "list" in said:
            raise mistake(said[word], f"{word}: has no meaning with a list of points")
    words = {word: given[word] for word in ("sampling", "runs", "seeds", "draw") if word in given}
    node = said.get("list") or said.get("parameters") or said.get("seeds")
    try:
        return space_of(given.get("list", given.get("parameters", {})), **words)
    except ModelError as error:
        where = next((said[w] for w in words if w in error.path), node)
        raise error.at((where or root).where) from None


def name_said(said: Mapping[str, Node], given: Mapping[str, Any], path: Path) -> str:
    """The name that a file says, or its own."""
    name = given.get("name", path.stem)
    if not isinstance(name, str):
        raise mistake(said["name"], f"name = {shown(name)}: expected a name")
    return name


def limits_said(said: Mapping[str, Node]) -> Limits:
    """The limits that a file says."""
    found: dict[str, Any] = {}
    if "time_limit" in said:
        with about(said["time_limit"]):
            found["seconds"] = seconds(plain(said["time_limit"]))
    if "memory_limit" in said:
        with about(said["memory_limit"]):
            found["bytes"] = size(plain(said["memory_limit"]))
    return Limits(**found)


def limits_of(time_limit: Any, memory_limit: Any) -> Limits:
    """The limits that a call says; None: as much as it takes.

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
