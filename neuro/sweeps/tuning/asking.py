"""Asks for trials: hands out their runs, and writes to the journal what came of them.

Several may ask one journal. A trial is claimed by the process that asked for it; that of a dead process is taken over,
and its runs that are kept are not done again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from neuro.core.errors import ModelError
from neuro.sweeps.claims import Claims
from neuro.sweeps.folder import PRUNED, Folder, RunOutcome
from neuro.sweeps.space import Point, RunItem
from neuro.sweeps.tuning.journal import locked, optuna, quietly, study_of
from neuro.sweeps.tuning.plan import SearchPlan, mean_metrics, worth
from neuro.sweeps.tuning.sampling import Way, draw, point_of


@dataclass
class Going:
    """A trial under way.

    Attributes:
        items: its runs.
        asked: hashes of those that were handed out.
    """

    items: tuple[RunItem, ...]
    asked: set[str] = field(default_factory=set)


class Asker:
    """Asks for trials of one search, and tells what came of them.

    Args:
        plan: how the search goes.
        before: what decides what comes of a run, beside its point and seed.
        folder: of the search.
        share: how many trials this one asks for at most; as many as there are left if None.

    Raises:
        ModelError: Optuna is not installed, or the journal is damaged.
    """

    def __init__(self, plan: SearchPlan, before: str, folder: Folder, share: int | None = None) -> None:
        self._plan, self._before, self._folder = plan, before, folder
        self._left = plan.most if share is None else share
        self._claims = Claims(folder.claims)
        self._claims.beat()
        self._going: dict[int, Going] = {}
        self._queue: deque[RunItem] = deque()
        self._states = optuna().trial.TrialState
        with self._alone():
            self._study = study_of(folder, tuple(plan.objectives.values()))

    def close(self) -> None:
        """Leave trials under way to the next asker."""
        self._claims.close()

    def more(self, number: int) -> Sequence[RunItem]:
        """Up to so many runs that are next; trials are asked for where there are none left of those before."""
        while len(self._queue) < number and (asked := self._next()) is not None:
            trial, point = asked
            self._going[trial] = Going(self._plan.items(self._before, point, trial))
            self._advance(trial)
        return [self._queue.popleft() for _ in range(min(number, len(self._queue)))]

    def tell(self, key: str) -> None:
        """A run is there: trials that wait for it go on."""
        for number in [number for number, going in self._going.items() if key in going.asked]:
            self._advance(number)

    def finished(self) -> bool:
        """Whether all trials there can be are over, those of others too."""
        trials = self._study.get_trials(deepcopy=False)
        return len(trials) >= self._plan.most and all(trial.state.is_finished() for trial in trials)

    def others(self) -> list[str]:
        """The claims of trials that others have under way."""
        trials = self._study.get_trials(deepcopy=False)
        numbers = (trial.number for trial in trials if not trial.state.is_finished())
        return [_claim(number) for number in numbers if number not in self._going]

    def counts(self) -> dict[str, int]:
        """How many trials are done, failed, pruned, and left."""
        return counted(self._study.get_trials(deepcopy=False), self._plan.most)

    def _alone(self) -> Any:
        return locked(self._folder.claims / ".ask")

    def _next(self) -> tuple[int, Point] | None:
        """The number and the point of a trial that a dead process has left, or of a new one."""
        with self._alone():
            trials = self._study.get_trials(deepcopy=False)
            for trial in trials:
                waits = not trial.state.is_finished() and trial.number not in self._going
                if waits and self._claims.take(_claim(trial.number)):
                    return trial.number, point_of(self._plan, trial.params)
            number = len(trials)
            if self._left <= 0 or number >= self._plan.most:
                return None
            self._left -= 1
            self._claims.take(_claim(number))
            return number, draw(self._study, self._plan, number)

    def _advance(self, number: int) -> None:
        """Hand out the next runs of a trial, or end it."""
        going = self._going[number]
        there = self._folder.outcomes(item.key for item in going.items)
        each = [there[item.key] for item in going.items if item.key in there]
        worse = self._worse(number, there)
        if any(one.failed for one in each):
            self._end(number, self._states.FAIL)
        elif worse or any(one.outcome == PRUNED for one in each):
            self._end(number, self._states.PRUNED)
        elif len(there) == len({item.key for item in going.items}):
            self._judge(number, each)
        else:
            left = [item for item in going.items if item.key not in there and item.key not in going.asked]
            one_by_one = self._plan.prune and self._plan.runs > 1
            if not one_by_one or not going.asked - set(there):
                self._hand_out(going, left[:1] if one_by_one else left)

    def _hand_out(self, going: Going, items: Sequence[RunItem]) -> None:
        """Those that another trial waits for are not done twice."""
        for item in items:
            if not any(item.key in other.asked for other in self._going.values()):
                self._queue.append(item)
            going.asked.add(item.key)

    def _worse(self, number: int, there: Mapping[str, RunOutcome]) -> bool:
        """Whether others were better after so many runs of a trial; of a single run its steps are kept here, too."""
        if not self._plan.prune:
            return False
        way, items = Way(self._study, self._plan.prune, number), self._going[number].items
        if self._plan.runs == 1:
            for one in there.values():
                for step, value in one.steps.items():
                    way.worse(int(step), value)
            return False
        name, values = next(iter(self._plan.objectives)), list[float]()
        for k, item in enumerate(items):
            if item.key not in there:
                return False
            try:
                values += worth(there[item.key].metrics, {name: ""})
            except ModelError:
                return False
            if way.worse(k, sum(values) / len(values)) and k + 1 < len(items):
                return True
        return False

    def _judge(self, number: int, each: Sequence[RunOutcome]) -> None:
        metrics = mean_metrics([one.metrics for one in each])
        try:
            values = worth(metrics, self._plan.objectives)
        except ModelError:
            self._end(number, self._states.FAIL)
            if not all(name in metrics for name in self._plan.objectives):
                raise
        else:
            self._end(number, self._states.COMPLETE, values)

    def _end(self, number: int, state: Any, values: Sequence[float] | None = None) -> None:
        going = self._going.pop(number)
        mine = {item.key for item in going.items} - {key for other in self._going.values() for key in other.asked}
        self._queue = deque(item for item in self._queue if item.key not in mine)
        with quietly():
            self._study.tell(number, values, state=state, skip_if_finished=True)
        self._claims.give_up(_claim(number))


def counted(trials: Sequence[Any], most: int) -> dict[str, int]:
    """How many of Optuna's trials are done, failed and pruned, and how many of all that there can be are left."""
    names = [trial.state.name for trial in trials]
    found = {
        word: names.count(state) for word, state in (("done", "COMPLETE"), ("failed", "FAIL"), ("pruned", "PRUNED"))
    }
    return {**found, "left": max(0, most - sum(found.values()))}


def _claim(number: int) -> str:
    return f"trial-{number}"
