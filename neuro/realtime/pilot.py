"""The acting and learning part of a closed loop: a network with a world, or an object with the same methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from neuro.chips.hosting import HostWork
from neuro.coding.work import Work
from neuro.coding.world import Act, Infos, Moment, Shown, Taught, Teacher
from neuro.core.errors import ModelError, unknown
from neuro.model.network import Network
from neuro.program.program import Population, Program
from neuro.realtime.environments import Environments
from neuro.realtime.episodes import Floats
from neuro.run.compiled import compile as compiled
from neuro.run.copies import Copies
from neuro.run.stepper import Stepper


def block_seed(seed: int, block: int) -> int:
    """Return the seed of the network's draws in a block."""
    return int(np.random.SeedSequence([seed, block, 1]).generate_state(1)[0])


_TAKES = {"spikes": ("listed", "a spike_generator"), "rates": ("poisson", "a poisson_generator")}
"""Kind of population for the output of an encoder, and the name of its model in messages."""


class Pilot(Protocol):
    """Base of the acting and learning part of a loop: a network, or another object for comparison."""

    def begin(self, copies: int, block: int) -> None:
        """Begin a block with a number of copies, and with the learnt state."""

    def act(self, observations: Floats, infos: Infos) -> npt.NDArray[Any]:
        """Return the action for each observation, (copies, dimensions)."""

    def explored(self, observations: Floats, rewards: Sequence[float], returns: Sequence[float]) -> None:
        """Receive the observations, rewards and returns of random moves."""

    def teach(self, moment: Moment) -> None:
        """Learn from a control step."""

    def merge(self) -> None:
        """Add up the changes of all copies since the last call, and give all copies the sum."""

    def arrays(self) -> dict[str, Any]:
        """Return the learnt state, for a checkpoint."""

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Restore the state that `arrays` returned."""


class NetworkPilot:
    """The network of a description with a `world`, as the pilot of a loop.

    Args:
        net: the network.
        environments: environments of the loop; the encoders and the decoder are made for their spaces.
        backend: name of the backend, or the backend itself.
        seed: seed of all random numbers.
        learns: whether to set signals; without signals no weight changes.
        record: whether to record spikes and traces of the present block.
        options: options of the backend.

    Attributes:
        copies: copies of the network in execution.
        encoders: encoders in use, by population.
        taught: teachers in use, by signal; empty if the network does not learn.
        counts: number of spikes of the last control step by population, (copies, neurons).
    """

    def __init__(
        self,
        net: Network,
        environments: Environments,
        *,
        backend: Any,
        seed: int,
        learns: bool = True,
        record: bool = False,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        world = net.world_section
        assert world is not None
        self.net, self._world, self._learns, self._record = net, world, learns, record
        self._backend, self._seed, self._options = backend, seed, dict(options or {})
        self._environments = environments
        self.copies = self._compile(environments.n, 0)
        self._block = 0  # block of the present copies
        program = self.copies.program
        self.encoders = self._encoders(program)
        self._act, self._read = self._decoder(program)
        self._n_receivers: dict[str, int] = {}  # number of neurons that receive each signal
        self.taught = self._teachers(program) if learns else {}
        self._pass_host_work()
        self._plastic = [p.name for p in program.projections if p.synapse.learns] if learns else []
        self._moves = [p.name for p in program.projections if p.synapse.learns == "moves"] if learns else []
        if environments.n > 1 and len(self._moves) < len(self._plastic):
            other = next(name for name in self._plastic if name not in self._moves)
            raise ModelError(
                f"copies = {environments.n}: projection '{other}' learns from spike to spike: expected rules "
                "that learn from move to move, whose changes add up",
                hint="use copies=1",
            )

    # parts created once

    def _compile(self, copies: int, block: int) -> Copies:
        seed = block_seed(self._seed, block)
        made: Copies = compiled(self.net, backend=self._backend, seed=seed, copies=copies, **self._options)
        return made

    def _wrong(self, error: ModelError, *path: str) -> ModelError:
        return error.at(self.net.world_origin, "world").but(path=("world", *path, *error.path))

    def _part(self, program: Program, name: str, *path: str) -> int:
        names = [part.name for part in program.populations]
        if name not in names:
            raise self._wrong(unknown("population", name, names), *path)
        return names.index(name)

    def _encoders(self, program: Program) -> dict[str, Shown]:
        encoders = {}
        for name, encoder in self._world.observe.items():
            part = program.populations[self._part(program, name, "observe", name)]
            kind, expected = _TAKES[encoder.gives]
            if part.kind != kind:
                output = f"{encoder.name} gives {encoder.gives}"
                message = f"population '{name}' is {part.model_name}: {output}: expected {expected}"
                raise self._wrong(ModelError(message), "observe", name)
            observations = self._environments.observations
            try:
                in_use = encoder.made(observations, part.shape)
            except ModelError as error:
                raise self._wrong(error, "observe", name, encoder.name) from None
            if in_use.size and in_use.size != part.size:
                needs = f"{encoder.name} of {observations} needs {in_use.size:,}"
                message = f"population '{name}' has {part.size:,} neurons: {needs}"
                raise self._wrong(ModelError(message, hint=f"shape: {in_use.size}"), "observe", name)
            encoders[name] = in_use
        return encoders

    def _decoder(self, program: Program) -> tuple[Act, list[str]]:
        decoder = self._world.act
        read_parts = [program.populations[self._part(program, name, "act")] for name in decoder.of]
        step = self._world.step
        refractory = [part.parameters["t_ref"].max() if "t_ref" in part.parameters else 0.0 for part in read_parts]
        most_spikes = [max(1.0, step / max(float(t_ref), program.resolution)) for t_ref in refractory]
        try:
            act = decoder.made(self._environments.actions, [part.size for part in read_parts], most_spikes)
        except ModelError as error:
            raise self._wrong(error, "act", decoder.name) from None
        return act, [part.name for part in read_parts]

    def _teachers(self, program: Program) -> dict[str, Taught]:
        teachers = {}
        self._choosers: dict[str, str] = {}  # population of each signal whose values depend on the chosen action
        signals = {signal.name: signal for signal in program.signals}
        for name, teacher in (self._world.reward or {}).items():
            if name not in signals:
                raise self._wrong(unknown("signal", name, signals), "reward", name)
            critic = getattr(teacher, "critic", None)
            neurons = 0 if critic is None else program.populations[self._part(program, critic, "reward", name)].size
            other = getattr(teacher, "as_", None)
            if other is not None and (other not in self._world.reward or hasattr(self._world.reward[other], "as_")):
                names = [key for key in self._world.reward if not hasattr(self._world.reward[key], "as_")]
                raise self._wrong(unknown("signal with its own value", other, names), "reward", name)
            heard_by = program.populations[signals[name].target]
            self._n_receivers[name] = heard_by.size
            if teacher.others != 1.0:
                self._check_chooses(heard_by, name, teacher)
                self._choosers[name] = heard_by.name
            teachers[name] = teacher.made(neurons)
            try:
                teachers[name].join(self.encoders)
            except ModelError as error:
                raise self._wrong(error, "reward", name, teacher.name) from None
        # A teacher that uses another teacher's value comes after that teacher.
        return dict(sorted(teachers.items(), key=lambda item: hasattr(self._world.reward[item[0]], "as_")))

    def _check_chooses(self, heard_by: Population, signal: str, teacher: Teacher) -> None:
        silence = {heard_by.name: np.zeros((1, heard_by.size), dtype=np.int64)}
        try:
            self._world.act.chosen(silence, heard_by.name)
        except ModelError as error:
            raise self._wrong(error, "reward", signal, teacher.name, "others") from None

    @property
    def host_work(self) -> list[HostWork]:
        """Work of the host for one copy in a control step: encoders, decoder and teachers."""
        program, world = self.copies.program, self._world
        parts, ticks = {part.name: part for part in program.populations}, round(world.step / program.resolution)
        works: list[tuple[str, Work | None]] = [
            (f"{world.observe[name].name} of {name}", encoder.work(ticks, parts[name].shape))
            for name, encoder in self.encoders.items()
        ]
        sizes = [parts[name].size for name in self._read]
        works.append((f"{world.act.name} of {', '.join(self._read)}", world.act.work(sizes)))
        for name, taught in self.taught.items():
            teacher, work = world.reward[name], taught.work()
            total = None if work is None else work + teacher.spread_work(self._n_receivers[name], taught.several)
            works.append((f"{teacher.name} of {name}", total))
        return [HostWork(name, work, steps=ticks) for name, work in works]

    def _pass_host_work(self) -> None:
        """Pass the work of the host to the simulations of all copies, for their bills."""
        for sim in self.copies:
            signals = [] if sim._signals is None else sim._signals.host_work()
            sim.host_work[:] = [*signals, *self.host_work]

    # a block

    def begin(self, copies: int, block: int) -> None:
        """Begin a block: the network at time 0, with the learnt state."""
        if self._block == block:
            self.copies.reset()
        else:
            weights = self.weights
            self.copies, self._block = self._compile(copies, block), block
            self._pass_host_work()
            self._set_weights(weights)
        outputs = {name: self._world.observe[name].gives for name in self.encoders}
        spiking = [name for name in outputs if outputs[name] == "spikes"]
        teachers = {name: self._world.reward[name] for name in self.taught}
        self._signals = {
            name: (teacher, getattr(teacher, "as_", None), self.copies.port(name), self._n_receivers[name])
            for name, teacher in teachers.items()
        }
        critics = [teacher.critic for teacher in teachers.values() if hasattr(teacher, "critic")]
        self._counted = list(dict.fromkeys([*self._read, *critics]))
        advance = partial(self.copies._advance, forget=not self._record)
        self._stepper = Stepper(self.copies._joined, self._world.step, spiking, self._counted, advance)
        self._rates = {name: self.copies.port(name, "rate") for name in outputs if outputs[name] == "rates"}
        self._rng = np.random.default_rng([block_seed(self._seed, block), 2])
        self._chosen: dict[str, npt.NDArray[np.bool_]] = {}
        for taught in self.taught.values():
            taught.begin(copies)
        self._before = {name: self.copies[0].weights(name)[2].ravel() for name in self._moves} if copies > 1 else {}

    def act(self, observations: Floats, infos: Infos) -> npt.NDArray[Any]:
        """Show the observations, run a control step, and return the actions."""
        lists = []
        for name, encoder in self.encoders.items():
            encoder.rewarded(self._environments.rewards)
            if name in self._rates:
                self._rates[name].set(encoder.rates(observations))
            else:
                lists.append(encoder.spikes(observations, infos, self._stepper.ticks, self._rng))
        counts = self._stepper.step(*lists)
        self.counts = dict(zip(self._counted, counts, strict=True))
        return self._act(self.counts)

    def explored(self, observations: Floats, rewards: Sequence[float], returns: Sequence[float]) -> None:
        """Learn the ranges of observations and the scale of rewards from random moves."""
        for encoder in self.encoders.values():
            encoder.learn(observations)
        for taught in self.taught.values():
            taught.explored(rewards, returns)

    def teach(self, moment: Moment) -> None:
        """Set all signals for the next control step."""
        if not self.taught:
            return
        raw: dict[str, Floats] = {}
        chosen = {name: self._world.act.chosen(self.counts, voters) for name, voters in self._choosers.items()}
        for name, taught in self.taught.items():
            teacher, source_signal, port, size = self._signals[name]
            raw[name] = taught.values(moment) if source_signal is None else taught.of(raw[source_signal])
            values = teacher.spread(raw[name], size, moment.time)
            if name in chosen:
                delayed = (teacher if source_signal is None else self._signals[source_signal][0]).delayed
                voted = self._chosen.get(name, chosen[name]) if delayed else chosen[name]
                values = values * np.where(voted, 1.0, teacher.others)
            port.set(values)
        self._chosen = chosen
        if np.count_nonzero(moment.last):
            for name in self._moves:
                self.copies.clear(name, moment.last)
        for name, taught in self.taught.items():
            share = taught.share(moment)
            if share < 1.0:
                self._shrink(self._world.reward[name].critic, share)  # only a critic has a share

    def _shrink(self, critic: str, share: float) -> None:
        """Multiply the weights onto a critic by `share`."""
        self.merge()
        for part in self.copies.program.projections:
            if self.copies.program.populations[part.target].name == critic and part.name in self._plastic:
                for sim in self.copies:
                    sim.set_weights(part.name, share * sim.get(part.name, "weight"))
        self._before = {name: self.copies[0].get(name, "weight") for name in self._before}

    def merge(self) -> None:
        """Add up the changes of all copies since the last call, and give all copies the sum."""
        self._before = {name: self.copies.merge(name, before) for name, before in self._before.items()}

    @property
    def weights(self) -> dict[str, Any]:
        """Weights of all projections that learn, by name, in the form of `Simulation.set_weights`."""
        return {name: self.copies[0].get(name, "weight") for name in self._plastic}

    def _set_weights(self, weights: Mapping[str, Any]) -> None:
        for sim in self.copies:
            for name, values in weights.items():
                sim.set_weights(name, values)

    def arrays(self) -> dict[str, Any]:
        """Return the learnt state, for a checkpoint."""
        made: dict[str, Any] = {"learnt": self.weights}
        made |= {f"encoder.{name}": encoder.arrays() for name, encoder in self.encoders.items()}
        return made | {f"teacher.{name}": taught.arrays() for name, taught in self.taught.items()}

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Restore the state that `arrays` returned."""
        self._set_weights(arrays["learnt"])
        for name, encoder in self.encoders.items():
            encoder.put(arrays.get(f"encoder.{name}", {}))
        for name, taught in self.taught.items():
            taught.put(arrays.get(f"teacher.{name}", {}))
