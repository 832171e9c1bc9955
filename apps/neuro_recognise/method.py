"""What every way of recognising is: settings, and three functions between events and scores.

    events -> observe -> evidence -> fit -> learnt;  learnt, evidence -> answer -> scores

What is observed of a recording does not depend on what was learnt, so it is computed once for all folds and kept. An
observer sees a recording grow: events go in part after part, and what they show comes out whenever it is asked for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, TypeAlias

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Registry, Settings, find_backend, setting, unknown
from neuro_events import Events
from neuro_events.parts import joined_parts
from neuro_recognise.shown import Array, Evidence, Features, Floats, Ints

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    import neuro
    from neuro.apps import Checkpoint


SPLITS = "chosen on splits of N-MNIST's training recordings, which its accuracies are of, too"
"""Source of a value that was chosen by what was reported afterwards, not on recordings apart."""


Learnt: TypeAlias = Mapping[str, Array | str]
"""What training gives: arrays and texts by name, all that answering needs beside the settings."""

Run: TypeAlias = "tuple[neuro.Simulation, neuro.TrialCounts]"
"""The simulation that a network ran on, and what that took."""

Drawings: TypeAlias = "Mapping[str, Figure]"
"""Pictures by name."""

SILENT = -1
"""The decision where nothing speaks for any class."""


MAX_OUTSIDE = 0.05
"""Share of a recording's events that may lie outside of the field and be left out."""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a training is.

    Attributes:
        what: is being done, e.g. "epoch 2 of 8".
        done, total: of that.
        right: share of what was done that was decided rightly, where that is known.
        among: how many of how many such things are done, where there are several.
    """

    what: str
    done: int
    total: int
    right: float | None = None
    among: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class Course:
    """How a training goes: what is random, what runs networks, and what is kept of it on the way.

    Attributes:
        seed: of everything random.
        backend: runs networks.
        checkpoint: keeps the state, so that a killed training goes on; None keeps nothing.
        report: called with the progress.
    """

    seed: int = 0
    backend: str = "event"
    checkpoint: Checkpoint | None = None
    report: Callable[[Progress], None] = lambda progress: None

    def resume(self) -> dict[str, Any]:
        """What `keep` wrote before a kill; nothing if there is none."""
        return self.checkpoint.resume() if self.checkpoint else {}

    def keep(self, **parts: Array | Mapping[str, Array]) -> None:
        """Keep the state of the training, in place of the one before."""
        if self.checkpoint:
            self.checkpoint.keep(**parts)


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a recogniser says of recordings.

    Attributes:
        scores: (recordings, classes), the larger, the more speaks for a class; NaN in all of a row where nothing
            speaks for any.
        votes: the same by other ways of reading the same evidence, by name; `scores` are among them.
        run: gives the run of the network on the same recordings, for bills; None without a network. A method that
            answers by less than its whole network runs that only when asked.
        neurons_per_core: of a chip, for bills, fewer than it allows; None for as many.
        duration_s: how long the recordings last together, s, for bills in real time, where the network runs in a time
            of its own, e.g. so many steps a frame; None where a step of the network is as long as on the recording.
    """

    scores: Floats
    votes: Mapping[str, Floats] = field(default_factory=dict)
    run: Callable[[], Run] | None = None
    neurons_per_core: int | None = None
    duration_s: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Pictures, each shown from its time on until that of the next.

    Attributes:
        name: what they are.
        at_ms: (pictures,) since the first event, ascending.
        images: (pictures, rows, columns), from 0 on; all are drawn on one scale.
        told: a few words on each; none for ().
    """

    name: str
    at_ms: Floats
    images: Array
    told: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class TrialView:
    """Spikes of the trials of a network, each shown from its time on until that of the next.

    Attributes:
        name: whose spikes, e.g. "input spikes of each frame".
        at_ms: (trials,) since the first event of the recording, ascending.
        length_ms: of a trial.
        size: number of neurons.
        offsets: (trials + 1,) trial i has ``times[offsets[i]:offsets[i + 1]]``.
        times: (spikes,) ms, since the beginning of the trial.
        ids: (spikes,) neurons.
        told: a few words on each trial, such as the winner; none for ().
        bands: names of groups of equally many neurons, in the order of their ids; none for ().
    """

    name: str
    at_ms: Floats
    length_ms: float
    size: int
    offsets: Ints
    times: Floats
    ids: Ints
    told: tuple[str, ...] = ()
    bands: tuple[str, ...] = ()


View: TypeAlias = Pictures | TrialView


@dataclass(frozen=True)
class Method(Settings):
    """Base of all methods: a frozen dataclass of settings.

    Attributes:
        size: width and height of the field that is looked at, px, from the top left pixel; 0 takes the sensor's.

    Class attributes:
        title: what it is, in one line.
        source: where it is described.
        needs: an extra that training needs, "" for none.
        spikes: whether it is a spiking network, which has a bill on chips.
        changeable: settings that may be changed after training, since what was learnt goes with any of their values.
        by_moment: whether beginnings of recordings have to be learnt apart to decide early, since what is seen of a
            beginning differs from what is seen of the whole.
        unobserved: settings that what is observed does not depend on, such as those of learning.
        presets: other settings by name, as values that differ; the first, without a name, are the defaults.
        measured: accuracy by data set, as text; docs/reference/recognisers.md has the commands.
    """

    title: ClassVar[str]
    source: ClassVar[str]
    needs: ClassVar[str] = ""
    spikes: ClassVar[bool] = False
    changeable: ClassVar[tuple[str, ...]] = ()
    by_moment: ClassVar[bool] = False
    unobserved: ClassVar[tuple[str, ...]] = ()
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    measured: ClassVar[Mapping[str, str]] = {}

    size: tuple[int, int] = setting((0, 0), "px", "field that is looked at; [0, 0] takes the sensor's", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.size) != 2:
            raise ModelError(f"{self.place()}: size = {list(self.size)}: expected width and height")

    def place(self) -> str:
        """``method`` and its name."""
        return f"method '{self.called()}'"

    def way_out_of_silence(self) -> str:
        """Return what to change where recordings get no decision, with the settings that are thresholds."""
        thresholds = [f"--set {row.name}={row.value:g}" for row in self.rows() if "threshold" in row.doc]
        lower = f"expected lower values than {', '.join(thresholds)}, or " if thresholds else "expected "
        return f"{lower}recordings with more events"

    def preset(self, name: str) -> Self:
        """These settings with those of a preset.

        Raises:
            ModelError: there is none of that name.
        """
        if name not in self.presets:
            raise unknown(f"settings of {self.place()}", name, self.presets)
        return self.changed(self.presets[name])

    def fitting(self, size: tuple[int, int]) -> Self:
        """These settings with everything decided that follows from the sensor.

        Args:
            size: its width and height, px.
        """
        return replace(self, size=size) if self.size == (0, 0) else self

    def inside(self, events: Events) -> Events:
        """The events inside the field, as of a sensor of its size.

        Raises:
            ModelError: more than 5 % of the events lie outside of it.
        """
        left = self.within(events)
        self.check_outside(len(events) - len(left), len(events))
        return left

    def within(self, events: Events) -> Events:
        """The events inside the field, as of a sensor of its size, however many that are."""
        width, height = self.size
        if events.sensor_size == self.size:
            return events
        left = events[(events.x < width) & (events.y < height)]
        return Events(left.t, left.x, left.y, left.p, (width, height))

    def check_outside(self, outside: int, total: int) -> None:
        """Refuse a recording of which too much lies outside of the field.

        Raises:
            ModelError: it is more than 5 % of the events.
        """
        width, height = self.size
        if outside > MAX_OUTSIDE * total:
            raise ModelError(
                f"{outside} of {total} events lie outside of the {width}x{height} field that is "
                f"looked at, expected at most {MAX_OUTSIDE:.0%}",
                hint="crop the recording round the object first, train with a larger 'size', or find several objects: "
                "'neuro recognise detect'",
            )

    def check_backend(self, name: str) -> None:
        """Refuse a backend that nothing would run on, or that is not there.

        Args:
            name: of a backend; "event" is every method's default.

        Raises:
            ModelError: there is none of this name, or the method has no network.
        """
        if name != "event" and not self.spikes:
            networks = ", ".join(known for known, method in METHODS.items() if method.spikes)
            raise ModelError(
                f"backend = '{name}': {self.place()} has no network that could run on it",
                hint=f"leave it out; methods with a network: {networks}",
            )
        find_backend(name)

    def fixed(self) -> Mapping[str, Any]:
        """The settings that a training under way cannot change, as plain data."""
        return self.as_words()

    def observing(self) -> Mapping[str, Any]:
        """The settings that `observe` depends on, as plain data: equal ones give the same evidence."""
        return {name: value for name, value in self.as_words().items() if name not in self.unobserved}

    @abstractmethod
    def observe(self, events: Events) -> Evidence:
        """What a recording shows, whatever was learnt.

        Raises:
            ModelError: the recording does not fit the settings.
        """

    def observe_until(self, events: Events, times_us: Sequence[int]) -> list[Evidence]:
        """What the beginnings of a recording show.

        Args:
            events: the recording.
            times_us: how long each beginning is from the first event on, us, ascending.
        """
        first, begin = int(events.t[0]) if len(events) else 0, 0
        observer, found = self.observer(), []
        for time in times_us:
            end = int(np.searchsorted(events.t, first + time, "right"))
            observer.add(events[begin:end])
            found.append(observer.evidence())
            begin = end
        return found

    def observer(self) -> Observer:
        """What sees a recording grow; a method that need not look at all events again has its own."""
        return Whole(self.observe, self.size)

    def views(self, events: Events, learnt: Learnt, classes: Sequence[str]) -> Sequence[View]:
        """What this method makes of a recording on the way, by time, for `neuro recognise watch`; none by default.

        Args:
            events: the recording, at least one event.
            learnt: by `fit`.
            classes: names.
        """
        return ()

    @abstractmethod
    def fit(self, shown: Features, course: Course) -> Learnt:
        """Learn from what labelled recordings show.

        Raises:
            ModelError: there is too little to learn from.
        """

    @abstractmethod
    def answer(self, learnt: Learnt, shown: Features, backend: str = "event") -> Answer:
        """What was learnt, asked about recordings.

        Args:
            learnt: by `fit`.
            shown: what the recordings show; their labels are not looked at.
            backend: runs networks.
        """

    def asker(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Answer]:
        """`answer` with all that can be prepared: for asking often. It gives the same bits whatever it was asked."""
        return partial(self.answer, learnt, backend=backend)

    def network(self, learnt: Learnt) -> neuro.Network | None:
        """The learnt network, None for a method without."""
        return None

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """What was learnt, as pictures by name; none where there is nothing to see."""
        return {}


def choose(scores: Floats) -> Ints:
    """The class with the largest score of each row, `SILENT` where all are NaN."""
    silent = np.isnan(scores).all(axis=1)
    return np.where(silent, SILENT, np.where(np.isnan(scores), -np.inf, scores).argmax(axis=1))


METHODS: Registry[type[Method]] = Registry(
    "method", (), takes=lambda thing: isinstance(thing, type) and issubclass(thing, Method), group="neuro.recognisers"
)
"""All methods by name."""


class Observer(ABC):
    """Sees one recording grow."""

    @abstractmethod
    def add(self, events: Events) -> None:
        """Take in the next events."""

    @abstractmethod
    def evidence(self) -> Evidence:
        """What `Method.observe` gives of all events so far, to the bit.

        Raises:
            ModelError: they do not fit the method.
        """


class Whole(Observer):
    """Keeps the events and observes all of them anew: right for every method.

    Args:
        observe: `Method.observe`.
        size: of the field, for a recording without events.
    """

    def __init__(self, observe: Callable[[Events], Evidence], size: tuple[int, int]) -> None:
        self._observe, self._size = observe, size
        self._parts: list[Events] = []

    def add(self, events: Events) -> None:
        """Keep the next events."""
        if len(events):
            self._parts.append(events)

    def evidence(self) -> Evidence:
        """Observe what was kept."""
        none: Any = []
        seen = joined_parts(self._parts) if self._parts else Events(none, none, none, none, self._size)
        self._parts = [seen] if len(seen) else []
        return self._observe(seen)


class Grows(Protocol):
    """A description that grows event by event."""

    def add(self, events: Events) -> None:
        """Take in the next events."""

    def histograms(self) -> npt.NDArray[np.floating]:
        """The description of all events so far."""


class Growing(Observer):
    """Sees by a description that grows, so that a moment costs what came since the last, not all that came.

    Args:
        field: what is looked at.
        description: without events yet; its values are the evidence "vector".
    """

    def __init__(self, field: Method, description: Grows) -> None:
        self._field, self._description = field, description
        self._outside = self._total = 0

    def add(self, events: Events) -> None:
        """Describe the next events."""
        within = self._field.within(events)
        self._total += len(events)
        self._outside += len(events) - len(within)
        self._description.add(within)

    def evidence(self) -> Evidence:
        """The description as a vector."""
        self._field.check_outside(self._outside, self._total)
        return {"vector": self._description.histograms().ravel().astype(np.float32)}
