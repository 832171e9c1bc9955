"""What people see of a search: its points as a table, as CSV and as a figure of accuracy against joules."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from neuro.apps import Kind, console, table, write_picture, write_text
from neuro_recognise.evaluate import wilson

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Place", "draw", "logarithmic", "show", "write"]

CSV = Kind("a table of 'neuro train --search'", lambda path: path.read_bytes()[:8] == b"network,")
GREY, BLUE = "0.65", "#0072B2"


@dataclass(frozen=True, slots=True)
class Place:
    """A point of a search.

    Attributes:
        varied: the values of what varied, by name.
        accuracy: where it was judged, mean of the folds.
        microjoules: of a recording on the chip, likewise.
        file: the network; that of the front is learnt from all that is not held out.
        tested: of the front how many are right of how many that are held out, and microjoules of one of them.
    """

    varied: Mapping[str, Any]
    accuracy: float
    microjoules: float
    file: Path
    tested: tuple[int, int, float] | None


def show(places: Sequence[Place], chip: str) -> None:
    """Print a row for each point of the front."""
    front = [place for place in places if place.tested]
    names = list(front[0].varied)
    cells = []
    for place in front:
        assert place.tested is not None, "it is of the front"
        right, n, spent = place.tested
        low, high = wilson(right, n)
        values = (f"{value:g}" for value in place.varied.values())
        searched = f"{place.accuracy:.1%}", f"{place.microjoules:.3g} uJ"
        cells.append((*values, *searched, f"{right / n:.1%}", f"{low:.1%} - {high:.1%}", f"{spent:.3g} uJ"))
    head = (*(f">{name}" for name in names), ">judged", f">on {chip}", ">held out", ">95 % interval", f">on {chip}")
    console().print(table(head, cells, title=f"{len(front)} of {len(places)} networks that no other beats"))


def write(folder: Path, places: Sequence[Place], chip: str) -> tuple[Path, Path]:
    """Write front.csv and front.png; errors as of `neuro.apps.output`."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    found = ("accuracy", "microjoules", "held_out_right", "held_out", "held_out_microjoules")
    writer.writerow(("network", *places[0].varied, *found))
    for place in places:
        tested = place.tested or ("", "", "")
        name = place.file.relative_to(folder).as_posix()
        writer.writerow((name, *place.varied.values(), place.accuracy, place.microjoules, *tested))
    files = folder / "front.csv", folder / "front.png"
    write_text(files[0], out.getvalue(), CSV)
    write_picture(files[1], draw(places, chip))
    return files


def draw(places: Sequence[Place], chip: str) -> Figure:
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
    share = [100.0 * right / n for right, n, _ in tests]
    limits = [wilson(right, n) for right, n, _ in tests]
    below = [at - 100.0 * low for at, (low, _) in zip(share, limits, strict=True)]
    above = [100.0 * high - at for at, (_, high) in zip(share, limits, strict=True)]
    spent = [joules for _, _, joules in tests]
    label = "the same, learnt anew, on recordings held out (95 %)"
    axis.errorbar(
        spent, share, yerr=(below, above), fmt="D", color=BLUE, label=label, markersize=5, linewidth=1.2, capsize=2
    )
    logarithmic(axis)
    axis.set_xlabel(f"microjoules of a recording on {chip}")
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


def _at(places: Sequence[Place]) -> tuple[list[float], list[float]]:
    return [place.microjoules for place in places], [100.0 * place.accuracy for place in places]
