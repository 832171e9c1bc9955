"""The decoders of this package, see `neuro.coding.world`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from neuro.coding.work import Work, on_numbers
from neuro.coding.world import Act, Bools, Decoder, Floats, Ints
from neuro.core.errors import ModelError
from neuro.core.quantities import quantity

if TYPE_CHECKING:
    import gymnasium


def _box(name: str, space: Any) -> Any:
    """The space, if its actions are numbers with bounds."""
    from gymnasium import spaces

    if not isinstance(space, spaces.Box) or not space.is_bounded():
        raise ModelError(f"{name}: action space {space}: expected a Box with finite bounds", hint="winner takes others")
    return space


def _numbers(name: str, space: Any, neurons: int, expected: int) -> None:
    if neurons != expected:
        raise ModelError(f"{name}: {neurons} neurons for actions of {space}: expected {expected}")


@dataclass(frozen=True, kw_only=True, eq=False)
class winner(Decoder):
    """The neurons with most spikes of each population, the first of equal ones, are the choice for a number."""

    votes: int = quantity(1, "", "neurons side by side that stand for one choice together", kind="integer", at_least=1)

    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder; along a number of a Box the neurons stand for actions between its bounds."""
        from gymnasium import spaces

        from neuro.coding.spaces import actions_of

        box = isinstance(space, spaces.Box)
        numbers = int(np.prod(space.shape or ())) if box else 1
        circuits, rest = divmod(len(sizes), max(1, numbers))
        if box and (rest or not circuits):
            raise ModelError(f"winner: {len(sizes)} populations for actions of {space}: expected {numbers}, or more")
        actions = actions_of(space, sizes[0] // self.votes if box else 2, circuits if box else 1)
        expected = [self.votes * size for size in actions.sizes]
        if list(sizes) != expected:
            message = f"winner: populations of {list(sizes)} neurons for actions of {space}"
            raise ModelError(f"{message}: expected {len(expected)} of {', '.join(map(str, expected))}")
        one, *others = self.of
        if not others:
            return lambda counts: actions.of(self._winners(counts[one])[:, None])
        return lambda counts: actions.of(np.array([self._winners(counts[name]) for name in self.of]).T)

    def work(self, sizes: Sequence[int]) -> Work:
        """Return a comparison for each choice, and with several votes an addition for each neuron."""
        neurons = sum(sizes)
        return on_numbers(neurons // self.votes + (neurons if self.votes > 1 else 0), neurons + len(sizes))

    def _winners(self, fired: Ints) -> Ints:
        """Return the choice of a population in each copy, (copies,)."""
        if self.votes > 1:
            fired = fired.reshape(len(fired), -1, self.votes).sum(axis=2)
        winners: Ints = fired.argmax(axis=1)
        return winners

    def chosen(self, counts: Mapping[str, Ints], population: str) -> Bools:
        """Return which neurons of a population voted for the action."""
        if population not in self.of:
            raise ModelError(
                f"others: population '{population}' chooses no action: expected one of {', '.join(self.of)}"
            )
        fired = counts[population]
        chosen: Bools = np.arange(fired.shape[1]) // self.votes == self._winners(fired)[:, None]
        return chosen


@dataclass(frozen=True, kw_only=True, eq=False)
class difference(Decoder):
    """Pairs of neurons pull a number up and down: gain times the difference of their spikes over the most possible.

    Source: Mosca, MSc thesis, 2020, eq. 129.
    """

    gain: Any = quantity(1.0, "", "factor, one for all or one for each number", above=0, arrays=True)

    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder: neurons 0 and 1 are the pair of the first number."""
        box, pairs = _box("difference", space), sum(sizes) // 2
        _numbers("difference", space, sum(sizes), 2 * int(np.prod(box.shape)))
        low, high, shape = box.low.astype(np.float64), box.high.astype(np.float64), (-1, *box.shape)
        gain = np.asarray(self.gain, np.float64)
        if gain.size not in (1, pairs):
            raise ModelError(f"difference: gain = {gain.tolist()}: expected a number or a list of {pairs}")
        factor = (np.broadcast_to(gain, (pairs,)) / most[0]).reshape(box.shape)
        names = self.of

        def act(counts: Mapping[str, Ints]) -> npt.NDArray[Any]:
            each = [counts[name] for name in names]
            fired = each[0] if len(each) == 1 else np.concatenate(each, axis=1)
            actions: Floats = factor * (fired[:, 0::2] - fired[:, 1::2]).reshape(shape)
            np.maximum(actions, low, out=actions)  # with the next one half as long as clip
            np.minimum(actions, high, out=actions)
            return actions

        return act

    def work(self, sizes: Sequence[int]) -> Work:
        """Return no work: the motors of the body count the spikes of a pair and pull against each other."""
        return Work()


@dataclass(frozen=True, kw_only=True, eq=False)
class mean(Decoder):
    """The mean of what the neurons stand for, spread evenly between the bounds, weighted by their spikes."""

    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder; without a spike the action is in the middle."""
        box = _box("mean", space)
        low, high = (np.ravel(each).astype(np.float64) for each in (box.low, box.high))
        if len(sizes) != low.size:
            raise ModelError(f"mean: {len(sizes)} populations for actions of {space}: expected {low.size}")
        values = [np.linspace(a, b, n) for a, b, n in zip(low, high, sizes, strict=True)]
        names = self.of

        def act(counts: Mapping[str, Ints]) -> npt.NDArray[Any]:
            numbers = []
            for name, stands_for in zip(names, values, strict=True):
                fired = counts[name]
                spikes = fired.sum(axis=1)
                total = fired @ stands_for
                numbers.append(np.where(spikes > 0, total / np.maximum(spikes, 1), stands_for.mean()))
            return np.stack(numbers, axis=1).reshape(-1, *box.shape).astype(box.dtype)

        return act

    def work(self, sizes: Sequence[int]) -> Work:
        """Return an addition and a weighted addition for each neuron, and for each number a limit and a division."""
        return on_numbers(2 * sum(sizes) + 2 * len(sizes), sum(sizes) + len(sizes))


@dataclass(frozen=True, kw_only=True, eq=False)
class counts(Decoder):
    """Each neuron is a number of the action: offset + gain times its spikes, within the bounds."""

    gain: float = quantity(1.0, "", "for a spike", nonzero=True)
    offset: float = quantity(0.0, "", "without a spike")

    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder."""
        box, names = _box("counts", space), self.of
        _numbers("counts", space, sum(sizes), int(np.prod(box.shape)))
        low, high = box.low.astype(np.float64), box.high.astype(np.float64)

        def act(counts: Mapping[str, Ints]) -> npt.NDArray[Any]:
            fired = np.concatenate([counts[name] for name in names], axis=1).reshape(-1, *box.shape)
            return np.asarray(np.clip(self.offset + self.gain * fired, low, high).astype(box.dtype))

        return act

    def work(self, sizes: Sequence[int]) -> Work:
        """Return no work: a motor of the body counts its spikes."""
        return Work()
