"""Ports: fast setting and reading of values at every step of a closed loop.

A port accepts values that need no conversion directly: an array of doubles within the bounds. All other values are
passed to `Simulation.set`, `signal` and `get`, with their rules and errors.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from threading import get_ident
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from neuro.core.errors import ModelError
from neuro.core.keyed_random import LARGEST_MEAN
from neuro.core.quantities import Quantity, word_of
from neuro.kernels.jit import kernel
from neuro.program.backend import Engine, counter
from neuro.program.program import Floats, Ints, synapse_states
from neuro.program.together import Engines
from neuro.run import settable
from neuro.run.handles import Neurons, Run
from neuro.run.turn import NOW, Turn, refused

_HUGE = sys.float_info.max
_DOUBLE, _WHOLE = np.dtype(np.float64), np.dtype(np.int64)


class Port:
    """Access to a value of a running network, made by `Simulation.port` and `Copies.port`, for repeated use.

    For copies the first axis of all arrays has an entry for each copy.

    Args:
        ports: the simulations and their engines.
        text: name of the part and its value, for messages.
        size: number of values for each simulation.
        low: smallest value that is accepted directly.
        high: largest value that is accepted directly.

    Attributes:
        text: name in messages, e.g. "rate of 'cells'".
    """

    _call = ""
    """The method of a simulation in place of which `set` is called."""

    def __init__(self, ports: Ports, text: str, size: int = 0, low: float = math.inf, high: float = -math.inf) -> None:
        self.text, self._turn, self._sims, self._engines = text, ports.turn, ports.sims, ports.engines
        self._together, n = ports.together, len(self._sims)
        self._shapes = ((size,),) if self._together is None else ((n, size), (n, 1))
        self._size, self._low, self._high = size, low, high

    def __repr__(self) -> str:
        return f"Port({self.text}{'' if self._together is None else f', {len(self._sims)} copies'})"

    def set(self, values: ArrayLike) -> None:
        """Set the values from the next step on: one value for all, or a value for each neuron or synapse.

        Args:
            values: new values in a form of `Simulation.set` or `signal`. For copies an array (copies, n) or (copies,
                1), or one value for all. The fastest form is a float64 array with a value for each neuron or synapse.

        Raises:
            ModelError: a value is out of bounds, the port is read-only, or another call of the simulation is running.
        """
        turn, own_turn = self._turn, ("a port's set", get_ident())
        try:
            if turn.setdefault(NOW, own_turn) is not own_turn:
                raise refused(f"port: {self.text}", turn)
            self._set(values)
        finally:
            if turn.get(NOW) is own_turn:
                del turn[NOW]

    def get(self, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Return the present values.

        Args:
            out: array for the result: float64, or int64 for spikes and counts, with a value for each neuron or synapse.
                For spikes its size is the largest number of spikes.

        Returns:
            `out` or a new array, for copies (copies, n). For spikes the filled part of `out`.

        Raises:
            ModelError: `out` does not fit, the port is write-only, or another call of the simulation is running.
        """
        turn, own_turn = self._turn, ("a port's get", get_ident())
        try:
            if turn.setdefault(NOW, own_turn) is not own_turn:
                raise refused(f"port: {self.text}", turn)
            return self._get(out)
        finally:
            if turn.get(NOW) is own_turn:
                del turn[NOW]

    def _set(self, values: Any) -> None:
        if (
            type(values) is np.ndarray
            and values.dtype == _DOUBLE
            and values.shape in self._shapes
            and values.flags.c_contiguous
            and within(values if values.ndim == 1 else values.reshape(-1), self._low, self._high)
        ):
            if self._together is None:
                self._accept(self._engines[0], values)
            else:
                has_all = values.shape == self._shapes[0]
                self._accept_all(self._together, values if has_all else np.repeat(values, self._size, axis=1))
            for sim in self._sims:
                sim.steered[self._call] = None
        elif self._together is None:
            self._set_one(self._sims[0], values)
        else:
            rows, n = np.asarray(values), len(self._sims)
            if rows.ndim and (rows.ndim == 1 or len(rows) != n):
                actual = f"an array of shape {list(rows.shape)}"
                raise ModelError(f"port: {self.text}: {actual}: expected {n} copies first, then values")
            for k, sim in enumerate(self._sims):
                self._set_one(sim, values if not rows.ndim else rows[k, 0] if rows.shape[1:] == (1,) else rows[k])

    def _accept(self, engine: Engine, values: Floats) -> None:
        """Set values of one engine that are within the bounds."""

    def _accept_all(self, engines: Engines, values: Floats) -> None:
        """Set values of all engines that are within the bounds, (copies, n)."""
        for engine, row in zip(self._engines, values, strict=True):
            self._accept(engine, row)

    def _set_one(self, sim: Any, values: ArrayLike) -> None:
        """Set any values of one simulation, by the method that the port replaces."""
        raise ModelError(f"port: {self.text}: the port can only be read")

    def _get(self, out: NDArray[Any] | None) -> NDArray[Any]:
        if self._together is None:
            return self._filled(self._read(0), out)
        rows = [self._read(k) for k in range(len(self._sims))]
        if len(sizes := {row.size for row in rows}) > 1:
            message = f"port: {self.text}: copies have {min(sizes)} to {max(sizes)} values: expected as many in each"
            raise ModelError(message, hint="copies[k].port")
        return self._filled(np.array(rows), out)

    def _read(self, copy: int) -> NDArray[Any]:
        """Return the values of one copy."""
        raise ModelError(f"port: {self.text}: the port can only be set")

    def begin(self) -> None:
        """Forget earlier reads, because the simulation was reset or restored."""

    def _filled(self, values: NDArray[Any], out: NDArray[Any] | None) -> NDArray[Any]:
        if out is None:
            return values
        if type(out) is not np.ndarray or out.dtype != values.dtype or out.shape != values.shape:
            raise self._unfit(out, values.dtype, f"shape {list(values.shape)}")
        out[...] = values
        return out

    def _unfit(self, out: Any, dtype: np.dtype[Any], extent: str) -> ModelError:
        actual = f"{out.dtype} of shape {list(out.shape)}" if isinstance(out, np.ndarray) else type(out).__name__
        return ModelError(f"port: {self.text}: out is {actual}: expected an array of {dtype} of {extent}")


class _NeuronPort(Port):
    """A port for a state or parameter of neurons."""

    _call = "set"

    def __init__(self, ports: Ports, of: Any, neurons: Neurons, word: str) -> None:
        part, self._run, self._of, self._word = neurons.part, ports.run, of, word
        self._index, self._ids = neurons.index, neurons.ids
        is_rate = part.kind == "poisson" and word == "rate"
        self._rates = is_rate and self._ids is None
        self._checks_together = not (is_rate or word in settable.states(part))
        q = settable.quantity_of(part, word)
        low, high = _closed(q) if q is not None and q.kind == "number" else (math.inf, -math.inf)
        if is_rate:
            high = min(high, LARGEST_MEAN * 1000.0 / self._run.clock.resolution)
        size = part.size if self._ids is None else self._ids.size
        super().__init__(ports, f"{word} of {neurons.text}", size, low, high)

    def _accept(self, engine: Engine, values: Floats) -> None:
        if self._ids is not None:
            all_values = engine.get(self._index, self._word)
            all_values[self._ids] = values
            values = all_values
        by_name = {self._word: values}
        if self._checks_together:
            settable.check_together(self._run.program, self._index, by_name, engine, self._run.clock)
        engine.set(self._index, by_name)

    def _accept_all(self, engines: Engines, values: Floats) -> None:
        if self._rates:
            engines.set_rate(self._index, values)
        else:
            super()._accept_all(engines, values)

    def _set_one(self, sim: Any, values: ArrayLike) -> None:
        sim.set(self._of, **{self._word: values})

    def _read(self, copy: int) -> Floats:
        return self._engines[copy].get(self._index, self._word, self._ids)


class _SynapsePort(Port):
    """A port for the weight or another state of the synapses of a projection."""

    def __init__(self, ports: Ports, of: Any, index: int, word: str) -> None:
        part = ports.run.program.projections[index]
        super().__init__(ports, f"{word} of '{part.name}'")
        self._of, self._index, self._word, self._is_state = of, index, word, word in synapse_states(part)

    def _set_one(self, sim: Any, values: ArrayLike) -> None:
        sim.set(self._of, **{self._word: values})

    def _read(self, copy: int) -> Floats:
        if self._is_state:
            values = self._engines[copy].get_synapses(self._index, self._word)
            if within(values, -_HUGE, _HUGE):
                return values
        checked: Floats = self._sims[copy].get(self._of, self._word)
        return checked


class _SignalPort(Port):
    """A port for a signal, with one value for each modulated neuron."""

    _call = "signal"

    def __init__(self, ports: Ports, of: Any, index: int) -> None:
        part, self._of, self._index = ports.run.program.signals[index], of, index
        size = ports.run.program.populations[part.target].size
        super().__init__(ports, f"signal '{part.name}'", size, -_HUGE, _HUGE)

    def _accept(self, engine: Engine, values: Floats) -> None:
        engine.signal(self._index, np.add(values, 0.0))

    def _accept_all(self, engines: Engines, values: Floats) -> None:
        engines.signal(self._index, np.add(values, 0.0))

    def _set_one(self, sim: Any, values: ArrayLike) -> None:
        sim.signal(self._of, values)


class _CountPort(Port):
    """A port for the number of spikes of each neuron since the last read."""

    def __init__(self, ports: Ports, neurons: Neurons) -> None:
        super().__init__(ports, f"counts of {neurons.text}")
        self._fired = counter(self._engines[0]) if self._together is None else self._together.fired
        self._index, self._ids = neurons.index, neurons.ids
        self.begin()

    def _present(self) -> Ints:
        counts = self._fired(self._index)
        return counts if self._ids is None else counts[..., self._ids]

    def begin(self) -> None:
        self._before = self._present()

    def _get(self, out: NDArray[Any] | None) -> NDArray[Any]:
        counts = self._present()
        new = self._filled(counts - self._before, out)
        self._before = counts
        return new


class _SpikePort(Port):
    """A port for the spikes since the last read: ids of neurons in the order of time, then id."""

    def __init__(self, ports: Ports, of: Any, neurons: Neurons) -> None:
        super().__init__(ports, f"spikes of {neurons.text}")
        self._run, self._of = ports.run, of
        self.begin()

    def begin(self) -> None:
        self._since = self._run.clock.ms(self._run.engine.step)

    def _get(self, out: NDArray[Any] | None) -> NDArray[Any]:
        if out is not None and (type(out) is not np.ndarray or out.dtype != _WHOLE or out.ndim != 1):
            raise self._unfit(out, _WHOLE, "one axis")
        ids: Ints = self._sims[0].spikes(self._of, since=self._since)[1]
        if out is not None and ids.size > out.size:
            raise self._unfit(out, _WHOLE, f"at least {ids.size}, the spikes since {self._since:g} ms")
        self.begin()
        return ids if out is None else self._filled(ids, out[: ids.size])


class Ports:
    """Maker of the ports of a simulation or of copies. Ports refer to simulations; simulations refer weakly to ports.

    Args:
        sims: the simulations of the ports.
        turn: turn of the simulation, see `neuro.run.turn`.
        engines_of_copies: joined engines of copies; None for a single simulation, whose arrays have no axis of copies.
    """

    def __init__(self, sims: Sequence[Any], turn: Turn, engines_of_copies: Engines | None = None) -> None:
        self.sims, self.turn, self.together = sims, turn, engines_of_copies
        self.run: Run = sims[0]._run
        self.engines: list[Engine] = [sim._engine for sim in sims]

    def port(self, of: Any, what: str | None) -> Port:
        """Return a port; see `Simulation.port`."""
        handles = self.run.handles
        if what is None:
            return _SignalPort(self, of, handles.signal(of))
        if what not in ("counts", "spikes"):
            part = handles.neurons_or_projection(of)
            self.sims[0].get(of, what)  # raises an error for an unknown word
            if isinstance(part, int):
                return _SynapsePort(self, of, part, what)
            return _NeuronPort(self, of, part, word_of(what))
        neurons = handles.neurons(of)
        if what == "spikes":
            self.sims[0].spikes(of, since=math.inf)  # raises an error for spikes that are not recorded
            if self.together is not None:
                message = "port: the number of spikes differs between copies: expected 'counts'"
                raise ModelError(message, hint="copies[k].port")
        port: Port = _CountPort(self, neurons) if what == "counts" else _SpikePort(self, of, neurons)
        for sim in self.sims:
            sim._ports.add(port)
        return port


def _closed(q: Quantity) -> tuple[float, float]:
    """Return the smallest and the largest finite number within the bounds of a quantity."""
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
    """Return whether all values are in [low, high]. NaN is outside."""
    # A single loop, since several calls of NumPy take longer than a step of a small network.
    is_within = True
    for k in range(values.size):
        is_within &= (low <= values[k]) & (values[k] <= high)
    return is_within
