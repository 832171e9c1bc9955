"""Beside what ReMuS learns in the demonstration: a network that learnt the same recordings by gradients before.

It ships as `demo_digits` of `neuro_models`; docs/how-to/train.md tells how it was trained. It needs no torch.
"""

from __future__ import annotations

from collections.abc import Mapping

import neuro
from neuro.apps import console, table
from neuro.chips import COLUMNS
from neuro.events import Recordings
from neuro_models import path
from neuro_recognise.methods.gradients import Dense
from neuro_recognise.priced import Priced
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.telling.tried import Tried

__all__ = ["TARGET", "show", "trained"]

TARGET = "loihi"
"""The chip on which both are compared."""


def trained(data: Recordings, seed: int) -> Recogniser:
    """The network as a recogniser.

    Args:
        data: the recordings that it learnt from.
        seed: by which they were made.
    """
    net = neuro.load(path("demo_digits"))
    method = Dense(size=(34, 34), hidden=int(net.populations["hidden"].shape[0]))
    return Recogniser(method, data.classes, method.learnt_of(net), {"recordings": len(data), "seed": seed})


def show(found: Mapping[str, tuple[Tried, Priced]]) -> None:
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
