"""Training: episodes from random starts, saved between them so that it continues after a kill; `--set`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError, apps
from neuro.apps import Checkpoint, assignments, check_output, hdf5, unknown
from neuro_drone.controllers import CONTROLLERS, Learner, kind_of, make, settings_of
from neuro_drone.controllers.deep import Deep, needed
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import flown
from neuro_drone.model import FORMAT, Model, packed
from neuro_drone.parts import Ball, Line, check_whole
from neuro_drone.paths import drawn
from neuro_drone.scenario import Scenario, load

STEPS = 60_000
"""Steps of a training. Source: thesis, table 5."""

EPISODES = {Ball: 100, Line: 1000}
"""Most steps of an episode of training: 20,000 steps then begin at 200 places round the ball, so that all fields learn;
on a line the first corner is 400 steps away."""

KEEP = 2000
"""Steps between two checkpoints, at least."""

TEST_EVERY = 1000
"""Steps of training from one test of frozen weights to the next."""

FLIGHTS, FLIGHT_STEPS = 2, 60
"""Of a test: an eighth of the steps that are learnt from. The first half of a flight is the way to the target."""

TEST_SEED = 2_000_016
"""Of starts, paths and noise: the same in every test, and not those of a training or of `neuro drone test`.

It is the first from 2,000,000 on with which the two balls begin in opposite quarters of the picture, more than 25 px
off on each axis, and the two lines on opposite sides, more than 10 px off, one in each direction.
"""

Arrays = dict[str, npt.NDArray[Any]]
_KINDS = {"steps": np.int64, "error_px": np.float64, "lost": np.bool_}
"""Of the history of a training."""
_CURVE = {"steps": np.int64, "error_px": np.float64, "lost": np.int64}


@dataclass(frozen=True, slots=True)
class TrainingProgress:
    """How far a training is.

    Attributes:
        seed: of the training.
        episode: that has ended, from 0.
        step, steps: done, and all.
        error_px: mean of the episode.
        lost: whether the target was lost.
        frozen_px: mean of the last test with frozen weights; not a number before the first.
    """

    seed: int
    episode: int
    step: int
    steps: int
    error_px: float
    lost: bool
    frozen_px: float = math.nan


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
        episode: most steps of one; it ends before where the target is lost or the lap is over. `EPISODES` says it
            if not given.
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
    scenario, settings = load(scenario), dict(settings or {})
    episode = EPISODES[type(scenario.task)] if episode is None else episode
    check_whole("steps", steps, 1)
    check_whole("episode", episode, 1)
    check_whole("seed", seed, below="2^63")
    learner = make(controller, scenario, seed, settings)
    settings = settings_of(controller, scenario, settings)
    net = getattr(learner, "net", None)
    model = Model(controller, scenario, seed, 0, episode, settings, network={} if net is None else packed(net))
    if kind_of(controller).learns and isinstance(learner, Learner):
        if out is not None and (made := _made(out, model, steps)) is not None:
            return made
        history, curve = _learn(learner, model, steps, out, report)
        model = model.trained(steps, learner.learnt(), history, curve)
    elif isinstance(learner, Learner):
        model = model.trained(0, learner.learnt(), {}, {})
    if out is not None:
        model.save(out)
        _checkpoint(out, model, steps).remove()
    return model


def _checkpoint(out: Path, model: Model, steps: int) -> Checkpoint:
    return Checkpoint(out, "neuro drone training 2", model.told() | {"steps": steps})


def _made(out: Path, model: Model, steps: int) -> Model | None:
    """The finished model of this very training, if it is there; else see that it can be written."""
    if out.is_file():
        made = Model.load(out)
        if made.told() | {"steps": made.steps} == model.told() | {"steps": steps}:
            _checkpoint(out, model, steps).remove()
            return made
    check_output(out, hdf5.kind(FORMAT))
    return None


def _learn(
    learner: Learner, model: Model, steps: int, out: Path | None, report: Report | None
) -> tuple[Arrays, Arrays]:
    """Fly episodes until all steps are done; gives their history, and the tests on the way."""
    checkpoint = None if out is None else _checkpoint(out, model, steps)
    found = checkpoint.resume() if checkpoint else {}
    if found:
        learner.restore(found["state"])
    history: dict[str, list[Any]] = {name: found["history"][name].tolist() if found else [] for name in _KINDS}
    env, curve = DroneEnv(model.scenario), Curve(model.scenario, found.get("curve"))
    done = kept = sum(history["steps"])
    while done < steps:
        index = len(history["steps"])
        count, error_px, lost = _episode(env, learner, (model.seed, index), min(model.episode, steps - done))
        for name, value in zip(_KINDS, (count, error_px, lost), strict=True):
            history[name].append(value)
        done += count
        curve.follow(learner, done)
        if report is not None:
            report(TrainingProgress(model.seed, index, done, steps, error_px, lost, curve.last_px))
        if checkpoint and done - kept >= KEEP and done < steps:
            checkpoint.keep(state=learner.state(), history=_arrays(history), curve=curve.arrays())
            kept = done
    env.close()
    curve.close()
    return _arrays(history), curve.arrays()


def _arrays(history: Mapping[str, list[Any]]) -> Arrays:
    return {name: np.array(history[name], kind) for name, kind in _KINDS.items()}


def _episode(env: DroneEnv, learner: Learner, seed: tuple[int, int], most: int) -> tuple[int, float, bool]:
    """Fly and learn from a drawn start, for so many steps at most; gives the steps, their mean error, and lost."""
    _, start = env.reset(seed=int(np.random.default_rng(seed).integers(2**31)))
    steps, total, lost = 0, 0.0, False
    for info in islice(flown(env, learner, start), most):
        steps, total, lost = steps + 1, total + info["error_px"], info["lost"]
    return steps, total / steps, lost


class Curve:
    """The training curve: how well a controller would fly if it learnt no more; exploration and dopamine hide that.

    It is tested with frozen weights along a training, which neither it nor its randomness is touched by.

    The error is that in the picture, as in the history of a training: of a line that of its column, and where the drone
    climbs that of the ball's place. The other axes tell in the flights that are lost.

    Args:
        scenario: of the training.
        found: what `arrays` gave, to go on from there.
    """

    def __init__(self, scenario: Scenario, found: Mapping[str, npt.NDArray[Any]] | None = None) -> None:
        self._env, self._line = DroneEnv(scenario), scenario.kind == "line"
        self._points: dict[str, list[Any]] = {name: found[name].tolist() if found else [] for name in _CURVE}

    def follow(self, learner: Learner, done: int) -> None:
        """Test once if a test was due since the last.

        Args:
            learner: as it is after so many steps.
            done: steps of the training.
        """
        last = self._points["steps"][-1] if self._points["steps"] else 0
        if done // TEST_EVERY == last // TEST_EVERY:
            return
        pilot = learner.frozen()
        errors, lost = zip(*(self._fly(pilot, index) for index in range(FLIGHTS)), strict=True)
        for name, value in zip(_CURVE, (done, float(np.mean(errors)), sum(lost)), strict=True):
            self._points[name].append(value)

    def _fly(self, pilot: Any, index: int) -> tuple[float, bool]:
        """Mean error of the second half of a flight, and whether the target was lost; then the last error stays."""
        rng = np.random.default_rng((TEST_SEED, index))
        _, start = self._env.reset(seed=int(rng.integers(2**31)), options={"path": drawn(rng, self._line)})
        infos = list(islice(flown(self._env, pilot, start), FLIGHT_STEPS))
        errors = [info["error_px"] for info in infos]
        errors += errors[-1:] * (FLIGHT_STEPS - len(errors))
        return float(np.mean(errors[FLIGHT_STEPS // 2 :])), infos[-1]["lost"]

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
        made = make(controller, changed, 0, settings)  # mistakes are reported before any work
    except ModelError as error:  # a name that is none of the network's parameters may be meant for a setting
        for name in sorted(settings.keys() - known):
            if error.kind.startswith("unknown parameter") and get_close_matches(name, known, 1):
                raise unknown(f"setting of controller '{controller}'", name, known) from None
        raise
    if isinstance(made, Deep):
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
