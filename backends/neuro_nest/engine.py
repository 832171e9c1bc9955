"""The engine of NEST, which reads and writes values between NEST's runs."""

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

_NEST_NAMES = {"K_plus": "Kplus"}


class NestEngine:
    """A program that runs in NEST; `neuro.program.backend.Engine` documents each method.

    Args:
        program: a network that the backend does not refuse.
        threads: number of NEST's threads.
    """

    unreadable = UNREADABLE

    def __init__(self, program: Program, threads: int) -> None:
        self.program, self._threads = program, threads
        self._nest = kernel.lend(self, program.name)
        self.net = self._build(
            [{name: v.copy() for name, v in p.parameters.items()} for p in program.populations],
            [p.weight for p in program.projections],
            [p.synapse.vector() for p in program.projections],
        )

    def _build(self, parameters: list[dict[str, Floats]], weights: list[Floats], rules: list[Floats]) -> NestNetwork:
        return NestNetwork(self.program, self._nest, self._threads, parameters, weights, rules)

    @property
    def _with_synapses(self) -> list[NestProjection]:
        """The projections whose synapses the program has, without those that NEST draws."""
        return [synapses for synapses in self.net.synapses if isinstance(synapses, NestProjection)]

    def _synapses(self, projection: int) -> NestProjection:
        self.program.refuse_undrawn(projection)
        synapses = self.net.synapses[projection]
        assert isinstance(synapses, NestProjection)
        return synapses

    @property
    def step(self) -> int:
        """The last finished step."""
        return self.net.step

    def run(self, steps: int) -> None:
        """Advance by some steps."""
        self.net.run(steps)

    def inject(self, population: int, steps: Ints, ids: Ints) -> None:
        """Add spikes of a spike_generator."""
        self.net.sources[population].inject(steps, ids, self.step)

    def signal(self, signal: int, values: Floats) -> None:
        """Set the dopamine concentration of all synapses with this signal."""
        for synapses in self._with_synapses:
            if synapses.part.signal == signal:
                self._check_moment(synapses, f"signal '{self.program.signals[signal].name}'")
                self._write(synapses, "n", values[synapses.target])

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        """Return a state or parameter of every neuron, or of some."""
        self._check_shown(population, name)
        with nest_errors():
            return self.net.cells[population].get(name, ids)

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Set states and parameters."""
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
        """Return a state of every synapse."""
        synapses = self._synapses(projection)
        if not synapses.part.synapse.learns:
            if synapses.part.share.number == 1:
                return np.broadcast_to(synapses.weights, synapses.part.size).copy()
            # A single weight may be shared by all synapses, or belong to the only synapse of this process. Both are
            # broadcast to the synapses of this process.
            return synapses.all_values(np.broadcast_to(synapses.weights, synapses.source.size))
        if synapses.part.synapse.modulated:
            self._check_moment(synapses, f"'{name}' of '{synapses.part.name}'")
        with nest_errors():
            values = synapses.read(self._nest, self.net.ends(synapses), _NEST_NAMES.get(name, name))
        if name == "K_plus" and not synapses.part.synapse.modulated:
            # NEST's stdp_synapse stores K+ as of the last pre spike.
            elapsed = self.step - self.net.records[synapses.part.source].sent[synapses.source]
            values = values * np.exp(
                -elapsed * self.program.resolution / self.net.synapse_parameters(synapses)["tau_plus"]
            )
        return synapses.all_values(values)

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Set the parameters of a projection's synapse model."""
        synapses = self._synapses(projection)
        self._check_changeable(synapses, "the numbers")
        numbers = parameters if parameters.ndim == 1 else synapses.own_values(parameters)
        self.net.rules[projection] = numbers.copy()
        nest_parameters = self.net.synapse_parameters(synapses)
        synapses.invalidate()
        with nest_errors():
            if synapses.part.synapse.modulated or synapses.part.synapse.name in SHARED:
                for name in synapses.models():
                    self._nest.SetDefaults(name, nest_parameters)
            else:
                for name, value in nest_parameters.items():
                    synapses.write(
                        self._nest, self.net.ends(synapses), name, np.broadcast_to(value, len(synapses.source))
                    )

    def set_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights. `chosen` is not needed, because `weights` holds NEST's own values for the others."""
        synapses = self._synapses(projection)
        if synapses.part.synapse.learns:
            self._check_changeable(synapses, "the weights")
        elif synapses.part.carries == "spikes" and not synapses.part.as_by_sign(weights):
            assert synapses.part.receptor is not None
            label = f"weights of '{synapses.part.name}' onto receptor '{synapses.part.receptor.name}'"
            raise ModelError(f"{label}: {BY_SIGN}", hint=ELSEWHERE)
        synapses.weights = synapses.own_values(weights).copy()
        self._write(synapses, "weight", synapses.per_synapse(synapses.part.arriving(synapses.weights)))

    def _write(self, synapses: NestProjection, name: str, values: Floats) -> None:
        with nest_errors():
            synapses.write(self._nest, self.net.ends(synapses), name, values)

    def _check_shown(self, population: int, name: str) -> None:
        part = self.program.populations[population]
        if name in UNREADABLE:
            raise ModelError(
                f"{name} of '{part.name}': NEST neither shows nor sets it between steps",
                hint="backend 'event' has the same network and shows it",
            )

    def _check_changeable(self, synapses: NestProjection, subject: str) -> None:
        """Raise an error if NEST would apply a change to earlier spikes, too."""
        if synapses.part.synapse.modulated:
            self._check_moment(synapses, f"{subject} of '{synapses.part.name}'")
        elif self.step:
            raise ModelError(
                f"{subject} of '{synapses.part.name}' cannot change once it runs: NEST's stdp_synapse would apply them "
                "to earlier post spikes, too",
                hint="change them at time 0, or use backend 'event'",
            )

    def _check_moment(self, synapses: NestProjection, subject: str) -> None:
        """Raise an error unless NEST updates the synapses at the present step."""
        interval = self.net.grid(synapses)
        if self.step % interval:
            ms = self.net.clock.ms
            raise ModelError(
                f"{subject} at {ms(self.step):g} ms: NEST updates synapses with dopamine every {ms(interval):g} ms "
                "(deliver_interval x the smallest delay): expected a multiple of this interval",
                hint=f"run to {ms(self.step - self.step % interval + interval):g} ms",
            )

    def spikes(self, population: int, since: int) -> Spikes:
        """Return the recorded spikes after a step."""
        return self.net.records[population].since(since)

    def forget(self, before: int) -> None:
        """Drop recorded spikes up to a step."""
        for record in self.net.records:
            record.forget(before)

    def counts(self) -> EngineCounts:
        """Return the counts since the start or the last reset."""
        records = self.net.records
        stepped = np.array([p.kind == "neuron" for p in self.program.populations])
        active = self.program.share.total(self.net.activity.active) * stepped
        for target in {p.target for p in self.program.projections if p.undrawn is not None}:
            active[target] = self.program.populations[target].size * self.step  # only NEST knows the arrivals
        return EngineCounts(
            steps=self.step,
            events=tuple(record.events.copy() for record in records),
            spikes=tuple(record.spikes.copy() for record in records),
            active=active,
            trial_updates=np.zeros(len(self.program.projections), dtype=np.int64),
        )

    def memory(self) -> dict[str, int]:
        """Return the bytes of the whole process of NEST, and of the recorded spikes."""
        return {
            "process of NEST": int(self._nest.memory_size) * 1024,
            "spikes": sum(record.nbytes for record in self.net.records),
        }

    def reset(self, weights: bool) -> None:
        """Return to step 0. The network is built again in NEST."""
        first_weights = [p.weight for p in self.program.projections]
        weights_before = [*first_weights]
        for synapses in self._with_synapses:
            weights_before[synapses.index] = synapses.own_values(self.get_synapses(synapses.index, "weight"))
        with nest_errors():
            self._nest.ResetKernel()
        self.net = self._build(
            [c.parameters for c in self.net.cells], first_weights if weights else weights_before, self.net.rules
        )

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Raise an error, because NEST cannot save its state."""
        raise ModelError(
            "backend 'nest' cannot save: NEST has no way to write or read its state",
            hint="backend 'event' saves and restores; sim.network() keeps what was learnt",
        )

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Raise an error, because NEST cannot restore a state."""
        self.snapshot()

    def present(self, trial: Trial) -> Outcome:
        """Not implemented, because networks with trials are refused."""
        raise NotImplementedError

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Not implemented, because networks with trials are refused."""
        raise NotImplementedError

    def encourage(self, projection: int, maps: Ints) -> None:
        """Not implemented, because networks with trials are refused."""
        raise NotImplementedError
