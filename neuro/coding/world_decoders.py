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
    """Return the space if its actions are numbers with bounds, else raise an error."""
    from gymnasium import spaces

    if not isinstance(space, spaces.Box) or not space.is_bounded():
        raise ModelError(f"{name}: action space {space}: expected a Box with finite bounds", hint="use winner instead")
    return space


def _numbers(name: str, space: Any, neurons: int, expected: int) -> None:
    if neurons != expected:
        raise ModelError(f"{name}: {neurons} neurons for actions of {space}: expected {expected}")


@dataclass(frozen=True, kw_only=True, eq=False)
class winner(Decoder):
    """The neuron with most spikes in a population chooses the value of a number. The first of equal neurons wins."""

    votes: int = quantity(1, "", "number of adjacent neurons that share a choice", kind="integer", at_least=1)

    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder. In a Box, the neurons of a number represent values between the bounds."""
        from gymnasium import spaces

        from neuro.coding.spaces import actions_of

        box = isinstance(space, spaces.Box)
        numbers = int(np.prod(space.shape or ())) if box else 1
        circuits, remainder = divmod(len(sizes), max(1, numbers))
        if box and (remainder or not circuits):
            raise ModelError(f"winner: {len(sizes)} populations for actions of {space}: expected {numbers}, or more")
        actions = actions_of(space, sizes[0] // self.votes if box else 2, circuits if box else 1)
        expected = [self.votes * size for size in actions.sizes]
        if list(sizes) != expected:
            message = f"winner: populations of {list(sizes)} neurons for actions of {space}"
            raise ModelError(f"{message}: expected {len(expected)} of {', '.join(map(str, expected))}")
        first_name, *other_names = self.of
        if not other_names:
            return lambda counts: actions.of(self._winners(counts[first_name])[:, None])
        return lambda counts: actions.of(np.array([self._winners(counts[name]) for name in self.of]).T)

    def work(self, sizes: Sequence[int]) -> Work:
        """Return the work: a comparison per choice, and with several votes an addition per neuron."""
        neurons = sum(sizes)
        return on_numbers(neurons // self.votes + (neurons if self.votes > 1 else 0), neurons + len(sizes))

    def _winners(self, fired: Ints) -> Ints:
        """Return the choice of a population in each copy, (copies,)."""
        if self.votes > 1:
            fired = fired.reshape(len(fired), -1, self.votes).sum(axis=2)
        winners: Ints = fired.argmax(axis=1)
        return winners

    def chosen(self, counts: Mapping[str, Ints], population: str) -> Bools:
        """Return True for each neuron of a population that voted for the action."""
        if population not in self.of:
            raise ModelError(
                f"others: population '{population}' chooses no action: expected one of {', '.join(self.of)}"
            )
        fired = counts[population]
        chosen: Bools = np.arange(fired.shape[1]) // self.votes == self._winners(fired)[:, None]
        return chosen


@dataclass(frozen=True, kw_only=True, eq=False)
class difference(Decoder):
    """Pairs of neurons pull a number up and down: gain x difference of their spikes / largest possible difference.

    Source: Mosca, MSc thesis, 2020, eq. 129.
    """

    gain: Any = quantity(1.0, "", "factor for all numbers, or a factor for each number", above=0, arrays=True)
    votes: int = quantity(1, "", "pairs side by side that pull one number together", kind="integer", at_least=1)

    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder: neurons 0 and 1 are the first pair of the first number."""
        box = _box("difference", space)
        numbers = int(np.prod(box.shape))
        _numbers("difference", space, sum(sizes), 2 * numbers * self.votes)
        low, high, shape = box.low.astype(np.float64), box.high.astype(np.float64), (-1, *box.shape)
        gain = np.asarray(self.gain, np.float64)
        if gain.size not in (1, numbers):
            raise ModelError(f"difference: gain = {gain.tolist()}: expected a number or a list of {numbers}")
        factor = (np.broadcast_to(gain, (numbers,)) / (most[0] * self.votes)).reshape(box.shape)
        names = self.of

        def act(counts: Mapping[str, Ints]) -> npt.NDArray[Any]:
            counts_of_names = [counts[name] for name in names]
            fired = counts_of_names[0] if len(counts_of_names) == 1 else np.concatenate(counts_of_names, axis=1)
            pulls = fired[:, 0::2] - fired[:, 1::2]
            if self.votes > 1:
                pulls = pulls.reshape(-1, self.votes).sum(axis=1)
            actions: Floats = factor * pulls.reshape(shape)
            np.maximum(actions, low, out=actions)  # with the next line twice as fast as clip
            np.minimum(actions, high, out=actions)
            return actions

        return act

    def work(self, sizes: Sequence[int]) -> Work:
        """Return no work: the motors of the body count the spikes of a pair and pull against each other."""
        return Work()


@dataclass(frozen=True, kw_only=True, eq=False)
class mean(Decoder):
    """The mean of the neurons' values, weighted by their spikes. The values are evenly spaced between the bounds."""

    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder. Without a spike the action is in the middle of its bounds."""
        box = _box("mean", space)
        low, high = (np.ravel(bound).astype(np.float64) for bound in (box.low, box.high))
        if len(sizes) != low.size:
            raise ModelError(f"mean: {len(sizes)} populations for actions of {space}: expected {low.size}")
        values = [np.linspace(a, b, n) for a, b, n in zip(low, high, sizes, strict=True)]
        names = self.of

        def act(counts: Mapping[str, Ints]) -> npt.NDArray[Any]:
            numbers = []
            for name, neuron_values in zip(names, values, strict=True):
                fired = counts[name]
                spikes = fired.sum(axis=1)
                total = fired @ neuron_values
                numbers.append(np.where(spikes > 0, total / np.maximum(spikes, 1), neuron_values.mean()))
            return np.stack(numbers, axis=1).reshape(-1, *box.shape).astype(box.dtype)

        return act

    def work(self, sizes: Sequence[int]) -> Work:
        """Return the work: an addition and a weighted addition per neuron, and a limit and a division per number."""
        return on_numbers(2 * sum(sizes) + 2 * len(sizes), sum(sizes) + len(sizes))


@dataclass(frozen=True, kw_only=True, eq=False)
class counts(Decoder):
    """Each neuron sets a number of the action: offset + gain times its spikes, within the bounds."""

    gain: float = quantity(1.0, "", "change of the number for a spike", nonzero=True)
    offset: float = quantity(0.0, "", "value of the number without a spike")

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
