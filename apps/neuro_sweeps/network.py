"""One run of a network's file at a point of a sweep."""

from __future__ import annotations

import copy
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from neuro import ModelError, Network
from neuro.apps import (
    Choice,
    Clock,
    Node,
    Population,
    Projection,
    Quantity,
    Where,
    a,
    build,
    check,
    digest_of,
    find_backend,
    gather,
    gathering,
    in_ms,
    nearest,
    resolve,
    unknown,
    word_of,
)
from neuro_sweeps.function import UNITS, check_metrics, measured, report_step

if TYPE_CHECKING:
    from neuro import Simulation

_FOR = Quantity("ms", "how long", above=0.0)
Fill = Callable[[Path], None]
Made = tuple[dict[str, Any], Fill | None, dict[str, Any]]


@dataclass(frozen=True)
class NetworkRun:
    """What a sweep over a network runs at each point.

    Attributes:
        file: of the network, an absolute path.
        files: hashes of all files that it is made of, by their paths.
        duration: how long, as it is written.
        backend: what it runs on.
        threads: of a run.
        set: parameters that are the same in all runs.
        metrics: what is kept as numbers, by name.
        keep: "metrics", or "results" for a file of results, too.
        at: when it reports on the way, ms; what comes of it does not depend on that.
        reports: the metric that it reports then.
    """

    file: Path
    files: Mapping[str, str]
    duration: Any = 1000.0
    backend: str = "event"
    threads: int = 1
    set: Mapping[str, Any] = field(default_factory=dict)
    metrics: tuple[str, ...] = ("spikes",)
    keep: str = "metrics"
    at: tuple[float, ...] = ()
    reports: str = ""

    def same(self) -> dict[str, Any]:
        """What decides what comes of a run: contents, no places."""
        hashes = {str(_beside(Path(name), self.file.parent)): digest for name, digest in self.files.items()}
        words = {"duration": self.duration, "backend": _content(self.backend), "set": dict(self.set)}
        return {"network": hashes, **words, "metrics": list(self.metrics), "keep": self.keep}

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain data, from which `from_dict` makes it."""
        files = {"file": str(self.file), "files": dict(self.files)}
        words = {"duration": self.duration, "backend": self.backend, "threads": self.threads, "set": dict(self.set)}
        words |= {"at": list(self.at), "reports": self.reports} if self.at else {}
        return {"kind": "network", **files, **words, "metrics": list(self.metrics), "keep": self.keep}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> NetworkRun:
        """What `as_dict` has written."""
        words = {name: value for name, value in content.items() if name != "kind"}
        lists = {name: tuple(words.get(name, ())) for name in ("metrics", "at")}
        return cls(**{**words, **lists, "file": Path(words["file"])})

    def check_inputs(self) -> None:
        """See whether the files are what they were when the sweep began.

        Raises:
            ModelError: one is gone, or was edited.
        """
        for name, digest in self.files.items():
            if (now := digest_of(name)) != digest:
                what = "was edited since the sweep began" if now else "cannot be read"
                raise ModelError(f"{name}: {what}: expected the file that it was", hint="a new folder is a new sweep")

    def check(self, point: Mapping[str, Any], seeded: bool) -> None:
        """Refuse names and values of a point before anything runs; networks run with and without seeds.

        Raises:
            ModelError: a parameter or a metric is unknown, or the network cannot be so.
        """
        net, run = self.described(point)
        check_metrics(self.metrics, net.populations, net.projections, net.world_section is not None)
        find_backend(str(run.get("backend", self.backend)))
        Clock(net.resolution).step(self._ms(run), "for")

    def units(self, names: Iterable[str]) -> dict[str, str]:
        """The units of parameters and metrics, by name; what has none, or an unknown one, is left out."""
        net, _ = self.described({})
        found = {name: _unit(net, name) for name in names}
        return {name: unit for name, unit in found.items() if unit}

    @cached_property
    def _sections(self) -> dict[str, Node]:
        return gather(self.file)

    def described(self, point: Mapping[str, Any]) -> tuple[Network, dict[str, Any]]:
        """The network of a point, and the words of its run."""
        given = self._sections["parameters"].value if "parameters" in self._sections else {}
        own, run, parts = sorted_out({**self.set, **point}, given)
        return changed(build(resolve(self._sections, own, Where(str(self.file)))), parts), run

    def _ms(self, run: Mapping[str, Any]) -> float:
        said = in_ms(run.get("for", self.duration), "for")
        return float(check(_FOR, said, "for"))

    def __call__(self, point: Mapping[str, Any], seed: int | None) -> Made:
        """Run: metrics, what writes more files, and what the record of the run has to say."""
        from neuro import compile
        from neuro.apps import fingerprint

        net, run = self.described(point)
        backend = str(run.pop("backend", self.backend))
        ms = self._ms(run)
        figures = {name.partition(".")[2]: run[name] for name in run if name.startswith("chip.")}
        options = {name.partition(".")[2]: run[name] for name in run if name.startswith("backend.")}
        with _table(backend, figures) as target:
            tables = {backend: target}
            if net.world_section is not None:
                return self._in_world(net, ms, backend, tables, seed or 0, options)
            sim = compile(net, backend=target, seed=seed or 0, threads=self.threads, **options)
            for k, time in enumerate(self.at, 1):
                sim.run(time - sim.time)
                report_step(measured(sim, [self.reports], tables)[self.reports], k)
            sim.run(ms - sim.time)
            found = measured(sim, self.metrics, tables)
        about = {"backend": backend, "threads": self.threads, "seed": seed or 0, "network": fingerprint(sim.program)}
        return found, self._fill(sim, net) if self.keep == "results" else None, about

    def _in_world(
        self, net: Network, ms: float, backend: str, tables: dict[str, str], seed: int, options: Mapping[str, Any]
    ) -> Made:
        """Run a network with a world, as `__call__` runs a network alone."""
        from neuro import closed_loop
        from neuro.apps import fingerprint, results as files

        words: dict[str, Any] = {"backend": tables[backend], "seed": seed, "threads": self.threads}
        loop = closed_loop(net, record=self.keep == "results", **words, **options)
        for k, time in enumerate(self.at, 1):
            loop.run(ms=time)
            report_step(measured(loop.sim, [self.reports], tables, loop.log)[self.reports], k)
        loop.run(ms=ms)
        figures = measured(loop.sim, self.metrics, tables, loop.log)
        about = {"backend": backend, "threads": self.threads, "seed": seed, "network": fingerprint(loop.sim.program)}

        def fill(folder: Path) -> None:
            files.write(loop.results(threads=self.threads), folder / "results.h5")

        return figures, fill if self.keep == "results" else None, about

    def _fill(self, sim: Simulation, net: Network) -> Fill:
        from neuro.apps import collect, results as files

        return lambda folder: files.write(collect(sim, net, threads=self.threads), folder / "results.h5")


def network_run(file: Path, **words: Any) -> NetworkRun:
    """What runs a network, with the hashes of all files that it is made of; see `NetworkRun`.

    Raises:
        ModelError: the file is no network.
    """
    with gathering() as read:
        made = NetworkRun(file.absolute(), {}, **words)
        made.described({})
        if words.get("backend", "").endswith((".yaml", ".yml")):
            find_backend(words["backend"])
    return NetworkRun(made.file, {name: digest_of(name) for name in read}, **words)


@contextmanager
def _table(backend: str, figures: Mapping[str, Any]) -> Iterator[str]:
    """The backend, or where figures of its chip are changed a table that is like it, for as long as it is needed."""
    if not figures:
        yield backend
        return
    table: dict[str, Any] = {"like": str(Path(backend).absolute()) if "." in backend else backend}
    table["name"] = f"{Path(backend).stem}-swept"
    for name, value in figures.items():
        section, _, word = name.partition(".")
        figure = {"value": value, "source": "this sweep"}
        if word:
            table.setdefault(section, {})[word] = figure
        else:
            table[section] = figure
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chip.yaml"
        path.write_text(yaml.safe_dump(table), "utf-8")
        yield str(path)


def _beside(path: Path, folder: Path) -> Path:
    """A file by its place beside another, or by its name where it lies elsewhere."""
    return path.relative_to(folder) if path.is_relative_to(folder) else Path(path.name)


def _content(backend: str) -> str:
    """A backend by its name; a table by what it holds."""
    return digest_of(backend) if backend.endswith((".yaml", ".yml")) else backend


RUN = ("backend", "for")
"""Words of the run itself that a sweep may go through."""

PREFIXES = ("backend", "chip")
"""`backend.OPTION` is an option of the backend, `chip.costs.NAME` or `chip.limits.NAME` a figure of its table."""


def sorted_out(
    point: Mapping[str, Any], parameters: Iterable[str]
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """A point as parameters of the file, words of the run, and values of parts.

    Raises:
        ModelError: a name without a dot is neither.
    """
    own, run, parts = dict[str, Any](), dict[str, Any](), dict[str, Any]()
    for name, value in point.items():
        if name in parameters:
            own[name] = value
        elif name in RUN or name.partition(".")[0] in PREFIXES:
            run[name] = value
        elif "." in name:
            parts[name] = value
        else:
            known = (*parameters, *RUN)
            hint = f"{nearest(name, known)}; of a part: POPULATION.PARAMETER, PROJECTION.weight"
            raise ModelError(f"unknown parameter '{name}'", hint=hint)
    return own, run, parts


def changed(net: Network, values: Mapping[str, Any]) -> Network:
    """A network with other values of parts.

    Args:
        net: the network; it stays as it is.
        values: by `POPULATION.PARAMETER`; `PROJECTION.weight`, `.delay`, or a parameter of its synapse model or of its
            connection rule.

    Raises:
        ModelError: there is no such part or parameter, or a value is out of bounds.
    """
    if not values:
        return net
    other = copy.copy(net)
    other.populations, other.projections = dict(net.populations), dict(net.projections)
    for name, value in values.items():
        part, _, word = name.rpartition(".")
        if part in other.populations:
            other.populations[part] = _population(other.populations[part], word, value)
        elif part in other.projections:
            other.projections[part] = _projection(other, other.projections[part], word, value)
        else:
            raise unknown("population or projection", part, (*other.populations, *other.projections))
    return other


def _population(part: Population, word: str, value: Any) -> Population:
    names = _names(part.model)
    if word not in names:
        raise unknown(f"parameter of '{part.name}', {a(part.model.name)},", word, names)
    return replace(part, model=replace(part.model, **{names[word]: value}))


def _projection(net: Network, part: Projection, word: str, value: Any) -> Projection:
    if word in ("weight", "delay"):
        fresh = copy.copy(net)
        fresh.projections = {}
        fresh.place = part.origin
        views = ((part.source, part.source_view), (part.target, part.target_view))
        ends = [net.populations[name] if view is None else view for name, view in views]
        words = {"weight": part.weight, "delay": part.delay, word: value}
        return fresh.connect(ends[0], ends[1], part.rule, part.synapse, name=part.name, **words)
    synapse, rule = _names(part.synapse), _names(part.rule)
    if word in synapse:
        return replace(part, synapse=replace(part.synapse, **{synapse[word]: value}))
    if word in rule:
        return replace(part, rule=replace(part.rule, **{rule[word]: value}))
    raise unknown(f"parameter of '{part.name}'", word, ("weight", "delay", *synapse, *rule))


def _unit(net: Network, name: str) -> str:
    """The unit of a metric, of a word of the run or of a parameter of a part; "" if it has none."""
    first, _, rest = name.partition(".")
    part, _, word = name.rpartition(".")
    if rest and first in UNITS:
        return UNITS[first]
    if name == "for" or (part in net.projections and word == "delay"):
        return "ms"
    of = rest if first in ("weight", "weight_sd") else part if word == "weight" else ""
    if of in net.projections:
        target = net.populations[net.projections[of].target]
        return str(getattr(target.model, "weight_unit", ""))
    choices: list[Choice] = [net.populations[part].model] if part in net.populations else []
    choices += [net.projections[part].synapse, net.projections[part].rule] if part in net.projections else []
    return next((each.quantities()[word].unit for each in choices if word in each.quantities()), "")


def _names(choice: Choice) -> dict[str, str]:
    """Fields of a choice by the words that users write."""
    return {word_of(entry.name): entry.name for entry in fields(choice)}
