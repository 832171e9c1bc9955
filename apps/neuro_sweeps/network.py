"""A run of a network's file at a point of a sweep."""

from __future__ import annotations

import copy
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

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
from neuro_sweeps.function import UNITS, check_metrics, measure, report_step

_FOR = Quantity("ms", "duration of the run", above=0.0)
Fill = Callable[[Path], None]
"""Function that writes the files of a run into a folder."""
RunResult = tuple[dict[str, Any], Fill | None, dict[str, Any]]
"""Metrics of a run, the function that writes its files, if any, and entries for its provenance."""


@dataclass(frozen=True)
class NetworkRun:
    """The run of a network at a point.

    Attributes:
        file: file of the network, an absolute path.
        files: hashes of all files of the network, by path.
        duration: duration, as in the definition: a number in ms, or a text with a unit.
        backend: name of the backend, or the file of a chip's table.
        threads: threads of a run.
        set: parameters that are the same in all runs.
        metrics: names of the metrics that are kept.
        keep: "metrics", or "results" to keep a file of results as well.
        at: times in ms at which the run reports `reports`. They do not change the results.
        reports: metric that is reported at these times.
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

    def identity(self) -> dict[str, Any]:
        """Return all inputs of a run but point and seed: contents of files instead of paths."""
        hashes = {str(_relative(Path(name), self.file.parent)): digest for name, digest in self.files.items()}
        content = {"duration": self.duration, "backend": _content(self.backend), "set": dict(self.set)}
        return {"network": hashes, **content, "metrics": list(self.metrics), "keep": self.keep}

    def as_dict(self) -> dict[str, Any]:
        """Return the run as plain data, for `from_dict`."""
        files = {"file": str(self.file), "files": dict(self.files)}
        content = {"duration": self.duration, "backend": self.backend, "threads": self.threads, "set": dict(self.set)}
        content |= {"at": list(self.at), "reports": self.reports} if self.at else {}
        return {"kind": "network", **files, **content, "metrics": list(self.metrics), "keep": self.keep}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> NetworkRun:
        """Return the run for the data of `as_dict`."""
        fields = {name: value for name, value in content.items() if name != "kind"}
        lists = {name: tuple(fields.get(name, ())) for name in ("metrics", "at")}
        return cls(**{**fields, **lists, "file": Path(fields["file"])})

    def check_inputs(self) -> None:
        """Check that the files are unchanged since the sweep began.

        Raises:
            ModelError: a file is missing, or was edited.
        """
        for name, digest in self.files.items():
            if (new_digest := digest_of(name)) != digest:
                problem = "was edited since the sweep began" if new_digest else "cannot be read"
                raise ModelError(f"{name}: {problem}: expected the unchanged file", hint="use a new folder")

    def check(self, point: Mapping[str, Any], seeded: bool) -> None:
        """Check a point before the first run. `seeded` is ignored, since a network runs with and without a seed.

        Raises:
            ModelError: a parameter or a metric is unknown, or a value is invalid.
        """
        net, run = self.at_point(point)
        check_metrics(self.metrics, net.populations, net.projections, net.world_section is not None)
        find_backend(str(run.get("backend", self.backend)))
        Clock(net.resolution).step(self._ms(run), "for")

    def units(self, names: Iterable[str]) -> dict[str, str]:
        """Return the units of parameters and metrics by name. A name without a unit is left out."""
        net, _ = self.at_point({})
        units = {name: _unit(net, name) for name in names}
        return {name: unit for name, unit in units.items() if unit}

    @cached_property
    def _sections(self) -> dict[str, Node]:
        return gather(self.file)

    def at_point(self, point: Mapping[str, Any]) -> tuple[Network, dict[str, Any]]:
        """Return the network at a point, and the values of the point that belong to the run instead of the network."""
        names = self._sections["parameters"].value if "parameters" in self._sections else {}
        parameters, run, parts = split_point({**self.set, **point}, names)
        return with_values(build(resolve(self._sections, parameters, Where(str(self.file)))), parts), run

    def _ms(self, run: Mapping[str, Any]) -> float:
        return float(check(_FOR, in_ms(run.get("for", self.duration), "for"), "for"))

    def __call__(self, point: Mapping[str, Any], seed: int | None) -> RunResult:
        """Run the network at a point with a seed."""
        from neuro import closed_loop, compile
        from neuro.apps import collect, fingerprint, results as files

        net, run = self.at_point(point)
        backend = str(run.pop("backend", self.backend))
        ms, keeps_results = self._ms(run), self.keep == "results"
        figures = {name.partition(".")[2]: run[name] for name in run if name.startswith("chip.")}
        options = {name.partition(".")[2]: run[name] for name in run if name.startswith("backend.")}
        arguments: dict[str, Any] = {"seed": seed or 0, "threads": self.threads, **options}
        with _table(backend, figures) as target:
            if net.world_section is not None:
                loop: Any = closed_loop(net, backend=target, record=keeps_results, **arguments)
                sim, log = loop.sim, loop.log
            else:
                sim, log, loop = compile(net, backend=target, **arguments), None, None
            for step, time in enumerate((*self.at, ms), 1):
                if loop:
                    loop.run(ms=time)
                else:
                    sim.run(time - sim.time)
                if step <= len(self.at):
                    report_step(measure(sim, [self.reports], {backend: target}, log)[self.reports], step)
            metrics = measure(sim, self.metrics, {backend: target}, log)
        record = {"backend": backend, "threads": self.threads, "seed": seed or 0, "network": fingerprint(sim.program)}

        def fill(folder: Path) -> None:
            recorded = loop.results(threads=self.threads) if loop else collect(sim, net, threads=self.threads)
            files.write(recorded, folder / "results.h5")

        return metrics, fill if keeps_results else None, record


def network_run(file: Path, **words: Any) -> NetworkRun:
    """Return the run of a network with the hashes of all its files. `words` are attributes of `NetworkRun`.

    Raises:
        ModelError: the file is not a network.
    """
    with gathering() as files:
        run = NetworkRun(file.absolute(), {}, **words)
        run.at_point({})
        if words.get("backend", "").endswith((".yaml", ".yml")):
            find_backend(words["backend"])
    return NetworkRun(run.file, {name: digest_of(name) for name in files}, **words)


@contextmanager
def _table(backend: str, figures: Mapping[str, Any]) -> Iterator[str]:
    """Return the backend, or a temporary table of its chip with the figures that the sweep changes."""
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


def _relative(path: Path, folder: Path) -> Path:
    """Return a path relative to a folder, or the file's name if the file is outside of the folder."""
    return path.relative_to(folder) if path.is_relative_to(folder) else Path(path.name)


def _content(backend: str) -> str:
    """Return the name of a backend, or the hash of a table's file."""
    return digest_of(backend) if backend.endswith((".yaml", ".yml")) else backend


RUN = ("backend", "for")
"""Settings of the run that a sweep may vary."""

PREFIXES = ("backend", "chip")
"""First words of the parameters that belong to the run.

`backend.OPTION` is an option of the backend. `chip.costs.NAME` and `chip.limits.NAME` are figures in the chip's table.
"""


def split_point(
    point: Mapping[str, Any], parameters: Iterable[str]
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Split a point into parameters of the file, settings of the run, and values of parts.

    Raises:
        ModelError: a name without a dot is neither a parameter of the file nor a setting of the run.
    """
    file_parameters, run, parts = dict[str, Any](), dict[str, Any](), dict[str, Any]()
    for name, value in point.items():
        if name in parameters:
            file_parameters[name] = value
        elif name in RUN or name.partition(".")[0] in PREFIXES:
            run[name] = value
        elif "." in name:
            parts[name] = value
        else:
            names = (*parameters, *RUN)
            hint = f"{nearest(name, names)}; parameters of parts are POPULATION.PARAMETER, PROJECTION.weight"
            raise ModelError(f"unknown parameter '{name}'", hint=hint)
    return file_parameters, run, parts


def with_values(net: Network, values: Mapping[str, Any]) -> Network:
    """Return a copy of a network with other values of parts.

    Args:
        net: the network, which is not changed.
        values: values by `POPULATION.PARAMETER`, `PROJECTION.weight`, `PROJECTION.delay`, or `PROJECTION.PARAMETER` of
            the synapse model or the connection rule.

    Raises:
        ModelError: there is no such part or parameter, or a value is out of bounds.
    """
    if not values:
        return net
    result = copy.copy(net)
    result.populations, result.projections = dict(net.populations), dict(net.projections)
    for name, value in values.items():
        part, _, word = name.rpartition(".")
        if part in result.populations:
            result.populations[part] = _population(result.populations[part], word, value)
        elif part in result.projections:
            result.projections[part] = _projection(result, result.projections[part], word, value)
        else:
            raise unknown("population or projection", part, (*result.populations, *result.projections))
    return result


def _population(part: Population, word: str, value: Any) -> Population:
    names = _names(part.model)
    if word not in names:
        raise unknown(f"parameter of '{part.name}', {a(part.model.name)},", word, names)
    return replace(part, model=replace(part.model, **{names[word]: value}))


def _projection(net: Network, part: Projection, word: str, value: Any) -> Projection:
    if word in ("weight", "delay"):
        # `connect` checks the value as in the network's file.
        without_projections = copy.copy(net)
        without_projections.projections = {}
        without_projections.place = part.origin
        views = ((part.source, part.source_view), (part.target, part.target_view))
        ends = [net.populations[name] if view is None else view for name, view in views]
        arguments = {"weight": part.weight, "delay": part.delay, word: value}
        return without_projections.connect(ends[0], ends[1], part.rule, part.synapse, name=part.name, **arguments)
    synapse, rule = _names(part.synapse), _names(part.rule)
    if word in synapse:
        return replace(part, synapse=replace(part.synapse, **{synapse[word]: value}))
    if word in rule:
        return replace(part, rule=replace(part.rule, **{rule[word]: value}))
    raise unknown(f"parameter of '{part.name}'", word, ("weight", "delay", *synapse, *rule))


def _unit(net: Network, name: str) -> str:
    """Return the unit of a metric, a setting of the run or a parameter of a part; "" if there is none."""
    first, _, word_after = name.partition(".")
    part, _, word = name.rpartition(".")
    if word_after and first in UNITS:
        return UNITS[first]
    if name == "for" or (part in net.projections and word == "delay"):
        return "ms"
    projection = word_after if first in ("weight", "weight_sd") else part if word == "weight" else ""
    if projection in net.projections:
        target = net.populations[net.projections[projection].target]
        return str(getattr(target.model, "weight_unit", ""))
    choices: list[Choice] = [net.populations[part].model] if part in net.populations else []
    choices += [net.projections[part].synapse, net.projections[part].rule] if part in net.projections else []
    return next((choice.quantities()[word].unit for choice in choices if word in choice.quantities()), "")


def _names(choice: Choice) -> dict[str, str]:
    """Return the fields of a model or rule by their names in YAML, e.g. "lambda_" by "lambda"."""
    return {word_of(entry.name): entry.name for entry in fields(choice)}
