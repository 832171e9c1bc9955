"""What rewritten functions call while they run for all neurons at once (`neuro_torch.translate`).

Every neuron is a lane. `live` is which lanes go on here: None for all, else a tensor of booleans. A branch on numbers
that all lanes share is a branch; on a tensor both ways are gone, each with its lanes live, and what is written keeps
its old value in the others. A loop goes on while a lane is live in it.
"""

from __future__ import annotations

import builtins
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import BuiltinFunctionType, FunctionType
from typing import Any

import numpy as np
import torch
from torch import Tensor

from neuro_torch.translate import Untranslatable, translated

ALL = object()
"""The index of all neurons: `lo` and `hi` of a call, and `i` in it."""

NUMBERS = (bool, int, float, np.generic)


@dataclass(slots=True)
class Frame:
    """A call: the lanes that came in, those that have returned, and what they return."""

    came: Tensor | None
    gone: Tensor | None = None
    value: Any = None


@dataclass(slots=True)
class Loop:
    """A loop of a call: the lanes that came to it, and those that are still in it."""

    frame: Frame
    came: Tensor | None
    inside: Tensor | None


@dataclass(slots=True)
class Fork:
    """A branch: the answer if all lanes share it; else the lanes that came, go each way, and left the first way."""

    told: bool | None
    came: Tensor | None = None
    yes: Any = None
    no: Any = None
    left: Tensor | None = None


class LaneRows:
    """States, inputs or other numbers of all neurons, by row; an index is (row, ALL), or ALL where there is one row.

    Args:
        rows: a tensor, or a number that all share, each.
        shape: to which what is stored is brought; None leaves it as it is.
    """

    __slots__ = ("rows", "shape")

    def __init__(self, rows: list[Any], shape: tuple[int, ...] | None = None) -> None:
        self.rows, self.shape = rows, shape

    def __getitem__(self, at: Any) -> Any:
        return self.rows[at[0]] if type(at) is tuple else self.rows[0]

    def write(self, lanes: Lanes, at: Any, value: Any) -> None:
        """Store in the lanes that are live."""
        row = at[0] if type(at) is tuple else 0
        new = value if lanes.live is None else merged(lanes.live, value, self.rows[row])
        self.rows[row] = new if self.shape is None else spread(new, self.shape, lanes.device)


def spread(value: Any, shape: tuple[int, ...], device: Any) -> Tensor:
    """A number or tensor as one of doubles and of a shape."""
    tensor = value if isinstance(value, Tensor) else torch.tensor(float(value), dtype=torch.float64, device=device)
    if tensor.dtype is not torch.float64:
        tensor = tensor.to(torch.float64)
    return tensor if tensor.shape == shape else tensor.expand(shape)


def merged(mask: Tensor, new: Any, old: Any) -> Any:
    """The new value in some lanes, the old in the others; what is NaN has one value for all."""
    if old is None or new is old:
        return new
    if isinstance(new, tuple) and isinstance(old, tuple) and len(new) == len(old):
        return tuple(merged(mask, n, o) for n, o in zip(new, old, strict=True))
    if not isinstance(new, (Tensor, *NUMBERS)) or not isinstance(old, (Tensor, *NUMBERS)):
        return new
    found = torch.where(mask, double(new, mask), double(old, mask))
    return reached(found, new, old)


def double(value: Any, like: Tensor) -> Any:
    """A float as a tensor of doubles; torch would take floats of Python for singles."""
    if isinstance(value, (float, np.floating)):
        return torch.tensor(float(value), dtype=torch.float64, device=like.device)
    return value


def reached(found: Tensor, *parts: Any) -> Tensor:
    """Hand on to a boolean how far above what it was compared with something was, see `Lanes.at_least`."""
    for part in parts:
        margin = getattr(part, "margin", None)
        if margin is not None:
            vars(found)["margin"] = margin
            break
    return found


class Lanes:
    """All neurons of one call.

    Args:
        device: where its tensors are.
        live: the lanes that take part, None for all.
        gate: of graded neurons that learn, the derivative of a choice by how far above its threshold something is: what
            a threshold chooses has this gradient, too, and what is rounded down that of itself.
    """

    def __init__(self, device: Any, live: Tensor | None = None, gate: Callable[[Tensor], Tensor] | None = None) -> None:
        self.device, self.live, self.gate = device, live, gate

    def run(self, function: Any, *arguments: Any) -> Any:
        """A function of a model's arithmetic, for all neurons."""
        return translated(function)(self, *arguments)

    # Calls.

    def enter(self) -> Frame:
        """A call begins."""
        return Frame(self.live)

    def returns(self, frame: Frame, value: Any) -> bool:
        """Lanes that are live return a value; True where all others have, too."""
        if self.live is None:
            frame.value = value
            return True
        frame.value = value if frame.gone is None else merged(self.live, value, frame.value)
        frame.gone = self.live if frame.gone is None else frame.gone | self.live
        self.live = torch.zeros_like(self.live)
        return False

    def leave(self, frame: Frame) -> Any:
        """A call ends: all lanes that came go on behind it."""
        self.live = frame.came
        return frame.value

    def call(self, function: Any, *arguments: Any) -> Any:
        """Call what a function calls, each by its own way to do it for all neurons."""
        if isinstance(function, FunctionType):
            return translated(function)(self, *arguments)
        if (plain := getattr(function, "py_func", None)) is not None:
            return translated(plain)(self, *arguments)
        if all(isinstance(argument, NUMBERS) for argument in arguments):
            return function(*arguments)
        if isinstance(function, BuiltinFunctionType | type | np.ufunc):
            own = _OWN.get(function) or getattr(torch, getattr(function, "__name__", ""), None)
            if own is not None:
                return own(self, *arguments) if function in _OWN else own(*map(self.tensor, arguments))
        raise Untranslatable(f"'{getattr(function, '__name__', function)}' of tensors")

    def tensor(self, value: Any) -> Tensor:
        """A number as a tensor of doubles; a tensor as it is."""
        return value if isinstance(value, Tensor) else torch.tensor(value, dtype=torch.float64, device=self.device)

    # Writing.

    def put(self, old: Any, new: Any) -> Any:
        """What a name means after an assignment."""
        return new if self.live is None else merged(self.live, new, old)

    def store(self, place: Any, at: Any, value: Any) -> None:
        """An assignment to a place of an array or a list."""
        if isinstance(place, LaneRows):
            place.write(self, at, value)
        else:
            place[at] = self.put(place[at], value)

    # Ways.

    def fork(self, test: Any) -> Fork:
        """A branch begins."""
        if not isinstance(test, Tensor):
            return Fork(bool(test))
        yes, came = test if test.dtype is torch.bool else test != 0, self.live
        return Fork(None, came, yes, ~yes) if came is None else Fork(None, came, came & yes, came & ~yes)

    def first(self, fork: Fork) -> bool:
        """Whether the first way is gone."""
        if fork.told is not None:
            return fork.told
        self.live = fork.yes
        return True

    def second(self, fork: Fork) -> bool:
        """Whether the second way is gone."""
        if fork.told is not None:
            return not fork.told
        fork.left, self.live = self.live, fork.no
        return True

    def join(self, fork: Fork) -> None:
        """Both ways come together."""
        if fork.told is not None:
            return
        if fork.left is fork.yes and self.live is fork.no:
            self.live = fork.came
            return
        assert fork.left is not None
        assert self.live is not None
        self.live = fork.left | self.live

    def choose(self, test: Any, yes: Callable[[], Any], no: Callable[[], Any]) -> Any:
        """One of two values."""
        if not isinstance(test, Tensor):
            return yes() if test else no()
        chosen, other, margin = yes(), no(), getattr(test, "margin", None)
        if self.gate is not None and margin is not None:
            return _Chosen.apply(test, self.tensor(chosen), self.tensor(other), margin, self.gate)  # type: ignore[no-untyped-call]
        return merged(test if test.dtype is torch.bool else test != 0, chosen, other)

    # Loops.

    def loop(self, frame: Frame) -> Loop:
        """A loop begins."""
        return Loop(frame, self.live, self.live)

    def goes_on(self, loop: Loop, test: Any) -> bool:
        """Whether a lane has another round; those that skipped the rest of the last are in again."""
        if isinstance(test, Tensor):
            loop.inside = test if loop.inside is None else loop.inside & test
        elif not test:
            return False
        if loop.frame.gone is not None:
            loop.inside = ~loop.frame.gone if loop.inside is None else loop.inside & ~loop.frame.gone
        self.live = loop.inside
        return self.live is None or bool(self.live.any())

    def numbers(self, loop: Loop, *bounds: Any) -> Iterator[Any]:
        """The rounds of a loop over `range`; one over all neurons has one round."""
        if bounds[-1] is ALL:
            yield ALL
        elif any(isinstance(bound, Tensor) for bound in bounds):
            if len(bounds) > 1:
                raise Untranslatable("'range' of two numbers that differ from neuron to neuron")
            k = 0
            while self.goes_on(loop, bounds[0] > k):
                yield k
                k += 1
        else:
            yield from self.each(loop, range(*(int(bound) for bound in bounds)))

    def each(self, loop: Loop, values: Any) -> Iterator[Any]:
        """The rounds of a loop over values that all lanes share."""
        for value in values:
            if not self.goes_on(loop, True):
                return
            yield value

    def looped(self, loop: Loop) -> None:
        """The lanes that came to the loop go on behind it, but for those that have returned."""
        self.live, gone = loop.came, loop.frame.gone
        if gone is not None:
            self.live = ~gone if loop.came is None else loop.came & ~gone

    def breaks(self, loop: Loop) -> bool:
        """Live lanes leave the loop; True where all do."""
        if self.live is None:
            return True
        loop.inside = ~self.live if loop.inside is None else loop.inside & ~self.live
        return self.skips()

    def skips(self) -> bool:
        """Live lanes wait for the next round; True where all do."""
        if self.live is None:
            return True
        self.live = torch.zeros_like(self.live)
        return False

    # Truth.

    def at_least(self, a: Any, b: Any) -> Any:
        """Whether a >= b; of what has a gradient the result knows by how much (`margin`), which surrogates ask for."""
        return self._with_margin(a >= b, a, b)

    def above(self, a: Any, b: Any) -> Any:
        """As `at_least`, a > b."""
        return self._with_margin(a > b, a, b)

    def at_most(self, a: Any, b: Any) -> Any:
        """As `at_least`, a <= b."""
        return self._with_margin(a <= b, b, a)

    def below(self, a: Any, b: Any) -> Any:
        """As `at_least`, a < b."""
        return self._with_margin(a < b, b, a)

    def _with_margin(self, found: Any, a: Any, b: Any) -> Any:
        if isinstance(found, Tensor) and any(isinstance(side, Tensor) and side.requires_grad for side in (a, b)):
            vars(found)["margin"] = a - b
        return found

    def both(self, first: Any, later: Callable[[], Any]) -> Any:
        """Whether both hold; the second is not asked where the first tells for all."""
        if not isinstance(first, Tensor):
            return later() if first else first
        second = later()
        if not isinstance(second, Tensor):
            return first if second else second
        return reached(torch.logical_and(first, second), first, second)

    def either(self, first: Any, later: Callable[[], Any]) -> Any:
        """Whether one holds, likewise."""
        if not isinstance(first, Tensor):
            return first or later()
        second = later()
        if not isinstance(second, Tensor):
            return second or first
        return reached(torch.logical_or(first, second), first, second)

    def no(self, value: Any) -> Any:
        """Whether it does not hold."""
        return torch.logical_not(value) if isinstance(value, Tensor) else not value

    def minus(self, a: Any, b: Any) -> Any:
        """A difference, of truths as of 0 and 1, too."""
        if isinstance(b, Tensor) and b.dtype is torch.bool:
            b = b.to(torch.float64)
        if isinstance(a, Tensor) and a.dtype is torch.bool:
            a = a.to(torch.float64)
        return a - b


def _better(lanes: Lanes, test: Any, new: Any, old: Any) -> Any:
    return lanes.choose(test, lambda: new, lambda: old)


def _extreme(better: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    def found(lanes: Lanes, *values: Any) -> Any:
        best = values[0]
        for value in values[1:]:
            best = _better(lanes, better(value, best), value, best)
        return best

    return found


class _Chosen(torch.autograd.Function):
    """One of two values, with the gradient of a surrogate for what was compared."""

    @staticmethod
    def forward(ctx: Any, test: Tensor, chosen: Tensor, other: Tensor, margin: Tensor, gate: Any) -> Tensor:
        ctx.save_for_backward(test, chosen, other, margin)
        ctx.gate = gate
        return torch.where(test, chosen, other)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        (g,), (test, chosen, other, margin) = grads, ctx.saved_tensors
        none = g.new_zeros(())
        to_margin = g * (chosen - other) * ctx.gate(margin)
        to_chosen, to_other = torch.where(test, g, none), torch.where(test, none, g)
        return None, to_chosen.sum_to_size(chosen.shape), to_other.sum_to_size(other.shape), to_margin, None


class _Floor(torch.autograd.Function):
    """Rounding down, whose gradient is that of doing nothing (Bengio, Leonard & Courville, arXiv:1308.3432, 2013)."""

    @staticmethod
    def forward(ctx: Any, value: Tensor) -> Tensor:
        return torch.floor(value)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        return grads[0]


def _floor(lanes: Lanes, value: Any) -> Any:
    return torch.floor(value) if lanes.gate is None else _Floor.apply(value)  # type: ignore[no-untyped-call]


_OWN: dict[Any, Callable[..., Any]] = {
    builtins.abs: lambda lanes, a: abs(a),
    builtins.max: _extreme(lambda a, b: a > b),
    builtins.min: _extreme(lambda a, b: a < b),
    builtins.round: lambda lanes, a: torch.round(a),
    builtins.int: lambda lanes, a: torch.trunc(a.to(torch.float64)),
    builtins.float: lambda lanes, a: a.to(torch.float64),
    builtins.bool: lambda lanes, a: a != 0,
    math.fabs: lambda lanes, a: abs(a),
    math.floor: _floor,
}
"""Functions of Python whose tensors' version has another name or other ways."""
