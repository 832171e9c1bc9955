"""The base class of an engine, which owns the arrays and the threads, runs steps, and takes and returns spikes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from neuro.core.errors import ModelError, a
from neuro.core.interrupts import AT_ONCE, Interruptible, end_if_stopped, torn
from neuro.program.backend import Spikes
from neuro.program.program import Floats, Ints, Program
from neuro.program.spikes import RecordedSpikes, carrying, nothing_listed, too_many
from neuro_event.building import build, joined_rows, layout
from neuro_event.loop import steps, tables as t

if TYPE_CHECKING:
    from neuro.program.listed import ListedSpikes
    from neuro_event.host.changing import Changing
    from neuro_event.host.probes import PreSpikeRecords, StateProbe
    from neuro_event.host.reading import NeuronReader, SynapseReader
    from neuro_event.host.threads import Threads


class Running:
    """A program that the compiled loop can advance.

    Modules that only some networks or only reads need are imported at the place of use.
    """

    def __init__(self, program: Program, threads: int) -> None:
        self._program = program
        self._n_threads = threads
        self._stop: Ints = np.zeros(1, dtype=np.int64)
        self._interruptible = Interruptible(self._stop)
        self._start_over()

    def _start_over(self, eager: bool = True, edges: Ints | None = None, joined: frozenset[int] | None = None) -> None:
        cut = () if edges is None else (edges, joined)
        self._arrays = build.build(self._program, self._n_threads, eager, *cut)
        self._arrays.net["stop"] = self._stop
        self._step, self._torn = 0, False
        # Parameters that were set, by "population.name", in the order of ids; the parameters of all synapse models, by
        # projection; and weights onto relays, which no kernel reads, by projection.
        self._changed_parameters: dict[str, Floats] = {}
        self._rules = {q: part.synapse.vector() for q, part in enumerate(self._program.projections)}
        self._relay_weights: dict[int, Floats] = {}
        self._record = RecordedSpikes()
        self._changing: Changing | None = None
        if any(part.kind == "current" or part.schedule is not None for part in self._program.populations):
            from neuro_event.host.changing import Changing

            self._changing = Changing(self._program, self._arrays)
        n_threads = self._arrays.net["edges"].shape[1] - 1
        self._threads: Threads | None = None
        if n_threads > 1:
            from neuro_event.host.threads import Threads

            self._threads = Threads(n_threads)
        self._lists: ListedSpikes | None = None
        if any(part.kind == "listed" for part in self._program.populations):
            from neuro.program.listed import ListedSpikes

            begins = [place.begin for place in self._arrays.places]
            self._lists = ListedSpikes(self._program, self._arrays.net, begins, n_threads)
        else:
            self._arrays.net |= nothing_listed(self._program, n_threads)
        self._samples: dict[int, StateProbe] = {}
        self._pre_spike_records: PreSpikeRecords | None = None
        if self._program.probes or self._program.synapse_probes:
            from neuro_event.host.probes import PreSpikeRecords, state_probes

            self._samples, self._pre_spike_records = state_probes(self._arrays), PreSpikeRecords(self._arrays)
        self._has_probes = bool(self._samples or self._pre_spike_records)
        self._trial_start = 0
        self._trial_updates = np.zeros(len(self._program.projections), dtype=np.int64)
        self._trial_rules: dict[int, tuple[ModuleType, Floats]] = {}
        self._weight_maps: dict[int, Ints] = {}
        self._pack()

    def _pack(self) -> None:
        """Pass the addresses of all arrays to the kernels. Call it whenever an array was replaced by another array."""
        net = self._arrays.net
        for _, array, owner in build.declared_in(self._arrays):
            if array.life.startswith("="):
                owner[array.name] = owner[array.life[1:]].view(array.kind)
        net["due_slots"] = net["due"].reshape(len(net["due"]), -1, net["awake"].size)
        build.link(self._arrays)
        self._table = t.table_of(net, self._arrays.plastic)
        self._view = self._table.ctypes.data
        self._flags = net["clock"][:, t.OVERRUN : t.UNCOUNTED + 1]
        self._no_flags = np.zeros_like(self._flags).tolist()
        for reader in ("_synapse_reader", "_neuron_reader"):  # the old readers refer to the old arrays
            vars(self).pop(reader, None)

    @cached_property
    def _synapse_reader(self) -> SynapseReader:
        from neuro_event.host.reading import SynapseReader

        return SynapseReader(self._arrays, self._table)

    @cached_property
    def _neuron_reader(self) -> NeuronReader:
        from neuro_event.host.reading import NeuronReader

        return NeuronReader(self._arrays)

    @property
    def step(self) -> int:
        """The last finished step."""
        return self._step

    def run(self, steps: int) -> None:
        """Advance by a number of steps.

        The loop returns to Python where a current or a rate changes, and where the record of spikes is full.
        """
        self._refuse_torn()
        end = self._step + steps
        self.join_rows()
        with self._interruptible:
            while self._step < end:
                self._run_to(end if self._changing is None else min(end, self._prepare(self._changing, self._step)))

    def share_stop(self, engines: Sequence[Running]) -> Ints:
        """Let several engines share one stop request, to stop together, and return the request.

        See `neuro.core.interrupts`.
        """
        for engine in engines:
            engine._stop = engine._arrays.net["stop"] = self._stop
            engine._interruptible = self._interruptible
            engine._pack()
        return self._stop

    def join_rows(self) -> None:
        """Lay out the joined rows before a run, if weights were set. Several changes cost a single layout."""
        if self._arrays.rows_outdated:
            joined_rows.join(self._arrays)
            self._pack()
            self._arrays.rows_outdated = False  # set last, so that the next run repeats a layout that was interrupted

    def _refuse_torn(self) -> None:
        """Raise an error if an interrupt has left threads at different steps."""
        if self._torn:
            raise torn()

    def _prepare(self, changing: Changing, step: int) -> int:
        """Write the currents and rates of the steps after `step`. Return the last step for which they are valid."""
        until, replaced = changing.prepare(self._view, step, self._parameter)
        if replaced:
            self._pack()
        return until

    def _parameter(self, population: int, name: str) -> Floats:
        """Return a parameter of every neuron of a population, e.g. the present rate of a generator, (neurons,)."""
        part, place = self._program.populations[population], self._arrays.places[population]
        if part.kind == "poisson" and name == "rate":
            mean: Floats = self._arrays.net["mean"][place.begin : place.end]
            return mean / (self._program.resolution * 1e-3)
        if layout.has_states(part):
            column = build.parameters(self._arrays, population)[:, list(part.parameters).index(name)]
            return np.broadcast_to(place.by_id(column) if column.size > 1 else column, part.size).copy()
        if part.kind == "current" and self._changing is not None:
            value = self._changing.currents.parameter(population, name)
        else:
            value = part.parameters[name]
        return np.broadcast_to(value, part.size).astype(np.float64)

    def _run_to(self, end: int) -> None:
        first, stop = self._step + 1, self._stop
        while first <= end:
            last = end
            if self._pre_spike_records:  # each step is a separate run, with buffers for the records of that step
                if self._pre_spike_records.make_room(self._view, first - 1):
                    self._pack()
                last = first
            if self._has_probes:
                last = min([last, *(-(-first // probe.every) * probe.every for probe in self._samples.values())])
            self._torn = True
            try:
                where = (
                    self._view,
                    first,
                    last + 1,
                    self._arrays.longest_slice,
                    self._arrays.reach,
                    self._program.resolution,
                )
                reached = steps.run(*where) if self._threads is None else self._threads.run(*where, stop)
                if stop.item():
                    end_if_stopped(stop)
            except BaseException:  # Ctrl-C is raised as soon as a kernel returns
                self._torn = self._threads is not None or int(stop[0]) == AT_ONCE
                self._step = int(self._arrays.net["reached"][0]) - 1
                raise
            self._torn, self._step = False, int(reached) - 1
            if reached <= last:
                self._drain()
                if reached == first and steps.has_room(self._view, first, 1, self._arrays.reach) < 1:
                    self._grow_log()
            elif self._has_probes:
                for probe in self._samples.values():
                    if last % probe.every == 0:
                        probe.read(self._view, last)
            first = int(reached)
        self._step = end
        self._check_flags()

    def _check_flags(self) -> None:
        """Raise an error for spikes that the kernels could not count or deliver.

        Spike counts have 64 bits. A history has as many entries as the refractory period allows, so a model that fires
        within its refractory period has overwritten spikes.
        """
        flags = self._flags.tolist()
        if flags == self._no_flags:
            return
        overrun, uncounted = (max(column) for column in zip(*flags, strict=True))
        if uncounted:
            raise too_many(self._program.populations[uncounted - 1])
        if overrun:
            part = self._program.populations[overrun - 1]
            raise ModelError(
                f"population '{part.name}': {a(part.model.name)} fired again within its t_ref, so its plastic synapses "
                "missed spikes: expected a model that is silent for t_ref after a spike"
            )

    def _grow_log(self) -> None:
        """Double the size of the log of spikes under way."""
        net = self._arrays.net
        old_size = net["log_ids"].shape[1]
        for name in ("log_ids", "log_counts"):
            bigger = np.zeros((net[name].shape[0], 2 * old_size), dtype=net[name].dtype)
            for thread in range(bigger.shape[0]):
                places = np.arange(max(0, int(net["log_at"][thread, 0]) - old_size), int(net["log_at"][thread, 0]))
                bigger[thread, places & (2 * old_size - 1)] = net[name][thread, places & (old_size - 1)]
            net[name] = bigger
        self._pack()

    def are_finite(self, population: int, states: Sequence[str]) -> bool:
        """Implement `neuro.program.backend.are_finite`. Sleeping neurons have the values of their last step."""
        place, model = self._arrays.places[population], type(self._program.populations[population].model)
        names = [s.name for s in model.states]
        rows = self._arrays.net["state"]
        return all(bool(np.isfinite(rows[names.index(name), place.begin : place.end]).all()) for name in states)

    @property
    def _spike_lists(self) -> ListedSpikes:
        assert self._lists is not None
        return self._lists

    def inject(self, population: int, steps: Ints, ids: Ints, payloads: Ints | None = None) -> None:
        """Add spikes of a listed population at steps after the present one."""
        if self._spike_lists.add(population, steps, ids, self._step, payloads):
            self._pack()

    def spikes(self, population: int, since: int) -> Spikes:
        """Return the recorded spikes of a population with step > `since`."""
        self._drain()
        place = self._arrays.places[population]
        ids_at = None if place.inside is None else place.outside
        recorded = self._record.spikes(place.begin, place.end, since, ids_at)
        return carrying(self._program.populations[population], recorded)

    def _drain(self) -> None:
        """Move recorded spikes from the buffers of the loop to the record."""
        names, lengths = ("rec_steps", "rec_ids", "rec_counts"), self._arrays.net["rec_at"][:, 0]
        steps, ids, counts = (self._arrays.net[name] for name in names)
        self._record.take((steps[k, :n], ids[k, :n], counts[k, :n]) for k, n in enumerate(lengths.tolist()))
        lengths[:] = 0

    def forget(self, before: int) -> None:
        """Drop the recorded spikes with step <= `before`."""
        if before >= self._step:
            self._arrays.net["rec_at"][:, 0] = 0
            self._record = RecordedSpikes()
            return
        self._drain()
        self._record.forget(before)
