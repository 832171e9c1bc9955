"""The engine: reading and writing between stretches of NEST's steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.program.backend import EngineCounts, Outcome, Spikes, Trial
from neuro.program.program import Floats, Ints, Program
from neuro_nest import kernel
from neuro_nest.kernel import nest_errors
from neuro_nest.network import NestNetwork
from neuro_nest.problems import BY_SIGN, ELSEWHERE, FINITE, NO_LEAK, RKF45_ONLY, has_new_current, refused_values
from neuro_nest.projections import NestProjection
from neuro_nest.tables import RK4, SHARED, UNREADABLE

_WORDS = {"K_plus": "Kplus"}


class NestEngine:
    """A program in execution; `neuro.program.backend.Engine` says what each method does.

    Args:
        program: the network, of which nothing is refused.
        threads: of NEST.
    """

    unreadable = UNREADABLE

    def __init__(self, program: Program, threads: int) -> None:
        self.program, self._threads = program, threads
        self._nest = kernel.lend(self, program.name)
        self.net = self._build(
            [{word: v.copy() for word, v in p.parameters.items()} for p in program.populations],
            [p.weight for p in program.projections],
            [p.synapse.vector() for p in program.projections],
        )

    def _build(self, parameters: list[dict[str, Floats]], weights: list[Floats], rules: list[Floats]) -> NestNetwork:
        return NestNetwork(self.program, self._nest, self._threads, parameters, weights, rules)

    @property
    def _listed(self) -> list[NestProjection]:
        """The projections whose synapses the program has."""
        return [wires for wires in self.net.wires if isinstance(wires, NestProjection)]

    def _wires(self, projection: int) -> NestProjection:
        self.program.refuse_undrawn(projection)
        wires = self.net.wires[projection]
        assert isinstance(wires, NestProjection)
        return wires

    @property
    def step(self) -> int:
        """The last finished step."""
        return self.net.step

    def run(self, steps: int) -> None:
        """Advance."""
        self.net.run(steps)

    def inject(self, population: int, steps: Ints, ids: Ints) -> None:
        """Add spikes of a spike_generator."""
        self.net.sources[population].inject(steps, ids, self.step)

    def signal(self, signal: int, values: Floats) -> None:
        """Set the dopamine of every synapse that listens."""
        for wires in self._listed:
            if wires.part.signal == signal:
                self._check_moment(wires, f"signal '{self.program.signals[signal].name}'")
                self._write(wires, "n", values[wires.target])

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        """A state or parameter of every neuron, or of some."""
        self._check_shown(population, name)
        with nest_errors():
            return self.net.cells[population].get(name, ids)

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Change states and parameters."""
        part = self.program.populations[population]
        for name in values:
            self._check_shown(population, name)
        if np.any(values.get(RK4, 0.0) != 0.0):
            raise ModelError(f"{RK4} of '{part.name}' cannot change: {RKF45_ONLY}", hint=ELSEWHERE)
        if has_new_current(self.net.cells[population].parameters, values):
            raise ModelError(f"I_e of '{part.name}' cannot change: {NO_LEAK}", hint=FINITE)
        changed = {**self.net.cells[population].parameters, **values}
        for limit, text in refused_values(part, changed, self.program.resolution):
            raise ModelError(
                f"'{part.name}' cannot change: {text}: {limit.why}", hint=f"{limit.way_out}, or {ELSEWHERE}"
            )
        self.net.cells[population].set(values)
        if population in self.net.noise:
            self.net.set_noise(population, values)

    def get_synapses(self, projection: int, name: str) -> Floats:
        """A state of every synapse."""
        wires = self._wires(projection)
        if not wires.part.synapse.learns:
            if wires.part.share.number == 1:
                return np.broadcast_to(wires.weights, wires.part.size).copy()
            # One weight is that of all, or of the only synapse that this process has: what each has decides nothing.
            return wires.joined(np.broadcast_to(wires.weights, wires.source.size))
        if wires.part.synapse.modulated:
            self._check_moment(wires, f"'{name}' of '{wires.part.name}'")
        with nest_errors():
            values = wires.read(self._nest, self.net.ends(wires), _WORDS.get(name, name))
        if name == "K_plus" and not wires.part.synapse.modulated:
            # NEST's stdp_synapse has K+ as of the last pre spike.
            passed = self.step - self.net.records[wires.part.source].sent[wires.source]
            values = values * np.exp(-passed * self.program.resolution / self.net.words(wires)["tau_plus"])
        return wires.joined(values)

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Change the numbers of a synapse model."""
        wires = self._wires(projection)
        self._check_changeable(wires, "the numbers")
        own = parameters if parameters.ndim == 1 else wires.given(parameters)
        self.net.rules[projection] = own.copy()
        words = self.net.words(wires)
        wires.changed()
        with nest_errors():
            if wires.part.synapse.modulated or wires.part.synapse.name in SHARED:
                for name in wires.models():
                    self._nest.SetDefaults(name, words)
            else:
                for word, value in words.items():
                    wires.write(self._nest, self.net.ends(wires), word, np.broadcast_to(value, len(wires.source)))

    def set_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights; those that are not chosen are NEST's own."""
        wires = self._wires(projection)
        if wires.part.synapse.learns:
            self._check_changeable(wires, "the weights")
        elif wires.part.carries == "spikes" and not wires.part.as_by_sign(weights):
            assert wires.part.receptor is not None
            what = f"weights of '{wires.part.name}' onto receptor '{wires.part.receptor.name}'"
            raise ModelError(f"{what}: {BY_SIGN}", hint=ELSEWHERE)
        wires.weights = wires.given(weights).copy()
        self._write(wires, "weight", wires.each(wires.part.arriving(wires.weights)))

    def _write(self, wires: NestProjection, word: str, values: Floats) -> None:
        with nest_errors():
            wires.write(self._nest, self.net.ends(wires), word, values)

    def _check_shown(self, population: int, name: str) -> None:
        part = self.program.populations[population]
        if name in UNREADABLE:
            raise ModelError(
                f"{name} of '{part.name}': NEST neither shows nor sets it between steps",
                hint="backend 'event' has the same network and shows it",
            )

    def _check_changeable(self, wires: NestProjection, what: str) -> None:
        """A change acts from the next step on, on synapses that are up to date."""
        if wires.part.synapse.modulated:
            self._check_moment(wires, f"{what} of '{wires.part.name}'")
        elif self.step:
            raise ModelError(
                f"{what} of '{wires.part.name}' cannot change once it runs: NEST's stdp_synapse would apply them to "
                "post spikes from before, too",
                hint="change them at time 0, or use backend 'event'",
            )

    def _check_moment(self, wires: NestProjection, what: str) -> None:
        grid = self.net.grid(wires)
        if self.step % grid:
            ms = self.net.clock.ms
            raise ModelError(
                f"{what} at {ms(self.step):g} ms: NEST brings synapses under dopamine up to date every {ms(grid):g} ms "
                "(deliver_interval x the smallest delay): expected a multiple of it",
                hint=f"run to {ms(self.step - self.step % grid + grid):g} ms",
            )

    def spikes(self, population: int, since: int) -> Spikes:
        """Recorded spikes after a step."""
        return self.net.records[population].since(since)

    def forget(self, before: int) -> None:
        """Drop recorded spikes up to a step."""
        for record in self.net.records:
            record.forget(before)

    def counts(self) -> EngineCounts:
        """Counts since the start or the last reset."""
        records = self.net.records
        stepped = np.array([p.kind == "neuron" for p in self.program.populations])
        active = self.program.share.total(self.net.activity.active) * stepped
        for target in {p.target for p in self.program.projections if p.undrawn is not None}:
            active[target] = self.program.populations[target].size * self.step  # arrivals are known to NEST alone
        return EngineCounts(
            steps=self.step,
            events=tuple(record.events.copy() for record in records),
            spikes=tuple(record.spikes.copy() for record in records),
            active=active,
            trial_updates=np.zeros(len(self.program.projections), dtype=np.int64),
        )

    def memory(self) -> dict[str, int]:
        """Bytes of NEST's whole process, and of the recorded spikes."""
        return {
            "process of NEST": int(self._nest.memory_size) * 1024,
            "spikes": sum(record.nbytes for record in self.net.records),
        }

    def reset(self, weights: bool) -> None:
        """Back to step 0: NEST is built anew."""
        first = [p.weight for p in self.program.projections]
        kept = [*first]
        for wires in self._listed:
            kept[wires.index] = wires.given(self.get_synapses(wires.index, "weight"))
        with nest_errors():
            self._nest.ResetKernel()
        self.net = self._build([c.parameters for c in self.net.cells], first if weights else kept, self.net.rules)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Refused: NEST cannot write its state."""
        raise ModelError(
            "backend 'nest' cannot save: NEST has no way to write or read its state",
            hint="backend 'event' saves and restores; sim.network() keeps what was learnt",
        )

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Refused, as `snapshot`."""
        self.snapshot()

    def present(self, trial: Trial) -> Outcome:
        """Never called: networks with trials are refused."""
        raise NotImplementedError

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Never called, as `present`."""
        raise NotImplementedError

    def encourage(self, projection: int, maps: Ints) -> None:
        """Never called, as `present`."""
        raise NotImplementedError
