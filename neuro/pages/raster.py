"""Rasters that can be zoomed: strips of spikes along a common time axis.

A spike is the number step * rows + row. A page contains the differences of the sorted numbers, with 7 bits per byte,
lowest bits first, as base64. A spike needs 1 or 2 bytes.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from neuro.core import html
from neuro.core.html import Html, tag
from neuro.program.program import Ints

LEAST_ROWS = 8
MOST_ROWS = 1000
HELP = (
    "Drag over a part to see it larger (along the time, or over neurons too); a double click shows the whole again. "
    "Ctrl and the wheel zoom, the arrows move along. All that this page draws along time shows the same part."
)
_BUTTONS = (("left", "←"), ("right", "→"), ("in", "+"), ("out", "-"), ("whole", "whole"))


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Neurons and steps of a population in a raster.

    Attributes:
        neurons: ids in ascending order; each neuron is a row.
        steps: end (exclusive) of the drawn steps, from 0.
        size: number of neurons of the population.
    """

    neurons: Ints
    steps: int
    size: int

    def keys(self, steps: Ints, ids: Ints) -> Ints:
        """Return step and row of each drawn spike as one number."""
        keep = (steps < self.steps) & np.isin(ids, self.neurons)
        row = np.searchsorted(self.neurons, ids[keep])
        keys: Ints = np.unique(steps[keep] * self.neurons.size + row)
        return keys

    def described(self, ms: float, resolution_ms: float) -> str:
        """Return the drawn share of the population and of the run as text."""
        n, end_ms = self.neurons.size, self.steps * resolution_ms
        count = f"{self.size:,} neuron{'s' * (self.size != 1)}"
        text = count if n == self.size else f"{n:,} of {count}, evenly chosen"
        return text if end_ms >= ms else f"{text}; the first {end_ms:g} of {ms:g} ms"


def window(size: int, trains: Sequence[tuple[Ints, Ints]], last: int, most: int, also: Iterable[int] = ()) -> Window:
    """Return the neurons and steps that fit into a raster. Neurons are left out first, then the end of the run.

    Args:
        size: number of neurons of the population.
        trains: steps and ids of the spikes of each strip.
        last: last step of the run.
        most: largest number of spikes of a strip.
        also: neurons to draw in any case.
    """
    total = max((ids.size for _, ids in trains), default=0)
    rows = max(min(MOST_ROWS, int(0.9 * most * size / max(total, 1))), LEAST_ROWS)
    neurons = np.union1d(evenly(size, rows), np.array([*also], dtype=np.int64)).astype(np.int64)
    end = last + 1
    for steps, ids in trains:
        drawn_steps = steps[np.isin(ids, neurons)]
        if drawn_steps.size > most:
            end = min(end, int(drawn_steps[most]))
    return Window(neurons, end, size)


def evenly(size: int, most: int) -> Ints:
    """Return at most `most` of the neurons 0 to size - 1, evenly spaced."""
    ids: Ints = np.unique(np.linspace(0, max(size - 1, 0), min(size, most)).astype(np.int64))
    return ids


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """A strip of a raster: the spikes of a population or backend.

    Attributes:
        name: source of the spikes.
        about: short description.
        window: drawn neurons and steps.
        kinds: keys of spikes by kind; each kind has a colour in the style sheet.
        mark: time of a mark in ms.
    """

    name: str
    about: str
    window: Window
    kinds: Mapping[str, Ints] = field(default_factory=dict)
    mark: float | None = None


def raster(
    strips: Sequence[Strip], ms: float, resolution_ms: float, *, label: str, tallest: int = 96, linked: bool = False
) -> Html:
    """Draw strips with heights in proportion to the populations. If `linked`, zooming one strip zooms all."""
    largest = max((strip.window.size for strip in strips), default=1)
    data = {
        "ms": ms,
        "step": resolution_ms,
        "together": linked,
        "strips": [_plain(strip, tallest * strip.window.size / largest) for strip in strips],
    }
    text = Html(json.dumps(data, separators=(",", ":")).replace("<", "\\u003c"))
    buttons = (tag("button", label, type="button", name_=name, aria_label=name) for name, label in _BUTTONS)
    return html.join(
        [
            tag("div", *buttons, tag("output"), class_="tools"),
            tag("div", tag("canvas", role="img", aria_label=label, tabindex=0, title=HELP)),
            tag("script", text, type="application/json"),
        ]
    )


@cache
def script() -> str:
    """Return the script that draws rasters; a page includes it once."""
    return (Path(__file__).parent / "raster.js").read_text("utf-8")


def _plain(strip: Strip, tallest: float) -> dict[str, object]:
    """Return a strip as data for the page's script, with a height of at most `tallest` px."""
    neurons = strip.window.neurons
    rows = neurons.size
    return {
        "name": strip.name,
        "about": strip.about,
        "rows": rows,
        "neurons": packed(neurons) if rows < strip.window.size else "",
        "height": round(max(24, min(tallest, 3 * rows))),
        "mark": strip.mark,
        "kinds": {kind: packed(keys) for kind, keys in strip.kinds.items() if keys.size},
    }


def packed(keys: Ints) -> str:
    """Return ascending numbers as base64 of the differences; see the module's docstring."""
    gaps = np.diff(keys, prepend=0).astype(np.uint64)
    digits = [gaps]
    while (higher := digits[-1] >> np.uint64(7)).any():
        digits.append(higher)
    columns = np.stack(digits, axis=1)
    is_used = columns > 0
    is_used[:, 0] = True
    continues = np.zeros_like(is_used)
    continues[:, :-1] = is_used[:, 1:]
    # Bit 7 of a byte is set if another byte of the number follows.
    content = (columns & np.uint64(127)) | (continues.astype(np.uint64) << np.uint64(7))
    return base64.b64encode(content[is_used].astype(np.uint8).tobytes()).decode("ascii")
