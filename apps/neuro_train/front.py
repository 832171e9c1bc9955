"""What people see of a search: its points as a table, as CSV and as a figure of accuracy against joules."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from neuro.apps import Kind, console, literal, table, wilson, write_picture, write_text
from neuro.chips import COLUMNS, between

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPENT = tuple(f"{clock}microjoules{end}" for clock in ("", "real_time_") for end in ("", "_low", "_high"))
"""What a recording takes, with its range, as fast as the chip can and in real time."""

CSV = Kind("a table of 'neuro train --search'", lambda path: path.read_bytes()[:8] == b"network,")
GREY, BLUE = "0.65", "#0072B2"


@dataclass(frozen=True, slots=True)
class FrontPlace:
    """A point of a search.

    Attributes:
        varied: the values of what varied, by name.
        accuracy: where it was judged, mean of the folds.
        microjoules: of a recording on the chip as fast as it can, likewise.
        file: the network; that of the front is learnt from all that is not held out.
        tested: of the front how many are `right` of `n` that are held out, and `SPENT` of one of them.
    """

    varied: Mapping[str, Any]
    accuracy: float
    microjoules: float
    file: Path
    tested: Mapping[str, float] | None


def show(places: Sequence[FrontPlace], chip: str) -> None:
    """Print a row for each point of the front."""
    front = [place for place in places if place.tested]
    names = list(front[0].varied)
    cells = []
    for place in front:
        assert place.tested is not None, "it is of the front"
        share, (low, high) = _held_out(place.tested)
        values = (f"{value:g}" for value in place.varied.values())
        joules = [1e-6 * place.tested[name] for name in SPENT]
        spent = between(*joules[:3]), between(*joules[3:])
        cells.append((*values, f"{place.accuracy:.1%}", f"{share:.1%}", f"{low:.1%} - {high:.1%}", *spent))
    head = (*(f">{name}" for name in names), ">judged", ">held out", ">95 % interval", *COLUMNS[1:3])
    title = f"{len(front)} of {len(places)} networks that no other beats, and a recording on {chip}"
    console().print(table(head, cells, title=title))


def _held_out(tested: Mapping[str, float]) -> tuple[float, tuple[float, float]]:
    """The share of right decisions, and its 95 % interval."""
    right, n = int(tested["right"]), int(tested["n"])
    return right / n, wilson(right, n)


def write(folder: Path, places: Sequence[FrontPlace], chip: str) -> tuple[Path, Path]:
    """Write front.csv and front.png; errors as of `neuro.apps.output`."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    found = ("accuracy", "microjoules", "held_out_right", "held_out", *(f"held_out_{name}" for name in SPENT))
    writer.writerow(("network", *places[0].varied, *found))
    for place in places:
        tested = [f"{place.tested[name]:.10g}" if place.tested else "" for name in ("right", "n", *SPENT)]
        name = place.file.relative_to(folder).as_posix()
        writer.writerow((name, *place.varied.values(), place.accuracy, place.microjoules, *tested))
    files = folder / "front.csv", folder / "front.png"
    write_text(files[0], out.getvalue(), CSV)
    write_picture(files[1], draw(places, chip))
    return files


def draw(places: Sequence[FrontPlace], chip: str) -> Figure:
    """Accuracy against joules: all points, and the front with what it reaches on recordings that are held out."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), dpi=150, layout="constrained")
    axis = figure.subplots()
    axis.spines[["top", "right"]].set_visible(False)
    front = [place for place in places if place.tested]
    others = [place for place in places if not place.tested]
    axis.plot(*_at(others), "o", color=GREY, markersize=4, label="judged in the search")
    axis.step(*_at(front), where="post", color=GREY, linewidth=1.0)
    axis.plot(*_at(front), "o", color="0.3", markersize=5, label="no other beats these")
    tests = [place.tested for place in front if place.tested]
    held_out = [_held_out(tested) for tested in tests]
    share = [100.0 * at for at, _ in held_out]
    below = [100.0 * (at - low) for at, (low, _) in held_out]
    above = [100.0 * (high - at) for at, (_, high) in held_out]
    spent = [tested["microjoules"] for tested in tests]
    label = "the same, learnt anew, on recordings held out (95 %)"
    axis.errorbar(
        spent, share, yerr=(below, above), fmt="D", color=BLUE, label=label, markersize=5, linewidth=1.2, capsize=2
    )
    logarithmic(axis)
    axis.set_xlabel(literal(f"microjoules of a recording on {chip}, as fast as it can"))
    axis.set_ylabel("right decisions, %")
    axis.legend(frameon=False, fontsize="small", loc="lower right")
    return figure


def logarithmic(axis: Axes) -> None:
    """Logarithms of what is there along the axis, with numbers as people write them."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    axis.set_xscale("log")
    low, high = axis.get_xlim()
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)) if high > 5.0 * low else MaxNLocator(6))
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter(NullFormatter())


def _at(places: Sequence[FrontPlace]) -> tuple[list[float], list[float]]:
    return [place.microjoules for place in places], [100.0 * place.accuracy for place in places]
