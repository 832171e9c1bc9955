"""The main job from nothing: recordings, training, test, pictures, what a recording takes on chips."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import neuro
from neuro.apps import PRICED, console, html, make_folder, sealed, table, write_text
from neuro.chips import COLUMNS, footnotes
from neuro_events import Recordings, recordings
from neuro_models import path
from neuro_recognise import energy
from neuro_recognise.energy import Priced
from neuro_recognise.methods.gradients import Dense
from neuro_recognise.recogniser import Recogniser, fit
from neuro_recognise.telling import report
from neuro_recognise.telling.pictures import confusion
from neuro_recognise.telling.report import LearningBar, Tried, try_out
from neuro_remus.saccades import make_dataset

N_TRAIN, N_TEST = 1500, 500
SEED = 0
"""Of the recordings that the network beside ReMuS learnt from."""
FIGURES = sealed("the figures of 'neuro remus demo'", f'"format": "{report.FORMAT}"', ', "digest": "{}"')
BILLS = sealed("the bills of 'neuro remus demo'", f'"format": "{energy.FORMAT}"', ', "digest": "{}"')


def run(data: Path | None, out: Path, seed: int) -> None:
    """Do it, or what is left of it; what is done already is not done again.

    Args:
        data: recordings; None makes some.
        out: folder for the recordings, the model, the figures and the pictures.
        seed: of everything random.

    Raises:
        EventFileError: the recordings cannot be read or made.
    """
    began = time.perf_counter()
    make_folder(out)
    known = data is None and seed == SEED
    if data is None:
        folder = out / "recordings"
        total = N_TRAIN + N_TEST
        missing = total - sum(1 for _ in folder.glob("*/*/*.bin"))
        if missing > 0:
            print(f"making {missing} of {total} recordings of moving digits in {folder}")
        else:
            print(f"using the {total} recordings of moving digits in {folder}")
        data = make_dataset(folder, N_TRAIN, N_TEST, seed)
    learning, unseen = halves(data, seed)
    print(f"learning from {len(learning)} recordings of {len(learning.classes)} classes")
    with LearningBar() as bar:
        made = fit(learning, "remus", seed=seed, out=out / "model.h5", cache=out / "c1", report=bar.show)
    print(f"{out / 'model.h5'}: {report.learnt(made)}\n\ntesting on {len(unseen)} recordings that it has never seen\n")
    tried = try_out(made, unseen)
    report.show(made, tried)
    write_text(out / "results.json", report.figures(made, tried) + "\n", FIGURES)
    print(out / "results.json")
    report.write_confusion(tried, out)
    report.write_pictures(made, out)
    priced = energy.bills(tried, PRICED.split(","))
    write_text(out / "energy.json", energy.words(made, tried, priced) + "\n", BILLS)
    print(f"{out / 'energy.json'}\n", flush=True)
    energy.show(made, tried, priced)
    found = {"remus": (tried, priced)}
    if known:
        _show_beside(learning, unseen, out, found)
    write_page(out / "index.html", made, found)
    print(f"\n{out / 'index.html'}: what was learnt, on one page")
    print(f"done in {time.perf_counter() - began:.0f} s")


def _show_beside(learning: Recordings, unseen: Recordings, out: Path, found: dict[str, tuple[Tried, Priced]]) -> None:
    """Test the network that learnt these recordings by gradients, and compare."""
    name = "by gradients"
    print(f"\nthe same {len(unseen)} recordings for a network that ships and learnt {name} from the {len(learning)}\n")
    made = trained_by_gradients(learning, SEED)
    tried = try_out(made, unseen)
    found[name] = tried, energy.bills(tried, PRICED.split(","))
    write_text(out / "gradients.json", energy.words(made, *found[name]) + "\n", BILLS)
    print(f"{out / 'gradients.json'}\n", flush=True)
    show_beside_each_other(found)


def halves(data: Path, seed: int) -> tuple[Recordings, Recordings]:
    """At most `N_TRAIN` recordings to learn from and at most `N_TEST` others, each class alike.

    Data without folders Train and Test is divided, a quarter of it is for the test.
    """
    learning = recordings(data, part="Train")
    unseen = recordings(data, part="Test", classes=learning.classes)
    shuffled = _shuffled(learning, seed)
    if {item.name for item in learning} == {item.name for item in unseen}:
        cut = min(len(shuffled) // 4, N_TEST)
        return shuffled[cut:][:N_TRAIN], shuffled[:cut]
    return shuffled[:N_TRAIN], _shuffled(unseen, seed)[:N_TEST]


def _shuffled(data: Recordings, seed: int) -> Recordings:
    """In a random order in which the classes take turns, as long as they have recordings."""
    labels = np.array([item.label for item in data])
    turn, chance = np.empty(len(data)), np.random.default_rng([seed, 1]).permutation(len(data))
    for label in np.unique(labels):
        mine = np.flatnonzero(labels == label)
        turn[mine] = chance[mine].argsort().argsort()
    return Recordings(data.path, [data[int(k)] for k in np.lexsort((chance, turn))], data.classes)


TARGET = "loihi"
"""The chip on which both are compared."""


def trained_by_gradients(data: Recordings, seed: int) -> Recogniser:
    """The network that learnt the same recordings by gradients, as a recogniser.

    It ships as `demo_digits` of `neuro_models`; docs/how-to/train.md says how it was trained. It needs no torch.

    Args:
        data: the recordings that it learnt from.
        seed: by which they were made.
    """
    net = neuro.load(path("demo_digits"))
    method = Dense(size=(34, 34), hidden=int(net.populations["hidden"].shape[0]))
    return Recogniser(method, data.classes, method.learnt_of(net), {"recordings": len(data), "seed": seed})


def show_beside_each_other(found: Mapping[str, tuple[Tried, Priced]]) -> None:
    """Print a row for each recogniser: how many it decides rightly, and what a recording takes on the chip.

    Args:
        found: what came of each and its bills, by name.
    """
    heads = ("recogniser", ">accuracy", ">95 % interval", *COLUMNS)
    rows = []
    for name, (tried, priced) in found.items():
        low, high = tried.own.interval
        rows.append((name, f"{tried.own.accuracy:.1%}", f"{low:.1%} - {high:.1%}", *priced.bills[TARGET].cells()))
    console().print(table(heads, rows, title=f"a recording on {TARGET}"))


PAGE = sealed(
    "the page of 'neuro remus demo'", '<meta name="generator" content="neuro remus demo">', "<!-- digest {} -->"
)
ABOUT = (
    "A network of spiking neurons looked at recordings of an event camera and learnt by reward: the first map to fire "
    "names the digit, and its synapses grow if it is right. Each tile below is one of its maps."
)


def write_page(path: Path, recogniser: Recogniser, found: Mapping[str, tuple[Tried, Priced]]) -> None:
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
    yield tag("ul", *(tag("li", line) for line in (*footnotes(priced.bills.values(), False), *energy.notes(priced))))
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
        if TARGET in priced.bills:
            bill = priced.bills[TARGET]
            slow = bill.real_time.total(3)
            below = f"a recording on {TARGET}, as fast as the chip can; {slow} in real time"
            yield html.card(f"energy, {name}", bill.total(3), below)
