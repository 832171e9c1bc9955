"""Output of the commands that test a recogniser: a progress bar, tables, JSON and pictures."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro import ModelError
from neuro.apps import Bar as Line, Evaluation, console, echo, evaluate, install, number, table, write_picture
from neuro_events import Events, Recordings, load
from neuro_recognise.deciding import ASSUMES, ASSURANCE, least_allowed, outcome
from neuro_recognise.method import METHODS, SILENT, Answer, Progress, choose
from neuro_recognise.methods import method_of
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.shown import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure


OWN = "own"
"""Name of the vote of a method that has only one vote."""


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """Results of a test.

    Attributes:
        own: evaluation by the scores of the recogniser.
        votes: evaluation by each decision rule on the same evidence, by the name of the rule.
        answer: scores, and the run of the network that computed them.
    """

    own: Evaluation
    votes: Mapping[str, Evaluation]
    answer: Answer


def try_out(recogniser: Recogniser, data: Recordings, backend: str = "event") -> Tried:
    """Test a recogniser on recordings.

    Args:
        recogniser: trained recogniser.
        data: recordings of its classes.
        backend: backend that runs networks.

    Raises:
        EventFileError: a recording is damaged.
        ModelError: a recording does not fit the method, or the backend cannot run the method.
    """
    recogniser.method.check_backend(backend)
    features = recogniser.shown(data)
    answer = recogniser.answer_shown(features, backend)
    votes = {name: evaluate(choose(scores), features.labels, features.classes) for name, scores in answer.votes.items()}
    return Tried(evaluate(choose(answer.scores), features.labels, features.classes), votes, answer)


MOMENTS = 20
"""Number of evenly spaced times at which a recording is scored, if `learn_early` has not set the moments."""


@dataclass(frozen=True, slots=True, eq=False)
class Predicted:
    """The decision on a recording.

    Attributes:
        path: the file.
        label: index of the class, -1 without evidence for any class.
        scores: (classes,) score of each class.
        decided_ms: time of the decision since the first event, ms. With an allowed error, this is the time at which the
            rule decided, or the end. Without an allowed error, this is the earliest moment after which the decision
            did not change. None without a decision.
        length_ms: duration of the recording, ms.
        settled: whether an allowed error was met.
    """

    path: str
    label: int
    scores: Floats
    decided_ms: float | None
    length_ms: float
    settled: bool = False


def predict_files(
    recogniser: Recogniser,
    files: Iterable[Path],
    backend: str = "event",
    allow: float | None = None,
    assurance: float = ASSURANCE,
) -> tuple[list[Predicted], list[ModelError]]:
    """Predict the class of the recording in each file.

    Args:
        recogniser: trained recogniser.
        files: recordings.
        backend: backend that runs networks.
        allow: largest share of wrong decisions. Each recording is decided as soon as this error is met; later events
            are not used. None decides on whole recordings.
        assurance: assurance of the allowed error, see `Recogniser.session`.

    Returns:
        The decisions, and the errors of files that are damaged or do not fit.

    Raises:
        ModelError: the backend cannot run the recogniser, or the allowed error cannot be met.
    """
    recogniser.answer([], backend)  # errors that concern all files are raised before any is read
    recogniser.session(allow=allow, assurance=assurance)
    predictions, errors = list[Predicted](), list[ModelError]()
    for file in files:
        try:
            events = load(file)
            predictions.append(
                _decided_whole(recogniser, str(file), events, backend)
                if allow is None
                else _decided_early(recogniser, str(file), events, backend, allow, assurance)
            )
        except ModelError as error:
            errors.append(error.at(None, str(file)))
    return predictions, errors


def _decided_whole(recogniser: Recogniser, file: str, events: Events, backend: str) -> Predicted:
    length = _length(events)
    scores = recogniser.scores(events, backend)
    label = int(choose(scores)[0])
    if label == SILENT:
        return Predicted(file, label, scores[0], None, length)
    if recogniser.early is None:
        times = np.linspace(0.0, length, MOMENTS + 1)[1:]
    else:
        learnt_ms = recogniser.early.held.times_us / 1000.0
        times = np.append(learnt_ms[learnt_ms < length], length)
    diffs = np.flatnonzero(choose(recogniser.scores_at(events, times.tolist(), backend)) != label)
    start = int(diffs[-1]) + 1 if diffs.size else 0
    return Predicted(file, label, scores[0], float(times[start]) if start < len(times) else length, length)


def _decided_early(
    recogniser: Recogniser, file: str, events: Events, backend: str, allow: float, assurance: float
) -> Predicted:
    length = _length(events)
    early = recogniser.early
    interval = early.held.times_us[0] / 1000.0 if early else 1.0
    window = length + interval
    session = recogniser.session(every_ms=interval, allow=allow, assurance=assurance, window_ms=window, backend=backend)
    scores = np.full(len(recogniser.classes), np.nan)
    for decision in chain(session.feed(events), session.end()):
        scores = decision.scores
        if decision.settled:
            return Predicted(file, decision.label, scores, decision.after_ms, length, settled=True)
    label = int(choose(scores[None])[0])
    return Predicted(file, label, scores, None if label == SILENT else length, length)


def _length(events: Events) -> float:
    return (int(events.t[-1]) - int(events.t[0])) / 1000.0 if len(events) else 0.0


class LearningBar:
    """A progress bar. A finished activity with a share of right decisions leaves a line."""

    def __enter__(self) -> LearningBar:
        self._line = Line().__enter__()
        self._line.say("preparing")
        return self

    def __exit__(self, *error: Any) -> None:
        self._line.stop()

    def show(self, progress: Progress) -> None:
        """Show the progress of a training."""
        text = progress.what
        if progress.right is not None:
            text += f": {progress.right:.1%} right"
        if progress.among is None:
            self._line.show(progress.done, progress.total, text, line=progress.right is None)
        else:
            n_done, total = progress.among
            self._line.show(n_done, total, f"{n_done} of {total} done; {text}")
        if progress.done == progress.total and progress.right is not None:
            self._line.keep(text)


FORMAT = "neuro recognise figures 1"
ALLOWED = (0.01, 0.02, 0.05, 0.075, 0.1, 0.15, 0.2)
"""Allowed shares of wrong decisions in the table of `show_early`."""


def show_methods() -> None:
    """Print all methods."""
    rows = []
    for name, method in METHODS.items():
        runs = "a network" if method.spikes else "-"
        measured = "\n".join(f"{data_set} {share}" for data_set, share in method.measured.items())
        rows.append((name, f"{method.title}\n{method.source}", runs, method.needs or "-", measured or "-"))
    out = console()
    out.print(table(("method", "description and source", "runs", "extra", "measured"), rows))
    for extra, trains in (("recognise", "support vector machines"), ("torch", "networks that learn by gradients")):
        if any(method.needs == extra for method in METHODS.values()):
            print(f"the extra {extra} trains {trains}: {install(extra)}")


def show_settings(name: str) -> None:
    """Print all settings of a method.

    Raises:
        ModelError: there is no such method.
    """
    method = method_of(name)
    rows = [(r.name, _value_text(r.value), r.unit, r.doc, r.source or "-") for r in method.rows()]
    out = console()
    out.print(f"{name}: {method.title}\n{method.source}")
    out.print(table(("setting", "value", "unit", "meaning", "source"), rows))
    for preset, values in method.presets.items():
        out.print(f"--preset {preset}: {', '.join(f'{k}={_value_text(v)}' for k, v in values.items())}")


def training_summary(recogniser: Recogniser) -> str:
    """Return a line with the method, the number of classes, and the number of training recordings.

    A warning follows if the method has a learning curve, and its accuracy in the last epoch is not above chance.
    """
    chance, history = 1 / len(recogniser.classes), np.ravel(recogniser.learnt.get("history", 1.0))
    message = f"{recogniser.method.called()} for {len(recogniser.classes)} classes"
    message += f", learnt from {recogniser.training['recordings']} recordings"
    if not history.size or not history[-1] <= chance:
        return message
    below = f"warning: {history[-1]:.1%} of the frames were decided rightly in the last epoch; chance is {chance:.1%}"
    return f"{message}\n{below}\n  hint: --set with other settings of 'neuro recognise list', or more recordings"


def describe(recogniser: Recogniser) -> None:
    """Print the conditions and settings of a training."""
    rows = [("classes", ", ".join(recogniser.classes)), *recogniser.training.items()]
    rows += [(row.name, _value_text(row.value)) for row in recogniser.method.rows()]
    out = console()
    out.print(training_summary(recogniser))
    out.print(table(("setting", "value"), rows))


def figures(recogniser: Recogniser, result: Tried) -> str:
    """Return all figures as JSON. Figures at the top level belong to the recogniser's own scores."""
    contents = {"format": FORMAT, "method": recogniser.method.called(), **result.own.as_words()}
    contents |= {"classes": list(recogniser.classes)}
    return json.dumps(
        contents | {"votes": {name: evaluation.as_words() for name, evaluation in result.votes.items()}}, indent=1
    )


def show(recogniser: Recogniser, result: Tried) -> None:
    """Print the accuracy of each vote, and the confusion matrix of the recogniser's own decisions."""
    name = recogniser.method.called()
    out = console()
    rows = [_row(name, result.own), *(_row(f"  by {vote}", evaluation) for vote, evaluation in result.votes.items())]
    out.print(table(("method", ">accuracy", ">95 % interval", ">right", ">of"), rows))
    own = result.own
    columns = ("shown", *(f">{class_name}" for class_name in (*own.classes, "silent")))
    counts_by_class = zip(own.classes, own.confusion.tolist(), strict=True)
    cells = ((class_name, *(n or "." for n in counts)) for class_name, counts in counts_by_class)
    out.print(table(columns, cells, title=f"decided by {name}"))
    silent, total = int(own.confusion[:, -1].sum()), int(own.confusion.sum())
    if 4 * silent > total:
        way_out = recogniser.method.way_out_of_silence()
        echo(f"{silent} of {total} recordings are silent, which counts as wrong: {way_out}")


def show_predicted(
    recogniser: Recogniser, predicted: list[Predicted], as_json: bool, allow: float | None = None
) -> None:
    """Print decisions as a table or as JSON. With an allowed error, the assumption behind it follows the table."""
    if as_json:
        texts = []
        for row in predicted:
            silent = row.label == SILENT
            scores = dict(zip(recogniser.classes, row.scores.tolist(), strict=True))
            entry: dict[str, Any] = {"recording": row.path, "class": None if silent else recogniser.classes[row.label]}
            entry |= {"decided_ms": row.decided_ms, "length_ms": row.length_ms, "settled": row.settled}
            texts.append(entry | {"scores": None if silent else scores})
        print(json.dumps(texts, indent=1))
        return
    rows = []
    for row in predicted:
        name = "silent" if row.label == SILENT else recogniser.classes[row.label]
        time = "-" if row.decided_ms is None else f"{row.decided_ms:.0f} of {row.length_ms:.0f} ms"
        top = sorted(zip(recogniser.classes, row.scores.tolist(), strict=True), key=lambda pair: -pair[1])[:3]
        message = "-" if row.label == SILENT else ", ".join(f"{which} {number(score)}" for which, score in top)
        rows.append((row.path, name, time, message))
    time = ">unchanged since" if allow is None else ">decided after"
    console().print(table(("recording", "class", time, "scores"), rows))
    if allow is not None:
        console().print(ASSUMES)


def show_early(recogniser: Recogniser, assurance: float = ASSURANCE) -> None:
    """Print the accuracy at each moment on held-out recordings, and the decision times for several allowed errors.

    Args:
        recogniser: trained recogniser; without `early`, nothing is printed.
        assurance: assurance of the allowed errors.
    """
    if recogniser.early is None:
        return
    held_out = recogniser.early.held
    moments = (
        np.unique(np.geomspace(1, len(held_out.times_us), min(10, len(held_out.times_us))).round().astype(int)) - 1
    )
    rows = [(f"{held_out.times_us[k] / 1000:g} ms", f"{held_out.right[:, k].mean():.1%}") for k in moments]
    out = console()
    out.print(f"{len(held_out.right)} recordings, each held out once")
    out.print(table((">after", ">right"), rows))
    smallest = least_allowed(held_out, assurance)
    out.print(f"with an assurance of {assurance:g} they support an allowed error of {smallest:.1%} or more")
    if supported := [allowed for allowed in ALLOWED if allowed >= smallest]:
        heads = (">--allow", ">decided after", ">wrong", ">95 % interval", ">of the worst class", ">95 % interval")
        rules = []
        for allowed in supported:
            result, class_texts = outcome(held_out, allowed, assurance), ("-", "-")
            shares = f"{result.error:.1%}", "{:.1%} to {:.1%}".format(*result.interval)
            if result.worst is not None:
                name = recogniser.classes[result.worst]
                class_texts = f"{name}: {result.worst_error:.1%}", "{:.1%} to {:.1%}".format(*result.worst_interval)
            rules.append((f"{allowed:.1%}", f"{result.mean_ms:.0f} ms", *shares, *class_texts))
        out.print("cross-validated: rules from nine tenths of them, tested on the last tenth")
        out.print(table(heads, rules))
    out.print(f"{ASSUMES}; with another mix the error may rise to that of the worst class")


def write_confusion(result: Tried, folder: Path) -> None:
    """Draw the confusion matrix of the recogniser's own decisions."""
    from neuro_recognise.telling.pictures import confusion

    _save(confusion(result.own), folder / "confusion.png")


def write_pictures(recogniser: Recogniser, folder: Path) -> None:
    """Draw pictures of the training result. If the method has no pictures, print a line instead."""
    figures = recogniser.method.pictures(recogniser.learnt, recogniser.classes)
    for name, figure in figures.items():
        _save(figure, folder / f"{name}.png")
    if not figures:
        print(f"method '{recogniser.method.called()}' has no pictures of what it has learnt")


NEAR = 0.03
"""Labels count as relearnt if the accuracy is at most this much below the accuracy before the permutation."""


def show_relearnt(accuracies: Mapping[str, Floats], before: int, classes: int, file: Path) -> None:
    """Print how well each method relearnt permuted labels, and plot accuracy by epoch.

    Args:
        accuracies: (seeds, epochs) accuracies, by the name of the method.
        before: number of epochs before the permutation.
        classes: number of classes.
        file: file of the plot.
    """
    from neuro_recognise.telling.pictures import relearnt

    n = next(iter(accuracies.values())).shape[1] - before
    head = ("method", ">before, %", ">after 1 epoch, %", f">after {n}, %", ">change, points", ">epochs to within 3")
    rows = []
    for name, shares in accuracies.items():
        ends = [shares[:, epoch] for epoch in (before - 1, before, -1)]
        near = np.flatnonzero(shares[:, before:].mean(axis=0) >= ends[0].mean() - NEAR)
        parts = (*ends, ends[2] - ends[0])
        rows.append((name, *map(_with_spread, parts), str(near[0] + 1) if near.size else f"not in {n}"))
    console().print(table(head, rows))
    _save(relearnt(accuracies, before, classes), file)


def _with_spread(shares: Floats) -> str:
    spread = f" ± {100 * shares.std(ddof=1):.1f}" if len(shares) > 1 else ""
    return f"{100 * shares.mean():.1f}{spread}"


def _save(figure: Figure, file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    write_picture(file, figure)
    print(file)


def _row(name: str, evaluation: Evaluation) -> tuple[object, ...]:
    low, high = evaluation.interval
    return name, f"{evaluation.accuracy:.1%}", f"{low:.1%} - {high:.1%}", evaluation.correct, evaluation.n


def _value_text(value: object) -> str:
    return f"[{', '.join(map(str, value))}]" if isinstance(value, (tuple, list)) else str(value)
