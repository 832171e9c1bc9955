"""What a backend is: a package that turns a `Program` into an engine, registered as `neuro.backends`."""

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
    """A register of an emulated chip overflowed while a network ran: what follows is the chip's, not the network's.

    Attributes:
        what: overflows, such as "input wraps of hidden".
        hint: what keeps it from that.
    """

    def __init__(self, message: str, what: str = "", hint: str = "") -> None:
        super().__init__(message)
        self.what, self.hint = what, hint


@dataclass(frozen=True, slots=True)
class Problem:
    """Something that a backend cannot run as described.

    Attributes:
        refused: True if it cannot run at all, False if it is approximated.
        what: the part and the property, e.g. "population 'exc': 1500 neurons".
        why: the limit, and what is done instead where it is approximated.
        way_out: what the author can do.
        origin: the place in the description.
    """

    refused: bool
    what: str
    why: str
    way_out: str = ""
    origin: Where | None = None

    def error(self) -> ModelError:
        """It as an error; `ModelError.others` of one that refuses a network are such."""
        return ModelError(f"{self.what}: {self.why}", where=self.origin, hint=self.way_out)


@dataclass(frozen=True, slots=True, eq=False)
class Spikes:
    """Spikes of one population, by step, then id. A multiplicity above 1 is several spikes in one step.

    Those of a graded population have a multiplicity of 1 and a payload each.
    """

    steps: Ints
    ids: Ints
    multiplicity: Ints
    payloads: NDArray[np.int32] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Sent:
    """A state of synapses as pre spikes have left it, and with which they are sent, by step.

    Attributes:
        steps: of the emission.
        synapses: their places in the order of the program's weights.
        values: of the state.
    """

    steps: Ints
    synapses: Ints
    values: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One presentation.

    Attributes:
        ticks, ids: input spikes, sorted by tick, then id; an input fires at most once if a rule learns.
        silenced: maps of the output that must not fire, shape (maps,), bool.
        peaks: whether the largest V_m of each neuron of the output is asked for.
    """

    ticks: Ints
    ids: Ints
    silenced: NDArray[np.bool_]
    peaks: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Wins:
    """The neurons that won in a trial, in the order in which they did, and the tick of each."""

    neurons: Ints
    ticks: Ints


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """How a trial ended.

    Attributes:
        winner: the neuron that decided, of several the first, or -1.
        tick: the tick of the decision, or -1.
        potential: largest V_m of each map at the decision, of several at its own first (before the reset), or at the
            end, shape (maps,).
        best: the neuron of each map that has it, shape (maps,).
        ticks: ticks that were run.
        peak: if asked for, the largest V_m of each neuron of the output up to the decision, shape (neurons,); infinite
            for the winner.
        peak_tick: the first tick at which it had it; for the winner the decision.
        wins: all winners, where there may be several.
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
        steps: steps run.
        events: spike events of each population (a multiplicity counts once), per neuron.
        spikes: spikes of each population with their multiplicity, per neuron; of a graded one its messages.
        active: neuron-steps of each population with an arrival or a spike.
        trial_updates: weights changed at the end of trials, per projection.
        native: what only this backend counts, by name: of a chip its overflows, say. They are not shared.
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
        """Advance."""

    def present(self, trial: Trial) -> Outcome:
        """Run one trial: clear what is under way, reset, present, decide. Advances the clock by its ticks.

        With `anew` in the program's trials all states are as at step 0 first, and synapses keep their weights alone.
        """

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Apply the rule's `teach` to the inputs of a neuron, of the trial just presented, at a tick of it.

        An input is taught by its first spike, with `spikes` "each" by all of them in turn.
        """

    def encourage(self, projection: int, maps: Ints) -> None:
        """Apply the rule's `encourage` to every weight of the given maps, once to a weight that several share."""

    def inject(self, population: int, steps: Ints, ids: Ints, payloads: Ints | None = None) -> None:
        """Add spikes of a listed population, at steps after the present one; with payloads where it is graded."""

    def signal(self, signal: int, values: Floats) -> None:
        """Set the dopamine concentration of every synapse that listens to a signal, one value per post neuron."""

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        """A state or parameter of all neurons, or of those of `ids` in their order; a copy."""

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Change states and parameters together, all or none; acts from the next step on.

        Each value has the shape (1,) or (size,). A `ModelError` names what the engine cannot hold.
        """

    def get_synapses(self, projection: int, name: str) -> Floats:
        """A state of every synapse, in the order of the program's weights.

        "weight" (stored, as NEST's), a state of the model such as "c", "K_plus" of the synapse's source, or
        "n" of its target.
        """

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Change the numbers of a synapse model, all of them, in the order of `Synapse.vector`.

        Shape (numbers,), or (synapses, numbers) where a rule takes a value for each, see `Synapse.of_each`.
        """

    def set_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights, or those that are chosen of them: the others are what a read shows, and stay."""

    def spikes(self, population: int, since: int) -> Spikes:
        """Recorded spikes with step > since."""

    def forget(self, before: int) -> None:
        """Drop recorded spikes with step <= before."""

    def counts(self) -> EngineCounts:
        """Counts since the start or the last reset."""

    def memory(self) -> dict[str, int]:
        """Bytes by what they hold, e.g. {"synapses": ..., "neurons": ...}."""

    def reset(self, weights: bool) -> None:
        """Back to step 0 and the initial states, and to the initial weights if asked."""

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that `restore` needs to continue bit for bit."""

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot of the same program."""


class Backend(Protocol):
    """How a program gets to run.

    A backend that computes in integers says `arithmetic = "integer"`; "float" is taken otherwise.
    A backend that cannot run some cases of `neuro.testing` lists them, with reasons, in an attribute
    `unsupported: dict[str, str]`. One that does not show some states of neurons names them in an attribute
    `unreadable: frozenset[str]`; its engine has it, too. One whose processes run a network together under mpirun is
    `Distributed`, too. One that runs many targets is a `Family`, too. One that draws synapses itself is `Draws`, too.
    """

    name: str
    description: str

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """What of the program is refused or approximated; `options` are those of `build`."""

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> Engine:
        """Make an engine at step 0."""


@runtime_checkable
class Distributed(Protocol):
    """A backend of which several processes that mpirun started run a network together."""

    def share(self) -> Share:
        """What of a network this process has; its methods reach the others.

        Raises:
            ModelError: the processes cannot work together.
        """


@runtime_checkable
class Draws(Protocol):
    """A backend with connection rules of its own, which draw the synapses of rules with `draw: backend`."""

    draws_synapses: bool
    """That it is so: true."""


@runtime_checkable
class Family(Protocol):
    """A backend that runs many targets, such as the chips of one arithmetic, of which its own name is one."""

    def of(self, target: str) -> Backend | None:
        """The backend for a target by name or by the file that describes it; None if it is of no or another family.

        Raises:
            ModelError: no family runs that target, or its file cannot be read.
        """

    def targets(self) -> Iterable[str]:
        """The names that `of` takes."""


@runtime_checkable
class Replays(Protocol):
    """A backend that can be compared with single calls of a chip's programs, beside whole networks."""

    def replay(self, case: Mapping[str, Any], events: NDArray[Any]) -> Mapping[str, NDArray[Any]]:
        """Return the states after every event of a case, by name; `neuro.testing.chip_traces` has such cases.

        Raises:
            ModelError: the chip has no such programs.
        """


@runtime_checkable
class Registers(Protocol):
    """An engine whose neurons and synapses have registers that can be read."""

    def registers(self, population: int, name: str) -> Ints:
        """A register of every neuron, by its own name or that of the state or parameter it stands for."""

    def synapse_registers(self, projection: int, name: str) -> Ints:
        """A register of every synapse, in the order of the program's weights."""


@runtime_checkable
class SettableSynapses(Protocol):
    """An engine that runs rules that learn by moves, the states of whose synapses can be set."""

    def set_synapses(self, projection: int, name: str, values: Floats) -> None:
        """Set a state of every synapse, in the order of the program's weights."""


@runtime_checkable
class Notes(Protocol):
    """An engine that notes what pre spikes leave in synapses that learn from spike pairs."""

    def noted(self, probe: int) -> Sent:
        """What those of the program's `synapse_probes` number `probe` were left with since this was last asked."""


@runtime_checkable
class Samples(Protocol):
    """An engine that reads states of neurons by itself while it runs, in the steps that are multiples of a probe's."""

    @property
    def samples(self) -> Collection[int]:
        """The numbers of those of the program's `probes` that it reads."""

    def sampled(self, probe: int) -> tuple[Ints, Floats]:
        """Steps, and the values in them, shape (steps, neurons), of one of them since this was last asked."""


@runtime_checkable
class Fired(Protocol):
    """An engine that tells of one population how often each neuron has fired, without counting everything."""

    def fired(self, population: int) -> Ints:
        """Spikes since the start or the last reset, with their multiplicity, per neuron; a copy."""


def counter(engine: Engine) -> Callable[[int], Ints]:
    """Return a function that counts the spikes of each neuron of a population."""
    return engine.fired if isinstance(engine, Fired) else lambda population: engine.counts().spikes[population]


def unnoted(program: Program) -> list[Problem]:
    """The problems of a backend whose engine does not note what pre spikes leave."""
    return [
        Problem(
            True,
            f"probe '{probe.name}': {probe.record} at pre spikes",
            "weights that learn are shown between steps only",
            "record it every so many ms, or run it on backend 'event'",
            probe.origin,
        )
        for probe in program.synapse_probes
        if not probe.every and program.projections[probe.projection].synapse.learns == "pairs"
    ]


def unreadable(shows: Backend | Engine) -> frozenset[str]:
    """The states of neurons that a backend or its engine does not show."""
    names: frozenset[str] = getattr(shows, "unreadable", frozenset())
    return names


def are_finite(engine: Engine, population: int, states: Sequence[str]) -> bool:
    """Whether states of a population of a linear model are neither NaN nor infinite, in any of its neurons.

    An engine whose neurons sleep may have an `are_finite` of its own, which need not bring them to the present: what is
    finite when a linear neuron falls asleep stays finite.
    """
    own: Callable[[int, Sequence[str]], bool] | None = getattr(engine, "are_finite", None)
    if own is not None:
        return own(population, states)
    return all(bool(np.isfinite(engine.get(population, name)).all()) for name in states)


def floats_only(program: Program) -> list[Problem]:
    """The problems of a float backend: parts in a chip's registers."""
    parts: list[tuple[str, Model | Synapse, Where | None]] = [
        (f"population '{p.name}'", p.model, p.origin) for p in program.populations if p.model.chip
    ]
    parts += [(f"projection '{p.name}'", p.synapse, p.origin) for p in program.projections if p.synapse.chip]
    return [
        Problem(
            True,
            f"{what}: {choice.name}",
            f"it is in the registers or programs of {choice.chip}",
            f"backend '{choice.chip}' runs it",
            origin,
        )
        for what, choice, origin in parts
    ]


SAVE_FROZEN = "neuro run FILE --save-frozen learnt.yaml writes what it learns as static synapses"
"""The way out of a backend that cannot learn."""

TAKE_PAYLOADS = "run it on event, reference, torch or loihi2"
"""The way out of a backend whose spikes carry no payloads."""


def ungraded(program: Program) -> list[Problem]:
    """The problems of a backend whose spikes carry no payloads."""
    return [
        Problem(
            True,
            f"population '{part.name}': {part.model.name}",
            "its spikes carry payloads, and spikes carry none here",
            TAKE_PAYLOADS,
            part.origin,
        )
        for part in program.populations
        if part.model.graded
    ]


def own_generators(program: Program) -> list[Problem]:
    """The problems of a backend whose host sends listed and Poisson spikes, and writes currents that change seldom."""
    emitting = "only poisson_generator, inhomogeneous_poisson_generator and spike_generator emit spikes here"
    inject = "run it on backend 'event', or inject the spikes that it emits there into a spike_generator"
    varying = "its current changes at every step, and the host writes a current only when it changes"
    found = []
    for part in program.populations:
        message = f"population '{part.name}': {part.model.name}"
        if part.kind == "generator":
            found.append(Problem(True, message, emitting, inject, part.origin))
        elif isinstance(part.model, CurrentGenerator) and part.model.varies:
            steps = "list its values in a step_current_generator, or run it on backend 'event'"
            found.append(Problem(True, message, varying, steps, part.origin))
    for projection in program.projections:
        if projection.carries == "current" and projection.receptor is not None:
            message = f"projection '{projection.name}': a current to receptor '{projection.receptor.name}'"
            way_out = "leave the receptor out: the current then acts on V_m as it is"
            found.append(Problem(True, message, "the host writes currents into the bias", way_out, projection.origin))
    return found


BACKENDS: Registry[Backend] = Registry(
    "backend",
    (),
    takes=lambda part: all(hasattr(part, word) for word in ("name", "problems", "build")),
    group="neuro.backends",
    name=lambda backend: backend.name,
)
"""All backends by name."""


def installed() -> dict[str, Backend]:
    """All backends by name, imported."""
    return dict(sorted(BACKENDS.items()))


def find_backend(name: str | PathLike[str]) -> Backend:
    """The backend of that name, or that of a family (`Family`) for the target of that name or file.

    Raises:
        ModelError: there is none, or the file does not describe such a target.
    """
    text = str(name)
    if text in BACKENDS:
        return BACKENDS[text]
    families = [each for each in installed().values() if isinstance(each, Family)]
    for family in families:
        if (found := family.of(text)) is not None:
            return found
    known = dict.fromkeys((*BACKENDS, *(target for family in families for target in family.targets())))
    raise unknown("backend", text, known)
