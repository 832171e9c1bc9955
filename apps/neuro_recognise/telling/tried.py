"""A recogniser tried on recordings: how well it decides, and what that took."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from neuro.events import Recordings
from neuro_recognise.evaluate import Evaluation, evaluate
from neuro_recognise.method import Answer, choose
from neuro_recognise.recogniser import Recogniser

__all__ = ["OWN", "Tried", "try_out"]

OWN = "own"
"""The vote of a method that has only one."""


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """What came of showing recordings.

    Attributes:
        own: by the scores of the recogniser.
        votes: by other ways of reading the same evidence, by name.
        answer: scores, and what it took to find them.
    """

    own: Evaluation
    votes: Mapping[str, Evaluation]
    answer: Answer


def try_out(recogniser: Recogniser, data: Recordings, backend: str = "event") -> Tried:
    """Let a recogniser decide on recordings.

    Args:
        recogniser: what was learnt.
        data: recordings of its classes.
        backend: runs networks.

    Raises:
        EventFileError: a recording is damaged.
        ModelError: one does not fit the method, or the backend cannot run it.
    """
    recogniser.method.check_backend(backend)
    shown = recogniser.shown(data)
    answer = recogniser.answer_shown(shown, backend)
    votes = {name: evaluate(choose(scores), shown.labels, shown.classes) for name, scores in answer.votes.items()}
    return Tried(evaluate(choose(answer.scores), shown.labels, shown.classes), votes, answer)
