"""A search: what is run, how it goes, with which limits; said in YAML or in Python."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.extension import extensions
from neuro.core.inputs import digest_of, record_input
from neuro.core.measures import in_ms
from neuro.model.language.nodes import mistake, plain, words
from neuro.model.language.reader import Node, read
from neuro.sweeps.definition import (
    OF_ALL,
    Limits,
    Run,
    before_of,
    blaming,
    inputs_of,
    limits_said,
    name_said,
    run_of,
    run_said,
    same_of,
)
from neuro.sweeps.folder import Folder
from neuro.sweeps.function import function_run
from neuro.sweeps.metrics import METRICS
from neuro.sweeps.network import NetworkRun
from neuro.sweeps.tuning.plan import SearchPlan, plan_of

_PLAN = ("parameters", "objectives", "trials", "sampler", "draw", "seeds", "folds", "prune")
WORDS = (*OF_ALL, *_PLAN)


@dataclass(frozen=True)
class Search:
    """A search.

    Attributes:
        name: for people.
        run: what is run at each point.
        plan: how it goes.
        limits: of one run.
    """

    name: str
    run: Run
    plan: SearchPlan
    limits: Limits = Limits()

    @cached_property
    def before(self) -> str:
        """What decides what comes of a run, beside its point and seed."""
        return before_of(self.run)

    @property
    def inputs(self) -> tuple[str, ...]:
        """All files that decide what comes of it."""
        return inputs_of(self.run)

    def told(self) -> dict[str, Any]:
        """What `tune.json` has, beside where it comes from."""
        return {
            "name": self.name,
            "same": same_of(self.run) | self.plan.same(),
            "plan": self.plan.told(),
            "before": self.before,
            "limits": {"seconds": self.limits.seconds, "bytes": self.limits.bytes},
            "what": self.run.told(),
            "with": {file: digest_of(file) for file in extensions()},
        }


def load_search(path: Path) -> Search:
    """Read a search from a YAML file, and see whether it can be run.

    Raises:
        ModelError: with the place of the first mistake.
    """
    root = read(path, "a tuning", "network: net.yaml")
    record_input(path)
    said = words(root, WORDS, "a tuning", needs=("parameters", "objectives", "trials"))
    given = {word: plain(node) for word, node in said.items()}
    plan = _plan(said, given)
    if "network" in said:
        given["metrics"] = _metrics(given.get("metrics", []), plan)
    search = Search(name_said(said, given, path), run_said(root, said, given, path, "tuning"), plan, limits_said(said))
    if isinstance(search.run, NetworkRun):
        search = replace(search, run=_reporting(search.run, plan, said))
    with blaming(said, said["parameters"]):
        check_search(search)
    return search


def python_search(function: Any, plan: SearchPlan, limits: Limits, set: Mapping[str, Any] | None, here: bool) -> Search:
    """A search over a function.

    Raises:
        ModelError: it does not take what the space has, or other processes cannot find it.
    """
    run = function_run(function, set, here)
    if plan.prune and "at" in plan.prune:
        raise ModelError("prune.at: is of networks: a function calls neuro.report_step itself")
    search = Search(run.name, run, plan, limits)
    check_search(search)
    return search


def search_of(folder: Folder) -> Search:
    """The search of a folder, once all is what it was when it began.

    Raises:
        ModelError: there is none, or a file of it was edited, or has to be named by `--with` again.
    """
    told = folder.read()
    for file, digest in told["with"].items():
        if file not in extensions():
            raise ModelError(f"it was made with {file}", hint=f"say so, if you trust it: --with {shlex.quote(file)}")
        if digest_of(file) != digest:
            raise ModelError(f"{file}: was edited since the tuning began: expected the file that it was")
    run = run_of(told["what"])
    run.check_inputs()
    limits = Limits(told["limits"]["seconds"], told["limits"]["bytes"])
    return Search(told["name"], run, SearchPlan.of(told["plan"]), limits)


def check_search(search: Search) -> None:
    """Refuse names that nothing bears, before anything runs.

    Raises:
        ModelError: a parameter or a metric is unknown.
    """
    plan = search.plan
    point = plan.items("", {axis.name: axis.at(0.5) for axis in plan.axes})[0].point
    if isinstance(search.run, NetworkRun):
        if plan.folds:
            raise ModelError("folds: are told to a function: expected seeds for a network")
        search.run.check(point)
    else:
        search.run.check(point, bool(plan.seeds))


def _plan(said: Mapping[str, Node], given: Mapping[str, Any]) -> SearchPlan:
    values = {word: given[word] for word in _PLAN if word in given}
    try:
        return plan_of(**values)
    except ModelError as error:
        node = next((said[word] for word in error.path[:1] if word in said), said["parameters"])
        raise error.at(node.where) from None


def _metrics(given: Any, plan: SearchPlan) -> Any:
    """What is kept of a network: also the objectives, but those that a registered function may bring."""
    many = [given] if isinstance(given, str) else given
    if not isinstance(many, list):
        return many
    brought = any(isinstance(name, str) and name in METRICS for name in many)
    return [
        *many,
        *(name for name in plan.objectives if name not in many and (name in METRICS or not brought or "." in name)),
    ]


def _reporting(run: NetworkRun, plan: SearchPlan, said: Mapping[str, Node]) -> NetworkRun:
    """With the times at which a run that may be pruned tells its objective."""
    if not plan.prune:
        return run
    times = tuple(plan.prune.get("at", ()))
    if plan.runs == 1 and not times:
        raise mistake(said["prune"], "prune: a network needs 'at', when it is compared: {by: median, at: [100 ms]}")
    if plan.runs > 1 and times:
        raise mistake(said["prune"], "prune.at: with seeds, trials are compared after each seed: expected no 'at'")
    end = float(in_ms(run.duration, "for"))
    if times and times[-1] >= end:
        message = f"prune.at = {times[-1]:g} ms: expected times before the end of the run, {end:g} ms"
        raise mistake(said["prune"], message)
    return replace(run, at=times, reports=next(iter(plan.objectives)))
