"""Training in the closed loop with checkpoints, the training curve, and `--set`."""

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
from neuro_drone.model import FORMAT, Model, pack_network
from neuro_drone.parts import check_whole
from neuro_drone.paths import draw_variation
from neuro_drone.scenario import Scenario, load

STEPS = 60_000
"""Default steps of a training. Source: thesis, table 5."""

TEST_EVERY = 2000
"""Steps of training between two tests of frozen weights."""

FLIGHTS, FLIGHT_STEPS = 2, 60
"""Flights of a test during a training, and steps of a flight. The tests add about a sixteenth to the steps of the
training. In the first half of a flight, the drone approaches the target."""

TEST_SEED = 2_000_016
"""Seed of starts, paths and noise, the same in every test. A training and `neuro drone test` use other seeds.

The value is the first seed >= 2,000,000 with suitable starts. The balls of the two flights start in opposite quarters
of the picture, more than 25 px off on each axis. The two lines start on opposite sides, more than 10 px off, and have
opposite directions.
"""

LAST = 20
"""Number of latest episodes whose mean reward a progress report shows."""
_CURVE = {"steps": np.int64, "error_px": np.float64, "lost": np.int64}


@dataclass(frozen=True, slots=True)
class TrainingProgress:
    """Progress of a training.

    Attributes:
        seed: seed of the training.
        episodes: completed episodes.
        step, steps: completed steps, and all steps.
        reward: mean reward per step in the last `LAST` episodes, at most 1; NaN before the end of the first episode.
        frozen_px: mean error of the last test with frozen weights, px; NaN before the first test.
    """

    seed: int
    episodes: int
    step: int
    steps: int
    reward: float
    frozen_px: float

    @property
    def text(self) -> str:
        """Describe the progress: steps, error with frozen weights, and reward."""
        test_text = "" if math.isnan(self.frozen_px) else f", {self.frozen_px:.1f} px frozen, from far starts"
        learning = "" if math.isnan(self.reward) else f", reward {self.reward:.3f} a step while it learns"
        return f"{self.step:,} of {self.steps:,} steps{test_text}{learning}"


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
    """Train a controller and return its model. A controller that does not learn is stored without training.

    Args:
        scenario: the scenario, its name or its file.
        controller: a name of `CONTROLLERS`.
        steps: control steps of the whole training.
        episode: longest episode, steps; an episode ends earlier if the target is lost or the lap is over. Default: the
            value in the network's world, else `EPISODES`.
        seed: seed of everything random, also of the starts.
        settings: settings of the controller by name.
        out: file of the model. A checkpoint is written beside it. After an interruption the same call continues from
            the checkpoint, and the model has the same bits. A complete training is loaded instead of repeated.
        report: called with the progress after each episode.

    Raises:
        ModelError: a name or a setting is wrong, or `out` belongs to another training.
    """
    model = untrained(load(scenario), controller, seed, episode, settings or {})
    check_whole("steps", steps, 1)
    arguments = model.training_arguments() | {"steps": steps}
    if out is not None:
        check_output(out, hdf5.kind(FORMAT))
        if out.is_file() and (stored := Model.load(out)).training_arguments() | {"steps": stored.steps} == arguments:
            Checkpoint(out, "", {}).remove()
            return stored
    if kind_of(controller).learns:
        model = _learn(model, steps, out, arguments, report)
    if out is not None:
        model.save(out)
        Checkpoint(out, "", {}).remove()
    return model


def untrained(
    scenario: Scenario, controller: str, seed: int, episode: int | None, settings: Mapping[str, Any]
) -> Model:
    """Return the model of a controller before learning; the arguments are those of `train`."""
    check_whole("seed", seed, below="2^63")
    new_controller = make(controller, scenario, seed, settings)
    files, world_episode = {}, None
    if isinstance(new_controller, Spiking):
        # Errors here name the user's file. Errors of the stored network could not name it.
        new_controller.loop(DroneEnv(scenario))
        files, world_episode = pack_network(new_controller.net), new_controller.world.episode
    episode = (world_episode or EPISODES[scenario.kind]) if episode is None else episode
    check_whole("episode", episode, 1)
    return Model(controller, scenario, seed, 0, episode, settings_of(controller, scenario, settings), network=files)


def _learn(model: Model, steps: int, out: Path | None, arguments: Mapping[str, Any], report: Report | None) -> Model:
    """Learn in the closed loop until all steps are done, with tests of frozen weights in between."""
    env = gymnasium.wrappers.TimeLimit(DroneEnv(model.scenario), model.episode)
    loop = model.loop(env, learns=True)
    checkpoint = None if out is None else loop.checkpoint(out, arguments)
    arrays = {} if checkpoint is None else checkpoint.resume()
    loop.go_on(arrays)
    curve, episodes = Curve(model, arrays.get("curve")), len(loop.log)

    def report_progress() -> None:
        log = loop.log
        reward = log.returns[-LAST:].sum() / log.lengths[-LAST:].sum() if len(log) else math.nan
        if report is not None:
            report(TrainingProgress(model.seed, len(log), loop.steps, steps, float(reward), curve.last_px))

    def watch() -> None:
        nonlocal episodes
        curve.follow(loop)
        if len(loop.log) > episodes:
            episodes = len(loop.log)
            report_progress()

    def after(loop: ClosedLoop) -> None:
        if checkpoint is not None:
            checkpoint.keep(**loop.arrays(), curve=curve.arrays())
        report_progress()

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
    """The training curve: the error of frozen weights in tests during a training.

    While a controller learns, exploration and dopamine hide the quality of its weights. The tests change neither the
    training nor its random numbers.

    The error is `error_px`: for a ball the error of the position in the picture, for a line the error of the column.
    Errors on the other axes show only if they end in a lost flight.

    Args:
        model: the model before learning.
        points: result of `arrays`, to continue a curve.
    """

    def __init__(self, model: Model, points: Mapping[str, npt.NDArray[Any]] | None = None) -> None:
        line, rngs = model.scenario.kind == "line", [np.random.default_rng((TEST_SEED, k)) for k in range(FLIGHTS)]
        reset_calls = [(int(rng.integers(2**31)), {"path": draw_variation(rng, line)}) for rng in rngs]
        self._env = Flights(model.scenario, cycle(reset_calls))
        self._loop = model.loop(self._env)
        self._points: dict[str, list[Any]] = {name: points[name].tolist() if points else [] for name in _CURVE}
        self._last_test = self._points["steps"][-1] if self._points["steps"] else 0

    def follow(self, loop: ClosedLoop) -> None:
        """Test once if a test is due.

        Args:
            loop: closed loop of the training.
        """
        if loop.steps // TEST_EVERY == self._last_test // TEST_EVERY:
            return
        self._last_test, pilot = loop.steps, loop.pilot
        if isinstance(pilot, ControllerPilot):
            self._loop.pilot = ControllerPilot(pilot.controller.frozen())
        else:
            self._loop.pilot.put(pilot.arrays())
        self._loop.test(FLIGHTS, most=FLIGHT_STEPS)
        errors, lost = [], 0
        for track, info in zip(self._env.errors, self._env.last, strict=True):
            distances = [px for _, px in track]
            distances += distances[-1:] * (FLIGHT_STEPS - len(distances))  # after a loss, the last error is repeated
            errors.append(np.mean(distances[FLIGHT_STEPS // 2 :]))
            lost += info["lost"]
        self._env.errors.clear()
        self._env.last.clear()
        for name, value in zip(_CURVE, (loop.steps, np.mean(errors), lost), strict=True):
            self._points[name].append(value)

    @property
    def last_px(self) -> float:
        """Error of the last test, px; NaN before the first test."""
        return float(self._points["error_px"][-1]) if self._points["error_px"] else math.nan

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return arrays by name, (tests,) each: steps of the training, error_px (mean of the flights), lost flights."""
        return {name: np.array(self._points[name], kind) for name, kind in _CURVE.items()}

    def close(self) -> None:
        """Close the environment of the tests."""
        self._env.close()


@dataclass(frozen=True, slots=True)
class TrainingJob:
    """A training as a job for another process. The attributes are the arguments of `train`."""

    scenario: Scenario | str | Path
    controller: str = "snn"
    steps: int = STEPS
    episode: int | None = None
    seed: int = 0
    settings: Mapping[str, Any] | None = None
    out: Path | None = None

    def run(self, report: Report | None = None) -> Model:
        """Train and return the model."""
        return train(report=report, **{name: getattr(self, name) for name in self.__slots__})


def side_by_side(
    jobs: Sequence[TrainingJob], processes: int | None = None, report: Report | None = None
) -> list[Model]:
    """Run each training in its own process, with the same results as alone; see `neuro.apps.side_by_side`.

    Args:
        jobs: the trainings.
        processes: processes at a time; default the number of cores.
        report: called with the progress of each training.

    Returns:
        The models, in the order of the jobs.

    Raises:
        ModelError: the first error of a job.
    """
    return apps.side_by_side(TrainingJob.run, jobs, processes, report)


_WORDS = {one.name for one in fields(Scenario)}


def apply_changes(scenario: str | Path, controller: str, texts: Sequence[str]) -> tuple[Scenario, dict[str, Any]]:
    """Apply the changes of `--set` to a scenario and to the settings of a controller, and check both.

    Args:
        scenario: name or file of the scenario.
        controller: name of the controller.
        texts: changes "name=value". A name with a dot, or one that only a scenario has, changes the scenario; any other
            name is a setting of the controller.

    Raises:
        ModelError: there is no such scenario, controller or name, or a value is invalid.
    """
    setting_names = set(kind_of(controller).settings.own())
    values = _parse_changes(texts)
    scenario_names = {name for name in values if "." in name or name in _WORDS - setting_names}
    new_scenario = load(scenario, **{name: values[name] for name in values if name in scenario_names})
    settings = {name: values[name] for name in values if name not in scenario_names}
    names = setting_names | _WORDS
    try:
        untrained(new_scenario, controller, 0, None, settings)  # raises errors before any training starts
    except ModelError as error:  # an unknown parameter of the network may be a misspelt setting
        for name in sorted(settings.keys() - names):
            if error.kind.startswith("unknown parameter") and get_close_matches(name, names, 1):
                raise unknown(f"setting of controller '{controller}'", name, names) from None
        raise
    maker = kind_of(controller).maker
    if isinstance(maker, type) and issubclass(maker, Deep):
        needed(controller)
    return new_scenario, settings


def _parse_changes(texts: Sequence[str]) -> dict[str, Any]:
    """Return changes by name. Refuse the scenario's seed, which no command uses."""
    values = assignments(list(texts))
    if "seed" in values:
        raise ModelError("--set seed: it would change nothing", hint="training has --seed; tests have fixed seeds")
    return values


def pilot(model: Path | None, scenario: str | None, controller: str | None, texts: Sequence[str]) -> Model:
    """Load a trained model, or make the model of a controller that does not learn.

    Args:
        model: file of the model.
        scenario: scenario of the flights; default the scenario of the model, or B60 if there is no file.
        controller: name of the controller, if there is no file.
        texts: changes, see `apply_changes`. With a file of a model, only changes of the scenario are allowed.

    Raises:
        ModelError: see `apply_changes`; or the named controller must be trained first.
    """
    if model is None:
        name = controller or ""
        if kind_of(name).learns:
            alternatives = ", ".join(name for name, kind in CONTROLLERS.items() if not kind.learns)
            raise ModelError(
                f"controller '{name}' has to learn first: expected a model, or one of {alternatives}",
                hint=f"neuro drone train --controller {name}",
            )
        world, settings = apply_changes(scenario or "B60", name, texts)
        return train(world, name, settings=settings)
    trained = Model.load(model)
    changes = _parse_changes(texts)
    for name in changes:
        if "." not in name and name not in _WORDS:
            raise ModelError(
                f"--set {name}: the settings of a trained controller stay: expected a word of the scenario",
                hint="'neuro drone train --set' has settings of the controller",
            )
    return replace(trained, scenario=load(trained.scenario if scenario is None else scenario, **changes))
