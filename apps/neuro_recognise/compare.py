"""Comparison of methods on one data set by cross-validation, with results stored in a folder and shown as a table.

FOLDER/METHOD-SEED-FOLD.json    decisions and times of a fold, and bills in the first fold; a fold with a result of the
                                same code is not repeated
FOLDER/table.md, compare.html   all results
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError, apps
from neuro.apps import write_text
from neuro.chips import COLUMNS, cells
from neuro_events import EventFileError, Recordings
from neuro_recognise.energy import price
from neuro_recognise.method import Method, Progress, choose
from neuro_recognise.methods import METHODS, method_of
from neuro_recognise.observations import code_of, observe
from neuro_recognise.recogniser import field_of, learn
from neuro_recognise.shown import Features, Ints

RESULTS = apps.JobResults("a result of 'neuro recognise compare'", "neuro recognise fold 1")
TIMED = 20
"""Number of recordings that are observed once more, to measure the time per recording."""


@dataclass(frozen=True, slots=True)
class Contestant:
    """A method with its settings, one row of the table.

    Attributes:
        name: name of the method, with its preset if there is one.
        method: the method with its settings.
    """

    name: str
    method: Method


@dataclass(frozen=True, slots=True)
class MethodComparison:
    """The plan of a comparison.

    Attributes:
        contestants: rows of the table.
        folds: number of folds for each seed.
        seeds: seeds of folds and trainings.
        targets: chips and processors on which the energy of networks is computed.
        folder: folder for results.
        backend: backend that runs networks; other methods do not use it.
        jobs: number of folds that run in parallel; None for one per core.
    """

    contestants: tuple[Contestant, ...]
    folds: int
    seeds: tuple[int, ...]
    targets: tuple[str, ...]
    folder: Path
    backend: str = "event"
    jobs: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """Results of a method.

    Attributes:
        contestant: the method.
        evaluations: for each seed, the evaluation of all recordings. Each recording is decided by a
            recogniser that was trained on the other folds.
        votes: evaluations of alternative decision rules, by the name of the rule, one for each seed.
        observe_ms: mean time to compute the evidence of a recording, ms.
        train_s: mean time of a training, s.
        answer_ms: mean time to decide from the evidence of a recording, ms.
        bills: bill per recording by the name of the target, as plain data. A target that refuses the network has its
            reason instead. None for a method without a network.
        refused: reason why the method could not run, "" if it ran.
    """

    contestant: Contestant
    evaluations: tuple[apps.Evaluation, ...] = ()
    votes: Mapping[str, tuple[apps.Evaluation, ...]] | None = None
    observe_ms: float = float("nan")
    train_s: float = float("nan")
    answer_ms: float = float("nan")
    bills: Mapping[str, Any] | None = None
    refused: str = ""

    @property
    def accuracy(self) -> float:
        """Mean accuracy over the seeds; NaN if the method could not run."""
        return float(np.mean([run.accuracy for run in self.evaluations])) if self.evaluations else float("nan")

    @property
    def spread(self) -> float:
        """Standard deviation of the accuracy over the seeds; NaN with a single seed."""
        accuracies = [run.accuracy for run in self.evaluations]
        return float(np.std(accuracies, ddof=1)) if len(accuracies) > 1 else float("nan")


def contestants(names: Sequence[str] = ()) -> tuple[Contestant, ...]:
    """Return methods by name.

    Args:
        names: names of methods, or of their presets, e.g. ``hats:poker``; all methods if empty.

    Raises:
        ModelError: there is no such method or preset.
    """
    parts = (name.partition(":") for name in names or METHODS)
    return tuple(Contestant(name + colon + preset, method_of(name, preset)) for name, colon, preset in parts)


def compare(data: Recordings, plan: MethodComparison, report: Callable[[Progress], None]) -> list[Compared]:
    """Train and test all methods; results that are already in the folder are reused.

    The folds run in parallel in separate processes, see `neuro.apps.grid`.

    Args:
        data: labelled recordings.
        plan: plan of the comparison.
        report: function that is called with the progress.

    Returns:
        The results of each method, in the order of the plan.

    Raises:
        EventFileError: a recording is damaged, or all recordings are of one class.
        ModelError: there is no such backend, a file in the folder was not written by `compare`, or there are too few
            recordings.
    """
    apps.find_backend(plan.backend)
    field, folds = field_of(data), {seed: data.folds(plan.folds, seed=seed) for seed in plan.seeds}
    apps.make_folder(plan.folder)
    fingerprint = data.fingerprint()

    def look(name: str, done: int, total: int) -> None:
        report(Progress(f"{name}: looking", done, total))

    jobs: list[Fold] = []
    entries: list[Contestant] = []
    refused: dict[int, str] = {}
    for number, contestant in enumerate(plan.contestants):
        try:
            fitting = Contestant(contestant.name, contestant.method.fitting(field))
            entries.append(fitting)
            features = observe(fitting.method, data, fingerprint=fingerprint, report=partial(look, contestant.name))
        except (EventFileError, apps.Unwritable):
            raise
        except ModelError as error:
            entries[number:] = [contestant]
            refused[number] = _reason(error)
            continue
        jobs += [
            _fold_of(number, fitting, features, fingerprint[:32], (seed, k), parts, plan)
            for seed in plan.seeds
            for k, parts in enumerate(folds[seed])
        ]
    results = apps.grid(RESULTS, jobs, plan.jobs, telling(report, len(jobs)))
    rows = []
    for number, contestant in enumerate(entries):
        runs = [result for job, result in zip(jobs, results, strict=True) if job.contestant == number]
        reason = refused.get(number, "") or next((result["refused"] for result in runs if "refused" in result), "")
        if reason:  # e.g. a missing optional dependency, or recordings that the method does not support
            rows.append(Compared(contestant, refused=reason))
        else:
            rows.append(_summary(contestant, runs, data, plan))
    return rows


def telling(report: Callable[[Progress], None], jobs: int) -> Callable[[tuple[str, Progress | None] | None], None]:
    """Return a callback for the jobs' messages that reports the progress with the number of finished jobs.

    A message is the job's name and its progress; None as progress means that the job is finished.
    """
    n_done = 0

    def tell(message: tuple[str, Progress | None] | None) -> None:
        nonlocal n_done
        name, progress = message or ("", None)
        n_done += progress is None
        if message is not None:
            current = progress or Progress("", n_done, jobs)
            counter = (n_done, jobs) if jobs > 1 else None
            report(replace(current, what=f"{name}: {current.what}" if current.what else name, among=counter))

    return tell


def _reason(error: ModelError) -> str:
    """Return the message of an error in one line, without the hint."""
    return ": ".join(problem.alone() for problem in (error, *error.others))


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """A training and its test, a job of `neuro.apps.grid`.

    Attributes:
        contestant: index of the method.
        name: name in progress reports.
        method: the method with its settings.
        features: evidence of all recordings.
        train_rows, test_rows: indices of the recordings to train on, and of those to test on.
        of: conditions that determine the result, as plain data, e.g. method, seed and fold. A stored result with equal
            conditions is reused.
        file: file of the result.
    """

    contestant: int
    name: str
    method: Method
    features: Features
    train_rows: Ints
    test_rows: Ints
    of: Mapping[str, Any]
    file: Path

    def work(self, report: Callable[[tuple[str, Progress | None]], None]) -> dict[str, Any]:
        """Train and test. Return the result as plain data, or the reason why the method cannot run."""
        backend, seed, began = self.of["backend"], self.of["seed"], time.process_time()
        options: Any = {"seed": seed, "backend": backend, "report": lambda progress: report((self.name, progress))}
        try:
            recogniser = learn(self.method, self.features.take(self.train_rows), self.of["data"], **options)
            trained = time.process_time()
            answer = recogniser.answer_shown(self.features.take(self.test_rows), backend)
        except (EventFileError, apps.Unwritable):
            raise
        except ModelError as error:
            report((self.name, None))
            return {"refused": _reason(error)}
        ended = time.process_time()
        bills: dict[str, Any] | None = None
        if answer.run is not None:
            bills, run = {}, answer.run()
            for target in self.of.get("targets", ()):
                try:
                    sizes = answer.neurons_per_core, answer.duration_s, answer.host
                    priced = price(run, len(self.test_rows), [target], *sizes)
                    bills |= {name: bill.as_dict() for name, bill in priced.bills.items()}
                    bills |= {name: {"refused": reason} for name, reason in priced.refused.items()}
                except ModelError as error:
                    bills[target] = {"refused": _reason(error)}
        report((self.name, None))
        return {
            "provenance": apps.provenance(backend=backend, seed=seed),
            "tested": self.test_rows.tolist(),
            "decided": choose(answer.scores).tolist(),
            "votes": {vote: choose(scores).tolist() for vote, scores in answer.votes.items()},
            "train_s": trained - began,
            "answer_ms": 1000.0 * (ended - trained) / len(self.test_rows),
            "bills": bills,
        }


def _fold_of(
    number: int,
    contestant: Contestant,
    features: Features,
    digest: str,
    run: tuple[int, int],
    parts: tuple[Ints, Ints],
    plan: MethodComparison,
) -> Fold:
    (seed, fold), method = run, contestant.method
    key: dict[str, Any] = {
        "method": method.called(),
        "settings": method.as_words(),
        "code": code_of(method),
        "data": digest,
    }
    key |= {"backend": plan.backend if method.spikes else "event", "seed": seed, "fold": fold, "folds": plan.folds}
    if method.spikes and run == (plan.seeds[0], 0):  # bills are computed for one fold only
        key["targets"] = list(plan.targets)
    name = f"{contestant.name}, seed {seed}, fold {fold + 1} of {plan.folds}"
    file = plan.folder / f"{contestant.name.replace(':', '-').replace('/', '_')}-{seed}-{fold}.json"
    return Fold(number, name, method, features, *parts, key, file)


def _observing_ms(method: Method, data: Recordings) -> float:
    """Measure the time to observe a recording, ms, after one call that compiles."""
    events = [item.load() for item in data[:TIMED]]
    method.observe(events[0])
    began = time.process_time()
    for event in events:
        method.observe(event)
    return 1000.0 * (time.process_time() - began) / len(events)


def _summary(
    contestant: Contestant, results: Sequence[Mapping[str, Any]], data: Recordings, plan: MethodComparison
) -> Compared:
    """Combine the results of all folds."""
    seeds = [[result for result in results if result["of"]["seed"] == seed] for seed in plan.seeds]

    def evaluated(decisions: Sequence[tuple[list[int], list[int]]]) -> apps.Evaluation:
        decided = np.full(len(data), -1, np.int64)
        for tested, labels in decisions:
            decided[tested] = labels
        return apps.evaluate(decided, data.labels, data.classes)

    votes = {
        vote: tuple(evaluated([(result["tested"], result["votes"][vote]) for result in parts]) for parts in seeds)
        for vote in results[0]["votes"]
    }
    return Compared(
        contestant,
        tuple(evaluated([(result["tested"], result["decided"]) for result in parts]) for parts in seeds),
        votes,
        _observing_ms(contestant.method, data),
        float(np.mean([result["train_s"] for result in results])),
        float(np.mean([result["answer_ms"] for result in results])),
        results[0]["bills"],
    )


PAGE = apps.sealed(
    "a page of 'neuro recognise compare'",
    '<meta name="generator" content="neuro recognise compare">',
    "<!-- digest {} -->",
)
TABLE = apps.sealed("a table of 'neuro recognise compare'", "<!-- neuro recognise compare -->", "<!-- digest {} -->")
HEAD = ("method", "runs on", ">accuracy", ">95 % interval", "other votes", ">look, ms", ">train, s", ">decide, ms")
ABOUT = (
    "Networks run on a backend, the other methods on none. "
    "Accuracy is the share of right decisions over all recordings, each decided by a training on the other folds, with "
    "the standard deviation over seeds. The interval is Wilson's for the recordings of one seed. Times are those of "
    "one core: look, to compute the evidence of a recording; train, to learn from the other folds; decide, to decide "
    "from the evidence of a recording."
)
BILLS = ("method", "chip", *COLUMNS)
BILL = (
    "Joules per recording: operations of the network plus static power of the chip, without the host that turns "
    "events into the network's input. Each is a count times a published figure; brackets show the range of the "
    "figures. The chip is on while it works, or, in real time, for the duration of the recording. > marks totals "
    "without static power or learning, for which no figure is published."
)


def show(results: Sequence[Compared], plan: MethodComparison) -> None:
    """Print the tables and the reasons of methods and targets that could not run."""
    out = apps.console()
    out.print(apps.table(HEAD, [_row(compared, plan) for compared in results]))
    if bills := list(_bills(results)):
        out.print(apps.table(BILLS, bills, title="joules per recording"))
    for compared in results:
        if compared.refused:
            print(f"- {compared.contestant.name}: {compared.refused}")
    for line in _unpriced(results):
        print(f"- {line}")


def write(results: Sequence[Compared], plan: MethodComparison, data: str) -> tuple[Path, Path]:
    """Write the table and the page into the folder.

    Args:
        results: results of each method.
        plan: plan of the comparison.
        data: name of the data set, for the title.

    Returns:
        The files.
    """
    markdown, page = plan.folder / "table.md", plan.folder / "compare.html"
    text = _markdown(HEAD, [_row(compared, plan) for compared in results])
    if bills := list(_bills(results)):
        text += "\nJoules per recording:\n\n" + _markdown(BILLS, bills)
    if unpriced := list(_unpriced(results)):
        text += "\n" + "".join(f"- {line}\n" for line in unpriced)
    write_text(markdown, f"<!-- neuro recognise compare -->\n\n{text}", TABLE)
    write_text(
        page, apps.html.page("neuro recognise compare", f"Recognisers on {data}", _parts(results, plan, data)), PAGE
    )
    return markdown, page


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table as Markdown. A column whose head begins with > is right-aligned."""
    rule = ["---:" if name.startswith(">") else "---" for name in head]
    return "".join(f"| {' | '.join(row)} |\n" for row in ([name.lstrip(">") for name in head], rule, *rows))


def _parts(results: Sequence[Compared], plan: MethodComparison, data: str) -> Iterator[Any]:
    from neuro_recognise.telling.pictures import accuracies, confusion

    html, tag, ran = apps.html, apps.html.tag, [row for row in results if row.evaluations]
    n = ran[0].evaluations[0].n if ran else 0
    yield tag("h1", "Recognisers side by side")
    seeds = f"{len(plan.seeds)} seed" + ("s" if len(plan.seeds) > 1 else "")
    yield tag("p", f"{n} recordings of {data}, {plan.folds} folds, {seeds}.", class_="lead")
    if ran:
        yield html.picture(
            accuracies([(row.contestant.name, row.evaluations) for row in ran]), "accuracy of each method"
        )
    yield html.table(HEAD, [_row(row, plan) for row in results])
    yield tag("p", ABOUT)
    if bills := list(_bills(results)):
        yield tag("h2", "Joules per recording")
        yield html.table(BILLS, bills)
        yield tag("p", BILL)
    if unpriced := list(_unpriced(results)):
        yield tag("ul", *(tag("li", line) for line in unpriced))
    if refused := [row for row in results if row.refused]:
        yield tag("h2", "Methods that could not run")
        yield tag("ul", *(tag("li", f"{row.contestant.name}: {row.refused}") for row in refused))
    yield tag("h2", "Which classes are confused")
    cards = []
    for row in ran:
        name = row.contestant.name
        picture = html.picture(confusion(row.evaluations[0]), f"confusion of {name}, seed {plan.seeds[0]}")
        cards.append(tag("div", tag("h3", name), tag("p", row.contestant.method.title), picture))
    yield tag("div", *cards, class_="cards")


def _row(row: Compared, plan: MethodComparison) -> tuple[str, ...]:
    runs = plan.backend if row.contestant.method.spikes else "-"
    if not row.evaluations:
        return (row.contestant.name, runs, "not run", *[""] * (len(HEAD) - 3))
    spread = "" if np.isnan(row.spread) else f" ± {100 * row.spread:.1f}"
    n = row.evaluations[0].n
    low, high = apps.wilson(round(row.accuracy * n), n)
    votes = {vote: np.mean([run.accuracy for run in results]) for vote, results in (row.votes or {}).items()}
    text = ", ".join(f"{vote} {100 * share:.1f}" for vote, share in votes.items())
    shares = (f"{100 * row.accuracy:.1f}{spread} %", f"{100 * low:.0f} - {100 * high:.0f}", text or "-")
    times = (f"{time:.2g}" for time in (row.observe_ms, row.train_s, row.answer_ms))
    return (row.contestant.name, runs, *shares, *times)


def _bills(results: Sequence[Compared]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each network and target: the bill, or "refused"."""
    for compared in results:
        for target, bill in (compared.bills or {}).items():
            refused = ("refused", *["-"] * (len(COLUMNS) - 1))
            yield compared.contestant.name, target, *(refused if bill.get("refused") else cells(bill))


def _unpriced(results: Sequence[Compared]) -> Iterator[str]:
    """Yield each refusal of a network by a target, with its reason."""
    for compared in results:
        for target, bill in (compared.bills or {}).items():
            if bill.get("refused"):
                yield f"{target} refuses {compared.contestant.name}: {bill['refused']}"
