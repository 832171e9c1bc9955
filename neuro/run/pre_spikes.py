"""What pre spikes leave in the synapses that they are sent along, as NEST's weight_recorder shows it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.program.backend import Engine, Notes, Sent
from neuro.program.program import Ints, Program

NOBODY: Ints = np.zeros(0, dtype=np.int64)


class PreSpikes:
    """What one probe has recorded at pre spikes.

    A spike that is emitted in a step acts when the next begins, so that of the last step is still to come. Where spike
    pairs teach, the engine notes what each spike leaves. Other weights do not change while a network runs: they are
    those of the moment in which the spikes set out.

    Args:
        program: the whole network.
        index: which of its `synapse_probes`.

    Attributes:
        probe: that one.
    """

    def __init__(self, program: Program, index: int) -> None:
        self._program, self._index = program, index
        self.probe = program.synapse_probes[index]
        self._part = program.projections[self.probe.projection]
        self._source = self._part.source
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._kept: list[Sent] = []
        self._seen, self._waiting = -1, (NOBODY, NOBODY)

    def look(self, engine: Engine) -> None:
        """Take over what spikes have left since the last look."""
        new = engine.noted(self._index) if isinstance(engine, Notes) and self._learns else self._followed(engine)
        if new.steps.size:
            order = np.lexsort((new.synapses, new.steps))
            self._kept.append(Sent(new.steps[order], new.synapses[order], new.values[order]))

    @property
    def _learns(self) -> bool:
        return self._part.synapse.learns == "pairs"

    def _followed(self, engine: Engine) -> Sent:
        """The synapses of those who have fired, with their weights of now."""
        spikes = engine.spikes(self._source, self._seen)
        steps, ids = np.repeat(spikes.steps, spikes.multiplicity), np.repeat(spikes.ids, spikes.multiplicity)
        steps, ids = np.concatenate((self._waiting[0], steps)), np.concatenate((self._waiting[1], ids))
        gone, self._seen = steps < engine.step, engine.step
        self._waiting = steps[~gone], ids[~gone]
        synapses, number = self._rows(ids[gone])
        values = engine.get_synapses(self.probe.projection, self.probe.record)
        return Sent(np.repeat(steps[gone], number), synapses, values[synapses])

    def _rows(self, ids: Ints) -> tuple[Ints, Ints]:
        """The synapses of some sources, one after the other, and how many each has."""
        sources, _ = self._program.connections(self.probe.projection)
        if self.probe.synapses is None:
            chosen = np.arange(sources.size)
        else:
            chosen = np.sort(self.probe.synapses)
        first, end = np.searchsorted(sources[chosen], ids), np.searchsorted(sources[chosen], ids, side="right")
        number = end - first
        places = np.arange(number.sum()) + np.repeat(first - np.cumsum(number) + number, number)
        return chosen[places], number

    def read(self) -> Sent:
        """All that has been recorded, by step, then synapse."""
        none = Sent(NOBODY, NOBODY, np.zeros(0))
        parts = [none, *self._kept]
        return Sent(*(np.concatenate([getattr(part, word) for part in parts]) for word in Sent.__slots__))

    def take(self) -> Sent:
        """All that has been recorded; it is forgotten."""
        found, self._kept = self.read(), []
        return found

    def forget(self, before: int) -> None:
        """Drop what spikes up to a step have left."""
        found = self.take()
        late = found.steps > before
        self._kept = [Sent(found.steps[late], found.synapses[late], found.values[late])]

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """All that has been recorded, and what is to come."""
        found = self.read()
        waiting = {"waiting_steps": self._waiting[0], "waiting_ids": self._waiting[1], "seen": np.array(self._seen)}
        return {**{word: getattr(found, word) for word in Sent.__slots__}, **waiting}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        self._kept = [Sent(*(arrays[word].copy() for word in Sent.__slots__))]
        self._waiting = arrays["waiting_steps"].copy(), arrays["waiting_ids"].copy()
        self._seen = int(arrays["seen"])
