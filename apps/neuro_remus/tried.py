"""A model tried on recordings: how well it decides, and what that took."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from neuro import Simulation
from neuro.events import Recordings
from neuro_recognise.evaluate import Evaluation, evaluate
from neuro_remus.decide import decisions, present
from neuro_remus.features import c1_spikes
from neuro_remus.model import Model
from neuro_remus.settings import VOTES

if TYPE_CHECKING:
    from neuro import TrialResults


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """What came of showing recordings.

    Attributes:
        votes: an evaluation by the name of each vote.
        sim: the network that they were shown to.
        trials: how each frame ended, and what all of them took.
        recordings: how many there were.
    """

    votes: Mapping[str, Evaluation]
    sim: Simulation
    trials: TrialResults
    recordings: int


def try_out(model: Model, data: Recordings, backend: str | Simulation = "event") -> Tried:
    """Let a model decide on recordings, by each vote.

    Args:
        model: what was learnt.
        data: recordings of its classes.
        backend: what runs it, or its simulation if there is one already.

    Raises:
        EventFileError: a recording is damaged or does not fit the front end.
    """
    sim = model.simulation(backend) if isinstance(backend, str) else backend
    spikes = c1_spikes(data, model.settings.front)
    trials = present(sim, spikes)
    decided = decisions(trials, spikes)
    votes = {vote: evaluate(decided.by(vote), spikes.labels, model.classes) for vote in VOTES}
    return Tried(votes, sim, trials, len(spikes))
