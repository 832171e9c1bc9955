"""Training: epochs over shuffled recordings, kept after each so that it can go on after a kill."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro.apps import Checkpoint, check_output, hdf5
from neuro_remus.features import Spikes
from neuro_remus.model import FORMAT, LEARNT, Model, network_of, to_text
from neuro_remus.settings import Settings

RATES = ("Ar_plus", "Ar_minus", "Ap_plus", "Ap_minus", "epsilon")
BATCH = 1000
"""Frames that are shown between two reports; the result does not depend on it."""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a training is.

    Attributes:
        epoch, epochs: the present one from 0, and all.
        done, total: frames of this epoch.
        correct: of those done, decided rightly.
    """

    epoch: int
    epochs: int
    done: int
    total: int
    correct: int


Report = Callable[[Progress], None]


def train(
    spikes: Spikes,
    settings: Settings,
    *,
    seed: int = 0,
    backend: str = "event",
    out: Path | None = None,
    report: Report | None = None,
) -> Model:
    """Teach layer S2.

    Args:
        spikes: of labelled recordings, from the settings' front end.
        settings: how.
        seed: of the first weights, dropout, ties and the order of the recordings.
        backend: runs the network.
        out: file for the model. Each epoch is kept beside it; the same call continues from there to the
            same bits. A training that is complete is not done again.
        report: is told the progress.

    Returns:
        The model.

    Raises:
        ModelError: a setting is wrong, there is nothing to learn, or `out` belongs to another training.
    """
    if not len(spikes.sample):
        raise neuro.ModelError("no recording is long enough for a frame: expected some to learn from")
    net = network_of(settings, len(spikes.classes))
    told = {"settings": settings.as_words() | {"epochs": 0}, "seed": seed, "backend": backend, "data": digest(spikes)}
    training = {name: told[name] for name in ("seed", "backend", "data")} | {"recordings": len(spikes)}
    checkpoint = None if out is None else Checkpoint(out, "neuro remus training 1", told)
    if out is not None and checkpoint is not None:
        if (made := _made(out, settings, training)) is not None:
            checkpoint.remove()
            return made
        check_output(out, hdf5.kind(FORMAT))
    sim = neuro.compile(net, backend=backend, seed=seed)
    history: list[float] = []
    if checkpoint and (found := checkpoint.resume()):
        history = found["history"].tolist()
        _restore(sim, found["state"])
    for epoch in range(len(history), settings.epochs):
        history.append(_epoch(sim, net, spikes, settings, seed, epoch, report))
        if checkpoint:
            checkpoint.keep(history=np.array(history), state=_state(sim))
    model = Model(settings, spikes.classes, to_text(net), sim.weights(LEARNT), np.array(history), training)
    if out is not None and checkpoint is not None:
        model.save(out)
        checkpoint.remove()
    return model


def _state(sim: neuro.Simulation) -> npt.NDArray[np.uint8]:
    """The file that `Simulation.save` writes, as bytes."""
    with tempfile.TemporaryDirectory() as folder:
        sim.save(Path(folder) / "state.h5")
        return np.fromfile(Path(folder) / "state.h5", np.uint8)


def _restore(sim: neuro.Simulation, state: npt.NDArray[np.uint8]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        state.tofile(Path(folder) / "state.h5")
        sim.restore(Path(folder) / "state.h5")


def digest(spikes: Spikes) -> str:
    """A hash of everything that is learnt from."""
    found = hashlib.blake2b(repr((spikes.classes, spikes.shape)).encode(), digest_size=16)
    for array in (spikes.times, spikes.ids, spikes.offsets, spikes.sample, spikes.labels):
        found.update(np.ascontiguousarray(array).data)
    return found.hexdigest()


def _made(out: Path, settings: Settings, training: dict[str, Any]) -> Model | None:
    """The finished model of this very training, if it is there."""
    if not out.exists():
        return None
    model = Model.load(out)
    return model if (model.settings, model.training) == (settings, training) else None


def _epoch(
    sim: neuro.Simulation,
    net: neuro.Network,
    spikes: Spikes,
    settings: Settings,
    seed: int,
    epoch: int,
    report: Report | None,
) -> float:
    """Show all recordings once; return the share of frames decided rightly."""
    rule = net.projections[LEARNT].synapse.parameters()
    sim.set(LEARNT, **{name: rule[name] * settings.rate_decay**epoch for name in RATES})
    rng = np.random.default_rng([seed, epoch])
    total, done, correct = len(spikes.sample), 0, 0
    for times, ids, offsets, sample in _batches(spikes, settings.order, rng):
        labels = spikes.labels[sample]
        results = sim.trials(times, ids, offsets, labels=labels, learn=True, samples=sample, epoch=epoch)
        sim.forget(before=sim.time)
        done += len(results)
        correct += int(np.count_nonzero(results.label == labels))
        if report is not None:
            report(Progress(epoch, settings.epochs, done, total, correct))
    return correct / total


Batch = tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]


def _batches(spikes: Spikes, order: str, rng: np.random.Generator) -> Iterator[Batch]:
    """All frames in a new order: times, ids, offsets and the recording of each frame."""
    if order == "frames":
        frames = rng.permutation(len(spikes.sample))
    else:
        place = np.empty(len(spikes), np.int64)
        place[rng.permutation(len(spikes))] = np.arange(len(spikes))
        frames = np.argsort(place[spikes.sample], kind="stable")
    for first in range(0, len(frames), BATCH):
        part = frames[first : first + BATCH]
        where, offsets = spikes.of_frames(part)
        yield spikes.times[where], spikes.ids[where], offsets, spikes.sample[part]
