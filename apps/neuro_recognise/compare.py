"""Methods side by side on one data set: every fold trained and tested, kept in a folder, and shown as a table.

FOLDER/METHOD-SEED-FOLD.json    decisions and times of a fold, and of the first one bills; what is there is not done
                                again by the same code
FOLDER/table.md, compare.html   all that is there
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
    of_seeds: tuple[apps.Evaluation, ...] = ()
    votes: Mapping[str, tuple[apps.Evaluation, ...]] | None = None
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

    Folds are done side by side in processes of their own, see `neuro.apps.grid`.

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
    apps.find_backend(plan.backend)
    field, folds = field_of(data), {seed: data.folds(plan.folds, seed=seed) for seed in plan.seeds}
    apps.make_folder(plan.folder)
    fingerprint = data.fingerprint()

    def look(name: str, done: int, total: int) -> None:
        report(Progress(f"{name}: looking", done, total))

    jobs: list[Fold] = []
    seen: list[Contestant] = []
    refused: dict[int, str] = {}
    for number, one in enumerate(plan.contestants):
        try:
            fitting = Contestant(one.name, one.method.fitting(field))
            seen.append(fitting)
            shown = observe(fitting.method, data, fingerprint=fingerprint, report=partial(look, one.name))
        except (EventFileError, apps.Unwritable):
            raise
        except ModelError as error:
            seen[number:] = [one]
            refused[number] = _reason(error)
            continue
        jobs += [
            _fold_of(number, fitting, shown, fingerprint[:32], (seed, k), parts, plan)
            for seed in plan.seeds
            for k, parts in enumerate(folds[seed])
        ]
    results = apps.grid(RESULTS, jobs, plan.jobs, telling(report, len(jobs)))
    found = []
    for number, one in enumerate(seen):
        mine = [result for job, result in zip(jobs, results, strict=True) if job.contestant == number]
        why = refused.get(number, "") or next((each["refused"] for each in mine if "refused" in each), "")
        if why:  # its extra is missing, or the recordings do not suit it
            found.append(Compared(one, refused=why))
        else:
            found.append(_summary(one, mine, data, plan))
    return found


def telling(report: Callable[[Progress], None], jobs: int) -> Callable[[tuple[str, Progress | None] | None], None]:
    """Return what takes the reports of jobs, a name and its progress, None when it is done, and tells how many are."""
    done = 0

    def tell(message: tuple[str, Progress | None] | None) -> None:
        nonlocal done
        name, progress = message or ("", None)
        done += progress is None
        if message is not None:
            alone = progress or Progress("", done, jobs)
            among = (done, jobs) if jobs > 1 else None
            report(replace(alone, what=f"{name}: {alone.what}" if alone.what else name, among=among))

    return tell


def _reason(error: ModelError) -> str:
    """Return what is wrong in one line, without the way out."""
    return ": ".join(one.alone() for one in (error, *error.others))


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """A training and its test, a job of `neuro.apps.grid`.

    Attributes:
        contestant: number of the method.
        name: for people.
        method: with its settings.
        shown: what all recordings show to it.
        others, mine: recordings to learn from, and to test.
        of: all that its result follows from, as plain data.
        file: of its result.
    """

    contestant: int
    name: str
    method: Method
    shown: Features
    others: Ints
    mine: Ints
    of: Mapping[str, Any]
    file: Path

    def work(self, report: Callable[[tuple[str, Progress | None]], None]) -> dict[str, Any]:
        """Train and test; the result as plain data, or why it cannot be run."""
        backend, seed, began = self.of["backend"], self.of["seed"], time.process_time()
        words: Any = {"seed": seed, "backend": backend, "report": lambda progress: report((self.name, progress))}
        try:
            made = learn(self.method, self.shown.take(self.others), self.of["data"], **words)
            trained = time.process_time()
            answer = made.answer_shown(self.shown.take(self.mine), backend)
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
                    priced = price(run, len(self.mine), [target], answer.neurons_per_core, answer.duration_s)
                    bills |= {name: bill.as_dict() for name, bill in priced.bills.items()}
                    bills |= {name: {"refused": why} for name, why in priced.refused.items()}
                except ModelError as error:
                    bills[target] = {"refused": _reason(error)}
        report((self.name, None))
        return {
            "provenance": apps.provenance(backend=backend, seed=seed),
            "tested": self.mine.tolist(),
            "decided": choose(answer.scores).tolist(),
            "votes": {vote: choose(scores).tolist() for vote, scores in answer.votes.items()},
            "train_s": trained - began,
            "answer_ms": 1000.0 * (ended - trained) / len(self.mine),
            "bills": bills,
        }


def _fold_of(
    number: int,
    contestant: Contestant,
    shown: Features,
    digest: str,
    which: tuple[int, int],
    parts: tuple[Ints, Ints],
    plan: MethodComparison,
) -> Fold:
    (seed, fold), method = which, contestant.method
    of: dict[str, Any] = {
        "method": method.called(),
        "settings": method.as_words(),
        "code": code_of(method),
        "data": digest,
    }
    of |= {"backend": plan.backend if method.spikes else "event", "seed": seed, "fold": fold, "folds": plan.folds}
    if method.spikes and which == (plan.seeds[0], 0):  # the bills of one fold are enough
        of["targets"] = list(plan.targets)
    name = f"{contestant.name}, seed {seed}, fold {fold + 1} of {plan.folds}"
    file = plan.folder / f"{contestant.name.replace(':', '-').replace('/', '_')}-{seed}-{fold}.json"
    return Fold(number, name, method, shown, *parts, of, file)


def _observing_ms(method: Method, data: Recordings) -> float:
    """Measure how long a recording is looked at, anew on some, after one that compiles what is needed."""
    events = [item.load() for item in data[:TIMED]]
    method.observe(events[0])
    began = time.process_time()
    for one in events:
        method.observe(one)
    return 1000.0 * (time.process_time() - began) / len(events)


def _summary(
    contestant: Contestant, results: Sequence[Mapping[str, Any]], data: Recordings, plan: MethodComparison
) -> Compared:
    """Join the results of all folds."""
    seeds = [[one for one in results if one["of"]["seed"] == seed] for seed in plan.seeds]

    def of_seed(decisions: Sequence[tuple[list[int], list[int]]]) -> apps.Evaluation:
        decided = np.full(len(data), -1, np.int64)
        for tested, labels in decisions:
            decided[tested] = labels
        return apps.evaluate(decided, data.labels, data.classes)

    votes = {
        vote: tuple(of_seed([(one["tested"], one["votes"][vote]) for one in parts]) for parts in seeds)
        for vote in results[0]["votes"]
    }
    return Compared(
        contestant,
        tuple(of_seed([(one["tested"], one["decided"]) for one in parts]) for parts in seeds),
        votes,
        _observing_ms(contestant.method, data),
        float(np.mean([one["train_s"] for one in results])),
        float(np.mean([one["answer_ms"] for one in results])),
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
    "Accuracy is that of all recordings, each decided by what was learnt from the other folds; after it the deviation "
    "between seeds. The interval is Wilson's, of one seed's recordings. Times are of one core: to look at a recording, "
    "to learn from the other folds, to decide on a recording that was looked at."
)
BILLS = ("method", "chip", *COLUMNS)
BILL = (
    "Joules of a recording: what the network does, and what the chip takes while it does; the host that turns events "
    "into its input is not in the bill. Counts times published figures, in brackets the range of these. The chip is on "
    "for as long as it works, or, in real time, for as long as the recording lasts. A total behind > lacks costs for "
    "which no figure is published: static power, or learning."
)


def show(found: Sequence[Compared], plan: MethodComparison) -> None:
    """Print the table."""
    out = apps.console()
    out.print(apps.table(HEAD, [_row(one, plan) for one in found]))
    if bills := list(_bills(found)):
        out.print(apps.table(BILLS, bills, title="joules of a recording"))
    for one in found:
        if one.refused:
            print(f"- {one.contestant.name}: {one.refused}")
    for line in _unpriced(found):
        print(f"- {line}")


def write(found: Sequence[Compared], plan: MethodComparison, data: str) -> tuple[Path, Path]:
    """Write the table and the page into the folder.

    Args:
        found: of each method.
        plan: what was compared.
        data: what on, for the title.

    Returns:
        The files.
    """
    markdown, page = plan.folder / "table.md", plan.folder / "compare.html"
    text = _markdown(HEAD, [_row(one, plan) for one in found])
    if bills := list(_bills(found)):
        text += "\nJoules of a recording:\n\n" + _markdown(BILLS, bills)
    if unpriced := list(_unpriced(found)):
        text += "\n" + "".join(f"- {line}\n" for line in unpriced)
    write_text(markdown, f"<!-- neuro recognise compare -->\n\n{text}", TABLE)
    write_text(
        page, apps.html.page("neuro recognise compare", f"Recognisers on {data}", _parts(found, plan, data)), PAGE
    )
    return markdown, page


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table as Markdown; a head that begins with > stands over numbers."""
    rule = ["---:" if name.startswith(">") else "---" for name in head]
    return "".join(f"| {' | '.join(row)} |\n" for row in ([name.lstrip(">") for name in head], rule, *rows))


def _parts(found: Sequence[Compared], plan: MethodComparison, data: str) -> Iterator[Any]:
    from neuro_recognise.telling.pictures import accuracies, confusion

    html, tag, ran = apps.html, apps.html.tag, [one for one in found if one.of_seeds]
    n = ran[0].of_seeds[0].n if ran else 0
    yield tag("h1", "Recognisers side by side")
    seeds = f"{len(plan.seeds)} seed" + ("s" if len(plan.seeds) > 1 else "")
    yield tag("p", f"{n} recordings of {data}, {plan.folds} folds, {seeds}.", class_="lead")
    if ran:
        yield html.picture(accuracies([(one.contestant.name, one.of_seeds) for one in ran]), "accuracy of each method")
    yield html.table(HEAD, [_row(one, plan) for one in found])
    yield tag("p", ABOUT)
    if bills := list(_bills(found)):
        yield tag("h2", "Joules of a recording")
        yield html.table(BILLS, bills)
        yield tag("p", BILL)
    if unpriced := list(_unpriced(found)):
        yield tag("ul", *(tag("li", line) for line in unpriced))
    if refused := [one for one in found if one.refused]:
        yield tag("h2", "What could not be run")
        yield tag("ul", *(tag("li", f"{one.contestant.name}: {one.refused}") for one in refused))
    yield tag("h2", "What is taken for what")
    cards = []
    for one in ran:
        name = one.contestant.name
        picture = html.picture(confusion(one.of_seeds[0]), f"confusion of {name}, seed {plan.seeds[0]}")
        cards.append(tag("div", tag("h3", name), tag("p", one.contestant.method.title), picture))
    yield tag("div", *cards, class_="cards")


def _row(one: Compared, plan: MethodComparison) -> tuple[str, ...]:
    runs = plan.backend if one.contestant.method.spikes else "-"
    if not one.of_seeds:
        return (one.contestant.name, runs, "not run", *[""] * (len(HEAD) - 3))
    spread = "" if np.isnan(one.spread) else f" ± {100 * one.spread:.1f}"
    n = one.of_seeds[0].n
    low, high = apps.wilson(round(one.accuracy * n), n)
    votes = {vote: np.mean([found.accuracy for found in each]) for vote, each in (one.votes or {}).items()}
    text = ", ".join(f"{vote} {100 * share:.1f}" for vote, share in votes.items())
    shares = (f"{100 * one.accuracy:.1f}{spread} %", f"{100 * low:.0f} - {100 * high:.0f}", text or "-")
    return one.contestant.name, runs, *shares, *(f"{took:.2g}" for took in (one.observe_ms, one.train_s, one.answer_ms))


def _bills(found: Sequence[Compared]) -> Iterator[tuple[str, ...]]:
    """Of each network the bill on each target; a refusal in its place."""
    for one in found:
        for target, bill in (one.bills or {}).items():
            refused = ("refused", *["-"] * (len(COLUMNS) - 1))
            yield one.contestant.name, target, *(refused if bill.get("refused") else cells(bill))


def _unpriced(found: Sequence[Compared]) -> Iterator[str]:
    """Networks that a target refuses, and why."""
    for one in found:
        for target, bill in (one.bills or {}).items():
            if bill.get("refused"):
                yield f"{target} refuses {one.contestant.name}: {bill['refused']}"
