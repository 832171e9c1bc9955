"""The demonstration: make recordings, train, test, draw pictures, and compute energy on chips."""

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
"""Seed of the generated recordings on which the shipped network was trained."""
FIGURES = sealed("the figures of 'neuro remus demo'", f'"format": "{report.FORMAT}"', ', "digest": "{}"')
BILLS = sealed("the bills of 'neuro remus demo'", f'"format": "{energy.FORMAT}"', ', "digest": "{}"')


def run(data: Path | None, out: Path, seed: int) -> None:
    """Run the demonstration; finished steps are skipped.

    Args:
        data: folder of recordings; None generates some.
        out: folder for the recordings, the model, the results and the pictures.
        seed: seed of all random draws.

    Raises:
        EventFileError: the recordings cannot be read or made.
    """
    began = time.perf_counter()
    make_folder(out)
    has_shipped_network = data is None and seed == SEED
    if data is None:
        folder = out / "recordings"
        total = N_TRAIN + N_TEST
        n_missing = total - sum(1 for _ in folder.glob("*/*/*.bin"))
        if n_missing > 0:
            print(f"making {n_missing} of {total} recordings of moving digits in {folder}")
        else:
            print(f"using the {total} recordings of moving digits in {folder}")
        data = make_dataset(folder, N_TRAIN, N_TEST, seed)
    learning, unseen = halves(data, seed)
    print(f"learning from {len(learning)} recordings of {len(learning.classes)} classes")
    with LearningBar() as bar:
        recogniser = fit(learning, "remus", seed=seed, out=out / "model.h5", cache=out / "c1", report=bar.show)
    print(f"{out / 'model.h5'}: {report.training_summary(recogniser)}\n\ntesting on {len(unseen)} unseen recordings\n")
    test = try_out(recogniser, unseen)
    report.show(recogniser, test)
    write_text(out / "results.json", report.figures(recogniser, test) + "\n", FIGURES)
    print(out / "results.json")
    report.write_confusion(test, out)
    report.write_pictures(recogniser, out)
    priced = energy.bills(test, PRICED.split(","))
    write_text(out / "energy.json", energy.words(recogniser, test, priced) + "\n", BILLS)
    print(f"{out / 'energy.json'}\n", flush=True)
    energy.show(recogniser, test, priced)
    results = {"remus": (test, priced)}
    if has_shipped_network:
        _show_beside(learning, unseen, out, results)
    write_page(out / "index.html", recogniser, results)
    print(f"\n{out / 'index.html'}: what was learnt, on one page")
    print(f"done in {time.perf_counter() - began:.0f} s")


def _show_beside(learning: Recordings, unseen: Recordings, out: Path, results: dict[str, tuple[Tried, Priced]]) -> None:
    """Test the shipped network, which was trained by gradients on these recordings, and compare it with ReMuS."""
    name = "by gradients"
    print(f"\nthe same {len(unseen)} recordings with a shipped network, trained {name} on the {len(learning)}\n")
    recogniser = trained_by_gradients(learning, SEED)
    test = try_out(recogniser, unseen)
    results[name] = test, energy.bills(test, PRICED.split(","))
    write_text(out / "gradients.json", energy.words(recogniser, *results[name]) + "\n", BILLS)
    print(f"{out / 'gradients.json'}\n", flush=True)
    show_beside_each_other(results)


def halves(data: Path, seed: int) -> tuple[Recordings, Recordings]:
    """Return at most `N_TRAIN` recordings to learn from, and at most `N_TEST` others to test on.

    Classes have equal shares as far as possible. Without folders Train and Test, a quarter of the data is used to test.
    """
    learning = recordings(data, part="Train")
    unseen = recordings(data, part="Test", classes=learning.classes)
    shuffled = _shuffled(learning, seed)
    if {item.name for item in learning} == {item.name for item in unseen}:
        cut = min(len(shuffled) // 4, N_TEST)
        return shuffled[cut:][:N_TRAIN], shuffled[:cut]
    return shuffled[:N_TRAIN], _shuffled(unseen, seed)[:N_TEST]


def _shuffled(data: Recordings, seed: int) -> Recordings:
    """Return the recordings in random order; classes alternate as long as they have recordings."""
    labels = np.array([item.label for item in data])
    turn, rank = np.empty(len(data)), np.random.default_rng([seed, 1]).permutation(len(data))
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        turn[members] = rank[members].argsort().argsort()
    return Recordings(data.path, [data[int(k)] for k in np.lexsort((rank, turn))], data.classes)


TARGET = "loihi"
"""Chip on which both networks are compared."""


def trained_by_gradients(data: Recordings, seed: int) -> Recogniser:
    """Return the network that was trained by gradients on the same recordings, as a recogniser.

    The network ships as `demo_digits` of `neuro_models` and needs no torch; docs/how-to/train.md describes its
    training.

    Args:
        data: recordings that the network was trained on.
        seed: seed of these recordings.
    """
    net = neuro.load(path("demo_digits"))
    method = Dense(size=(34, 34), hidden=int(net.populations["hidden"].shape[0]))
    return Recogniser(method, data.classes, method.learnt_of(net), {"recordings": len(data), "seed": seed})


def show_beside_each_other(results: Mapping[str, tuple[Tried, Priced]]) -> None:
    """Print a table of accuracy and energy with a row for each recogniser.

    Args:
        results: test result and bills of each recogniser, by name.
    """
    heads = ("recogniser", ">accuracy", ">95 % interval", *COLUMNS)
    rows = []
    for name, (test, priced) in results.items():
        low, high = test.own.interval
        rows.append((name, f"{test.own.accuracy:.1%}", f"{low:.1%} - {high:.1%}", *priced.bills[TARGET].cells()))
    console().print(table(heads, rows, title=f"a recording on {TARGET}"))


PAGE = sealed(
    "the page of 'neuro remus demo'", '<meta name="generator" content="neuro remus demo">', "<!-- digest {} -->"
)
ABOUT = (
    "A spiking network learnt by reward from recordings of an event camera: the first map to fire names the digit, and "
    "its synapses grow if the name is right. Each tile below is one map."
)


def write_page(path: Path, recogniser: Recogniser, results: Mapping[str, tuple[Tried, Priced]]) -> None:
    """Write the page of results.

    Args:
        path: path of the page.
        recogniser: the trained recogniser.
        results: test result and bills of each recogniser, by name; the first entry belongs to `recogniser`.

    Raises:
        Unwritable: the page cannot be written, or another file has its name.
    """
    write_text(path, html.page("neuro remus demo", "What was learnt", _parts(path, recogniser, results)), PAGE)


def _parts(path: Path, recogniser: Recogniser, results: Mapping[str, tuple[Tried, Priced]]) -> Iterator[Any]:
    tag = html.tag
    name, (test, priced) = next(iter(results.items()))
    learnt_from = f"{recogniser.training['recordings']:,} recordings of {len(recogniser.classes)} classes"
    yield tag("h1", "What was learnt")
    yield tag("p", f"{name}, from {learnt_from}, tested on {test.own.n:,} unseen ones.", class_="lead")
    yield tag("div", *_cards(results), class_="cards")
    yield tag("p", ABOUT)
    for picture_name, figure in recogniser.method.pictures(recogniser.learnt, recogniser.classes).items():
        yield tag(
            "h2", {"prototypes": "What it looks for", "learning": "While it learnt"}.get(picture_name, picture_name)
        )
        yield html.picture(figure, picture_name)
    yield tag("h2", "Which digits it confuses")
    yield html.picture(confusion(test.own), f"confusion of {name}")
    yield tag("h2", "Energy and time per recording")
    rows = ((target, *bill.cells()) for target, bill in priced.bills.items())
    yield html.table(("chip", *COLUMNS), rows, f"{name} on chips, and as dense layers on cpu and gpu")
    yield tag("ul", *(tag("li", line) for line in (*footnotes(priced.bills.values(), False), *energy.notes(priced))))
    yield tag("h2", "What next")
    folder = path.parent
    commands = {
        f"neuro recognise watch {folder / 'model.h5'} RECORDING --out watch.html": "it decides while events arrive",
        f"neuro recognise energy {folder / 'model.h5'} --data FOLDER --sources": "energy, with sources of the figures",
        "neuro new my-classifier --template classifier": "a folder to start from",
    }
    wide = max(map(len, commands))
    yield tag("pre", "\n".join(f"{command:{wide}}   # {purpose}" for command, purpose in commands.items()))


def _cards(results: Mapping[str, tuple[Tried, Priced]]) -> Iterator[Any]:
    """Yield cards with accuracy and energy of each network."""
    for name, (test, priced) in results.items():
        low, high = test.own.interval
        yield html.card(f"right, {name}", f"{test.own.accuracy:.1%}", f"95 % interval {low:.1%} to {high:.1%}")
        if TARGET in priced.bills:
            bill = priced.bills[TARGET]
            slow = bill.real_time.total(3)
            note = f"a recording on {TARGET}, as fast as the chip can; {slow} in real time"
            yield html.card(f"energy, {name}", bill.total(3), note)
