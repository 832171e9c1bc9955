"""Runtime of rewritten model functions (`neuro_torch.translate`), which run for all neurons at once.

Every neuron is a lane. `live` marks the lanes that execute the current statement: None for all, else a tensor of
booleans. A branch on a number that all lanes share is an ordinary branch. If the condition is a tensor, both
branches run, each with its own lanes live. An assignment changes live lanes only. A loop runs while any lane is live in
it.

Example: for V = [1, 3], `if V >= 2: V = 0` runs the assignment with `live` = [False, True] and leaves V = [1, 0].
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
"""Index of all neurons: the value of `lo` and `hi` in a call, and of `i` in the loop over neurons."""

NUMBERS = (bool, int, float, np.generic)


@dataclass(slots=True)
class Frame:
    """State of a function call: the lanes that entered, the lanes that have returned, and the return value."""

    entered: Tensor | None
    returned: Tensor | None = None
    value: Any = None


@dataclass(slots=True)
class Loop:
    """State of a loop: the lanes that entered and the lanes still inside."""

    frame: Frame
    entered: Tensor | None
    inside: Tensor | None


@dataclass(slots=True)
class Fork:
    """State of a branch.

    Attributes:
        shared: the condition, if all lanes share it; then the other attributes stay None.
        entered: the lanes that entered.
        yes, no: the lanes of each branch.
        after_first: the lanes that are live at the end of the first branch.
    """

    shared: bool | None
    entered: Tensor | None = None
    yes: Any = None
    no: Any = None
    after_first: Tensor | None = None


class LaneRows:
    """States, inputs or other numbers of all neurons, by row; the index is (row, ALL), or ALL for a single row.

    Args:
        rows: one tensor per row, or one number that all neurons share.
        shape: shape to which stored values are expanded; None keeps the shape of the values.
    """

    __slots__ = ("rows", "shape")

    def __init__(self, rows: list[Any], shape: tuple[int, ...] | None = None) -> None:
        self.rows, self.shape = rows, shape

    def __getitem__(self, index: Any) -> Any:
        return self.rows[index[0]] if type(index) is tuple else self.rows[0]

    def write(self, lanes: Lanes, at: Any, value: Any) -> None:
        """Store a value in the live lanes."""
        row = at[0] if type(at) is tuple else 0
        new = value if lanes.live is None else merged(lanes.live, value, self.rows[row])
        self.rows[row] = new if self.shape is None else spread(new, self.shape, lanes.device)


def spread(value: Any, shape: tuple[int, ...], device: Any) -> Tensor:
    """Return a number or tensor as a tensor of doubles, expanded to a shape."""
    tensor = value if isinstance(value, Tensor) else torch.tensor(float(value), dtype=torch.float64, device=device)
    if tensor.dtype is not torch.float64:
        tensor = tensor.to(torch.float64)
    return tensor if tensor.shape == shape else tensor.expand(shape)


def merged(mask: Tensor, new: Any, old: Any) -> Any:
    """Return `new` in the masked lanes and `old` in the others; if either is not numeric, return `new`."""
    if old is None or new is old:
        return new
    if isinstance(new, tuple) and isinstance(old, tuple) and len(new) == len(old):
        return tuple(merged(mask, n, o) for n, o in zip(new, old, strict=True))
    if not isinstance(new, (Tensor, *NUMBERS)) or not isinstance(old, (Tensor, *NUMBERS)):
        return new
    result = torch.where(mask, double(new, mask), double(old, mask))
    return with_margin_of(result, new, old)


def double(value: Any, like: Tensor) -> Any:
    """Return a float as a tensor of doubles, because torch converts Python floats to singles; other values stay."""
    if isinstance(value, (float, np.floating)):
        return torch.tensor(float(value), dtype=torch.float64, device=like.device)
    return value


def with_margin_of(result: Tensor, *parts: Any) -> Tensor:
    """Copy the margin of a comparison to a result that depends on it, see `Lanes.at_least`."""
    for part in parts:
        margin = getattr(part, "margin", None)
        if margin is not None:
            vars(result)["margin"] = margin
            break
    return result


class Lanes:
    """All neurons of one call.

    Args:
        device: device of the tensors.
        live: the lanes that take part, None for all.
        gate: surrogate for graded neurons that learn: maps the margin of a comparison to the derivative of the choice
            that depends on it. With a gate, rounding down has the gradient of the identity.
    """

    def __init__(self, device: Any, live: Tensor | None = None, gate: Callable[[Tensor], Tensor] | None = None) -> None:
        self.device, self.live, self.gate = device, live, gate

    def run(self, function: Any, *arguments: Any) -> Any:
        """Run a function of a model's arithmetic for all neurons."""
        return translated(function)(self, *arguments)

    # Calls.

    def enter(self) -> Frame:
        """Begin a call."""
        return Frame(self.live)

    def returns(self, frame: Frame, value: Any) -> bool:
        """Run `return`: store the value for the live lanes; return True if no lane is left in the call."""
        if self.live is None:
            frame.value = value
            return True
        frame.value = value if frame.returned is None else merged(self.live, value, frame.value)
        frame.returned = self.live if frame.returned is None else frame.returned | self.live
        self.live = torch.zeros_like(self.live)
        return False

    def leave(self, frame: Frame) -> Any:
        """End a call: all lanes that entered continue after it."""
        self.live = frame.entered
        return frame.value

    def call(self, function: Any, *arguments: Any) -> Any:
        """Call a function in a rewritten function: rewrite it, run it on plain numbers, or use its torch version."""
        if isinstance(function, FunctionType):
            return translated(function)(self, *arguments)
        if (plain := getattr(function, "py_func", None)) is not None:
            return translated(plain)(self, *arguments)
        if all(isinstance(argument, NUMBERS) for argument in arguments):
            return function(*arguments)
        if isinstance(function, BuiltinFunctionType | type | np.ufunc):
            torch_version = _TORCH_VERSIONS.get(function) or getattr(torch, getattr(function, "__name__", ""), None)
            if torch_version is not None:
                return (
                    torch_version(self, *arguments)
                    if function in _TORCH_VERSIONS
                    else torch_version(*map(self.tensor, arguments))
                )
        raise Untranslatable(f"'{getattr(function, '__name__', function)}' of tensors")

    def tensor(self, value: Any) -> Tensor:
        """Return a number as a tensor of doubles; return a tensor unchanged."""
        return value if isinstance(value, Tensor) else torch.tensor(value, dtype=torch.float64, device=self.device)

    # Assignments.

    def put(self, old: Any, new: Any) -> Any:
        """Return the value of a variable after an assignment in the live lanes."""
        return new if self.live is None else merged(self.live, new, old)

    def store(self, place: Any, at: Any, value: Any) -> None:
        """Assign to an element of an array or a list in the live lanes."""
        if isinstance(place, LaneRows):
            place.write(self, at, value)
        else:
            place[at] = self.put(place[at], value)

    # Branches.

    def fork(self, test: Any) -> Fork:
        """Begin a branch."""
        if not isinstance(test, Tensor):
            return Fork(bool(test))
        yes, entered = test if test.dtype is torch.bool else test != 0, self.live
        return Fork(None, entered, yes, ~yes) if entered is None else Fork(None, entered, entered & yes, entered & ~yes)

    def first(self, fork: Fork) -> bool:
        """Return whether the `if` branch runs, and make its lanes live."""
        if fork.shared is not None:
            return fork.shared
        self.live = fork.yes
        return True

    def second(self, fork: Fork) -> bool:
        """Return whether the `else` branch runs, and make its lanes live."""
        if fork.shared is not None:
            return not fork.shared
        fork.after_first, self.live = self.live, fork.no
        return True

    def join(self, fork: Fork) -> None:
        """End a branch: the live lanes of both branches continue."""
        if fork.shared is not None:
            return
        if fork.after_first is fork.yes and self.live is fork.no:
            self.live = fork.entered
            return
        assert fork.after_first is not None
        assert self.live is not None
        self.live = fork.after_first | self.live

    def choose(self, test: Any, yes: Callable[[], Any], no: Callable[[], Any]) -> Any:
        """Evaluate a conditional expression."""
        if not isinstance(test, Tensor):
            return yes() if test else no()
        chosen, other, margin = yes(), no(), getattr(test, "margin", None)
        if self.gate is not None and margin is not None:
            return _Chosen.apply(test, self.tensor(chosen), self.tensor(other), margin, self.gate)  # type: ignore[no-untyped-call]
        return merged(test if test.dtype is torch.bool else test != 0, chosen, other)

    # Loops.

    def loop(self, frame: Frame) -> Loop:
        """Begin a loop."""
        return Loop(frame, self.live, self.live)

    def goes_on(self, loop: Loop, test: Any) -> bool:
        """Return whether any lane runs another iteration; lanes that waited for the iteration are live again."""
        if isinstance(test, Tensor):
            loop.inside = test if loop.inside is None else loop.inside & test
        elif not test:
            return False
        if loop.frame.returned is not None:
            loop.inside = ~loop.frame.returned if loop.inside is None else loop.inside & ~loop.frame.returned
        self.live = loop.inside
        return self.live is None or bool(self.live.any())

    def numbers(self, loop: Loop, *bounds: Any) -> Iterator[Any]:
        """Iterate over a `range`; a loop over all neurons is a single iteration."""
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
        """Iterate over values that all lanes share."""
        for value in values:
            if not self.goes_on(loop, True):
                return
            yield value

    def end_loop(self, loop: Loop) -> None:
        """End a loop: the lanes that entered continue, except those that have returned."""
        self.live, returned = loop.entered, loop.frame.returned
        if returned is not None:
            self.live = ~returned if loop.entered is None else loop.entered & ~returned

    def breaks(self, loop: Loop) -> bool:
        """Run `break`: the live lanes leave the loop; return True if all lanes leave."""
        if self.live is None:
            return True
        loop.inside = ~self.live if loop.inside is None else loop.inside & ~self.live
        return self.skips()

    def skips(self) -> bool:
        """Run `continue`: the live lanes wait for the next iteration; return True if all lanes wait."""
        if self.live is None:
            return True
        self.live = torch.zeros_like(self.live)
        return False

    # Comparisons and logic.

    def at_least(self, a: Any, b: Any) -> Any:
        """Return a >= b; if a or b has a gradient, the result carries the margin a - b for the surrogate."""
        return self._with_margin(a >= b, a, b)

    def above(self, a: Any, b: Any) -> Any:
        """Return a > b, with a margin as in `at_least`."""
        return self._with_margin(a > b, a, b)

    def at_most(self, a: Any, b: Any) -> Any:
        """Return a <= b, with a margin as in `at_least`."""
        return self._with_margin(a <= b, b, a)

    def below(self, a: Any, b: Any) -> Any:
        """Return a < b, with a margin as in `at_least`."""
        return self._with_margin(a < b, b, a)

    def _with_margin(self, result: Any, a: Any, b: Any) -> Any:
        if isinstance(result, Tensor) and any(isinstance(side, Tensor) and side.requires_grad for side in (a, b)):
            vars(result)["margin"] = a - b
        return result

    def both(self, first: Any, later: Callable[[], Any]) -> Any:
        """Return `first and later()`; `later` is not called if all lanes share a false `first`."""
        if not isinstance(first, Tensor):
            return later() if first else first
        second = later()
        if not isinstance(second, Tensor):
            return first if second else second
        return with_margin_of(torch.logical_and(first, second), first, second)

    def either(self, first: Any, later: Callable[[], Any]) -> Any:
        """Return `first or later()`; `later` is not called if all lanes share a true `first`."""
        if not isinstance(first, Tensor):
            return first or later()
        second = later()
        if not isinstance(second, Tensor):
            return second or first
        return with_margin_of(torch.logical_or(first, second), first, second)

    def no(self, value: Any) -> Any:
        """Return `not value`."""
        return torch.logical_not(value) if isinstance(value, Tensor) else not value

    def minus(self, a: Any, b: Any) -> Any:
        """Return a - b, with booleans as 0 and 1."""
        if isinstance(b, Tensor) and b.dtype is torch.bool:
            b = b.to(torch.float64)
        if isinstance(a, Tensor) and a.dtype is torch.bool:
            a = a.to(torch.float64)
        return a - b


def _select(lanes: Lanes, test: Any, new: Any, old: Any) -> Any:
    return lanes.choose(test, lambda: new, lambda: old)


def _extreme(better: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    def extreme(lanes: Lanes, *values: Any) -> Any:
        winner = values[0]
        for value in values[1:]:
            winner = _select(lanes, better(value, winner), value, winner)
        return winner

    return extreme


class _Chosen(torch.autograd.Function):
    """A choice of one of two values, whose gradient reaches the compared quantity through the gate."""

    @staticmethod
    def forward(ctx: Any, test: Tensor, chosen: Tensor, other: Tensor, margin: Tensor, gate: Any) -> Tensor:
        ctx.save_for_backward(test, chosen, other, margin)
        ctx.gate = gate
        return torch.where(test, chosen, other)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        (g,), (test, chosen, other, margin) = grads, ctx.saved_tensors
        zero = g.new_zeros(())
        d_margin = g * (chosen - other) * ctx.gate(margin)
        d_chosen, d_other = torch.where(test, g, zero), torch.where(test, zero, g)
        return (None, d_chosen.sum_to_size(chosen.shape), d_other.sum_to_size(other.shape), d_margin, None)


class _Floor(torch.autograd.Function):
    """Rounding down with the gradient of the identity (Bengio, Leonard & Courville, arXiv:1308.3432, 2013)."""

    @staticmethod
    def forward(ctx: Any, value: Tensor) -> Tensor:
        return torch.floor(value)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        return grads[0]


def _floor(lanes: Lanes, value: Any) -> Any:
    return torch.floor(value) if lanes.gate is None else _Floor.apply(value)  # type: ignore[no-untyped-call]


_TORCH_VERSIONS: dict[Any, Callable[..., Any]] = {
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
"""Python functions whose torch version has another name or signature."""
