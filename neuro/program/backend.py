"""Interface of a backend. A backend, registered as `neuro.backends`, turns a `Program` into an engine."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError, Where, unknown
from neuro.core.registry import Registry
from neuro.model.neurons import CurrentGenerator, Model
from neuro.model.synapses import Synapse
from neuro.program.program import Floats, Ints, Program, Share


class OverflowWarning(UserWarning):
    """Warning: a register of an emulated chip overflowed. Further results are the chip's, not the network's.

    Attributes:
        what: overflows, such as "input wraps of hidden".
        hint: way to avoid the overflow.
    """

    def __init__(self, message: str, what: str = "", hint: str = "") -> None:
        super().__init__(message)
        self.what, self.hint = what, hint


@dataclass(frozen=True, slots=True)
class Problem:
    """A part of a network that a backend cannot run as described.

    Attributes:
        refused: True if the part cannot run at all, False if it is approximated.
        what: the part and the property, e.g. "population 'exc': 1500 neurons".
        why: the limit, and the substitute if the part is approximated.
        way_out: hint for the author of the network.
        origin: the place in the description.
    """

    refused: bool
    what: str
    why: str
    way_out: str = ""
    origin: Where | None = None

    def error(self) -> ModelError:
        """Return the problem as an error, for `ModelError.others` of a refused network."""
        return ModelError(f"{self.what}: {self.why}", where=self.origin, hint=self.way_out)


@dataclass(frozen=True, slots=True, eq=False)
class Spikes:
    """Spikes of one population, by step, then id. A multiplicity above 1 stands for several spikes in one step.

    Spikes of a graded population have a multiplicity of 1 and a payload each.
    """

    steps: Ints
    ids: Ints
    multiplicity: Ints
    payloads: NDArray[np.int32] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Sent:
    """Values of a synaptic state after presynaptic spikes, as sent with them, sorted by step.

    Attributes:
        steps: steps of the emission.
        synapses: indices of the synapses in the order of the program's weights.
        values: values of the state.
    """

    steps: Ints
    synapses: Ints
    values: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One presentation of an input."""

    ticks: Ints
    ids: Ints
    silenced: NDArray[np.bool_]
    peaks: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Wins:
    """The neurons that won in a trial, in order, and the tick of each win."""

    neurons: Ints
    ticks: Ints


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """The result of a trial.

    Attributes:
        winner: the deciding neuron, the first of several, or -1.
        tick: the tick of the decision, or -1.
        potential: largest V_m of each map at the decision, shape (maps,), before the reset. With several winners, it is
            V_m at the first win of the map; without a decision, V_m at the end.
        best: the neuron of each map with this V_m, shape (maps,).
        ticks: number of ticks that ran.
        peak: if requested, the largest V_m of each output neuron up to the decision, shape (neurons,); infinite for the
            winner.
        peak_tick: the first tick at which V_m had this value; for the winner the tick of the decision.
        wins: all winners, if several neurons may win.
    """

    winner: int
    tick: int
    potential: Floats
    best: Ints
    ticks: int
    peak: Floats | None = None
    peak_tick: Ints | None = None
    wins: Wins | None = None


@dataclass(frozen=True, slots=True, eq=False)
class EngineCounts:
    """Raw counts since the start.

    Attributes:
        steps: number of steps.
        events: spike events of each population (a multiplicity counts once), per neuron.
        spikes: spikes of each population with their multiplicity, per neuron; of a graded population its messages.
        active: neuron-steps of each population with an arrival or a spike.
        trial_updates: weights changed at the end of trials, per projection.
        native: counts of this backend only, by name, e.g. the overflows of a chip.
    """

    steps: int
    events: tuple[Ints, ...]
    spikes: tuple[Ints, ...]
    active: Ints
    trial_updates: Ints
    native: Mapping[str, int] = field(default_factory=dict)


class Engine(Protocol):
    """A program in execution. Times are steps; populations and projections are indices."""

    @property
    def step(self) -> int:
        """The last finished step."""

    def run(self, steps: int) -> None:
        """Advance by a number of steps."""

    def present(self, trial: Trial) -> Outcome:
        """Run one trial: drop spikes in flight, reset, present, decide. Advance the clock by the ticks of the trial.

        With `anew` in the program's trials, everything except the weights is first reset to step 0.
        """

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Apply the rule's `teach` to the inputs of a neuron, at a tick of the trial just presented.

        An input is taught by its first spike; with `spikes` "each", by all its spikes in turn.
        """

    def encourage(self, projection: int, maps: Ints) -> None:
        """Apply the rule's `encourage` to every weight of the given maps, once per shared weight."""

    def inject(self, population: int, steps: Ints, ids: Ints, payloads: Ints | None = None) -> None:
        """Add spikes of a listed population at steps after the present one, with payloads for a graded population."""

    def signal(self, signal: int, values: Floats) -> None:
        """Set the dopamine concentration of all synapses that a signal modulates, one value per target neuron."""

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        """Return a copy of a state or parameter of all neurons, or of the neurons ``ids``, in this order."""

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Change states and parameters from the next step on, either all of them or none.

        Each value has the shape (1,) or (size,). A `ModelError` names the values that the engine cannot hold.
        """

    def get_synapses(self, projection: int, name: str) -> Floats:
        """Return a state of every synapse, in the order of the program's weights.

        The name is "weight" (as stored, like NEST's), a state of the model such as "c", "K_plus" of the source neuron,
        or "n" of the target neuron.
        """

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Change all parameters of a synapse model, in the order of `Synapse.vector`.

        Shape (parameters,), or (synapses, parameters) for a rule with a value per synapse, see `Synapse.per_synapse`.
        """

    def set_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights, or only the chosen ones.

        Other entries of `weights` are the values of the last read, and must not change.
        """

    def spikes(self, population: int, since: int) -> Spikes:
        """Return the recorded spikes with step > since."""

    def forget(self, before: int) -> None:
        """Drop recorded spikes with step <= before."""

    def counts(self) -> EngineCounts:
        """Return the counts since the start or the last reset."""

    def memory(self) -> dict[str, int]:
        """Return the bytes in use by content, e.g. {"synapses": ..., "neurons": ...}."""

    def reset(self, weights: bool) -> None:
        """Return to step 0 and the initial states, and to the initial weights if `weights` is true."""

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return all arrays that `restore` needs to continue bit for bit."""

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot of the same program."""


class Backend(Protocol):
    """Base of the backends, which run programs.

    A backend that computes in integers has `arithmetic = "integer"`; the default is "float".
    A backend that cannot run some cases of `neuro.testing` lists them, with reasons, in an attribute
    `unsupported: dict[str, str]`. A backend that cannot read some states of neurons names them in an attribute
    `unreadable: frozenset[str]`, which its engine has, too.

    Optional protocols are `Distributed` (several processes run a network under mpirun), `Family` (many targets, such as
    chips) and `Draws` (the backend draws synapses).
    """

    name: str
    description: str

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """Return the parts of the program that are refused or approximated, for the options of `build`."""

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> Engine:
        """Return an engine at step 0."""


@runtime_checkable
class Distributed(Protocol):
    """A backend that can run one network in several processes, started by mpirun."""

    def share(self) -> Share:
        """Return this process's share of a network. Methods of the share exchange values with other processes.

        Raises:
            ModelError: the processes cannot work together.
        """


@runtime_checkable
class Draws(Protocol):
    """A backend with its own connection rules, for synapses with `draw: backend`."""

    draws_synapses: bool
    """Always true; the attribute marks the protocol."""


@runtime_checkable
class Family(Protocol):
    """A backend with many targets, such as all chips of one arithmetic.

    The name of the backend is a target, too.
    """

    def of(self, target: str) -> Backend | None:
        """Return the backend of a target, given by name or file; None if the target is of another family.

        Raises:
            ModelError: no family runs that target, or its file cannot be read.
        """

    def targets(self) -> Iterable[str]:
        """Return the names of the targets that `of` accepts."""


@runtime_checkable
class Replays(Protocol):
    """A backend that can be compared with single calls of a chip's programs, in addition to whole networks."""

    def replay(self, case: Mapping[str, Any], events: NDArray[Any]) -> Mapping[str, NDArray[Any]]:
        """Return the states after every event of a case, by name. For cases see `neuro.testing.chip_traces`.

        Raises:
            ModelError: the chip has no such programs.
        """


@runtime_checkable
class Registers(Protocol):
    """An engine whose neurons and synapses have registers that can be read."""

    def registers(self, population: int, name: str) -> Ints:
        """Return a register of every neuron. `name` is the register, or the state or parameter stored there."""

    def synapse_registers(self, projection: int, name: str) -> Ints:
        """Return a register of every synapse, in the order of the program's weights."""


@runtime_checkable
class SettableSynapses(Protocol):
    """An engine in which the synaptic states of rules that learn by moves can be set."""

    def set_synapses(self, projection: int, name: str, values: Floats) -> None:
        """Set a state of every synapse, in the order of the program's weights."""


@runtime_checkable
class Notes(Protocol):
    """An engine that records synaptic states after presynaptic spikes, for rules that learn from spike pairs."""

    def noted(self, probe: int) -> Sent:
        """Return the records of synapse probe number `probe` since the last call."""


@runtime_checkable
class Samples(Protocol):
    """An engine that samples states of neurons during a run, in the steps of a probe."""

    @property
    def samples(self) -> Collection[int]:
        """Indices of the program's `probes` that the engine samples."""

    def sampled(self, probe: int) -> tuple[Ints, Floats]:
        """Return steps and values, shape (steps, neurons), of one probe since the last call."""


@runtime_checkable
class Fired(Protocol):
    """An engine that can count the spikes of one population without computing all other counts."""

    def fired(self, population: int) -> Ints:
        """Return a copy of the spike counts per neuron since the start or the last reset, with multiplicity."""


def counter(engine: Engine) -> Callable[[int], Ints]:
    """Return a function that counts the spikes of each neuron of a population."""
    return engine.fired if isinstance(engine, Fired) else lambda population: engine.counts().spikes[population]


def unnoted(program: Program) -> list[Problem]:
    """Return the problems of a backend with an engine that cannot record synapses at presynaptic spikes (`Notes`)."""
    return [
        Problem(
            True,
            f"probe '{probe.name}': {probe.record} at pre spikes",
            "learning weights can be read between steps only",
            "record it at intervals, with 'every', or run it on backend 'event'",
            probe.origin,
        )
        for probe in program.synapse_probes
        if not probe.every and program.projections[probe.projection].synapse.learns == "pairs"
    ]


def unreadable(owner: Backend | Engine) -> frozenset[str]:
    """Return the names of the states of neurons that a backend or its engine cannot read."""
    names: frozenset[str] = getattr(owner, "unreadable", frozenset())
    return names


def are_finite(engine: Engine, population: int, states: Sequence[str]) -> bool:
    """Return whether states of a linear model are finite, neither NaN nor infinite, in all neurons of a population.

    An engine whose neurons sleep may define its own `are_finite` without an update of sleeping neurons: a value that is
    finite when a linear neuron falls asleep stays finite.
    """
    engine_check: Callable[[int, Sequence[str]], bool] | None = getattr(engine, "are_finite", None)
    if engine_check is not None:
        return engine_check(population, states)
    return all(bool(np.isfinite(engine.get(population, name)).all()) for name in states)


def floats_only(program: Program) -> list[Problem]:
    """Return the problems of a float backend: models and rules defined in registers of a chip."""
    parts: list[tuple[str, Model | Synapse, Where | None]] = [
        (f"population '{p.name}'", p.model, p.origin) for p in program.populations if p.model.chip
    ]
    parts += [(f"projection '{p.name}'", p.synapse, p.origin) for p in program.projections if p.synapse.chip]
    return [
        Problem(
            True,
            f"{label}: {choice.name}",
            f"it is in the registers or programs of {choice.chip}",
            f"backend '{choice.chip}' runs it",
            origin,
        )
        for label, choice, origin in parts
    ]


SAVE_FROZEN = "neuro run FILE --save-frozen learnt.yaml writes the learnt weights as static synapses"
"""Hint for a backend that cannot learn."""

TAKE_PAYLOADS = "run it on event, reference, torch or loihi2"
"""Hint for a backend whose spikes carry no payloads."""


def ungraded(program: Program) -> list[Problem]:
    """Return the problems of a backend without payloads of spikes."""
    return [
        Problem(
            True,
            f"population '{part.name}': {part.model.name}",
            "its spikes carry payloads, and this backend has none",
            TAKE_PAYLOADS,
            part.origin,
        )
        for part in program.populations
        if part.model.graded
    ]


def own_generators(program: Program) -> list[Problem]:
    """Return the problems of a backend with a host that sends listed and Poisson spikes and steps currents."""
    emitting = "only poisson_generator, inhomogeneous_poisson_generator and spike_generator emit spikes here"
    inject = "run it on backend 'event', or inject its spikes of that run into a spike_generator"
    varying = "its current changes at every step, and the host writes a current only when it changes"
    problems = []
    for part in program.populations:
        message = f"population '{part.name}': {part.model.name}"
        if part.kind == "generator":
            problems.append(Problem(True, message, emitting, inject, part.origin))
        elif isinstance(part.model, CurrentGenerator) and part.model.varies:
            steps = "list its values in a step_current_generator, or run it on backend 'event'"
            problems.append(Problem(True, message, varying, steps, part.origin))
    for projection in program.projections:
        if projection.carries == "current" and projection.receptor is not None:
            message = f"projection '{projection.name}': a current to receptor '{projection.receptor.name}'"
            way_out = "leave the receptor out: the current then acts on V_m directly"
            problems.append(
                Problem(True, message, "the host writes currents into the bias", way_out, projection.origin)
            )
    return problems


BACKENDS: Registry[Backend] = Registry(
    "backend",
    (),
    takes=lambda part: all(hasattr(part, word) for word in ("name", "problems", "build")),
    group="neuro.backends",
    name=lambda backend: backend.name,
)
"""All backends by name."""


def installed() -> dict[str, Backend]:
    """Import all backends and return them by name."""
    return dict(sorted(BACKENDS.items()))


def find_backend(name: str | PathLike[str]) -> Backend:
    """Return the backend with a name, or the backend of a `Family` for a target, given by name or file.

    Raises:
        ModelError: no backend or target has that name, or the file does not describe a target.
    """
    text = str(name)
    if text in BACKENDS:
        return BACKENDS[text]
    families = [backend for backend in installed().values() if isinstance(backend, Family)]
    for family in families:
        if (member := family.of(text)) is not None:
            return member
    names = dict.fromkeys((*BACKENDS, *(target for family in families for target in family.targets())))
    raise unknown("backend", text, names)
