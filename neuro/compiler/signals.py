"""Resolve the values of signals: a list becomes a schedule in steps, an expression becomes operations on spikes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from neuro.compiler.shapes import Shape, end_of, size
from neuro.compiler.values import per_neuron
from neuro.core.checks import check
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, a, nearest, unknown
from neuro.core.grammar import Binary, Call, Name, Negative, Number, Tree
from neuro.core.units import unit
from neuro.model.distributions import Distribution
from neuro.model.equations.functions import ARGUMENTS
from neuro.model.network import Network
from neuro.model.neurons import CurrentGenerator
from neuro.model.parts import Signal, naming_the_part, refuse
from neuro.model.sections import largest_in_world
from neuro.model.signals import SOURCES, Source
from neuro.model.sources import computed, like, schedule
from neuro.model.views import View, view_of_text
from neuro.program import program as resolved
from neuro.program.program import Computed, Floats, Ints, Operation, Schedule

_OF_SPIKES = {"count": (1, 1), "rate": (1, 1), "mean": (1, 2), "trace": (2, 2), "after": (2, 3)}
_TAKES = {**{name: (count, count) for name, count in ARGUMENTS.items()}, **_OF_SPIKES}
"""Smallest and largest number of arguments of each function."""


def resolve_signals(net: Network, shapes: Mapping[str, Shape], clock: Clock, seed: int) -> tuple[resolved.Signal, ...]:
    """Resolve the signals of a network, with or without described values.

    Raises:
        ModelError: a description is invalid; the path of the error names the invalid key.
    """
    resolver = _Resolver(net, shapes, clock, seed)
    names = {name: index for index, name in enumerate(net.populations)}
    signals = []
    for part in net.signals.values():
        values, scale = resolver.of(part, ())
        largest = largest_in_world(net.world_section, part.name)
        signals.append(resolved.Signal(part.name, names[part.to], part.origin, values, scale, largest))
    return tuple(signals)


def populations_read(net: Network, signals: tuple[resolved.Signal, ...]) -> set[str]:
    """Return the populations whose spike times an expression needs, so that their spikes must be recorded."""
    names, plans = list(net.populations), [part.values for part in signals]
    operations = [operation for plan in plans if isinstance(plan, Computed) for operation in plan.operations]
    return {names[index] for operation in operations if operation.name == "after" for index, _ in operation.reads}


class _Resolver:
    def __init__(self, net: Network, shapes: Mapping[str, Shape], clock: Clock, seed: int) -> None:
        self.net, self.shapes, self.clock, self.seed = net, shapes, clock, seed
        self.plans: dict[str, Schedule | Computed | None] = {}

    def of(self, part: Signal, followers: tuple[str, ...]) -> tuple[Schedule | Computed | None, Floats]:
        """Return the source of a signal and its factor.

        Args:
            part: the signal.
            followers: names of the signals whose `like` leads to this signal, to detect a cycle.
        """
        source = part.values
        while isinstance(source, Source) and not isinstance(source, (schedule, computed, like)):
            with naming_the_part(part, "values", source.name):
                SOURCES.check(type(source))
                source = check(Signal.words["values"], source.stands_for(), "stands_for")
        if not isinstance(source, like):
            if part.name not in self.plans:
                self.plans[part.name] = None if source is None else self.plan(part, source)
            scale = self.numbers(part, source.scale, "scale") if isinstance(source, computed) else np.ones(1)
            return self.plans[part.name], scale
        where = f"values.{source.name}.signal"
        if source.signal in (*followers, part.name):
            refuse(part, f"like '{source.signal}', which is like this one: expected a signal with values", word=where)
        if source.signal not in self.net.signals:
            error = unknown("signal", source.signal, self.net.signals, path=("values", source.name, "signal"))
            raise error.at(part.origin, f"signal '{part.name}'")
        other_signal = self.net.signals[source.signal]
        plan, factor = self.of(other_signal, (*followers, part.name))
        if plan is None:
            refuse(part, f"like '{other_signal.name}', which has no values: expected a signal with values", word=where)
        width = max(factor.size, plan.values.shape[1] if isinstance(plan, Schedule) else 1)
        own_size, other_size = size(self.shapes[part.to]), size(self.shapes[other_signal.to])
        if width > 1 and own_size != other_size:
            text = f"like '{other_signal.name}', which has a value for each of {other_size} neurons"
            refuse(part, f"{text}: expected a signal to {other_size} neurons, found {own_size}", word=where)
        return plan, factor * self.numbers(part, source.scale, "scale")

    def numbers(self, part: Signal, value: Any, word: str) -> Floats:
        """Return one number for all neurons of the target, or one for each."""
        path = ("values",) if word == "values" else ("values", part.values.name)
        with naming_the_part(part, *path[word == "values" :]):
            return per_neuron(value, self.shapes[part.to], word, (self.seed, "signal", part.name))

    def plan(self, part: Signal, source: Any) -> Schedule | Computed:
        if not isinstance(source, Source):
            return Schedule(np.zeros(1, dtype=np.int64), self.numbers(part, source, "values")[None])
        with naming_the_part(part, "values", part.values.name):
            if isinstance(source, schedule):
                return self.schedule_of(part, source)
            assert isinstance(source, computed)
            every = self.clock.step(source.every, "every")
            return Computed(
                name=part.name,
                operations=_Reader(self.net, self.shapes, self.clock, source, every).operations,
                every=every,
                delay=self.delay(source.delay),
                tau=source.tau or 0.0,
                largest=source.largest,
            )

    def schedule_of(self, part: Signal, source: schedule) -> Schedule:
        times, values = source.arrays_of_schedule()
        rows, n = np.asarray(values, dtype=np.float64).reshape(len(times), -1), size(self.shapes[part.to])
        if rows.shape[1] not in (1, n):
            message = f"{source.name}.values has rows of {rows.shape[1]} values: expected {n}, one for each neuron"
            raise ModelError(f"{message}, or a list of one for all", path=("values",))
        return Schedule(self.clock.steps(np.asarray(times, dtype=np.float64), "times"), rows + 0.0)

    def delay(self, value: Any) -> int | Distribution:
        if isinstance(value, Distribution):
            return value
        if not isinstance(value, float):
            raise ModelError("delay is an array: expected a number or a distribution", path=("delay",))
        return self.clock.step(value, "delay")


class _Reader:
    """Reader that converts an expression to operations.

    Attributes:
        operations: the operations, each after its operands.
    """

    def __init__(self, net: Network, shapes: Mapping[str, Shape], clock: Clock, source: computed, every: int) -> None:
        self.net, self.shapes, self.clock, self.every = net, shapes, clock, every
        self.expression = source.syntax_tree()
        self.names = {name: index for index, name in enumerate(net.populations)}
        self.operations: tuple[Operation, ...] = ()
        try:
            self.read(self.expression.tree)
        except ModelError as error:
            raise error.but(message=f"{source.name}.expression: {error.message}", path=("expression",)) from None

    def add(self, name: str, *of: int, number: float = 0.0, reads: tuple[tuple[int, Ints | None], ...] = ()) -> int:
        self.operations += (Operation(name, of, number, reads),)
        return len(self.operations) - 1

    def read(self, tree: Tree) -> int:
        """Add the operations of a tree; return the index of the last one."""
        if isinstance(tree, Number):
            if tree.unit:
                raise self.expression.mistake(tree.at, f"found the unit {tree.unit}: expected a number without unit")
            return self.add("number", number=tree.value)
        if isinstance(tree, Negative):
            return self.add("-", self.add("number"), self.read(tree.of))
        if isinstance(tree, Binary):
            return self.add(tree.sign, self.read(tree.left), self.read(tree.right))
        if isinstance(tree, Name):
            message = f"found '{tree.name}': expected a number or a function"
            raise self.expression.mistake(tree.at, message, f"write count({tree.name})")
        return self.call(tree)

    def call(self, tree: Call) -> int:
        if tree.name not in _TAKES:
            message = f"unknown function '{tree.name}'"
            raise self.expression.mistake(tree.at, message, nearest(tree.name, _TAKES))
        fewest, most = _TAKES[tree.name]
        if not fewest <= len(tree.arguments) <= most:
            expected = f"{fewest}" if fewest == most else f"{fewest} or {most}"
            message = f"{tree.name} has {len(tree.arguments)} values in its brackets: expected {expected}"
            raise self.expression.mistake(tree.at, message)
        first, *others = tree.arguments
        period = self.every * self.clock.resolution
        if tree.name in ("mean", "trace"):
            decay = math.exp(-period / self.ms(others[0])) if others else 1.0
            return self.add(tree.name, self.read(first), number=decay if tree.name == "trace" else 1.0 - decay)
        if tree.name == "after":
            window = self.clock.floor(self.ms(others[1]) if len(others) > 1 else 20.0, "after")
            return self.add("after", number=float(window), reads=(self.neurons(first), self.neurons(others[0])))
        if tree.name in ("count", "rate"):
            index, ids = read = self.neurons(first)
            count = self.add("count", reads=(read,))
            n = size(self.shapes[list(self.names)[index]]) if ids is None else ids.size
            return (
                count if tree.name == "count" else self.add("*", count, self.add("number", number=1e3 / (n * period)))
            )
        return self.add(tree.name, *(self.read(argument) for argument in tree.arguments))

    def ms(self, tree: Tree) -> float:
        """Return a time in ms, from a number with or without a unit."""
        if not isinstance(tree, Number) or not tree.value > 0.0:
            raise self.expression.mistake(tree.at, "expected a time > 0 ms, as a number")
        factor, dimension = unit(tree.unit or "ms")
        if dimension != unit("ms")[1]:
            raise self.expression.mistake(tree.at, f"found the unit {tree.unit}: expected a unit of time")
        return tree.value * factor

    def neurons(self, tree: Tree) -> tuple[int, Ints | None]:
        """Return the index of a population, and the ids of the neurons if the tree names only some."""
        if not isinstance(tree, Name):
            raise self.expression.mistake(tree.at, "expected a population, or some of its neurons, as exc[:100]")
        try:
            part = view_of_text(tree.name.replace('"', ""), self.net.populations)
            name = part.population.name if isinstance(part, View) else part.name
            ids = end_of(part, self.shapes[name]).ids if isinstance(part, View) else None
        except ModelError as error:
            raise self.expression.mistake(tree.at, error.message, error.hint) from None
        model = self.net.populations[name].model
        if isinstance(model, CurrentGenerator):
            message = f"'{name}' is {a(model.name)}, which has no spikes: expected a population with spikes"
            raise self.expression.mistake(tree.at, message)
        return self.names[name], ids
