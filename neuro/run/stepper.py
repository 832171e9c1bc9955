"""Control steps: spikes in, run, counts out, in one call for a simulation or for many copies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from neuro.core.errors import ModelError, a
from neuro.program.backend import Engine
from neuro.program.program import Ints
from neuro.program.together import join_engines
from neuro.run.handles import Run
from neuro.run.ports import within
from neuro.run.watch import Watch

Listed = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike]

LOOK = 1000
"""Number of steps between checks for NaN while control steps run."""


class Joined:
    """Engines of one network at the same step, controlled together.

    Args:
        run: the network in execution.
        engines: the engine of each copy.
        watches: the watch on the states of each copy.

    Attributes:
        engines: the joined engines.
        plain: whether all engines can advance at once: there are no probes, streams or signals with values.
    """

    def __init__(self, run: Run, engines: Sequence[Engine], watches: Sequence[Watch]) -> None:
        self.run, program = run, run.program
        self._engine_of_copy, self._watches, self._due = list(engines), list(watches), 0
        self.engines = join_engines(program, engines)
        streams = any(part.stream is not None for part in program.populations)
        streams = streams or any(part.values is not None for part in program.signals)
        self.plain = not (program.probes or program.synapse_probes or streams)

    def __len__(self) -> int:
        return len(self._engine_of_copy)

    def advance(self, steps: int, forget: bool) -> None:
        """Advance all engines. With `forget`, spikes are not recorded, and states are checked at intervals only.

        Raises:
            ModelError: a state is NaN or infinite.
        """
        self.engines.run(steps, forget)
        step = self._engine_of_copy[0].step
        # A check of all states takes as long as a control step of a small network.
        if not forget or step >= self._due or step < steps:
            self._due = step + LOOK
            for watch in self._watches:
                watch.look()

    def check_together(self) -> None:
        """Raise an error if copies were run separately.

        Raises:
            ModelError: the copies are at different times.
        """
        steps = [engine.step for engine in self._engine_of_copy]
        if len(set(steps)) > 1:
            times = ", ".join(f"{self.run.clock.ms(step):g}" for step in steps[:4])
            raise ModelError(f"copies are at {times} ... ms: expected the same time", hint="run or reset all copies")


class Stepper:
    """Control steps of one length: spikes in, run, counts out; made by `Simulation.stepper` and `Copies.stepper`.

    Spikes of control steps are not recorded, so memory does not grow. `counts` of a port and `sim.counts()` include
    them.

    Args:
        joined: the copies.
        ms: length of a control step.
        emit: populations that receive spikes.
        count: populations whose spikes are counted.
        run: function that advances all copies by a number of steps instead of the stepper, and may record.

    Attributes:
        ms: length of a control step.
        ticks: length of a control step in steps of the network.
    """

    def __init__(
        self,
        joined: Joined,
        ms: float,
        emit: Sequence[Any],
        count: Sequence[Any],
        run: Callable[[int], None] | None = None,
    ) -> None:
        self._joined, self.ms, self.ticks = joined, ms, joined.run.steps(ms)
        handles, program = joined.run.handles, joined.run.program
        self._emit = [handles.neurons(part).index for part in emit]
        self._count = [handles.neurons(part).index for part in count]
        for index in self._emit:
            part = program.populations[index]
            if part.kind != "listed" or part.stream is not None or part.model.graded:
                raise ModelError(f"stepper: '{part.name}' is {a(part.model_name)}: expected a spike_generator")
        if run is None and not joined.plain:
            raise ModelError(
                "stepper: the network has probes, streams or signals with values: expected a network without them",
                hint="use run and ports",
            )
        self._run = run
        self._before = [joined.engines.fired(index) for index in self._count]

    def step(self, *spikes: Listed) -> list[Ints]:
        """Run one control step.

        Args:
            spikes: for each population of `emit` (ticks, ids), sorted by tick, then id, without repeated ids in a tick;
                ticks are steps from now, 1 to `ticks`. For several copies (offsets, ticks, ids), where copy k has the
                spikes `offsets[k] : offsets[k + 1]`.

        Returns:
            For each population of `count` the number of spikes of each neuron, (copies, neurons).

        Raises:
            ModelError: a tick or an id is out of bounds, or a state became NaN.
        """
        joined = self._joined
        joined.check_together()
        if len(spikes) != len(self._emit):
            raise ModelError(f"step: spikes of {len(spikes)} populations: expected {len(self._emit)}")
        if spikes:
            joined.engines.list_spikes(
                [self._list(index, train) for index, train in zip(self._emit, spikes, strict=True)]
            )
        if self._run is None:
            joined.advance(self.ticks, forget=True)
        else:
            self._run(self.ticks)
        fired = [joined.engines.fired(index) for index in self._count]
        counts = [counts_after - counts_before for counts_after, counts_before in zip(fired, self._before, strict=True)]
        self._before = fired
        return counts

    def _list(self, index: int, spikes: Listed) -> tuple[int, Ints, Ints, Ints]:
        part, n = self._joined.run.program.populations[index], len(self._joined)
        *optional, ticks, ids = (np.ascontiguousarray(array, dtype=np.int64) for array in spikes)
        offsets = optional[0] if optional else np.array([0, len(ticks)], dtype=np.int64)
        if offsets.shape != (n + 1,) or offsets[0] != 0 or offsets[-1] != len(ticks) or len(ids) != len(ticks):
            message = f"step: spikes of '{part.name}': expected (offsets, ticks, ids) with {n + 1} offsets"
            raise ModelError(message if n > 1 else f"step: spikes of '{part.name}': expected as many ticks as ids")
        for name, values, low, high in (("ticks", ticks, 1, self.ticks), ("ids", ids, 0, part.size - 1)):
            # Four calls of NumPy would take as long as some ticks of a small network.
            if not within(values, low, high):
                actual = f"{name} {values.min()} to {values.max()}"
                raise ModelError(f"step: spikes of '{part.name}': {actual}: expected {low} to {high}")
        return index, offsets, ticks, ids
