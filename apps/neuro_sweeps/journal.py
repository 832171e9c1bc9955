"""The journal of a search in Optuna's format, with a line for each event.

Each line has a checksum of its content and of the checksum before. So damaged, missing, doubled and moved lines are
detected.

Optuna reads the journal as usual: `JournalStorage(JournalFileBackend("tuned/journal.log"))`, or `optuna-dashboard`.
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any

from neuro import ModelError
from neuro.apps import needed
from neuro_sweeps.folder import SUM, Folder, locked, parsed, sum_of, writing

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.storages import BaseStorage, JournalStorage
    from optuna.study import Study
    from optuna.trial import FrozenTrial

NAME = "search"
"""Name of the study in a journal."""

OPTUNAS = {"maximise": "maximize", "minimise": "minimize"}
"""Optuna's names of the directions."""


class Journal:
    """A journal file, as a backend of `optuna.storages.JournalStorage`.

    A half-written last line of a killed process is ignored, and is cut off before the next line is added.

    Args:
        path: path of the file, which may not exist yet.
        lock: path of the lock file, with which one process at a time adds lines.
    """

    def __init__(self, path: Path, lock: Path) -> None:
        self._path, self._lock = path, lock
        self._line_ends = [(0, NAME)]
        """End and checksum of each line read so far. The first entry stands for the beginning of the file."""

    def read_logs(self, log_number_from: int) -> Iterator[dict[str, Any]]:
        """Yield all lines from a number on.

        Raises:
            ModelError: a line is damaged, or the file cannot be read.
        """
        number = min(log_number_from, len(self._line_ends) - 1)
        try:
            file = self._path.open("rb")
        except FileNotFoundError:
            return
        except OSError as error:
            raise ModelError(f"{self._path}: cannot be read: {error.strerror or error}") from None
        with file:
            file.seek(self._line_ends[number][0])
            for line in file:
                if not line.endswith(b"\n"):
                    return
                end, checksum_before = self._line_ends[number]
                number += 1
                log, line_checksum = self._parse(line, number, checksum_before)
                if number == len(self._line_ends):
                    self._line_ends.append((end + len(line), line_checksum))
                if number > log_number_from:
                    yield log

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Add lines.

        Raises:
            ModelError: a line that another process added is damaged.
            Unwritable: the disk is full, or the file cannot be written.
        """
        with writing(self._path), locked(self._lock), self._path.open("a+b") as file:
            _cut(file)
            for _ in self.read_logs(len(self._line_ends) - 1):
                pass
            file.write(_lines(logs, self._line_ends[-1][1]))
            file.flush()
            os.fsync(file.fileno())

    def remove_ends(self, trials: Collection[int], state: int) -> None:
        """Remove the lines that gave trials a final state. No other process may use the journal at the same time.

        Args:
            trials: identifiers of the trials.
            state: the state in Optuna.

        Raises:
            ModelError: a line is damaged.
            Unwritable: the disk is full, or the file cannot be written.
        """
        if not trials:
            return
        kept_logs = [log for log in self.read_logs(0) if log.get("trial_id") not in trials or log.get("state") != state]
        temporary = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        with writing(self._path), locked(self._lock):
            try:
                with temporary.open("wb") as file:
                    file.write(_lines(kept_logs, NAME))
                    file.flush()
                    os.fsync(file.fileno())
                temporary.replace(self._path)
            finally:
                temporary.unlink(missing_ok=True)

    def _parse(self, line: bytes, number: int, checksum_before: str) -> tuple[dict[str, Any], str]:
        """Parse a line, and return its content and checksum."""
        try:
            log = parsed(line)
            checksum = log.pop(SUM)
            if checksum == sum_of(log, checksum_before):
                return dict(log), checksum
        except (ValueError, KeyError, AttributeError, TypeError):
            pass
        hint = (
            f"'head -n {number - 1} {self._path.name}' has the undamaged lines; "
            "with them, later trials are asked for again, and kept runs are not repeated"
        )
        place = f" after line {number - 1}" if number > 1 else ""
        message = f"line {number}: damaged: expected the line that 'neuro tune run' wrote{place}"
        raise ModelError(f"{self._path}: {message}", hint=hint)


def _lines(logs: Iterable[dict[str, Any]], checksum_before: str) -> bytes:
    """Return lines of the file for logs. `checksum_before` is the checksum of the previous line."""
    lines = []
    for log in logs:
        plain = parsed(json.dumps(log))
        checksum_before = sum_of(plain, checksum_before)
        lines.append(json.dumps({**plain, SUM: checksum_before}, separators=(",", ":")) + "\n")
    return "".join(lines).encode()


def _cut(file: Any) -> None:
    """Cut off an incomplete last line."""
    end = file.seek(0, os.SEEK_END)
    if not end:
        return
    file.seek(end - 1)
    if file.read(1) != b"\n":
        file.seek(0)
        file.truncate(file.read().rfind(b"\n") + 1)


class DraftStorage:
    """A storage of Optuna with one trial in memory, whose changes no other process sees.

    Args:
        storage: storage of all other trials.
        trial: the trial in memory, which replaces a stored trial of the same number.
    """

    def __init__(self, storage: BaseStorage, trial: FrozenTrial) -> None:
        self._storage, self._trial = storage, trial

    def __getattr__(self, name: str) -> Any:
        return getattr(self._storage, name)

    def create_new_trial(self, study_id: int) -> int:
        """Return the identifier of the trial in memory."""
        return self._trial._trial_id

    def get_trial(self, trial_id: int) -> FrozenTrial:
        """Return a trial."""
        return self._trial if trial_id == self._trial._trial_id else self._storage.get_trial(trial_id)

    def get_trial_system_attrs(self, trial_id: int) -> dict[str, Any]:
        """Return the notes of samplers and pruners about a trial."""
        return self.get_trial(trial_id).system_attrs

    def get_all_trials(self, study_id: int, deepcopy: bool = True, states: Any = None) -> list[FrozenTrial]:
        """Return all trials, or only those in some states."""
        stored = self._storage.get_all_trials(study_id, deepcopy, states)
        draft = [copy(self._trial)] if states is None or self._trial.state in states else []
        number = self._trial.number
        earlier = [trial for trial in stored if trial.number < number]
        return [*earlier, *draft, *(trial for trial in stored[len(earlier) :] if trial.number > number)]

    def set_trial_param(self, trial_id: int, name: str, value: float, distribution: BaseDistribution) -> None:
        """Set a parameter of the trial in memory."""
        self._trial.params[name] = distribution.to_external_repr(value)
        self._trial.distributions[name] = distribution

    def set_trial_system_attr(self, trial_id: int, name: str, value: Any) -> None:
        """Add a note about the trial in memory."""
        self._trial.system_attrs = {**self._trial.system_attrs, name: value}  # a new mapping: earlier copies stay

    def study(self, **parts: Any) -> Study:
        """Return the study of the journal with the trial in memory."""
        study: Study = optuna().load_study(study_name=NAME, storage=self, **parts)
        return study


def optuna() -> Any:
    """Return the package Optuna, set to log errors only.

    Raises:
        ModelError: the package is not installed.
    """
    package = needed("optuna", "tune", "neuro tune: the package optuna is not installed")
    package.logging.set_verbosity(package.logging.ERROR)
    return package


@contextmanager
def without_warnings() -> Iterator[None]:
    """Ignore warnings of Optuna inside the context."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def journal_path(folder: Folder) -> Path:
    """Return the path of the journal of a folder."""
    return folder.path / "journal.log"


def journal_of(folder: Folder) -> Journal:
    """Return the journal of a folder."""
    return Journal(journal_path(folder), folder.claims / ".journal")


def storage_of(folder: Folder) -> JournalStorage:
    """Return the storage of Optuna for the search in a folder.

    Raises:
        ModelError: Optuna is not installed, or the journal is damaged.
    """
    optuna()
    from optuna.storages import JournalStorage

    try:
        with without_warnings():
            return JournalStorage(journal_of(folder))  # type: ignore[arg-type]
    except ModelError:
        raise
    except (AssertionError, AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        message = f"{journal_path(folder)}: damaged: Optuna cannot read it: {type(error).__name__}"
        raise ModelError(message, hint="without this file the search starts new trials, and reuses kept runs") from None


def study_of(folder: Folder, directions: Sequence[str]) -> Study:
    """Return the study of the search in a folder. A missing study is created.

    Args:
        folder: folder of the search.
        directions: directions of the objectives.

    Raises:
        ModelError: see `storage_of`.
    """
    package, storage = optuna(), storage_of(folder)
    with without_warnings():
        study: Study = package.create_study(
            storage=storage,
            study_name=NAME,
            directions=[OPTUNAS[direction] for direction in directions],
            load_if_exists=True,
            sampler=package.samplers.RandomSampler(0),
            pruner=package.pruners.NopPruner(),
        )
        return study


def trials_of(folder: Folder) -> list[Any]:
    """Return the trials in the journal of a folder, as Optuna's objects. Nothing is written.

    Raises:
        ModelError: see `storage_of`.
    """
    storage = storage_of(folder)
    studies = storage.get_all_studies()
    trials = storage.get_all_trials(studies[0]._study_id, deepcopy=False) if studies else []
    for trial in trials:
        if not all(isinstance(value, float | int) for value in trial.values or ()):
            raise ModelError(f"{journal_path(folder)}: damaged: trial {trial.number}: expected numbers as values")
    return trials
