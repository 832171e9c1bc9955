"""Training in the closed loop, which goes on after a kill; the training curve; `--set`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from itertools import cycle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from neuro import ClosedLoop, ModelError, apps
from neuro.apps import Checkpoint, End, assignments, check_output, hdf5, unknown
from neuro_drone.controllers import CONTROLLERS, kind_of, make, settings_of
from neuro_drone.controllers.deep import Deep, needed
from neuro_drone.controllers.pilot import ControllerPilot
from neuro_drone.controllers.spiking import EPISODES, Spiking
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import Flights
from neuro_drone.model import FORMAT, Model, packed
from neuro_drone.parts import check_whole
from neuro_drone.paths import drawn
from neuro_drone.scenario import Scenario, load

STEPS = 60_000
"""Steps of a training. Source: thesis, table 5."""

TEST_EVERY = 2000
"""Steps of training from one test of frozen weights to the next."""

FLIGHTS, FLIGHT_STEPS = 2, 60
"""Of a test: a sixteenth of the steps that are learnt from. The first half of a flight is the way to the target."""

TEST_SEED = 2_000_016
"""Of starts, paths and noise: the same in every test, and not those of a training or of `neuro drone test`.

It is the first from 2,000,000 on with which the two balls begin in opposite quarters of the picture, more than 25 px
off on each axis, and the two lines on opposite sides, more than 10 px off, one in each direction.
"""

LAST = 20
"""Episodes of which the mean reward is told."""
_CURVE = {"steps": np.int64, "error_px": np.float64, "lost": np.int64}


@dataclass(frozen=True, slots=True)
class TrainingProgress:
    """How far a training is.

    Attributes:
        seed: of the training.
        episodes: that have ended.
        step, steps: done, and all.
        reward: mean of a step in the last episodes, not a number before the first; the best is 1.
        frozen_px: mean of the last test with frozen weights; not a number before the first.
    """

    seed: int
    episodes: int
    step: int
    steps: int
    reward: float
    frozen_px: float

    @property
    def text(self) -> str:
        """Steps, and how well it flies, in a few words."""
        frozen = "" if math.isnan(self.frozen_px) else f", {self.frozen_px:.1f} px frozen, from afar"
        learning = "" if math.isnan(self.reward) else f", reward {self.reward:.3f} a step while it learns"
        return f"{self.step:,} of {self.steps:,} steps{frozen}{learning}"


Report = Callable[[TrainingProgress], None]


def train(
    scenario: Scenario | str | Path,
    controller: str = "snn",
    *,
    steps: int = STEPS,
    episode: int | None = None,
    seed: int = 0,
    settings: Mapping[str, Any] | None = None,
    out: Path | None = None,
    report: Report | None = None,
) -> Model:
    """Teach a controller; one that cannot learn is only put into a model.

    Args:
        scenario: the world and the task, its name or its file.
        controller: a name of `CONTROLLERS`.
        steps: of control, in all.
        episode: most steps of one; it ends before where the target is lost or the lap is over. The network's world
            or `EPISODES` says it if not given.
        seed: of everything random; episodes begin where it says.
        settings: of the controller, by name.
        out: file for the model. A checkpoint is kept beside it; the same call continues from there to the same bits.
            A training that is complete is not done again.
        report: called with the progress after each episode.

    Returns:
        The model.

    Raises:
        ModelError: a name or a setting is wrong, or `out` belongs to another training.
    """
    model = untrained(load(scenario), controller, seed, episode, settings or {})
    check_whole("steps", steps, 1)
    words = model.told() | {"steps": steps}
    if out is not None:
        if out.is_file() and (made := Model.load(out)).told() | {"steps": made.steps} == words:
            Checkpoint(out, "", {}).remove()
            return made
        check_output(out, hdf5.kind(FORMAT))
    if kind_of(controller).learns:
        model = _learn(model, steps, out, words, report)
    if out is not None:
        model.save(out)
        Checkpoint(out, "", {}).remove()
    return model


def untrained(
    scenario: Scenario, controller: str, seed: int, episode: int | None, settings: Mapping[str, Any]
) -> Model:
    """The model of a controller before learning; the words are those of `train`."""
    check_whole("seed", seed, below="2^63")
    made = make(controller, scenario, seed, settings)
    files, own = {}, None
    if isinstance(made, Spiking):
        made.loop(DroneEnv(scenario))  # what does not fit is told of the user's file
        files, own = packed(made.net), made.world.episode
    episode = (own or EPISODES[scenario.kind]) if episode is None else episode
    check_whole("episode", episode, 1)
    return Model(controller, scenario, seed, 0, episode, settings_of(controller, scenario, settings), network=files)


def _learn(model: Model, steps: int, out: Path | None, words: Mapping[str, Any], report: Report | None) -> Model:
    """Learn in the closed loop until all steps are done, with tests on the way."""
    env = gymnasium.wrappers.TimeLimit(DroneEnv(model.scenario), model.episode)
    loop = model.loop(env, learns=True)
    checkpoint = None if out is None else loop.checkpoint(out, words)
    found = {} if checkpoint is None else checkpoint.resume()
    loop.go_on(found)
    curve, episodes = Curve(model, found.get("curve")), len(loop.log)

    def tell() -> None:
        log = loop.log
        reward = log.returns[-LAST:].sum() / log.lengths[-LAST:].sum() if len(log) else math.nan
        if report is not None:
            report(TrainingProgress(model.seed, len(log), loop.steps, steps, float(reward), curve.last_px))

    def watch() -> None:
        nonlocal episodes
        curve.follow(loop)
        if len(loop.log) > episodes:
            episodes = len(loop.log)
            tell()

    def after(loop: ClosedLoop) -> None:
        if checkpoint is not None:
            checkpoint.keep(**loop.arrays(), curve=curve.arrays())
        tell()

    loop.watch = watch
    loop.until(End(steps=steps), after=after)
    env.close()
    curve.close()
    arrays = {name: part for name, part in loop.pilot.arrays().items() if part and name != "state"}
    history = {name: array for name, array in loop.log.arrays().items() if name != "solved"}
    return replace(
        model, steps=steps, learnt=arrays.pop("learnt", {}), history=history, curve=curve.arrays(), world=arrays
    )


class Curve:
    """The training curve: how well a controller would fly if it learnt no more; exploration and dopamine hide that.

    It is tested with frozen weights along a training, which neither it nor its randomness is touched by.

    The error is that in the picture, as in the history of a training: of a line that of its column, and where the drone
    climbs that of the ball's place. The other axes tell in the flights that are lost.

    Args:
        model: before learning.
        found: what `arrays` gave, to go on from there.
    """

    def __init__(self, model: Model, found: Mapping[str, npt.NDArray[Any]] | None = None) -> None:
        line, rngs = model.scenario.kind == "line", [np.random.default_rng((TEST_SEED, k)) for k in range(FLIGHTS)]
        begins = [(int(rng.integers(2**31)), {"path": drawn(rng, line)}) for rng in rngs]
        self._env = Flights(model.scenario, cycle(begins))
        self._loop = model.loop(self._env)
        self._points: dict[str, list[Any]] = {name: found[name].tolist() if found else [] for name in _CURVE}
        self._last = self._points["steps"][-1] if self._points["steps"] else 0

    def follow(self, loop: ClosedLoop) -> None:
        """Test once if a test was due since the last.

        Args:
            loop: of the training.
        """
        if loop.steps // TEST_EVERY == self._last // TEST_EVERY:
            return
        self._last, pilot = loop.steps, loop.pilot
        if isinstance(pilot, ControllerPilot):
            self._loop.pilot = ControllerPilot(pilot.controller.frozen())
        else:
            self._loop.pilot.put(pilot.arrays())
        self._loop.test(FLIGHTS, most=FLIGHT_STEPS)
        errors, lost = [], 0
        for track, last in zip(self._env.errors, self._env.last, strict=True):
            far = [px for _, px in track]
            far += far[-1:] * (FLIGHT_STEPS - len(far))  # of a flight that lost the target the last error stays
            errors.append(np.mean(far[FLIGHT_STEPS // 2 :]))
            lost += last["lost"]
        self._env.errors.clear()
        self._env.last.clear()
        for name, value in zip(_CURVE, (loop.steps, np.mean(errors), lost), strict=True):
            self._points[name].append(value)

    @property
    def last_px(self) -> float:
        """The error of the last test; not a number before the first."""
        return float(self._points["error_px"][-1]) if self._points["error_px"] else math.nan

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """One value a test: steps of the training, error_px (mean of the flights) and lost (how many)."""
        return {name: np.array(self._points[name], kind) for name, kind in _CURVE.items()}

    def close(self) -> None:
        """No test follows."""
        self._env.close()


@dataclass(frozen=True, slots=True)
class TrainingJob:
    """A training among several; the words are those of `train`."""

    scenario: Scenario | str | Path
    controller: str = "snn"
    steps: int = STEPS
    episode: int | None = None
    seed: int = 0
    settings: Mapping[str, Any] | None = None
    out: Path | None = None

    def run(self, report: Report | None = None) -> Model:
        """Train."""
        return train(report=report, **{name: getattr(self, name) for name in self.__slots__})


def side_by_side(
    jobs: Sequence[TrainingJob], processes: int | None = None, report: Report | None = None
) -> list[Model]:
    """Train several, each in a process of its own; each gives what it gives alone. See `neuro.apps.side_by_side`.

    Args:
        jobs: what to train.
        processes: at a time; all cores if not given.
        report: called with the progress of each, by its seed.

    Returns:
        The models, in the order of the jobs.

    Raises:
        ModelError: of the first job that raises one.
    """
    return apps.side_by_side(TrainingJob.run, jobs, processes, report)


_WORDS = {one.name for one in fields(Scenario)}


def chosen(scenario: str | Path, controller: str, texts: Sequence[str]) -> tuple[Scenario, dict[str, Any]]:
    """A scenario and the settings of a controller, with changes.

    Args:
        scenario: its name or file.
        controller: its name.
        texts: "name=value": with a dot, or a word that only a scenario has, a change of the scenario; else a setting
            of the controller.

    Raises:
        ModelError: there is no such scenario, controller or word, or a value cannot be.
    """
    own = set(kind_of(controller).settings.own())
    values = _said(texts)
    world = {name for name in values if "." in name or name in _WORDS - own}
    changed = load(scenario, **{name: values[name] for name in values if name in world})
    settings = {name: values[name] for name in values if name not in world}
    known = own | _WORDS
    try:
        untrained(changed, controller, 0, None, settings)  # mistakes are told before any work
    except ModelError as error:  # a name that is none of the network's parameters may be meant for a setting
        for name in sorted(settings.keys() - known):
            if error.kind.startswith("unknown parameter") and get_close_matches(name, known, 1):
                raise unknown(f"setting of controller '{controller}'", name, known) from None
        raise
    maker = kind_of(controller).maker
    if isinstance(maker, type) and issubclass(maker, Deep):
        needed(controller)
    return changed, settings


def _said(texts: Sequence[str]) -> dict[str, Any]:
    """Changes by name; the seed of a scenario is refused, since all episodes of a command have seeds of their own."""
    values = assignments(list(texts))
    if "seed" in values:
        raise ModelError("--set seed: it would change nothing", hint="training has --seed; tests have fixed seeds")
    return values


def pilot(model: Path | None, scenario: str | None, controller: str | None, texts: Sequence[str]) -> Model:
    """A trained model, or one of a controller that does not learn.

    Args:
        model: file of the model.
        scenario: another one than the model's; of a controller B60 if not given.
        controller: its name, if there is no file.
        texts: changes, see `chosen`; of a model only those of the scenario.

    Raises:
        ModelError: as `chosen`, or a controller by name must learn first.
    """
    if model is None:
        name = controller or ""
        if kind_of(name).learns:
            fixed = ", ".join(name for name, kind in CONTROLLERS.items() if not kind.learns)
            raise ModelError(
                f"controller '{name}' has to learn first: expected a model, or one of {fixed}",
                hint=f"neuro drone train --controller {name}",
            )
        world, settings = chosen(scenario or "B60", name, texts)
        return train(world, name, settings=settings)
    trained = Model.load(model)
    changes = _said(texts)
    for name in changes:
        if "." not in name and name not in _WORDS:
            raise ModelError(
                f"--set {name}: the settings of a trained controller stay: expected a word of the scenario",
                hint="'neuro drone train --set' has settings of the controller",
            )
    return replace(trained, scenario=load(trained.scenario if scenario is None else scenario, **changes))
