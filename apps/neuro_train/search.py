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
        folds: of each the indices to learn from, and those to test on.
        plan: settings of each training.
        backends: to test on, beside what learnt.
        out: of the networks: fold 1 of trained.yaml is trained-1.yaml, with its figures in trained-1.json.
        report: called with how far it is.

    Returns:
        Of each fold `n`, `right` by backend, `equal` decisions by backend, overflows and joules by chip, `room` in
        registers, and seconds of one core.
    """

    def of_fold(k: int, parts: Fold) -> dict[str, Any]:
        name = f"fold {k + 1} of {len(folds)}"
        own = out.with_name(f"{out.stem}-{k + 1}{out.suffix}")
        file = own.with_suffix(".json")
        of = identity(net, samples, plan) | {"fold": name, "backends": list(backends)}
        if result := FOLD_RESULTS.read(file, of):
            return result
        checkpoint, unseen = training_checkpoint(net, own, samples, plan, name), samples.take(parts[1])

        def tell(epoch: int, figures_of_epoch: Mapping[str, float]) -> None:
            report(f"{name}: learning, {figures_of_epoch.get('right', 0.0):.1%} right", epoch, plan.epochs)

        trained, room, tests = train_and_test(
            net, own, samples.take(parts[0]), unseen, plan, backends, backends, checkpoint, tell
        )
        figures = {
            "n": len(unseen),
            "cpu_s": trained.cpu_s,
            "right": {one.backend: one.own.correct for one in tests},
            "equal": {one.backend: one.agrees(tests[0]) for one in tests},
            "same_spikes": {one.backend: one.same_spikes(tests[0]) for one in tests},
            "overflows": {one.backend: one.overflows for one in tests if one.overflows},
            "room": [asdict(one) for one in room],
            "sent": {one.backend: one.mean_spikes for one in tests if one.mean_spikes},
            "bills": {one.backend: one.bill.as_dict() for one in tests if one.bill},
        }
        result = FOLD_RESULTS.write(file, of, figures)
        checkpoint.remove()
        return result

    return [of_fold(k, parts) for k, parts in enumerate(folds)]


Space = dict[str, list[Any]]
"""Values to choose from, by name."""

OF_PLAN = (
    "prune", "rate", "decay", "slope", "temperature", "warp", "mirror", "epochs", "batch", "bits", "neurons_per_core",
)  # fmt: skip
"""Words of a plan that may vary, beside `for`, its duration."""

STEPS = (1, 2, 4)
SHARES = (0.25, 0.5, 0.75, 1.0)
HIDDEN = (0.125, 0.25, 0.5, 1.0)
PRUNE = (0.0, 0.25, 0.5, 0.75)
EXAMPLE = "--search step,for,hidden=16:64,prune"


def space(text: str, net: neuro.Network, plan: TrainingPlan, parameters: Mapping[str, Any]) -> Space:
    """Read what varies.

    Args:
        text: names with commas between them, each with its values after "=" and ":" between these: `step` (ms),
            `for` (ms), words of a plan, and parameters of the network's file. `step`, `for`, `hidden` and
            `prune` have values if none are given: the network's step and 2 and 4 times it, quarters of the plan's
            duration in whole steps of all, 1/8 to the whole of the hidden layer, and nothing to three quarters pruned.
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
    point_space: Space = {name: values or _usual(name, steps, plan, parameters) for name, values in choices.items()}
    for duration in point_space.get("for", [plan.duration]):
        for step in steps:
            if abs(duration / step - round(duration / step)) > 1e-9:
                message = f"--search: a duration of {duration:g} ms is no whole number of steps of {step:g} ms"
                raise ModelError(f"{message}: expected multiples of all steps", hint="for=50:100,step=5:10")
    return {name: list(dict.fromkeys(values)) for name, values in point_space.items()}


def parted(point: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split a point into parameters of the network's file and settings of the plan."""
    words = {"for", *(field.name for field in fields(TrainingPlan))}
    of_plan = {"duration" if name == "for" else name: value for name, value in point.items() if name in words}
    of_file = {"resolution" if name == "step" else name: value for name, value in point.items() if name not in words}
    return of_file, of_plan


def _number(name: str, text: str) -> float | int:
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"--search {name}={text}: expected numbers with ':' between them", hint=EXAMPLE) from None


def _usual(name: str, steps: list[Any], plan: TrainingPlan, parameters: Mapping[str, Any]) -> list[Any]:
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
    raise ModelError(f"--search {name}: expected its values", hint=f"--search {name}=1:2:4")


PARTS = 5
"""In how many parts recordings are divided, where no folds are asked for: one is held out, one judges."""

Ints = npt.NDArray[np.int64]

RESULTS = JobResults("a result of 'neuro train --search'", "neuro train point 1")
OBJECTIVES = {"accuracy": "maximise", "microjoules": "minimise"}


def check_optuna() -> None:
    """Refuse to begin without Optuna.

    Raises:
        ModelError: it is not installed.
    """
    from importlib.util import find_spec

    if find_spec("optuna") is None:
        raise ModelError("neuro train --search asks Optuna, which is not installed", hint=install("tune"))


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
    """Train `budget` networks, and the best of them anew.

    Args:
        file: of the network.
        data: the recordings.
        part: of recordings in parts.
        without: patterns of names that are left out.
        plan: settings of every training that do not vary.
        params: of the file, that do not vary.
        space: what varies.
        budget: how many networks.
        folds: of how many trainings a trial is made; of one if not given.
        folder: where all is kept.
        say: called with which network of the front learns anew.

    Returns:
        All points, those of the front tested on what is held out; by joules.

    Raises:
        ModelError: the folder is of another search, or nothing could be trained.
    """
    words: dict[str, Any] = {"file": str(file), "data": str(data), "part": part, "without": json.dumps(without)}
    words |= {"folder": str(folder), "plan": json.dumps(plan.as_words()), "params": json.dumps(dict(params))}
    _recordings.cache_clear()  # of a search before in this process
    words |= {"recordings": _recordings(str(data), part, words["without"]).fingerprint()[:32]}
    words |= {"network": fingerprint(module_of(neuro.load(file, params=params), plan).program)}
    tuning = neuro.tune(
        point, space, objectives=OBJECTIVES, trials=budget, out=folder, sampler="tpe", draw=plan.seed,
        folds=folds, set=words, on="here",
    )  # fmt: skip
    best = {trial.number for trial in tuning.best()}
    if not best:
        failed = next((trial.error for trial in tuning.trials() if trial.error), "no trial is done")
        raise ModelError(f"{folder}: no network could be trained: {failed}")
    places, names = list[FrontPlace](), set[str]()
    for trial in [trial for trial in tuning.trials() if trial.values is not None]:
        name = _name(trial.point)
        if name in names:
            continue
        names.add(name)
        tested = {}
        if trial.number in best:
            say(f"learning the front anew: {sum(each.tested is not None for each in places) + 1} of {len(best)}")
            tested = point(**words, **trial.point, fold=None, folds=folds or PARTS - 1)
        where = folder / ("front" if tested else "points") / f"{name}.yaml"
        values = trial.values or (float("nan"),) * 2
        places.append(FrontPlace(trial.point, values[0], values[1], where, tested or None))
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
        file: as of `search`.
        data: likewise.
        part: likewise.
        without: likewise, as JSON.
        folder: likewise.
        plan: likewise, as JSON.
        params: likewise, as JSON.
        recordings: a hash of what they are, so that no search goes on with others.
        network: likewise, of the file with `params`.
        fold: of the parts on which it is judged; None: on what is held out, learnt from all others.
        folds: in how many parts that is divided which is not held out.
        varied: values by name.

    Returns:
        `accuracy` on the chip, `microjoules` of a recording on it, as fast as it can, and all others of `SPENT`, how
        many are `right` of `n`, and `cpu_s`.
    """
    of_file, of_plan = parted(varied)
    settings = TrainingPlan(**{**json.loads(plan), **of_plan})
    net = neuro.load(file, params={**json.loads(params), **of_file})
    is_held_out = fold is None
    out = Path(folder) / ("front" if is_held_out else "points") / f"{_name(varied)}.yaml"
    if fold:
        out = out.with_name(f"{out.stem}_fold{fold}.yaml")
    make_folder(out.parent)
    source = _recordings(data, part, without)
    samples = show(net, source, settings, lambda what, count, total: None)
    learnt_from, judged = divided(source, settings.seed, fold, folds)
    which = f"part {'held out' if is_held_out else fold} of {folds + 1}"
    of = identity(net, samples, settings) | {"part": which, "varied": dict(varied)}
    result_file = out.with_suffix(".json")
    if (result := RESULTS.read(result_file, of)) and out.exists():
        return {str(name): float(value) for name, value in result["found"].items()}
    mine = samples.take(learnt_from)
    checkpoint = training_checkpoint(net, out, mine, settings, which)
    trained = learn(net, mine, settings, checkpoint)
    trained.net.save(out)
    room = rooms(trained.net, settings.chip, mine, settings)
    test = on_backend(trained.net, settings.chip, samples.take(judged), settings, room=room)
    warn_of_overflows(settings.chip, test.overflows, len(judged))
    if test.bill is None:
        raise ModelError(f"{settings.chip}: has no costs: expected a chip that has")
    each = [joules for bill in (test.bill, test.bill.real_time) for joules in (bill.total_j, bill.low_j, bill.high_j)]
    figures = {"accuracy": test.own.accuracy, **{name: 1e6 * joules for name, joules in zip(SPENT, each, strict=True)}}
    figures |= {"right": float(test.own.correct), "n": float(len(judged)), "cpu_s": trained.cpu_s}
    RESULTS.write(result_file, of, {"found": figures})
    checkpoint.remove()
    return figures


def divided(recordings: Recordings, seed: int, fold: int | None, folds: int) -> tuple[Ints, Ints]:
    """Return the indices of the recordings for training and of those for the test."""
    parts = [tested for _, tested in recordings.folds(folds + 1, seed=seed)]
    held_out = parts.pop()
    if fold is None:
        return np.sort(np.concatenate(parts)), held_out
    judged = parts.pop(fold)
    return np.sort(np.concatenate(parts)), judged


@cache
def _recordings(data: str, part: str, without: str) -> Recordings:
    from neuro_events import recordings

    return leaving_out(recordings(Path(data), part=part), json.loads(without))


def _name(varied: Mapping[str, Any]) -> str:
    return "_".join(f"{name}{value:g}" for name, value in varied.items())
