"""Signals whose values are described, set while a network runs."""

from __future__ import annotations

import builtins
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import NEVER, Clock
from neuro.core.errors import ModelError
from neuro.core.keyed_random import generator
from neuro.model.distributions import Distribution
from neuro.model.equations import functions
from neuro.program.backend import Engine, counter
from neuro.program.program import Computed, Floats, Ints, Operation, Program, Schedule

_SIGNS: Mapping[str, Callable[..., Any]] = {
    **{"+": operator.add, "-": operator.sub, "*": operator.mul, "/": functions.divided, "^": functions.power},
    **{"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge},
}
_REMEMBERED = {"count": 1, "mean": 1, "trace": 1, "after": 3}
"""How many numbers an operation keeps from one period to the next."""

_NEVER = -float(NEVER)


def signals_of(program: Program, engine: Engine) -> SignalFeeder | None:
    """What sets the signals of a program in an engine; None if nothing does."""
    described = any(part.values is not None for part in program.signals)
    return SignalFeeder(program, engine) if described else None


class SignalFeeder:
    """Sets the signals of a program that have values, between stretches of a run.

    Args:
        program: says what sets them.
        engine: runs it.

    Raises:
        ModelError: several processes run the network together.
    """

    def __init__(self, program: Program, engine: Engine) -> None:
        if program.share.number > 1:
            raise ModelError("found signals with values, and several processes: expected one")
        self._engine = engine
        together: dict[int, _Together] = {}
        for index, part in enumerate(program.signals):
            if part.values is not None and part.scale is not None:
                scale = np.broadcast_to(part.scale, program.populations[part.target].size)
                one = together.setdefault(id(part.values), _Together(part.name, engine))
                one.heard.append((index, scale))
        plans = {id(part.values): part.values for part in program.signals}
        self._players: list[_Listed | _Expression] = []
        for key, one in together.items():
            plan = plans[key]
            if isinstance(plan, Computed):
                self._players.append(_Expression(plan, one, engine, program))
            elif plan is not None:
                self._players.append(_Listed(plan, one))

    def stretches(self, steps: int) -> Iterator[int]:
        """Cut a run into stretches; before each, and at the end, what is due is set."""
        end = self._engine.step + steps
        while True:
            now = self._engine.step
            for player in self._players:
                if player.due <= now:
                    player.set(now)
            if now >= end:
                self.listen()
                return
            yield min(end, *(player.due for player in self._players)) - now

    def listen(self) -> None:
        """Read the spikes that are told by their times, before they are forgotten."""
        for player in self._players:
            player.listen()

    def begin(self) -> None:
        """Back to the beginning."""
        for player in self._players:
            player.begin()

    def state(self) -> dict[str, NDArray[Any]]:
        """What was computed so far and is under way, by signal."""
        return {f"{p.name}/{word}": array for p in self._players for word, array in p.state().items()}

    def put(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on where `state` was asked for."""
        for player in self._players:
            words = {
                name.rpartition("/")[2]: array for name, array in arrays.items() if name.startswith(f"{player.name}/")
            }
            player.put(words)


class _Together:
    """Signals that are set together: the index of each and the factor for each neuron."""

    def __init__(self, name: str, engine: Engine) -> None:
        self.name, self._engine, self.heard = name, engine, list[tuple[int, Floats]]()

    def set(self, values: float | Floats) -> None:
        for index, scale in self.heard:
            self._engine.signal(index, values * scale + 0.0)


class _Listed:
    """Values that are listed.

    Attributes:
        due: the step after which something is to be done.
    """

    def __init__(self, plan: Schedule, target: _Together) -> None:
        self._plan, self._target, self.name = plan, target, target.name
        self.begin()

    def begin(self) -> None:
        self._next = 0
        self.due = self._due()

    def _due(self) -> int:
        return int(self._plan.steps[self._next]) if self._next < self._plan.steps.size else NEVER

    def set(self, now: int) -> None:
        self._next = int(np.searchsorted(self._plan.steps, now, side="right"))
        self._target.set(self._plan.values[self._next - 1])
        self.due = self._due()

    def listen(self) -> None:
        """No spikes are asked for."""

    def state(self) -> dict[str, NDArray[Any]]:
        return {"next": np.array(self._next)}

    def put(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        self._next = int(arrays["next"])
        self.due = self._due()


class _Expression:
    """Values that are computed each period, and set when their delay is over.

    Attributes:
        due: the step after which something is to be done.
    """

    def __init__(self, plan: Computed, target: _Together, engine: Engine, program: Program) -> None:
        self._plan, self._target, self.name, self._engine = plan, target, target.name, engine
        self._seed, self._clock, self._fired = program.seed, Clock(program.resolution), counter(engine)
        self._functions = [_function(operation) for operation in plan.operations]
        sizes = [_REMEMBERED.get(operation.name, 0) for operation in plan.operations]
        self._memory = np.zeros(sum(sizes))
        self._places = [sum(sizes[:k]) for k in range(len(sizes))]
        self._afters = [
            (operation, place)
            for operation, place in zip(plan.operations, self._places, strict=True)
            if operation.name == "after"
        ]
        self.begin()

    def begin(self) -> None:
        self._memory[:] = 0.0
        for _, place in self._afters:
            self._memory[place] = _NEVER
        self._next, self._level, self._since, self._heard = self._plan.every, 0.0, 0, 0
        self._coming: list[tuple[int, float]] = []  # as many as fall into the longest delay
        self.due = self._next

    def set(self, now: int) -> None:
        if now >= self._next:
            self._next = now - now % self._plan.every + self._plan.every
            value = self._value(now)
            if value or not self._plan.tau:
                self._coming.append((now + self._delay(now), value))
        arrived = [value for step, value in self._coming if step <= now]
        if arrived:
            self._coming = [each for each in self._coming if each[0] > now]
            if self._plan.tau:
                passed = (now - self._since) * self._clock.resolution
                self._level = self._level * math.exp(-passed / self._plan.tau) + math.fsum(arrived)
                self._since = now
            else:
                self._level = arrived[-1]
            self._target.set(self._level)
        self.due = min(self._next, *(step for step, _ in self._coming), NEVER)

    def _delay(self, now: int) -> int:
        """Steps until the value of a period is set; a delay that is drawn below 0 is 0."""
        delay = self._plan.delay
        if not isinstance(delay, Distribution):
            return delay
        drawn = delay.drawn(generator(self._seed, "signal", f"{self._plan.name}/{now}"), 1)
        return max(0, round(float(drawn[0]) / self._clock.resolution))

    def _value(self, now: int) -> float:
        """What the expression gives at the end of a period.

        Raises:
            ModelError: it is not finite.
        """
        found: list[float] = []
        counted: dict[int, Ints] = {}

        def count(population: int, ids: Ints | None) -> float:
            if population not in counted:
                counted[population] = self._fired(population)
            return float(counted[population].sum() if ids is None else counted[population][ids].sum())

        for operation, function, at in zip(self._plan.operations, self._functions, self._places, strict=True):
            values = [found[k] for k in operation.of]
            if function is not None:
                found.append(function(*values))
                continue
            match operation.name:
                case "number":
                    found.append(operation.number)
                case "count":
                    spikes = count(*operation.reads[0])
                    found.append(spikes - float(self._memory[at]))
                    self._memory[at] = spikes
                case "mean":
                    period = now // self._plan.every
                    share = 1.0 if period == 1 else operation.number or 1.0 / period
                    self._memory[at] += share * (values[0] - self._memory[at])
                    found.append(float(self._memory[at]))
                case "trace":
                    self._memory[at] = self._memory[at] * operation.number + values[0]
                    found.append(float(self._memory[at]))
                case _:
                    spikes = count(*operation.reads[1])
                    if spikes != self._memory[at + 2]:  # to read them takes as long as many steps of a small network
                        self.listen()
                    found.append(float(self._memory[at + 1]))
                    self._memory[at + 1 : at + 3] = 0.0, spikes
        if not math.isfinite(found[-1]):
            message = f"signal '{self.name}': its expression is {found[-1]} at {self._clock.ms(now):g} ms"
            raise ModelError(f"{message}: expected a finite number", hint="where(b > 0, a / max(b, 1), 0)")
        return float(found[-1])

    def listen(self) -> None:
        if not self._afters:
            return
        now = self._engine.step
        for operation, at in self._afters:
            (first, _), (second, several) = (self._heard_of(*each, now) for each in operation.reads)
            first = np.concatenate([self._memory[at : at + 1], first])
            last = first[np.searchsorted(first, second, side="left") - 1]
            self._memory[at] = first[-1]
            self._memory[at + 1] += several[second - last <= operation.number].sum()
        self._heard = now

    def _heard_of(self, population: int, ids: Ints | None, now: int) -> tuple[Floats, Ints]:
        """Steps of the spikes since this was last asked, and how many in each."""
        found = self._engine.spikes(population, self._heard)
        chosen = found.steps <= now
        if ids is not None:
            chosen &= np.isin(found.ids, ids, kind="table")
        return found.steps[chosen].astype(np.float64), found.multiplicity[chosen]

    def state(self) -> dict[str, NDArray[Any]]:
        numbers = np.array([self._next, self._level, self._since, self._heard])
        return {
            "numbers": numbers,
            "memory": self._memory.copy(),
            "coming": np.array(self._coming, dtype=np.float64).reshape(-1, 2),
        }

    def put(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        following, level, since, heard = arrays["numbers"].tolist()
        self._next, self._level, self._since, self._heard = int(following), level, int(since), int(heard)
        self._memory[:] = arrays["memory"]
        self._coming = [(int(step), value) for step, value in arrays["coming"].tolist()]
        self.due = min(self._next, *(step for step, _ in self._coming), NEVER)


def _function(operation: Operation) -> Callable[..., Any] | None:
    """What computes an operation that has no memory."""
    if operation.name in _SIGNS:
        return _SIGNS[operation.name]
    if operation.name in _REMEMBERED or operation.name == "number":
        return None
    own = getattr(functions, f"of_{operation.name}", None) or getattr(functions, operation.name, None)
    function: Callable[..., Any] = own or getattr(builtins, operation.name)
    return function
