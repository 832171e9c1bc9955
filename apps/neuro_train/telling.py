"""Output of a training or a search: tables, curves, pages, and the front of accuracy against joules."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from neuro.apps import Kind, console, html, literal, sealed, table, warn_of_overflows, wilson, write_picture, write_text
from neuro.chips import COLUMNS, between, footnotes
from neuro_train.tested import MARGIN, MemoryRoom, TestedNetwork, memory_lines, summed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from neuro_train.plan import TrainingPlan
    from neuro_train.trainer import Trained


PAGE = sealed("a page of 'neuro train'", '<meta name="generator" content="neuro train">', "<!-- digest {} -->")
HEAD = ("runs on", ">accuracy", ">95 % interval", ">equal decisions", ">equal spikes", ">first spike")
TARGETS = ("runs on", ">R2", ">largest difference")
SHARE = "right", "R2"
"""Titles of the curve "right": of a training with labels, and of a training with targets."""
BILLS = ("runs on", *COLUMNS)
JOULES = (
    "Joules and chip time are means over recordings: counts times published figures, with the range of the figures in "
    "brackets. The chip is on while it works, or, in real time, as long as the recording lasts. The bill "
    "includes the operations of the host, but neither the bytes that it moves nor its idle power."
)
ABOUT = (
    "Accuracy is measured on the test recordings, with Wilson's interval; silence is wrong. Equal decisions and equal "
    f"spikes are counted against the first row; a recording counts if all its output spikes are equal. {JOULES} The "
    "time of the first output spike is the network's time."
)
ABOUT_TARGETS = (
    "R2 is the share of the targets' variance that the output's potentials explain, as the mean over the neurons. "
    f"The largest difference is that of any potential in any step from the first row. {JOULES}"
)
ROOM = (
    "The table shows the largest input of a neuron in a step, over the learnt recordings, as a share of its register; "
    f"above 100 % the register wraps. Scales are halved until the input fits {MARGIN:g} times or a weight would lose a "
    "bit; neuro.compile takes the scales as scales={...}."
)


def rows(tests: Sequence[TestedNetwork]) -> list[tuple[str, ...]]:
    """Return a row for each backend, under `HEAD` or `TARGETS`."""
    if (torch := tests[0].V_m) is not None:
        differences = ((run, np.abs(np.asarray(run.V_m) - torch).max()) for run in tests)
        return [(run.backend, _share_or_dash(run.r_squared), f"{difference:.3g} mV") for run, difference in differences]
    table_rows: list[tuple[str, ...]] = []
    for run in tests:
        low, high = run.own.interval
        equal = f"{run.agrees(tests[0]):.1%}", f"{run.same_spikes(tests[0])} of {len(run.labels)}"
        first_spike = "-" if np.isnan(run.first_ms) else f"{run.first_ms:.1f} ms"
        accuracy = f"{run.own.accuracy:.1%}", f"{low:.1%} - {high:.1%}"
        table_rows.append((run.backend, *accuracy, *equal, first_spike))
    return table_rows


def _share_or_dash(value: float) -> str:
    """Return a share with three digits, or "-" for NaN."""
    return "-" if np.isnan(value) else f"{value:.3f}"


def head(tests: Sequence[TestedNetwork]) -> tuple[str, ...]:
    """Return the titles of the columns of `rows`."""
    return HEAD if tests[0].V_m is None else TARGETS


def bills(tests: Sequence[TestedNetwork]) -> list[tuple[str, ...]]:
    """Return a row for each chip with the energy of a recording."""
    return [(test.backend, *test.bill.cells()) for test in tests if test.bill]


def show(tests: Sequence[TestedNetwork], room: Sequence[MemoryRoom] = ()) -> None:
    """Print the room in registers, a row for each backend, the bills and their assumptions; warn of overflows."""
    for line in memory_lines(room):
        print(f"- {line}")
    if not tests:
        return
    for test in tests:
        warn_of_overflows(test.backend, test.overflows, len(test.labels))
    console().print(table(head(tests), rows(tests), title=f"{len(tests[0].labels)} recordings"))
    if bill_rows := bills(tests):
        console().print(table(BILLS, bill_rows, title="a recording"))
    for line in footnotes([test.bill for test in tests if test.bill], False):
        print(f"- {line}")
    _show_sent({test.backend: test.mean_spikes for test in tests})


def _show_sent(counts: Mapping[str, Mapping[str, float]]) -> None:
    """Print the mean number of spikes or messages of a recording on each backend."""
    for backend, population_counts in counts.items():
        if population_counts:
            parts = ", ".join(f"{number:.0f} of '{name}'" for name, number in population_counts.items())
            print(f"{backend}: {sum(population_counts.values()):.0f} spikes in a recording, {parts}")


def show_folds(folds: Sequence[Mapping[str, Any]]) -> None:
    """Print a row for each fold, the mean of all folds and the least room; warn of overflows in any fold."""
    names, n = list(folds[0]["right"]), sum(fold["n"] for fold in folds)
    all_rooms = [MemoryRoom(**room) for fold in folds for room in fold.get("room", ())]
    smallest = {(room.chip, room.population): room for room in sorted(all_rooms, key=lambda room: room.share)}
    for line in memory_lines([replace(room, chosen=False) for room in smallest.values()]):  # scales differ by fold
        print(f"- {line}")
    for name in names:
        overflows = (fold.get("overflows", {}).get(name, {}) for fold in folds)
        warn_of_overflows(name, summed(overflows), n)
    cells = [
        (str(k + 1), *(f"{fold['right'][name] / fold['n']:.1%}" for name in names), f"{fold['cpu_s']:.1f} s")
        for k, fold in enumerate(folds)
    ]
    console().print(table(("fold", *(f">{name}" for name in names), ">CPU time"), cells))
    for name in names:
        n_right = sum(fold["right"][name] for fold in folds)
        low, high = wilson(n_right, n)
        print(f"{name}: {n_right / n:.2%} of {n} right (95 % interval {low:.1%} - {high:.1%})")
    for name in names:
        parts = [(fold["n"], fold.get("sent", {}).get(name, {})) for fold in folds]
        _show_sent({name: {key: sum(k * part[key] for k, part in parts) / n for key in parts[0][1]}})


def write(
    path: Path,
    plan: TrainingPlan,
    trained: Trained,
    tests: Sequence[TestedNetwork],
    recordings: int,
    room: Sequence[MemoryRoom] = (),
) -> None:
    """Write the page. Errors: see `neuro.apps.write_text`."""
    title = f"{trained.net.name}: trained by gradients"
    write_text(path, html.page("neuro train", title, _parts(plan, trained, tests, recordings, room)), PAGE)


def _parts(
    plan: TrainingPlan, trained: Trained, tests: Sequence[TestedNetwork], recordings: int, room: Sequence[MemoryRoom]
) -> Iterator[Any]:
    tag = html.tag
    yield tag("h1", f"{trained.net.name}: trained by gradients")
    lead = f"{recordings} recordings, {plan.epochs} epochs, {trained.cpu_s:.1f} s of one core."
    yield tag("p", lead, class_="lead")
    share = SHARE[plan.loss == "mse"]
    if cards := list(_cards(trained, tests, share)):
        yield tag("div", *cards, class_="cards")
    if tests:
        yield tag("h2", f"On {len(tests[0].labels)} unseen recordings")
        yield html.table(head(tests), rows(tests))
        if bill_rows := bills(tests):
            yield html.table(BILLS, bill_rows)
        yield tag("p", ABOUT if tests[0].V_m is None else ABOUT_TARGETS)
    if room:
        yield tag("h2", "Room in registers")
        notes = {False: "the chip's own", True: "smaller, to leave room"}
        cells = ((row.chip, row.population, f"{row.share:.1%}", f"{row.scale:.6g}", notes[row.chosen]) for row in room)
        yield html.table(("chip", "population", ">largest input of a step", ">units per mV", "scale"), cells)
        yield tag("p", ROOM)
    if len(trained.curves["loss"]):
        yield tag("h2", "While it learnt")
        pictures = (
            html.picture(drawing, f"{label} by epoch") for label, drawing in curves(trained.curves, share).items()
        )
        yield tag("div", *pictures, class_="grid")
    yield tag("h2", "How it was trained")
    settings = {"for (ms)" if name == "duration" else name: value for name, value in plan.as_words().items()}
    words = ((name, _word(value)) for name, value in settings.items() if value not in (None, [], {}, 0.0, ""))
    rates = ((f"rate of {name}", f"{rate:g}") for name, rate in trained.rates.items() if rate != plan.rate)
    yield html.table(("what", "value"), [*words, *rates])
    yield tag("pre", str(trained.module.plan))
    if sources := list(footnotes([test.bill for test in tests if test.bill], True)):
        yield tag("h2", "Where the joules come from")
        yield tag("ul", *(tag("li", line) for line in sources))


def _cards(trained: Trained, tests: Sequence[TestedNetwork], share: str) -> Iterator[Any]:
    """Yield cards with the accuracy on unseen recordings, or else on the learnt ones, and joules on each chip."""
    if tests and tests[0].V_m is not None:
        yield html.card("R2", _share_or_dash(tests[0].r_squared), f"on {len(tests[0].labels)} unseen recordings")
    elif tests:
        score = tests[0].own
        low, high = score.interval
        yield html.card("accuracy", f"{score.accuracy:.1%}", f"of {score.n} unseen recordings; {low:.1%} to {high:.1%}")
    elif np.isfinite(trained.curves["right"]).any():
        yield html.card(share, f"{trained.curves['right'][-1]:.1%}", "on the learnt recordings")
    for test in tests:
        if test.bill:
            slow = test.bill.real_time.total(3)
            note = f"a recording, as fast as the chip can; {slow} in real time; {test.grade}"
            yield html.card(f"energy on {test.backend}", test.bill.total(3), note)


def _word(value: Any) -> str:
    """Return a value as it is written on the command line."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name}={_word(item)}" for name, item in value.items())
    if isinstance(value, list):
        return ", ".join(value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def curves(figures: Mapping[str, npt.NDArray[np.float64]], share: str = SHARE[0]) -> dict[str, Figure]:
    """Return drawings of loss, accuracy on the learnt recordings, and joules if they were in the loss, by label."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    quantities = [("loss", "loss", 1.0)]
    if np.isfinite(figures["right"]).any():
        quantities.append(("right", f"{share}, %", 100.0))
    if figures["joules"].any():
        quantities.append(("joules", "as fast as the chip can, uJ", 1e6))
    drawings = {}
    for name, label, unit in quantities:
        drawings[label] = figure = Figure(figsize=(3.4, 2.6), dpi=140, layout="constrained")
        axis = figure.subplots()
        axis.plot(np.arange(1, len(figures[name]) + 1), unit * figures[name], color="#0072B2", lw=1.4)
        axis.set_xlabel("epoch")
        axis.set_ylabel(label)
        axis.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
        axis.spines[["top", "right"]].set_visible(False)
    return drawings


SPENT = tuple(f"{clock}microjoules{end}" for clock in ("", "real_time_") for end in ("", "_low", "_high"))
"""Names of the energy of a recording with its range, as fast as the chip can and in real time."""

CSV = Kind("a table of 'neuro train --search'", lambda path: path.read_bytes()[:8] == b"network,")
GREY, BLUE = "0.65", "#0072B2"


@dataclass(frozen=True, slots=True)
class FrontPlace:
    """A point of a search.

    Attributes:
        varied: varied values by name.
        accuracy: accuracy on the part that judges the network, as the mean over the folds.
        microjoules: energy of a recording on the chip, as fast as the chip can, as the mean over the folds.
        file: file of the network. A network of the front is trained on all parts but the held-out one.
        tested: for the front, the numbers `right` and `n` of held-out recordings, and `SPENT` of a recording.
    """

    varied: Mapping[str, Any]
    accuracy: float
    microjoules: float
    file: Path
    tested: Mapping[str, float] | None


def show_front(places: Sequence[FrontPlace], chip: str) -> None:
    """Print a row for each point of the front."""
    front = [place for place in places if place.tested]
    names = list(front[0].varied)
    cells = []
    for place in front:
        assert place.tested is not None, "`place` is on the front"
        share, (low, high) = _held_out(place.tested)
        values = (f"{value:g}" for value in place.varied.values())
        joules = [1e-6 * place.tested[name] for name in SPENT]
        energy = between(*joules[:3]), between(*joules[3:])
        cells.append((*values, f"{place.accuracy:.1%}", f"{share:.1%}", f"{low:.1%} - {high:.1%}", *energy))
    head = (*(f">{name}" for name in names), ">judged", ">held out", ">95 % interval", *COLUMNS[1:3])
    title = f"{len(front)} of {len(places)} networks are on the front; energy of a recording on {chip}"
    console().print(table(head, cells, title=title))


def _held_out(tested: Mapping[str, float]) -> tuple[float, tuple[float, float]]:
    """Return the share of right decisions and its 95 % interval."""
    n_right, n = int(tested["right"]), int(tested["n"])
    return n_right / n, wilson(n_right, n)


def write_front(folder: Path, places: Sequence[FrontPlace], chip: str) -> tuple[Path, Path]:
    """Write front.csv and front.png; for errors see `neuro.apps.output`."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    columns = ("accuracy", "microjoules", "held_out_right", "held_out", *(f"held_out_{name}" for name in SPENT))
    writer.writerow(("network", *places[0].varied, *columns))
    for place in places:
        tested = [f"{place.tested[name]:.10g}" if place.tested else "" for name in ("right", "n", *SPENT)]
        name = place.file.relative_to(folder).as_posix()
        writer.writerow((name, *place.varied.values(), place.accuracy, place.microjoules, *tested))
    files = folder / "front.csv", folder / "front.png"
    write_text(files[0], out.getvalue(), CSV)
    write_picture(files[1], draw(places, chip))
    return files


def draw(places: Sequence[FrontPlace], chip: str) -> Figure:
    """Draw accuracy against joules: all points, and the front with its accuracy on held-out recordings."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), dpi=150, layout="constrained")
    axis = figure.subplots()
    axis.spines[["top", "right"]].set_visible(False)
    front = [place for place in places if place.tested]
    untested_places = [place for place in places if not place.tested]
    axis.plot(*_coordinates(untested_places), "o", color=GREY, markersize=4, label="judged in the search")
    axis.step(*_coordinates(front), where="post", color=GREY, linewidth=1.0)
    axis.plot(*_coordinates(front), "o", color="0.3", markersize=5, label="no other beats these")
    tests = [place.tested for place in front if place.tested]
    held_out = [_held_out(tested) for tested in tests]
    percent = [100.0 * share for share, _ in held_out]
    lower_errors = [100.0 * (share - low) for share, (low, _) in held_out]
    upper_errors = [100.0 * (high - share) for share, (_, high) in held_out]
    microjoules = [tested["microjoules"] for tested in tests]
    label = "the same, learnt anew, on recordings held out (95 %)"
    axis.errorbar(
        microjoules,
        percent,
        yerr=(lower_errors, upper_errors),
        fmt="D",
        color=BLUE,
        label=label,
        markersize=5,
        linewidth=1.2,
        capsize=2,
    )
    logarithmic(axis)
    axis.set_xlabel(literal(f"microjoules of a recording on {chip}, as fast as it can"))
    axis.set_ylabel("right decisions, %")
    axis.legend(frameon=False, fontsize="small", loc="lower right")
    return figure


def logarithmic(axis: Axes) -> None:
    """Make the x axis logarithmic, with plain numbers such as 1, 2 and 5 as labels."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    axis.set_xscale("log")
    low, high = axis.get_xlim()
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)) if high > 5.0 * low else MaxNLocator(6))
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter(NullFormatter())


def _coordinates(places: Sequence[FrontPlace]) -> tuple[list[float], list[float]]:
    return [place.microjoules for place in places], [100.0 * place.accuracy for place in places]
