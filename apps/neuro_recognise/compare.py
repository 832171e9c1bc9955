"""Methods side by side on one data set: every fold trained and tested, kept in a folder, and shown as a table.

FOLDER/METHOD-SEED-FOLD.json    decisions and times of a fold, and of the first one bills; what is there is not done
                                again by the same code
FOLDER/table.md, compare.html   all that is there
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import (
    Evaluation,
    Unwritable,
    check_output,
    evaluate,
    find_backend,
    kept_json,
    make_folder,
    provenance,
    sealed,
    side_by_side,
    write_text,
)
from neuro.events import EventFileError, Recordings
from neuro_recognise.code import code_of
from neuro_recognise.evaluate import price
from neuro_recognise.method import Answer, Method, Progress, choose
from neuro_recognise.methods import METHODS, method_of
from neuro_recognise.observations import observe
from neuro_recognise.recogniser import field_of, learn
from neuro_recognise.shown import Features, Ints

FORMAT = "neuro recognise fold 1"
RESULT = sealed("a result of 'neuro recognise compare'", f'"format": "{FORMAT}"', ', "digest": "{}"')
TIMED = 20
"""Recordings that are observed anew to measure how long that takes."""


@dataclass(frozen=True, slots=True)
class Contestant:
    """A method with its settings.

    Attributes:
        name: in the table: the method's and what differs from its defaults.
        method: with its settings.
    """

    name: str
    method: Method


@dataclass(frozen=True, slots=True)
class MethodComparison:
    """What is to be compared.

    Attributes:
        contestants: rows of the table.
        folds: of each seed.
        seeds: of folds and trainings.
        targets: chips and processors for which networks are priced.
        folder: where results are kept.
        backend: runs networks; other methods need none.
        jobs: folds that are done at the same time; as many as there are cores if None.
    """

    contestants: tuple[Contestant, ...]
    folds: int
    seeds: tuple[int, ...]
    targets: tuple[str, ...]
    folder: Path
    backend: str = "event"
    jobs: int | None = None

    def runs(self, method: Method) -> str:
        """What a method is run on; "event", which is not asked, for one without a network."""
        return self.backend if method.spikes else "event"


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """What came of a method.

    Attributes:
        contestant: the method.
        of_seeds: an evaluation of all recordings for each seed, each by what was learnt from the other folds.
        votes: likewise by other ways of reading, by name.
        observe_ms: to look at a recording.
        train_s: to learn from the other folds, mean of the folds.
        answer_ms: to decide on what was looked at, a recording.
        bills: by target what a recording takes on it, or why it cannot be priced, as plain data; None without a
            network.
        refused: why it could not be run at all, "" if it could.
    """

    contestant: Contestant
    of_seeds: tuple[Evaluation, ...] = ()
    votes: Mapping[str, tuple[Evaluation, ...]] | None = None
    observe_ms: float = float("nan")
    train_s: float = float("nan")
    answer_ms: float = float("nan")
    bills: Mapping[str, Any] | None = None
    refused: str = ""

    @property
    def accuracy(self) -> float:
        """Mean over the seeds; NaN where it could not be run."""
        return float(np.mean([one.accuracy for one in self.of_seeds])) if self.of_seeds else float("nan")

    @property
    def spread(self) -> float:
        """Standard deviation between the seeds; NaN of a single one."""
        found = [one.accuracy for one in self.of_seeds]
        return float(np.std(found, ddof=1)) if len(found) > 1 else float("nan")


def contestants(names: Sequence[str] = ()) -> tuple[Contestant, ...]:
    """Methods by name.

    Args:
        names: a method's, or with one of its presets, ``hats:poker``; all methods if there are none.

    Raises:
        ModelError: there is no such method or preset.
    """
    asked = (name.partition(":") for name in names or METHODS)
    return tuple(Contestant(name + colon + preset, method_of(name, preset)) for name, colon, preset in asked)


def compare(data: Recordings, plan: MethodComparison, report: Callable[[Progress], None]) -> list[Compared]:
    """Train and test all; what is in the folder already is not done again.

    Folds are done side by side in processes of their own, see `neuro.apps.side_by_side`.

    Args:
        data: labelled recordings.
        plan: what to compare.
        report: called with the progress.

    Returns:
        What came of each method, in the order of the plan.

    Raises:
        EventFileError: a recording is damaged, or all are of one class.
        ModelError: there is no such backend, a file in the folder is not ours, or there are too few recordings.
    """
    find_backend(plan.backend)
    field, folds = field_of(data), {seed: data.folds(plan.folds, seed=seed) for seed in plan.seeds}
    make_folder(plan.folder)
    fingerprint = data.fingerprint()

    def looked(one: Contestant) -> tuple[Contestant, Features | str]:
        """A method that fits the recordings, and what they show to it; or why it cannot be run."""

        def look(done: int, n: int) -> None:
            report(Progress(f"{one.name}: looking", done, n))

        try:
            fitting = Contestant(one.name, one.method.fitting(field))
            return fitting, observe(fitting.method, data, fingerprint=fingerprint, report=look)
        except (EventFileError, Unwritable):
            raise
        except ModelError as error:
            return one, _reason(error)

    def compared(one: Contestant, shown: Features | str, runs: Sequence[Mapping[str, Any]]) -> Compared:
        """One that cannot be run, as its extra is missing or the recordings do not suit it, says so."""
        refused = shown if isinstance(shown, str) else next((each["refused"] for each in runs if "refused" in each), "")
        if refused or isinstance(shown, str):
            return Compared(one, refused=refused)
        return _summary(one, runs, shown, plan, _observing_ms(one.method, data))

    seen = [looked(one) for one in plan.contestants]
    jobs = [
        [_fold_of(one, shown, fingerprint[:32], (seed, k), parts, plan) for seed in plan.seeds
         for k, parts in enumerate(folds[seed])] if isinstance(shown, Features) else []
        for one, shown in seen
    ]  # fmt: skip
    results = iter(_told(list(chain(*jobs)), plan.jobs, report))
    return [compared(*one, list(islice(results, len(mine)))) for one, mine in zip(seen, jobs, strict=True)]


def _reason(error: ModelError) -> str:
    """What is wrong in one line, without the way out."""
    return ": ".join(one.alone() for one in (error, *error.others))


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """A training and its test.

    Attributes:
        name: for people.
        method: with its settings.
        shown: what all recordings show to it.
        others, mine: recordings to learn from, and to test.
        of: what its result is of, as plain data.
        backend: runs networks.
        targets: for which it is priced.
        file: of its result.
    """

    name: str
    method: Method
    shown: Features
    others: Ints
    mine: Ints
    of: Mapping[str, Any]
    backend: str
    targets: tuple[str, ...]
    file: Path

    def kept(self) -> dict[str, Any]:
        """Its result, if it is there; else nothing."""
        kept = kept_json(self.file)
        there = kept.get("of") == json.loads(json.dumps(self.of)) and _priced(kept, self.targets)
        return kept if there else {}

    def run(self, report: Callable[[_Said], None]) -> dict[str, Any]:
        """Train and test; gives the result as plain data, or why it cannot be run."""
        check_output(self.file, RESULT)
        try:
            kept = self._learnt_and_tested(report)
        except (EventFileError, Unwritable):
            raise
        except ModelError as error:
            kept = {"refused": _reason(error)}
        else:
            write_text(self.file, json.dumps(kept, indent=1), RESULT)
        report((self.name, None))
        return kept

    def _learnt_and_tested(self, report: Callable[[_Said], None]) -> dict[str, Any]:
        began = time.process_time()
        made = learn(
            self.method, self.shown.take(self.others), self.of["data"], seed=self.of["seed"], backend=self.backend,
            report=lambda progress: report((self.name, progress)),
        )  # fmt: skip
        trained = time.process_time()
        answer = made.answer_shown(self.shown.take(self.mine), self.backend)
        ended = time.process_time()
        decided = {vote: choose(scores).tolist() for vote, scores in answer.votes.items()}
        record = provenance(backend=self.backend, seed=self.of["seed"])
        kept = {"format": FORMAT, "of": dict(self.of), "provenance": record, "tested": self.mine.tolist()}
        kept |= {"decided": choose(answer.scores).tolist(), "votes": decided}
        kept |= {"train_s": trained - began, "answer_ms": 1000.0 * (ended - trained) / len(self.mine)}
        return kept | {"bills": _bills(answer, len(self.mine), self.targets)}


_Said = tuple[str, Progress | None]
"""A fold, and how far it is; None when it is done."""


def _fold_of(
    contestant: Contestant,
    shown: Features,
    digest: str,
    which: tuple[int, int],
    parts: tuple[Ints, Ints],
    plan: MethodComparison,
) -> Fold:
    (seed, fold), method = which, contestant.method
    backend, targets = plan.runs(method), plan.targets if which == (plan.seeds[0], 0) else ()
    of: dict[str, Any] = {"method": method.called(), "settings": method.as_words(), "code": code_of(method)}
    of |= {"data": digest, "backend": backend, "seed": seed, "fold": fold, "folds": plan.folds}
    name = f"{contestant.name}, seed {seed}, fold {fold + 1} of {plan.folds}"
    file = plan.folder / f"{contestant.name.replace(':', '-').replace('/', '_')}-{seed}-{fold}.json"
    return Fold(name, method, shown, *parts, of, backend, targets, file)


def _told(folds: Sequence[Fold], processes: int | None, report: Callable[[Progress], None]) -> list[dict[str, Any]]:
    """The results of all folds; those that are not there are done now, side by side."""
    kept = {number: found for number, fold in enumerate(folds) if (found := fold.kept())}
    left = [number for number in range(len(folds)) if number not in kept]
    done = len(kept)

    def tell(said: _Said) -> None:
        nonlocal done
        name, progress = said
        done += progress is None
        alone = Progress("", done, len(folds)) if progress is None else progress
        among = (done, len(folds)) if len(folds) > 1 else None
        report(replace(alone, what=f"{name}: {alone.what}" if alone.what else name, among=among))

    for number, found in zip(left, side_by_side(Fold.run, [folds[k] for k in left], processes, tell), strict=True):
        kept[number] = found
    return [kept[number] for number in range(len(folds))]


def _bills(answer: Answer, recordings: int, targets: Iterable[str]) -> dict[str, Any] | None:
    """By target joules and seconds of a recording, or why it cannot be priced; None without a network."""
    if answer.run is None:
        return None
    bills: dict[str, Any] = {}
    run = answer.run()
    for target in targets:
        try:
            priced = price(run, recordings, [target], answer.neurons_per_core, answer.duration_s)
            bills |= {name: bill.as_dict() for name, bill in priced.bills.items()}
            bills |= {name: {"refused": why} for name, why in priced.refused.items()}
        except ModelError as error:
            bills[target] = {"refused": _reason(error)}
    return bills


def _priced(kept: Mapping[str, Any], targets: Iterable[str]) -> bool:
    """Return whether a result has a bill for each target, if it has any, and not one of an earlier form."""
    bills = kept["bills"]
    return bills is None or all({"missing", "refused"} & set(bills.get(target, ())) for target in targets)


def _observing_ms(method: Method, data: Recordings) -> float:
    """How long a recording is looked at, measured anew on some, after one that compiles what is needed."""
    events = [item.load() for item in data[:TIMED]]
    method.observe(events[0])
    began = time.process_time()
    for one in events:
        method.observe(one)
    return 1000.0 * (time.process_time() - began) / len(events)


def _summary(
    contestant: Contestant,
    results: Sequence[Mapping[str, Any]],
    shown: Features,
    plan: MethodComparison,
    observe_ms: float,
) -> Compared:
    """What came of all folds."""
    seeds = [[one for one in results if one["of"]["seed"] == seed] for seed in plan.seeds]

    def of_seed(parts: Sequence[Mapping[str, Any]], vote: str = "") -> Evaluation:
        decided = np.full(len(shown), -1, np.int64)
        for part in parts:
            decided[part["tested"]] = part["votes"][vote] if vote else part["decided"]
        return evaluate(decided, shown.labels, shown.classes)

    return Compared(
        contestant,
        tuple(of_seed(parts) for parts in seeds),
        {vote: tuple(of_seed(parts, vote) for parts in seeds) for vote in results[0]["votes"]},
        observe_ms,
        float(np.mean([one["train_s"] for one in results])),
        float(np.mean([one["answer_ms"] for one in results])),
        None if results[0]["bills"] is None else {target: results[0]["bills"][target] for target in plan.targets},
    )
