"""The base class of recognition methods: settings, and three functions between events and scores.

    events -> observe -> evidence -> fit -> learnt;  learnt, evidence -> answer -> scores

Evidence does not depend on what was learnt, so the evidence of a recording is computed once for all folds and cached.
An observer receives the events of one recording in parts, and returns the evidence of all events so far at any time.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, Self, TypeAlias

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Part, Registry, Settings, find_backend, setting, unknown
from neuro.chips import HostWork
from neuro.coding import Works
from neuro_events import Events
from neuro_events.parts import joined_parts
from neuro_recognise.shown import Array, Evidence, Features, Floats, Ints

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    import neuro
    from neuro.apps import Checkpoint


SPLITS = "chosen on the same splits of N-MNIST's training recordings as its accuracies"
"""Source of a value that was tuned on the same splits as its reported accuracy, not on separate recordings."""


Learnt: TypeAlias = Mapping[str, Array | str]
"""Result of a training: arrays and texts by name. The result and the settings suffice to compute scores."""

Run: TypeAlias = "tuple[neuro.Simulation, neuro.TrialCounts]"
"""A simulation of a network, and the operations counted in its trials."""

Drawings: TypeAlias = "Mapping[str, Figure]"
"""Pictures by name."""

SILENT = -1
"""The decision for a recording without evidence for any class, whose scores are all NaN."""


MAX_OUTSIDE = 0.05
"""Largest share of a recording's events outside of the field; these events are dropped."""


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a training.

    Attributes:
        what: current activity, e.g. "epoch 2 of 8".
        done, total: finished and total units of this activity.
        right: share of correct decisions so far; None if unknown.
        among: finished and total number of jobs, if several jobs run.
    """

    what: str
    done: int
    total: int
    right: float | None = None
    among: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class Course:
    """Conditions of a training: seed, backend, checkpoint and progress report.

    Attributes:
        seed: seed of all random numbers.
        backend: backend that runs networks.
        checkpoint: file from which an interrupted training resumes; None stores nothing.
        report: function that is called with the progress.
    """

    seed: int = 0
    backend: str = "event"
    checkpoint: Checkpoint | None = None
    report: Callable[[Progress], None] = lambda progress: None

    def resume(self) -> dict[str, Any]:
        """Return the last state that `keep` stored, or an empty dict."""
        return self.checkpoint.resume() if self.checkpoint else {}

    def keep(self, **parts: Array | Mapping[str, Array]) -> None:
        """Store the state of the training, and replace the previous state."""
        if self.checkpoint:
            self.checkpoint.keep(**parts)


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """Scores of recordings, and the run of the network that computed them.

    Attributes:
        scores: (recordings, classes), larger for a more likely class. A row is all NaN if there is no evidence for any
            class.
        votes: (recordings, classes) scores of each decision rule on the same evidence, by the name of the rule. They
            include `scores`.
        run: function that returns the run of the network on the same recordings, for the bill; None without a network.
            A method that needs only a part of its network for the scores simulates the rest in this call.
        neurons_per_core: limit of neurons per core of a chip, for the bill; None for the chip's own limit.
        duration_s: total duration of the recordings, s, for bills in real time. It is set if simulated time differs
            from recorded time, e.g. with a fixed number of steps per frame; None if both are equal.
        host: operations outside of the network, for the bill.
    """

    scores: Floats
    votes: Mapping[str, Floats] = field(default_factory=dict)
    run: Callable[[], Run] | None = None
    neurons_per_core: int | None = None
    duration_s: float | None = None
    host: tuple[HostWork, ...] = ()


class FrameSize(NamedTuple):
    """Sizes in the front end of a method with frames.

    Attributes:
        pixels: pixels of the field.
        sides: sides of the filters of each scale, px.
        orientations: orientations of the filters.
        side: side of a cell of the pool, px.
        cells: cells of the pool.
    """

    pixels: int
    sides: tuple[int, ...]
    orientations: int
    side: int
    cells: int

    @property
    def responses(self) -> int:
        """The number of filters times the number of cells."""
        return len(self.sides) * self.orientations * self.cells


class FrontEndPart(Part):
    """Base of the parts of a front end, which the host computes."""

    def work(self, size: FrameSize) -> Works:
        """Return the operations for each unit of use: an event, a frame, or a pixel that has events in a frame.

        The operations are None for a part that does not count them. The total of the bill is then incomplete.
        """
        return {"frame": None}


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Images over time. Each image is shown until the time of the next one.

    Attributes:
        name: title of the images.
        at_ms: (images,) times since the first event, ms, ascending.
        images: (images, rows, columns) values >= 0; all images share one colour scale.
        captions: a caption for each image; () for none.
    """

    name: str
    at_ms: Floats
    images: Array
    captions: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class TrialView:
    """Spikes of a network's trials over time. Each trial is shown until the time of the next one.

    Attributes:
        name: title of the spikes, e.g. "input spikes of each frame".
        at_ms: (trials,) times since the first event of the recording, ms, ascending.
        length_ms: duration of a trial, ms.
        size: number of neurons.
        offsets: (trials + 1,) indices; the spikes of trial i are at ``times[offsets[i]:offsets[i + 1]]``.
        times: (spikes,) times since the beginning of the trial, ms.
        ids: (spikes,) indices of the neurons.
        captions: a caption for each trial, e.g. the winner; () for none.
        bands: names of groups of equally many neurons, in the order of their ids; () for none.
    """

    name: str
    at_ms: Floats
    length_ms: float
    size: int
    offsets: Ints
    times: Floats
    ids: Ints
    captions: tuple[str, ...] = ()
    bands: tuple[str, ...] = ()


View: TypeAlias = Pictures | TrialView


@dataclass(frozen=True)
class Method(Settings):
    """Base of all methods: a frozen dataclass of settings.

    Attributes:
        size: width and height of the field in px, from the top left pixel. The field is the part of the sensor whose
            events are used; 0 uses the whole sensor.

    Class attributes:
        title: description in one line.
        source: publication or page that describes the method.
        needs: optional dependency (extra) that training needs, "" for none.
        spikes: whether the method has a spiking network, so that its energy on chips can be computed.
        changeable: settings that may be changed after training, because `Learnt` is valid for any of their values.
        by_moment: whether deciding early needs a separate training for each duration, because evidence of the beginning
            of a recording differs from evidence of the whole recording.
        unobserved: settings that evidence does not depend on, e.g. settings of the training.
        presets: named sets of settings that differ from the defaults.
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

    size: tuple[int, int] = setting((0, 0), "px", "field of the used events; [0, 0]: whole sensor", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.size) != 2:
            raise ModelError(f"{self.place()}: size = {list(self.size)}: expected width and height")

    def place(self) -> str:
        """Return the beginning of error messages: ``method`` and the method's name."""
        return f"method '{self.called()}'"

    def way_out_of_silence(self) -> str:
        """Return advice for recordings without a decision: lower the threshold settings, or use more events."""
        thresholds = [f"--set {row.name}={row.value:g}" for row in self.rows() if "threshold" in row.doc]
        lower = f"expected lower values than {', '.join(thresholds)}, or " if thresholds else "expected "
        return f"{lower}recordings with more events"

    def preset(self, name: str) -> Self:
        """Return these settings with the values of a preset.

        Raises:
            ModelError: the method has no preset of that name.
        """
        if name not in self.presets:
            raise unknown(f"preset of {self.place()}", name, self.presets)
        return self.changed(self.presets[name])

    def fitting(self, size: tuple[int, int]) -> Self:
        """Return a copy of the settings in which values that follow from the sensor are filled in.

        Args:
            size: width and height of the sensor, px.
        """
        return replace(self, size=size) if self.size == (0, 0) else self

    def inside(self, events: Events) -> Events:
        """Return the events inside the field; the result has the field as its sensor size.

        Raises:
            ModelError: more than 5 % of the events lie outside of the field.
        """
        cropped = self.within(events)
        self.check_outside(len(events) - len(cropped), len(events))
        return cropped

    def within(self, events: Events) -> Events:
        """Return the events inside the field, as `inside` does, but without a limit for events outside."""
        width, height = self.size
        if events.sensor_size == self.size:
            return events
        cropped = events[(events.x < width) & (events.y < height)]
        return Events(cropped.t, cropped.x, cropped.y, cropped.p, (width, height))

    def check_outside(self, outside: int, total: int) -> None:
        """Check that at most 5 % of the events of a recording lie outside of the field.

        Args:
            outside: number of events outside.
            total: number of all events.

        Raises:
            ModelError: more than 5 % lie outside.
        """
        width, height = self.size
        if outside > MAX_OUTSIDE * total:
            raise ModelError(
                f"{outside} of {total} events lie outside of the {width}x{height} field: "
                f"expected at most {MAX_OUTSIDE:.0%}",
                hint="crop the recording round the object first, train with a larger 'size', or find several objects: "
                "'neuro recognise detect'",
            )

    def check_backend(self, name: str) -> None:
        """Check that a backend exists and that the method has a network to run on it.

        Args:
            name: name of the backend; every method accepts "event", the default.

        Raises:
            ModelError: the backend does not exist, or the method has no network.
        """
        if name != "event" and not self.spikes:
            networks = ", ".join(name_with_network for name_with_network, method in METHODS.items() if method.spikes)
            raise ModelError(
                f"backend = '{name}': {self.place()} has no network that could run on it",
                hint=f"leave it out; methods with a network: {networks}",
            )
        find_backend(name)

    def fixed(self) -> Mapping[str, Any]:
        """Return the settings that must not change when a training resumes, as plain data."""
        return self.as_words()

    def observing(self) -> Mapping[str, Any]:
        """Return the settings that evidence depends on, as plain data. Equal settings give equal evidence."""
        return {name: value for name, value in self.as_words().items() if name not in self.unobserved}

    @abstractmethod
    def observe(self, events: Events) -> Evidence:
        """Compute the evidence of a recording. The evidence does not depend on the training.

        Raises:
            ModelError: the recording does not fit the settings.
        """

    def observe_until(self, events: Events, times_us: Sequence[int]) -> list[Evidence]:
        """Compute the evidence of several beginnings of a recording.

        Args:
            events: the recording.
            times_us: durations of the beginnings, counted from the first event, us, ascending.
        """
        first, begin = int(events.t[0]) if len(events) else 0, 0
        observer, evidence = self.observer(), []
        for time in times_us:
            end = int(np.searchsorted(events.t, first + time, "right"))
            observer.add(events[begin:end])
            evidence.append(observer.evidence())
            begin = end
        return evidence

    def observer(self) -> Observer:
        """Return a new observer. A method that can update its evidence incrementally overrides this function."""
        return Whole(self.observe, self.size)

    def views(self, events: Events, learnt: Learnt, classes: Sequence[str]) -> Sequence[View]:
        """Return intermediate results over time, e.g. frames or spikes, for `neuro recognise watch`; none by default.

        Args:
            events: the recording, with at least one event.
            learnt: result of `fit`.
            classes: names of the classes.
        """
        return ()

    @abstractmethod
    def fit(self, features: Features, course: Course) -> Learnt:
        """Learn from the evidence of labelled recordings.

        Raises:
            ModelError: there is too little to learn from.
        """

    @abstractmethod
    def answer(self, learnt: Learnt, features: Features, backend: str = "event") -> Answer:
        """Compute the scores of recordings.

        Args:
            learnt: result of `fit`.
            features: evidence of the recordings; labels are ignored.
            backend: backend that runs networks.
        """

    def asker(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Answer]:
        """Prepare `answer` for repeated use. The returned function gives the same bits in every call order."""
        return partial(self.answer, learnt, backend=backend)

    def network(self, learnt: Learnt) -> neuro.Network | None:
        """Return the learnt network; None for a method without a network."""
        return None

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """Draw what was learnt, as pictures by name; empty if the method has none."""
        return {}


def choose(scores: Floats) -> Ints:
    """Return the class with the largest score in each row, (rows,); `SILENT` for a row of NaN.

    Args:
        scores: (rows, classes).
    """
    silent = np.isnan(scores).all(axis=1)
    return np.where(silent, SILENT, np.where(np.isnan(scores), -np.inf, scores).argmax(axis=1))


METHODS: Registry[type[Method]] = Registry(
    "method", (), takes=lambda thing: isinstance(thing, type) and issubclass(thing, Method), group="neuro.recognisers"
)
"""All methods by name."""


class Observer(ABC):
    """Computes the evidence of one recording from events that arrive in parts."""

    @abstractmethod
    def add(self, events: Events) -> None:
        """Add the next events."""

    @abstractmethod
    def evidence(self) -> Evidence:
        """Return the evidence of all events so far, bit-identical to `Method.observe` of the same events.

        Raises:
            ModelError: the events do not fit the method.
        """


class Whole(Observer):
    """Stores all events and observes them again at each call of `evidence`; correct for every method.

    Args:
        observe: `Method.observe`.
        size: size of the field, px, for a recording without events.
    """

    def __init__(self, observe: Callable[[Events], Evidence], size: tuple[int, int]) -> None:
        self._observe, self._size = observe, size
        self._parts: list[Events] = []

    def add(self, events: Events) -> None:
        """Store the next events."""
        if len(events):
            self._parts.append(events)

    def evidence(self) -> Evidence:
        """Observe all stored events."""
        none: Any = []
        events = joined_parts(self._parts) if self._parts else Events(none, none, none, none, self._size)
        self._parts = [events] if len(events) else []
        return self._observe(events)


class Grows(Protocol):
    """A description of events, e.g. histograms, that is updated with each event."""

    def add(self, events: Events) -> None:
        """Add the next events."""

    def histograms(self) -> npt.NDArray[np.floating]:
        """Return the description of all events so far."""


class Growing(Observer):
    """Updates a description incrementally, so that a call of `add` processes only the new events.

    Args:
        field: the method, whose field selects the events.
        description: description that has no events yet; its values become the evidence "vector".
    """

    def __init__(self, field: Method, description: Grows) -> None:
        self._field, self._description = field, description
        self._outside = self._total = 0

    def add(self, events: Events) -> None:
        """Add the next events to the description."""
        is_inside = self._field.within(events)
        self._total += len(events)
        self._outside += len(events) - len(is_inside)
        self._description.add(is_inside)

    def evidence(self) -> Evidence:
        """Return the description as a vector."""
        self._field.check_outside(self._outside, self._total)
        return {"vector": self._description.histograms().ravel().astype(np.float32)}
