"""Several trainings of one network: cross-validation, and a search for accuracy against joules on a chip.

A search uses `neuro.tune`; the networks of its front are trained again and tested. Recordings are divided in parts.
The last part is held out: only the front is tested on it, once, after training on all other parts. A trial is
judged on one other part and trains on the rest. The varied values are a text such as "step,for,hidden=16:64,prune".

FOLDER/tune.json, journal.log, runs    of `neuro.tune`
FOLDER/points/NAME.yaml                network of each trial
FOLDER/front/NAME.yaml                 networks of the front, trained on all parts but the held-out one
FOLDER/front.csv, front.png            table and figure
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro import ModelError
from neuro.apps import JobResults, fingerprint, install, make_folder, unknown, warn_of_overflows
from neuro_train.data import BatchData, leaving_out, show
from neuro_train.plan import TrainingPlan
from neuro_train.telling import SPENT, FrontPlace
from neuro_train.tested import on_backend, rooms, train_and_test
from neuro_train.trainer import identity, learn, module_of, training_checkpoint

if TYPE_CHECKING:
    from neuro_events import Recordings


FOLD_RESULTS = JobResults("a result of 'neuro train --folds'", "neuro train fold 1")

Fold = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]
"""Indices of the recordings to learn from, and of the recordings to test on."""


def cross_validate(
    net: neuro.Network,
    samples: BatchData,
    folds: Sequence[Fold],
    plan: TrainingPlan,
    backends: Sequence[str],
    out: Path,
    report: Callable[[str, int, int], None],
) -> list[dict[str, Any]]:
    """Train and test each fold.

    Args:
        net: the network.
        samples: all recordings.
        folds: indices to learn from and to test on, for each fold.
        plan: settings of each training.
        backends: backends to test on, beside the trained module.
        out: file of the networks: fold 1 of trained.yaml is trained-1.yaml, with its figures in trained-1.json.
        report: called with the activity, the finished and the total number of its units.

    Returns:
        For each fold, `n`, `right` by backend, the share of `equal` decisions by backend, overflows and joules by chip,
        `room` in registers, and seconds of one core.
    """

    def run_fold(k: int, parts: Fold) -> dict[str, Any]:
        name = f"fold {k + 1} of {len(folds)}"
        network = out.with_name(f"{out.stem}-{k + 1}{out.suffix}")
        file = network.with_suffix(".json")
        conditions = identity(net, samples, plan) | {"fold": name, "backends": list(backends)}
        if result := FOLD_RESULTS.read(file, conditions):
            return result
        checkpoint, unseen = training_checkpoint(net, network, samples, plan, name), samples.take(parts[1])

        def tell(epoch: int, figures_of_epoch: Mapping[str, float]) -> None:
            report(f"{name}: learning, {figures_of_epoch.get('right', 0.0):.1%} right", epoch, plan.epochs)

        trained, room, tests = train_and_test(
            net, network, samples.take(parts[0]), unseen, plan, backends, backends, checkpoint, tell
        )
        figures = {
            "n": len(unseen),
            "cpu_s": trained.cpu_s,
            "right": {test.backend: test.own.correct for test in tests},
            "equal": {test.backend: test.agrees(tests[0]) for test in tests},
            "same_spikes": {test.backend: test.same_spikes(tests[0]) for test in tests},
            "overflows": {test.backend: test.overflows for test in tests if test.overflows},
            "room": [asdict(row) for row in room],
            "sent": {test.backend: test.mean_spikes for test in tests if test.mean_spikes},
            "bills": {test.backend: test.bill.as_dict() for test in tests if test.bill},
        }
        result = FOLD_RESULTS.write(file, conditions, figures)
        checkpoint.remove()
        return result

    return [run_fold(k, parts) for k, parts in enumerate(folds)]


Space = dict[str, list[Any]]
"""Values to try, by name."""

OF_PLAN = (
    "prune", "rate", "decay", "slope", "temperature", "warp", "mirror", "epochs", "batch", "bits", "neurons_per_core",
)  # fmt: skip
"""Settings of a plan that a search may vary, beside `for`, the duration."""

STEPS = (1, 2, 4)
SHARES = (0.25, 0.5, 0.75, 1.0)
HIDDEN = (0.125, 0.25, 0.5, 1.0)
PRUNE = (0.0, 0.25, 0.5, 0.75)
EXAMPLE = "--search step,for,hidden=16:64,prune"


def space(text: str, net: neuro.Network, plan: TrainingPlan, parameters: Mapping[str, Any]) -> Space:
    """Read the varied values of a search.

    Args:
        text: names and values, as in "step=1:2,hidden=16:64". A name is `step` (ms), `for` (ms), a setting of a plan or
            a parameter of the network's file. Four names have default values: `step` 1, 2 and 4 times the network's
            step; `for` 1/4 to the whole of the plan's duration, in whole steps; `hidden` 1/8 to the whole of the
            layer; `prune` 0 to 3/4.
        net: the network.
        plan: settings of every training that do not vary.
        parameters: the parameters of the network's file.

    Raises:
        ModelError: a name is unknown, a value is NaN, or a duration is not a whole number of steps.
    """
    choices: dict[str, list[float | int]] = {}
    for part in text.split(","):
        name, equals, values_text = part.strip().partition("=")
        if not name or (equals and not values_text):
            raise ModelError(f"--search {part}: expected NAME or NAME=VALUE:VALUE", hint=EXAMPLE)
        choices[name] = [_number(name, value) for value in values_text.split(":")] if values_text else []
    names = ["step", "for", *OF_PLAN, *(name for name in parameters if name != "resolution")]
    for name in choices:
        if name not in names:
            raise unknown("parameter of --search", name, names)
    if "step" in choices and "resolution" not in parameters:
        message = "--search step: the network's file has no parameter 'resolution'"
        raise ModelError(f"{message}: expected one, as 'neuro train dense' has")
    steps = choices.get("step") or [net.resolution * k for k in STEPS] if "step" in choices else [net.resolution]
    point_space: Space = {
        name: values or _default_values(name, steps, plan, parameters) for name, values in choices.items()
    }
    for duration in point_space.get("for", [plan.duration]):
        for step in steps:
            if abs(duration / step - round(duration / step)) > 1e-9:
                message = f"--search: a duration of {duration:g} ms is not a whole number of steps of {step:g} ms"
                raise ModelError(f"{message}: expected multiples of all steps", hint="e.g. for=50:100,step=5:10")
    return {name: list(dict.fromkeys(values)) for name, values in point_space.items()}


def parted(point: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split a point into parameters of the network's file and settings of the plan."""
    settings = {"for", *(field.name for field in fields(TrainingPlan))}
    options = {"duration" if name == "for" else name: value for name, value in point.items() if name in settings}
    network = {"resolution" if name == "step" else name: value for name, value in point.items() if name not in settings}
    return network, options


def _number(name: str, text: str) -> float | int:
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"--search {name}={text}: expected numbers with ':' between them", hint=EXAMPLE) from None


def _default_values(name: str, steps: list[Any], plan: TrainingPlan, parameters: Mapping[str, Any]) -> list[Any]:
    """Return the default values of a searched parameter."""
    if name == "step":
        return steps
    if name == "for":
        coarse = max(steps)
        return [max(1, int(plan.duration * share / coarse + 1e-9)) * coarse for share in SHARES]
    if name == "hidden":
        return [max(1, round(parameters["hidden"] * share)) for share in HIDDEN]
    if name == "prune":
        return list(PRUNE)
    raise ModelError(f"--search {name}: expected values", hint=f"e.g. --search {name}=1:2:4")


PARTS = 5
"""Number of parts of the recordings without `folds`: one is held out, and one judges a trial."""

Ints = npt.NDArray[np.int64]

RESULTS = JobResults("a result of 'neuro train --search'", "neuro train point 1")
OBJECTIVES = {"accuracy": "maximise", "microjoules": "minimise"}


def check_optuna() -> None:
    """Check that Optuna is installed.

    Raises:
        ModelError: Optuna is not installed.
    """
    from importlib.util import find_spec

    if find_spec("optuna") is None:
        raise ModelError("neuro train --search needs Optuna, which is not installed", hint=install("tune"))


def search(
    file: Path,
    data: Path,
    part: str,
    without: list[str],
    plan: TrainingPlan,
    params: Mapping[str, Any],
    space: Space,
    budget: int,
    folds: int | None,
    folder: Path,
    say: Callable[[str], None],
) -> list[FrontPlace]:
    """Train `budget` networks, and train the best of them again.

    Args:
        file: file of the network.
        data: path of the recordings.
        part: name of a part of the recordings.
        without: patterns of the names of recordings to leave out.
        plan: settings of every training that do not vary.
        params: parameters of the network's file that do not vary.
        space: varied values by name.
        budget: number of networks.
        folds: number of trainings of a trial; by default one.
        folder: folder for all results.
        say: called with the number of the network of the front that is trained again.

    Returns:
        All points, sorted by joules. Only the points of the front are tested on the held-out recordings.

    Raises:
        ModelError: the folder belongs to another search, or no network could be trained.
    """
    fixed: dict[str, Any] = {"file": str(file), "data": str(data), "part": part, "without": json.dumps(without)}
    fixed |= {"folder": str(folder), "plan": json.dumps(plan.as_words()), "params": json.dumps(dict(params))}
    _recordings.cache_clear()  # an earlier search of this process may have filled it
    fixed |= {"recordings": _recordings(str(data), part, fixed["without"]).fingerprint()[:32]}
    fixed |= {"network": fingerprint(module_of(neuro.load(file, params=params), plan).program)}
    tuning = neuro.tune(
        point, space, objectives=OBJECTIVES, trials=budget, out=folder, sampler="tpe", draw=plan.seed,
        folds=folds, set=fixed, on="here",
    )  # fmt: skip
    front = {trial.number for trial in tuning.best()}
    if not front:
        reason = next((trial.error for trial in tuning.trials() if trial.error), "no trial is done")
        raise ModelError(f"{folder}: no network could be trained: {reason}")
    places, names = list[FrontPlace](), set[str]()
    for trial in [trial for trial in tuning.trials() if trial.values is not None]:
        name = _name(trial.point)
        if name in names:
            continue
        names.add(name)
        tested = {}
        if trial.number in front:
            say(f"training the front again: {sum(place.tested is not None for place in places) + 1} of {len(front)}")
            tested = point(**fixed, **trial.point, fold=None, folds=folds or PARTS - 1)
        network = folder / ("front" if tested else "points") / f"{name}.yaml"
        values = trial.values or (float("nan"),) * 2
        places.append(FrontPlace(trial.point, values[0], values[1], network, tested or None))
    return sorted(places, key=lambda place: place.microjoules)


def point(
    file: str,
    data: str,
    part: str,
    without: str,
    folder: str,
    plan: str,
    params: str,
    recordings: str,
    network: str,
    fold: int | None = 0,
    folds: int = PARTS - 1,
    **varied: Any,
) -> dict[str, float]:
    """Train and test a network of a search, unless its result exists.

    Args:
        file: see `search`.
        data: see `search`.
        part: see `search`.
        without: see `search`, as JSON.
        folder: see `search`.
        plan: see `search`, as JSON.
        params: see `search`, as JSON.
        recordings: hash of the recordings, so that a search does not resume with other recordings.
        network: hash of the network with `params`, for the same purpose.
        fold: index of the part that judges the network; None trains on all parts and tests on the held-out one.
        folds: number of parts without the held-out one.
        varied: values by name.

    Returns:
        `accuracy` on the chip, the figures of `SPENT`, the number of `right` decisions, `n`, and `cpu_s`.
    """
    parameters, plan_settings = parted(varied)
    settings = TrainingPlan(**{**json.loads(plan), **plan_settings})
    net = neuro.load(file, params={**json.loads(params), **parameters})
    is_held_out = fold is None
    network_file = Path(folder) / ("front" if is_held_out else "points") / f"{_name(varied)}.yaml"
    if fold:
        network_file = network_file.with_name(f"{network_file.stem}_fold{fold}.yaml")
    make_folder(network_file.parent)
    source = _recordings(data, part, without)
    samples = show(net, source, settings, lambda what, count, total: None)
    training, test_indices = divided(source, settings.seed, fold, folds)
    part_name = f"part {'held out' if is_held_out else fold} of {folds + 1}"
    conditions = identity(net, samples, settings) | {"part": part_name, "varied": dict(varied)}
    result_file = network_file.with_suffix(".json")
    if (result := RESULTS.read(result_file, conditions)) and network_file.exists():
        return {str(name): float(value) for name, value in result["found"].items()}
    trained_on = samples.take(training)
    checkpoint = training_checkpoint(net, network_file, trained_on, settings, part_name)
    trained = learn(net, trained_on, settings, checkpoint)
    trained.net.save(network_file)
    room = rooms(trained.net, settings.chip, trained_on, settings)
    test = on_backend(trained.net, settings.chip, samples.take(test_indices), settings, room=room)
    warn_of_overflows(settings.chip, test.overflows, len(test_indices))
    if test.bill is None:
        raise ModelError(f"{settings.chip}: has no costs: expected a chip with costs")
    bill_j = [joules for bill in (test.bill, test.bill.real_time) for joules in (bill.total_j, bill.low_j, bill.high_j)]
    figures = {"accuracy": test.own.accuracy, **{name: 1e6 * j for name, j in zip(SPENT, bill_j, strict=True)}}
    figures |= {"right": float(test.own.correct), "n": float(len(test_indices)), "cpu_s": trained.cpu_s}
    RESULTS.write(result_file, conditions, {"found": figures})
    checkpoint.remove()
    return figures


def divided(recordings: Recordings, seed: int, fold: int | None, folds: int) -> tuple[Ints, Ints]:
    """Return the indices of the recordings for training, and of the recordings for the test."""
    parts = [test_indices for _, test_indices in recordings.folds(folds + 1, seed=seed)]
    held_out = parts.pop()
    if fold is None:
        return np.sort(np.concatenate(parts)), held_out
    test_indices = parts.pop(fold)
    return np.sort(np.concatenate(parts)), test_indices


@cache
def _recordings(data: str, part: str, patterns: str) -> Recordings:
    from neuro_events import recordings

    return leaving_out(recordings(Path(data), part=part), json.loads(patterns))


def _name(varied: Mapping[str, Any]) -> str:
    return "_".join(f"{name}{value:g}" for name, value in varied.items())
