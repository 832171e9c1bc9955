"""Ports, which are set or read at every step of a closed loop.

A port accepts at once what needs no conversion: an array of doubles within the bounds. Whatever else it is given goes
the way of `Simulation.set`, `signal` and `get`, and so has their meaning and their errors.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from threading import get_ident
from typing import Any
from weakref import WeakSet

import numpy as np
from numpy.typing import ArrayLike, NDArray

from neuro.core.errors import ModelError
from neuro.core.keyed_random import LARGEST_MEAN
from neuro.core.quantities import Quantity, word_of
from neuro.kernels.jit import kernel
from neuro.program.backend import counter
from neuro.program.program import Floats, Ints, synapse_states
from neuro.run import settable
from neuro.run.handles import Neurons, Run
from neuro.run.turn import NOW, Turn, refused

_HUGE = sys.float_info.max
_DOUBLE, _WHOLE = np.dtype(np.float64), np.dtype(np.int64)


class Port:
    """Something of a running network that is set or read again and again; made by `Simulation.port`.

    Attributes:
        text: what it is, for messages: "rate of 'cells'".
    """

    def __init__(self, text: str, turn: Turn) -> None:
        self.text, self._turn = text, turn

    def __repr__(self) -> str:
        return f"Port({self.text})"

    def set(self, values: ArrayLike) -> None:
        """Set the values, one for all or one for each; they act from the next step on.

        Args:
            values: as `Simulation.set` and `signal` take them; fastest is an array of float64, one for each.

        Raises:
            ModelError: a value is out of bounds, this can only be read, or a call of the simulation is under way.
        """
        turn, mine = self._turn, ("a port's set", get_ident())
        try:
            if turn.setdefault(NOW, mine) is not mine:
                raise refused(f"port: {self.text}", turn)
            self._set(values)
        finally:
            if turn.get(NOW) is mine:
                del turn[NOW]

    def _set(self, values: ArrayLike) -> None:
        raise ModelError(f"port: {self.text}: it is read and not set")

    def get(self, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """The values of now.

        Args:
            out: an array that takes them: float64, of spikes and counts int64, one for each; of spikes as many as
                may come.

        Returns:
            `out`, of spikes the part of it that is filled, or a new array.

        Raises:
            ModelError: `out` does not fit, this can only be set, or a call of the simulation is under way.
        """
        turn, mine = self._turn, ("a port's get", get_ident())
        try:
            if turn.setdefault(NOW, mine) is not mine:
                raise refused(f"port: {self.text}", turn)
            return self._get(out)
        finally:
            if turn.get(NOW) is mine:
                del turn[NOW]

    def _get(self, out: NDArray[Any] | None) -> NDArray[Any]:
        raise ModelError(f"port: {self.text}: it is set and not read")

    def begin(self) -> None:
        """The simulation went back, or on to another state: forget what was read before."""

    def _filled(self, values: NDArray[Any], out: NDArray[Any] | None) -> NDArray[Any]:
        if out is None:
            return values
        if type(out) is not np.ndarray or out.dtype != values.dtype or out.shape != values.shape:
            raise self._unfit(out, values.dtype, f"shape {list(values.shape)}")
        out[...] = values
        return out

    def _unfit(self, out: Any, dtype: np.dtype[Any], room: str) -> ModelError:
        found = f"{out.dtype} of shape {list(out.shape)}" if isinstance(out, np.ndarray) else type(out).__name__
        return ModelError(f"port: {self.text}: out is {found}: expected an array of {dtype} of {room}")


@dataclass(frozen=True, slots=True)
class _Bounds:
    """What is accepted at once: one double for each, within [low, high]."""

    shape: tuple[int, ...]
    low: float
    high: float

    def fit(self, values: Any) -> bool:
        """Whether values are such."""
        return (
            type(values) is np.ndarray
            and values.dtype == _DOUBLE
            and values.shape == self.shape
            and values.flags.c_contiguous
            and within(values, self.low, self.high)
        )


class _OfNeurons(Port):
    """A state or parameter of neurons."""

    def __init__(self, net: Ports, plain: Any, of: Any, neurons: Neurons, word: str) -> None:
        super().__init__(f"{word} of {neurons.text}", net.turn)
        self._net, self._plain, self._of, self._word = net, plain, of, word
        self._engine, self._index, self._ids = net.engine, neurons.index, neurons.ids
        part = neurons.part
        self._state = word in settable.states(part)
        drawn = part.kind == "poisson" and word == "rate"
        self._together = not (self._state or drawn)
        q = settable.quantity_of(part, word)
        size = part.size if self._ids is None else self._ids.size
        low, high = _closed(q) if q is not None and q.kind == "number" else (math.inf, -math.inf)
        if drawn:
            high = min(high, LARGEST_MEAN * 1000.0 / net.clock.resolution)
        self._bounds = _Bounds((size,), low, high)

    def _set(self, values: ArrayLike) -> None:
        if not self._bounds.fit(values):
            self._plain.set(self._of, **{self._word: values})
            return
        new: Floats = values  # type: ignore[assignment]
        if self._ids is not None:
            every = self._engine.get(self._index, self._word)
            every[self._ids] = new
            new = every
        named = {self._word: new}
        if self._together:
            settable.check_together(self._net.program, self._index, named, self._engine, self._net.clock)
        self._engine.set(self._index, named)
        self._plain.steered["set"] = None

    def _get(self, out: NDArray[Any] | None) -> NDArray[Any]:
        return self._filled(self._engine.get(self._index, self._word, self._ids), out)


class _OfSynapses(Port):
    """The weight, or another state, of the synapses of a projection."""

    def __init__(self, net: Ports, plain: Any, of: Any, index: int, word: str) -> None:
        part = net.program.projections[index]
        super().__init__(f"{word} of '{part.name}'", net.turn)
        self._engine, self._plain, self._of, self._index, self._word = net.engine, plain, of, index, word
        self._held = word in synapse_states(part)

    def _set(self, values: ArrayLike) -> None:
        self._plain.set(self._of, **{self._word: values})

    def _get(self, out: NDArray[Any] | None) -> NDArray[Any]:
        found = self._engine.get_synapses(self._index, self._word) if self._held else None
        if found is None or not within(found, -_HUGE, _HUGE):
            found = self._plain.get(self._of, self._word)
        return self._filled(found, out)


class _OfSignal(Port):
    """A signal, one value for each neuron that hears it."""

    def __init__(self, net: Ports, plain: Any, of: Any, index: int) -> None:
        part = net.program.signals[index]
        super().__init__(f"signal '{part.name}'", net.turn)
        self._plain, self._of, self._engine, self._index = plain, of, net.engine, index
        size = net.program.populations[part.target].size
        self._bounds = _Bounds((size,), -_HUGE, _HUGE)

    def _set(self, values: ArrayLike) -> None:
        if self._bounds.fit(values):
            self._engine.signal(self._index, np.add(values, 0.0))
            self._plain.steered["signal"] = None
        else:
            self._plain.signal(self._of, values)


class _Counts(Port):
    """How often each neuron has fired since this was last read."""

    def __init__(self, net: Ports, neurons: Neurons) -> None:
        super().__init__(f"counts of {neurons.text}", net.turn)
        self._fired, self._index, self._ids = counter(net.engine), neurons.index, neurons.ids
        self.begin()

    def _now(self) -> Ints:
        every = self._fired(self._index)
        return every if self._ids is None else every[self._ids]

    def begin(self) -> None:
        self._before = self._now()

    def _get(self, out: NDArray[Any] | None) -> NDArray[Any]:
        now = self._now()
        new = self._filled(now - self._before, out)
        self._before = now
        return new


class _Spikes(Port):
    """Neurons that have fired since this was last read: ids in the order of time, then id."""

    def __init__(self, net: Ports, plain: Any, of: Any, neurons: Neurons) -> None:
        super().__init__(f"spikes of {neurons.text}", net.turn)
        self._net, self._plain, self._of = net, plain, of
        self.begin()

    def begin(self) -> None:
        self._since = self._net.clock.ms(self._net.engine.step)

    def _get(self, out: NDArray[Any] | None) -> NDArray[Any]:
        if out is not None and (type(out) is not np.ndarray or out.dtype != _WHOLE or out.ndim != 1):
            raise self._unfit(out, _WHOLE, "one axis")
        ids = self._plain.spikes(self._of, since=self._since)[1]
        if out is not None and ids.size > out.size:
            raise self._unfit(out, _WHOLE, f"at least {ids.size}, the spikes since {self._since:g} ms")
        self.begin()
        return ids if out is None else self._filled(ids, out[: ids.size])


class Ports:
    """Makes the ports of a simulation, and knows those in use; they hold the simulation, and it does not hold them.

    Args:
        run: the network in execution.
        turn: the call that the simulation is in.
    """

    def __init__(self, run: Run, turn: Turn) -> None:
        self.program, self.engine, self.clock = run.program, run.engine, run.clock
        self._handles, self.turn = run.handles, turn
        self._used: WeakSet[Port] = WeakSet()

    def port(self, plain: Any, of: Any, what: str | None) -> Port:
        """A port of a simulation, whose calls it stands for; see `Simulation.port`."""
        port: Port
        if what is None:
            port = _OfSignal(self, plain, of, self._handles.signal(of))
        elif what == "counts":
            port = _Counts(self, self._handles.neurons(of))
        elif what == "spikes":
            neurons = self._handles.neurons(of)
            plain.spikes(of, since=math.inf)  # refuses what is not recorded
            port = _Spikes(self, plain, of, neurons)
        else:
            part = self._handles.neurons_or_projection(of)
            plain.get(of, what)  # refuses an unknown word
            if isinstance(part, int):
                port = _OfSynapses(self, plain, of, part, what)
            else:
                port = _OfNeurons(self, plain, of, part, word_of(what))
        self._used.add(port)
        return port

    def begin(self) -> None:
        """The simulation went back, or on to another state."""
        for each in self._used:
            each.begin()


def _closed(q: Quantity) -> tuple[float, float]:
    """The smallest and the largest finite number within the bounds of a quantity."""
    low, high = -_HUGE, _HUGE
    if q.at_least is not None:
        low = max(low, q.at_least)
    if q.above is not None:
        low = max(low, math.nextafter(q.above, math.inf))
    if q.at_most is not None:
        high = min(high, q.at_most)
    if q.below is not None:
        high = min(high, math.nextafter(q.below, -math.inf))
    return low, high


@kernel
def within(values: NDArray[Any], low: float, high: float) -> bool:
    """Whether all values lie in [low, high]; NaN does not."""
    # one pass: several passes of NumPy take longer than a step of a small network
    inside = True
    for k in range(values.size):
        inside &= (low <= values[k]) & (values[k] <= high)
    return inside
