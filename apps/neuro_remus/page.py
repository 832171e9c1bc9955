"""The page of the demonstration: what was learnt, how well it decides, what a recording takes on chips."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from neuro.apps import html, sealed, write_text
from neuro.chips import COLUMNS, footnotes
from neuro_recognise.energy import Priced, notes
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.telling.pictures import confusion
from neuro_recognise.telling.report import Tried

PAGE = sealed(
    "the page of 'neuro remus demo'", '<meta name="generator" content="neuro remus demo">', "<!-- digest {} -->"
)
ABOUT = (
    "A network of spiking neurons looked at recordings of an event camera and learnt by reward: the first map to fire "
    "names the digit, and its synapses grow if it is right. Each tile below is one of its maps."
)
CHIP = "loihi"


def write(path: Path, recogniser: Recogniser, found: Mapping[str, tuple[Tried, Priced]]) -> None:
    """Write the page.

    Args:
        path: of the page.
        recogniser: what was learnt.
        found: what came of it on unseen recordings and its bills, by name; the first is the recogniser's own.

    Raises:
        Unwritable: it cannot be written, or something else stands there.
    """
    write_text(path, html.page("neuro remus demo", "What was learnt", _parts(path, recogniser, found)), PAGE)


def _parts(path: Path, recogniser: Recogniser, found: Mapping[str, tuple[Tried, Priced]]) -> Iterator[Any]:
    tag = html.tag
    name, (tried, priced) = next(iter(found.items()))
    learnt_from = f"{recogniser.training['recordings']:,} recordings of {len(recogniser.classes)} classes"
    yield tag("h1", "What was learnt")
    yield tag("p", f"{name}, from {learnt_from}, tested on {tried.own.n:,} that it has never seen.", class_="lead")
    yield tag("div", *_cards(found), class_="cards")
    yield tag("p", ABOUT)
    for drawn, figure in recogniser.method.pictures(recogniser.learnt, recogniser.classes).items():
        yield tag("h2", {"prototypes": "What it looks for", "learning": "While it learnt"}.get(drawn, drawn))
        yield html.picture(figure, drawn)
    yield tag("h2", "What it takes for what")
    yield html.picture(confusion(tried.own), f"confusion of {name}")
    yield tag("h2", "What a recording takes")
    rows = ((target, *bill.cells()) for target, bill in priced.bills.items())
    yield html.table(("chip", *COLUMNS), rows, f"{name} on chips, and as dense layers on cpu and gpu")
    yield tag("ul", *(tag("li", line) for line in (*footnotes(priced.bills.values(), False), *notes(priced))))
    yield tag("h2", "What next")
    folder = path.parent
    commands = {
        f"neuro recognise watch {folder / 'model.h5'} RECORDING --out watch.html": "it decides while events arrive",
        f"neuro recognise energy {folder / 'model.h5'} --data FOLDER --sources": "where each figure is published",
        "neuro new my-classifier --template classifier": "a folder to start from",
    }
    wide = max(map(len, commands))
    yield tag("pre", "\n".join(f"{command:{wide}}   # {why}" for command, why in commands.items()))


def _cards(found: Mapping[str, tuple[Tried, Priced]]) -> Iterator[Any]:
    """Accuracy and joules of each network."""
    for name, (tried, priced) in found.items():
        low, high = tried.own.interval
        yield html.card(f"right, {name}", f"{tried.own.accuracy:.1%}", f"95 % interval {low:.1%} to {high:.1%}")
        if CHIP in priced.bills:
            bill = priced.bills[CHIP]
            slow = bill.real_time.total(3)
            below = f"a recording on {CHIP}, as fast as the chip can; {slow} in real time"
            yield html.card(f"energy, {name}", bill.total(3), below)
