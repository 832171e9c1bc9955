"""The journal of a search: Optuna's, a line for each thing that happened.

Each line has a sum of itself and of the sum before it, which tells damage, and a line that is missing, doubled or in
another's place.

Optuna reads it as it is: `JournalStorage(JournalFileBackend("tuned/journal.log"))`, or `optuna-dashboard`.
"""

from __future__ import annotations

import fcntl
import json
import os
import warnings
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any

from neuro import ModelError
from neuro.apps import Unwritable, needed
from neuro_sweeps.folder import SUM, Folder, parsed, sum_of

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.storages import BaseStorage, JournalStorage
    from optuna.study import Study
    from optuna.trial import FrozenTrial

NAME = "search"
"""Of the one study of a journal."""

OPTUNAS = {"maximise": "maximize", "minimise": "minimize"}
"""What Optuna calls our directions."""


class Journal:
    """The lines of a journal, as `optuna.storages.JournalStorage` reads and adds them.

    A line that a killed process left half-written was never there: it is cut off before the next is added.

    Args:
        path: of the file, which may not be there yet.
        lock: of the file by which one process adds at a time.
    """

    def __init__(self, path: Path, lock: Path) -> None:
        self._path, self._lock = path, lock
        self._after = [(0, NAME)]
        """Where each line that was read ends, and its sum; what stands there for the first is before all lines."""

    def read_logs(self, log_number_from: int) -> Iterator[dict[str, Any]]:
        """All from a line on.

        Raises:
            ModelError: a line is damaged, or the file cannot be read.
        """
        number = min(log_number_from, len(self._after) - 1)
        try:
            file = self._path.open("rb")
        except FileNotFoundError:
            return
        except OSError as error:
            raise ModelError(f"{self._path}: cannot be read: {error.strerror or error}") from None
        with file:
            file.seek(self._after[number][0])
            for line in file:
                if not line.endswith(b"\n"):
                    return
                end, before = self._after[number]
                number += 1
                log, after = self._checked(line, number, before)
                if number == len(self._after):
                    self._after.append((end + len(line), after))
                if number > log_number_from:
                    yield log

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Add lines.

        Raises:
            ModelError: a line that another process has added is damaged.
            Unwritable: the disk is full, or the file cannot be written.
        """
        try:
            with locked(self._lock), self._path.open("a+b") as file:
                _cut(file)
                for _ in self.read_logs(len(self._after) - 1):
                    pass
                file.write(_lines(logs, self._after[-1][1]))
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise Unwritable(self._path, f"cannot be written: {error.strerror or error}") from None

    def forget_ends(self, trials: Collection[int], state: int) -> None:
        """Take out the lines by which trials have come to a state; no other process may use the journal meanwhile.

        Args:
            trials: their identifiers.
            state: of Optuna.

        Raises:
            ModelError: a line is damaged.
            Unwritable: the disk is full, or the file cannot be written.
        """
        if not trials:
            return
        kept = [log for log in self.read_logs(0) if log.get("trial_id") not in trials or log.get("state") != state]
        aside = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        try:
            with locked(self._lock):
                with aside.open("wb") as file:
                    file.write(_lines(kept, NAME))
                    file.flush()
                    os.fsync(file.fileno())
                aside.replace(self._path)
        except OSError as error:
            aside.unlink(missing_ok=True)
            raise Unwritable(self._path, f"cannot be written: {error.strerror or error}") from None

    def _checked(self, line: bytes, number: int, before: str) -> tuple[dict[str, Any], str]:
        """What a line says, and its sum."""
        try:
            log = parsed(line)
            checksum = log.pop(SUM)
            if checksum == sum_of(log, before):
                return dict(log), checksum
        except (ValueError, KeyError, AttributeError, TypeError):
            pass
        hint = (
            f"'head -n {number - 1} {self._path.name}' is what is whole of it; "
            "trials after it are asked for again, and runs that are kept are not done again"
        )
        after = f" after line {number - 1}" if number > 1 else ""
        lack = f"line {number}: damaged: expected what 'neuro tune run' wrote{after}"
        raise ModelError(f"{self._path}: {lack}", hint=hint)


def _lines(logs: Iterable[dict[str, Any]], before: str) -> bytes:
    """As they stand in the file behind a line of a sum."""
    lines = []
    for log in logs:
        plain = parsed(json.dumps(log))
        before = sum_of(plain, before)
        lines.append(json.dumps({**plain, SUM: before}, separators=(",", ":")) + "\n")
    return "".join(lines).encode()


def _cut(file: Any) -> None:
    """Take away a last line that is not whole."""
    end = file.seek(0, os.SEEK_END)
    if not end:
        return
    file.seek(end - 1)
    if file.read(1) != b"\n":
        file.seek(0)
        file.truncate(file.read().rfind(b"\n") + 1)


class DraftStorage:
    """A storage of Optuna that has one trial in memory alone: no other process sees what is written to it.

    Args:
        storage: has all the others.
        trial: the one, in the place of that of its number if there is one.
    """

    def __init__(self, storage: BaseStorage, trial: FrozenTrial) -> None:
        self._storage, self._trial = storage, trial

    def __getattr__(self, name: str) -> Any:
        return getattr(self._storage, name)

    def create_new_trial(self, study_id: int) -> int:
        """The identifier of the one, which is asked for."""
        return self._trial._trial_id

    def get_trial(self, trial_id: int) -> FrozenTrial:
        """A trial."""
        return self._trial if trial_id == self._trial._trial_id else self._storage.get_trial(trial_id)

    def get_trial_system_attrs(self, trial_id: int) -> dict[str, Any]:
        """What a sampler or a pruner has noted of a trial."""
        return self.get_trial(trial_id).system_attrs

    def get_all_trials(self, study_id: int, deepcopy: bool = True, states: Any = None) -> list[FrozenTrial]:
        """All trials, those in some states where these are given."""
        others = self._storage.get_all_trials(study_id, deepcopy, states)
        mine = [copy(self._trial)] if states is None or self._trial.state in states else []
        number = self._trial.number
        before = [trial for trial in others if trial.number < number]
        return [*before, *mine, *(trial for trial in others[len(before) :] if trial.number > number)]

    def set_trial_param(self, trial_id: int, name: str, value: float, distribution: BaseDistribution) -> None:
        """Give the one a parameter."""
        self._trial.params[name] = distribution.to_external_repr(value)
        self._trial.distributions[name] = distribution

    def set_trial_system_attr(self, trial_id: int, name: str, value: Any) -> None:
        """Note something of the one."""
        self._trial.system_attrs = {**self._trial.system_attrs, name: value}  # lists made before stay

    def study(self, **parts: Any) -> Study:
        """The study of a journal, as it is with the one."""
        made: Study = optuna().load_study(study_name=NAME, storage=self, **parts)
        return made


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Wait until no other process has a lock, which a process that is killed gives back.

    Raises:
        Unwritable: there can be no such file.
    """
    try:
        file = path.open("ab")
    except OSError as error:
        raise Unwritable(path, f"cannot be written: {error.strerror or error}") from None
    with file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def optuna() -> Any:
    """The package Optuna, which tells no user of what is experimental in it.

    Raises:
        ModelError: it is not installed.
    """
    found = needed("optuna", "tune", "neuro tune: the package optuna is not installed")
    found.logging.set_verbosity(found.logging.ERROR)
    return found


@contextmanager
def quietly() -> Iterator[None]:
    """Without the warnings of Optuna."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def journal_path(folder: Folder) -> Path:
    """The file of the journal."""
    return folder.path / "journal.log"


def journal_of(folder: Folder) -> Journal:
    """The journal of a folder."""
    return Journal(journal_path(folder), folder.claims / ".journal")


def storage_of(folder: Folder) -> JournalStorage:
    """What Optuna keeps of the search in a folder.

    Raises:
        ModelError: Optuna is not installed, or the journal is damaged.
    """
    optuna()
    from optuna.storages import JournalStorage

    try:
        with quietly():
            return JournalStorage(journal_of(folder))  # type: ignore[arg-type]
    except ModelError:
        raise
    except (AssertionError, AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        lack = f"damaged: Optuna cannot read it: {type(error).__name__}"
        raise ModelError(f"{journal_path(folder)}: {lack}", hint="the folder without it asks for new trials") from None


def study_of(folder: Folder, directions: Sequence[str]) -> Study:
    """The study of the search in a folder; made if it is not there.

    Args:
        folder: of the search.
        directions: of the objectives.

    Raises:
        ModelError: as `storage_of`.
    """
    package, storage = optuna(), storage_of(folder)
    with quietly():
        made: Study = package.create_study(
            storage=storage,
            study_name=NAME,
            directions=[OPTUNAS[each] for each in directions],
            load_if_exists=True,
            sampler=package.samplers.RandomSampler(0),
            pruner=package.pruners.NopPruner(),
        )
        return made


def trials_of(folder: Folder) -> list[Any]:
    """The trials in the journal of a folder, as Optuna has them; nothing is written.

    Raises:
        ModelError: as `storage_of`.
    """
    storage = storage_of(folder)
    studies = storage.get_all_studies()
    trials = storage.get_all_trials(studies[0]._study_id, deepcopy=False) if studies else []
    for trial in trials:
        if not all(isinstance(value, float | int) for value in trial.values or ()):
            raise ModelError(f"{journal_path(folder)}: damaged: trial {trial.number}: expected numbers as values")
    return trials
