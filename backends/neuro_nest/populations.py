"""One population as nodes of NEST."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from neuro.core.clock import NEVER, Clock
from neuro.program.program import Floats, Ints, Population, Schedule
from neuro_nest.kernel import Ranks, set_nodes, told
from neuro_nest.sources import InjectedTrain, is_noise
from neuro_nest.tables import DEVICE, ENDLESS, NODES, RK4, UNREADABLE

_WITH_E_L = ("V_th", "V_reset", "V_min", "V_m")
"""What NEST holds relative to E_L: told again with it, so that no rounding moves it."""


class NestPopulation:
    """The nodes of a population and its present parameters.

    Args:
        nest: the module.
        part: the population.
        parameters: by word, shape (1,) or (size,).
        clock: of the network.
        ranks: the processes.
        number: of nodes, if it is not that of its neurons.
        devices: whether those of a generator send along synapses that do not learn.

    Attributes:
        first: the number of the first node; the others follow.
        first_device: likewise of the devices.
    """

    def __init__(
        self,
        nest: Any,
        part: Population,
        parameters: dict[str, Floats],
        clock: Clock,
        ranks: Ranks,
        number: int | None = None,
        devices: bool = False,
    ) -> None:
        self.part, self.parameters, self._clock, self._ranks = part, parameters, clock, ranks
        self._nest, self.nodes = nest, nest.Create(NODES[part.model.name], number or part.size)
        self.first = int(self.nodes[0].global_id)
        self._emitting = [self.nodes, *([nest.Create(DEVICE, part.size)] if devices else [])]
        self.first_device = int(self._emitting[-1][0].global_id)
        self._tell(self._first_words())
        if part.kind == "current" and part.schedule is not None:
            self._tell_schedule(part.schedule)

    def _first_words(self) -> dict[str, Floats]:
        """All that NEST must know before step 1."""
        if self.part.kind == "current":
            span = {"start": self._clock.ms(self.part.start)}
            if self.part.stop < NEVER:
                span["stop"] = self._clock.ms(self.part.stop)
            return self.parameters | {word: np.array([value]) for word, value in span.items()}
        if self.part.kind != "neuron":
            return {}
        states = [state.name for state in self.part.model.states if not (state.hidden or state.follows)]
        return self.parameters | {name: self.part.initial[name] for name in states if name not in UNREADABLE}

    def _tell_schedule(self, listed: Schedule) -> None:
        """Tell when a current changes, and its values."""
        times = self._clock.array_ms(listed.steps)
        rows = np.broadcast_to(listed.values.T, (self.part.size, listed.steps.size))
        set_nodes(self._nest, self.nodes, [{"amplitude_times": times, "amplitude_values": row.copy()} for row in rows])

    def emit(self, spikes: InjectedTrain) -> None:
        """Let the injectors fire, and the devices."""
        order = np.argsort(spikes.ids, kind="stable")
        ids, begin = np.unique(spikes.ids[order], return_index=True)
        times = np.split(self._clock.array_ms(spikes.steps[order]), begin[1:])
        numbers = np.split(spikes.multiplicity[order], begin[1:])
        if ids.size:
            words = [{"spike_times": t, "spike_multiplicities": m} for t, m in zip(times, numbers, strict=True)]
            for nodes in self._emitting:
                set_nodes(self._nest, nodes[ids.tolist()], words)

    def get(self, name: str, ids: Ints | None = None) -> Floats:
        """A state or parameter of every neuron, or of some."""
        if name in self.parameters:
            every = np.broadcast_to(self.parameters[name], self.part.size)
            return every.copy() if ids is None else every[ids]
        if self._ranks.size > 1:
            gathered = self._gathered(name)
            return gathered if ids is None else gathered[ids]
        if ids is None:
            return np.atleast_1d(np.array(self.nodes.get(name), dtype=np.float64))
        order = np.argsort(ids)  # NEST takes its nodes in ascending order only
        found: Floats = np.empty(ids.size)
        found[order] = self.nodes[ids[order].tolist()].get(name)
        return found

    def _gathered(self, name: str) -> Floats:
        """A state of the neurons of all processes."""
        mine = (self._ranks.rank - self.first) % self._ranks.size  # NEST deals its nodes out in turn
        here = self.nodes[mine :: self._ranks.size] if mine < self.part.size else ()
        told = here.get(["global_id", name]) if here else {"global_id": [], name: []}
        ids, values = np.atleast_1d(told["global_id"]).astype(np.int64), np.atleast_1d(told[name]).astype(np.float64)
        found: Floats = np.empty(self.part.size)
        found[self._ranks.gather(ids) - self.first] = self._ranks.gather(values)
        return found

    def set(self, values: Mapping[str, Floats]) -> None:
        """Change states and parameters, all or none."""
        old = {name: self.get(name) for name in values}
        parameters = self.parameters | {name: v.copy() for name, v in values.items() if name in self.parameters}
        try:
            self._tell(values)
        except Exception:
            self._tell(old)
            raise
        self.parameters.update(parameters)

    def _tell(self, values: Mapping[str, Floats]) -> None:
        if self.part.kind in ("poisson", "listed", "generator") or is_noise(self.part):
            return
        if "E_L" in values:
            beside = [n for n in _WITH_E_L if n not in values and (n in self.parameters or n == "V_m")]
            values = {n: self.get(n) for n in beside} | dict(values)
        words = {name: self._in_words_of_nest(name, each) for name, each in values.items() if name != RK4}
        own = {name: each for name, each in words.items() if len(each) > 1}
        shared = {name: each[0] for name, each in words.items() if name not in own}
        neurons = [shared | {name: own[name][i] for name in own} for i in range(self.part.size)] if own else [shared]
        with told():
            set_nodes(self._nest, self.nodes, neurons)

    def _in_words_of_nest(self, name: str, values: Floats) -> list[Any]:
        if name == "refractory_input":
            return [bool(v) for v in values]
        if name == "tau_m":
            return [ENDLESS if np.isinf(v) else v for v in values.tolist()]
        if name == "t_ref":
            return [self._clock.ms(round(v / self._clock.resolution)) for v in values.tolist()]
        plain: list[Any] = values.tolist()
        return plain
