"""What `neuro train` may be told on a command line; `neuro_train.plan.TrainingPlan` says what most of it means."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from neuro.apps import whole
from neuro_train.plan import LOSSES

Option = typer.Option


def folds(text: str) -> int:
    """A whole number >= 2."""
    return whole(text, 2)


# recordings
Data = Annotated[Path, Option("--data", metavar="FOLDER", help="Recordings: a folder, zip or HDF5 data set.")]
Part = Annotated[str, Option("--part", metavar="NAME", help="Of recordings in parts, such as Train.")]
Without = Annotated[
    list[str], Option("--without", metavar="PATTERN", help="Leave out names like '*i.aedat'; repeatable.")
]
Test = Annotated[Path | None, Option("--test", metavar="FOLDER", help="Recordings to test on.")]
Folds = Annotated[
    int | None, Option("--folds", metavar="N", parser=folds, help="Test each Nth on what the others taught instead.")
]
Backends = Annotated[str, Option(metavar="A,B,...", help="What to test on.")]

# how they are seen
Input = Annotated[str, Option("--input", metavar="NAME", help="The population of the pixels.")]
Output = Annotated[str, Option("--output", metavar="NAME", help="The population with a neuron a class.")]
Duration = Annotated[float, Option(metavar="MS", help="Of each recording, in ms.")]
Start = Annotated[float, Option(metavar="MS", help="What is left out before that, in ms.")]
Scale = Annotated[int, Option(metavar="N", help="Pixels in a row and column that are one neuron.")]
Window = Annotated[
    str | None,
    Option(metavar="X,Y", help="Of a larger sensor: its part from that pixel, or 'centred' on each recording."),
]
Augment = Annotated[
    list[str],
    Option(
        "--augment",
        metavar="NAME=N",
        help="shift=2: move by up to 2 px; warp=0.1: turn, scale, shear; mirror=0.5: every second; repeatable.",
    ),
]

# how it learns
Epochs = Annotated[int, Option(metavar="N", help="How often each recording is shown; 0 tests only.")]
Batch = Annotated[int, Option(metavar="N", help="Recordings between two steps of learning.")]
Rate = Annotated[float, Option(metavar="R", help="The largest learning rate, for weights of about 0.1.")]
Decay = Annotated[float, Option(metavar="R", help="Of weights, in each step, times the rate.")]
Loss = Annotated[str, Option(metavar="NAME", help=", ".join(LOSSES))]
Temperature = Annotated[float, Option(metavar="N", help="Spikes, mV or steps that make a class e times likelier.")]
Surrogate = Annotated[str, Option(metavar="NAME", help="fast_sigmoid, arctan, slayer or triangle.")]
Slope = Annotated[float, Option(metavar="X", help="Of the surrogate, per V_th - V_reset.")]
Learn = Annotated[
    list[str],
    Option(
        "--learn",
        metavar="NAME",
        help="A projection whose weights learn, NAME=weight,delay, or POPULATION=tau_m,V_th; repeatable.",
    ),
]
Device = Annotated[str, Option(metavar="NAME", help="A device of torch, such as cuda.")]
Threads = Annotated[int, Option(metavar="N", min=1, help="Threads to compute with.")]

# for a chip
Cost = Annotated[
    list[str], Option("--cost", metavar="CHIP=X", help="Add X to the loss for each microjoule; repeatable.")
]
Bits = Annotated[int | None, Option(metavar="N", help="Of weights while they learn, on a chip's grid.")]
Prune = Annotated[float, Option(metavar="SHARE", help="Drop so many synapses, the smallest, half way.")]
NeuronsPerCore = Annotated[
    int | None, Option("--neurons-per-core", metavar="N", help="Of a chip, fewer than it allows.")
]

# what comes of it
Out = Annotated[Path, Option("--out", metavar="FILE", help="The network to write.")]
Page = Annotated[Path | None, Option(metavar="FILE", help="The page to write; that of --out if not given.")]
Search = Annotated[
    str | None,
    Option("--search", metavar="A,B=1:2,...", help="Vary step, duration, hidden, prune, ...: accuracy by joules."),
]
Budget = Annotated[int, Option(metavar="N", min=1, help="Networks that a search trains.")]
