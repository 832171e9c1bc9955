"""Signals with described values, set during a run."""

from __future__ import annotations

import builtins
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.hosting import HostWork
from neuro.coding.work import Work, on_numbers
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
"""Number of values that an operation stores from one period to the next."""
_OPERATIONS = {"number": 0, "mean": 2}
"""Multiply-accumulates of an operation, for all others 1."""


def signals_of(program: Program, engine: Engine) -> SignalFeeder | None:
    """Return the feeder of the signals of a program; None if no signal has values."""
    described = any(part.values is not None for part in program.signals)
    return SignalFeeder(program, engine) if described else None


class SignalFeeder:
    """Feeder that sets the signals with values between parts of a run.

    Args:
        program: the program with the signals.
        engine: the engine that runs the program.

    Raises:
        ModelError: several processes run the network together.
    """

    def __init__(self, program: Program, engine: Engine) -> None:
        if program.share.number > 1:
            raise ModelError("found signals with values, and several processes: expected one")
        self._engine = engine
        players: dict[int, _Listed | _Expression] = {}
        for index, part in enumerate(program.signals):
            plan, scale = part.values, part.scale
            if plan is None or scale is None:
                continue
            if id(plan) in players:
                pass
            elif isinstance(plan, Computed):
                players[id(plan)] = _Expression(plan, engine, program)
            else:
                players[id(plan)] = _Listed(plan, engine, part.name)
            size = program.populations[part.target].size
            players[id(plan)].targets.append((index, np.broadcast_to(scale, size)))
        self._players = list(players.values())

    def host_work(self) -> list[HostWork]:
        """Return the work of the host for one value of each expression."""
        players = [player for player in self._players if isinstance(player, _Expression)]
        return [HostWork(f"signal {player.name}", player.work(), "value", steps=player.every) for player in players]

    def stretches(self, steps: int) -> Iterator[int]:
        """Divide a run into parts. Signals are set before each part and at the end."""
        end = self._engine.step + steps
        while True:
            step = self._engine.step
            for player in self._players:
                if player.due <= step:
                    player.set(step)
            if step >= end:
                return
            yield min(end, *(player.due for player in self._players)) - step

    def listen(self) -> None:
        """Read the spikes that expressions need, before the records are forgotten."""
        for player in self._players:
            player.listen()

    def begin(self) -> None:
        """Return to time 0."""
        for player in self._players:
            player.begin()

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the computed values that are not set yet, by signal."""
        self.listen()
        return {f"{p.name}/{word}": array for p in self._players for word, array in p.state().items()}

    def put(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a `state`."""
        for player in self._players:
            prefix = f"{player.name}/"
            player.put({name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)})


class _Player:
    """Base of the players. A player sets some signals together.

    Attributes:
        targets: the index of each signal, and the factor for each neuron.
        due: the step after which `set` must be called next.
    """

    due: int

    def __init__(self, engine: Engine, name: str) -> None:
        self._engine, self.name, self.targets = engine, name, list[tuple[int, Floats]]()
        self.begin()

    def begin(self) -> None:
        """Return to time 0."""

    def listen(self) -> None:
        """Read spikes before they are forgotten. Most players need none."""

    def _set_signals(self, values: float | Floats) -> None:
        for index, scale in self.targets:
            self._engine.signal(index, values * scale + 0.0)


class _Listed(_Player):
    """Player of listed values."""

    def __init__(self, plan: Schedule, engine: Engine, name: str) -> None:
        self._plan = plan
        super().__init__(engine, name)

    def begin(self) -> None:
        self.due = int(self._plan.steps[0]) if self._plan.steps.size else NEVER

    def set(self, present_step: int) -> None:
        following = int(np.searchsorted(self._plan.steps, present_step, side="right"))
        self._set_signals(self._plan.values[following - 1])
        self.due = int(self._plan.steps[following]) if following < self._plan.steps.size else NEVER

    def state(self) -> dict[str, NDArray[Any]]:
        return {"due": np.array(self.due)}

    def put(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        self.due = int(arrays["due"])


class _Expression(_Player):
    """Player that computes the value of an expression each period, and sets the value after a delay."""

    def __init__(self, plan: Computed, engine: Engine, program: Program) -> None:
        self._plan, self._seed, self._clock = plan, program.seed, Clock(program.resolution)
        self._fired = counter(engine)
        self._sizes = [part.size for part in program.populations]
        self._functions = [_function(operation) for operation in plan.operations]
        sizes = [_REMEMBERED.get(operation.name, 0) for operation in plan.operations]
        self._places = [sum(sizes[:k]) for k in range(len(sizes))]
        self._memory = np.zeros(sum(sizes))
        operations = zip(plan.operations, self._places, strict=True)
        self._afters = [(operation, place) for operation, place in operations if operation.name == "after"]
        super().__init__(engine, plan.name)

    def begin(self) -> None:
        self._memory[:] = 0.0
        for _, place in self._afters:
            self._memory[place] = -NEVER
        self._delayed: list[tuple[int, float]] = []  # values whose delay is not over
        self._next = self.due = self._plan.every
        self._level, self._since, self._read_up_to = 0.0, 0, 0

    def set(self, now: int) -> None:
        if now >= self._next:
            self._next = now + self._plan.every
            value = self._value(now)
            if value or not self._plan.tau:
                self._delayed.append((now + self._delay(now), value))
        due_values = [value for step, value in self._delayed if step <= now]
        if due_values:
            self._delayed = [item for item in self._delayed if item[0] > now]
            if self._plan.tau:
                elapsed = (now - self._since) * self._clock.resolution
                self._level = self._level * math.exp(-elapsed / self._plan.tau) + math.fsum(due_values)
                self._since = now
            else:
                self._level = due_values[-1]
            self._set_signals(self._level)
        self.due = min(self._next, *(step for step, _ in self._delayed), NEVER)

    @property
    def every(self) -> int:
        """Number of steps between two values."""
        return self._plan.every

    def work(self) -> Work | None:
        """Return the operations of one value; None with `after`, whose count depends on the spikes."""
        plan = self._plan
        if self._afters:
            return None
        reads = [op.reads[0] for op in plan.operations if op.name == "count"]
        spikes = [self._sizes[population] if ids is None else ids.size for population, ids in reads]
        others = sum(_OPERATIONS.get(op.name, 1) for op in plan.operations)
        dose = 4 * (plan.tau > 0.0)
        targets = sum(scale.size for _, scale in self.targets)
        factors = sum(np.unique(scale).size for _, scale in self.targets)
        # The sum of the counts of n neurons has n - 1 additions; the difference from the last sum is in `others`.
        return on_numbers(sum(spikes) - len(spikes) + others + dose + factors, sum(spikes) + 2 * targets)

    def _delay(self, period_end: int) -> int:
        """Return the delay of a value in steps. A drawn delay below 0 counts as 0."""
        delay = self._plan.delay
        if not isinstance(delay, Distribution):
            return delay
        draws = delay.checked_sample(generator(self._seed, "signal", f"{self._plan.name}/{period_end}"), 1)
        return max(0, round(float(draws[0]) / self._clock.resolution))

    def _value(self, period_end: int) -> float:
        """Return the value of the expression at the end of a period.

        Raises:
            ModelError: the value is not finite.
        """
        results: list[float] = []
        counted: dict[int, Ints] = {}

        def count(population: int, ids: Ints | None) -> float:
            if population not in counted:
                counted[population] = self._fired(population)
            return float(counted[population].sum() if ids is None else counted[population][ids].sum())

        for operation, function, place in zip(self._plan.operations, self._functions, self._places, strict=True):
            values = [results[k] for k in operation.of]
            if function is not None:
                results.append(function(*values))
                continue
            match operation.name:
                case "number":
                    results.append(operation.number)
                case "count":
                    spikes = count(*operation.reads[0])
                    results.append(spikes - float(self._memory[place]))
                    self._memory[place] = spikes
                case "mean":
                    period = period_end // self._plan.every
                    share = 1.0 if period == 1 else operation.number or 1.0 / period
                    self._memory[place] += share * (values[0] - self._memory[place])
                    results.append(float(self._memory[place]))
                case "trace":
                    self._memory[place] = self._memory[place] * operation.number + values[0]
                    results.append(float(self._memory[place]))
                case _:
                    spikes = count(*operation.reads[1])
                    # Reading spikes takes as long as many steps of a small network.
                    if spikes != self._memory[place + 2]:
                        self.listen()
                    results.append(float(self._memory[place + 1]))
                    self._memory[place + 1 : place + 3] = 0.0, spikes
        if not math.isfinite(results[-1]):
            message = f"signal '{self.name}': its expression is {results[-1]} at {self._clock.ms(period_end):g} ms"
            hint = "avoid division by 0, e.g. where(b > 0, a / max(b, 1), 0)"
            raise ModelError(f"{message}: expected a finite number", hint=hint)
        return float(results[-1])

    def listen(self) -> None:
        if not self._afters:
            return
        step = self._engine.step
        for operation, place in self._afters:
            (earlier, _), (later, counts) = (self._new_spikes(*source, step) for source in operation.reads)
            earlier = np.concatenate([self._memory[place : place + 1], earlier])
            previous = earlier[np.searchsorted(earlier, later, side="left") - 1]
            self._memory[place] = earlier[-1]
            self._memory[place + 1] += counts[later - previous <= operation.number].sum()
        self._read_up_to = step

    def _new_spikes(self, population: int, ids: Ints | None, period_end: int) -> tuple[Floats, Ints]:
        """Return the steps of the spikes since the last call, and the number of spikes in each."""
        train = self._engine.spikes(population, self._read_up_to)
        is_selected = train.steps <= period_end
        if ids is not None:
            is_selected &= np.isin(train.ids, ids, kind="table")
        return train.steps[is_selected].astype(np.float64), train.multiplicity[is_selected]

    def state(self) -> dict[str, NDArray[Any]]:
        delayed = np.array(self._delayed, dtype=np.float64).reshape(-1, 2)
        numbers = np.array([self.due, self._next, self._level, self._since, self._read_up_to])
        return {"numbers": numbers, "memory": self._memory.copy(), "coming": delayed}

    def put(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        next_due, period_end, self._level, since, end = arrays["numbers"].tolist()
        self.due, self._next, self._since, self._read_up_to = int(next_due), int(period_end), int(since), int(end)
        self._memory[:] = arrays["memory"]
        self._delayed = [(int(step), value) for step, value in arrays["coming"].tolist()]


def _function(operation: Operation) -> Callable[..., Any] | None:
    """Return the function of an operation without memory."""
    if operation.name in _SIGNS:
        return _SIGNS[operation.name]
    if operation.name in _REMEMBERED or operation.name == "number":
        return None
    specific = getattr(functions, f"of_{operation.name}", None) or getattr(functions, operation.name, None)
    function: Callable[..., Any] = specific or getattr(builtins, operation.name)
    return function
