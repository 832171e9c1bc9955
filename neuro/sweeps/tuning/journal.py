"""The journal of a search: Optuna's, a line for each thing that happened, each with a sum that tells damage.

Optuna reads it as it is: `JournalStorage(JournalFileBackend("tuned/journal.log"))`, or `optuna-dashboard`.
"""

from __future__ import annotations

import fcntl
import json
import os
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from neuro.core.errors import ModelError
from neuro.core.extras import needed
from neuro.core.outputs import Unwritable
from neuro.sweeps.folder import SUM, Folder, sum_of

if TYPE_CHECKING:
    from optuna.storages import JournalStorage
    from optuna.study import Study

NAME = "search"
"""Of the one study of a journal."""


class Journal:
    """The lines of a journal, as `optuna.storages.JournalStorage` reads and adds them.

    A line that a killed process left half-written was never there: it is cut off before the next is added.

    Args:
        path: of the file, which may not be there yet.
        lock: of the file by which one process adds at a time.
    """

    def __init__(self, path: Path, lock: Path) -> None:
        self._path, self._lock = path, lock
        self._begins = [0]

    def read_logs(self, log_number_from: int) -> Iterator[dict[str, Any]]:
        """All from a line on.

        Raises:
            ModelError: a line is damaged.
        """
        number = min(log_number_from, len(self._begins) - 1)
        try:
            file = self._path.open("rb")
        except FileNotFoundError:
            return
        with file:
            file.seek(self._begins[number])
            for line in file:
                if not line.endswith(b"\n"):
                    return
                number += 1
                if number == len(self._begins):
                    self._begins.append(self._begins[-1] + len(line))
                if number > log_number_from:
                    yield self._checked(line, number)

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Add lines.

        Raises:
            Unwritable: the disk is full, or the file cannot be written.
        """
        lines = b"".join(_line(json.loads(json.dumps(log))) for log in logs)
        try:
            with locked(self._lock), self._path.open("a+b") as file:
                _cut(file)
                file.write(lines)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise Unwritable(self._path, f"cannot be written: {error.strerror or error}") from None

    def forget_ends(self, trials: Collection[int], state: int) -> None:
        """Take out the lines by which trials have come to a state; nobody else may use the journal meanwhile.

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
                    file.write(b"".join(map(_line, kept)))
                    file.flush()
                    os.fsync(file.fileno())
                aside.replace(self._path)
        except OSError as error:
            aside.unlink(missing_ok=True)
            raise Unwritable(self._path, f"cannot be written: {error.strerror or error}") from None

    def _checked(self, line: bytes, number: int) -> dict[str, Any]:
        try:
            log = json.loads(line)
            if log.pop(SUM) == sum_of(log):
                return dict(log)
        except (ValueError, KeyError, AttributeError, TypeError):
            pass
        hint = (
            f"'head -n {number - 1} {self._path.name}' is what is whole of it; "
            "trials after it are asked for again, and runs that are kept are not done again"
        )
        raise ModelError(f"{self._path}: line {number}: damaged: expected what 'neuro tune run' wrote", hint=hint)


def _line(log: Mapping[str, Any]) -> bytes:
    return json.dumps({**log, SUM: sum_of(log)}, separators=(",", ":")).encode() + b"\n"


def _cut(file: Any) -> None:
    """Take away a last line that is not whole."""
    end = file.seek(0, os.SEEK_END)
    if not end:
        return
    file.seek(end - 1)
    if file.read(1) != b"\n":
        file.seek(0)
        file.truncate(file.read().rfind(b"\n") + 1)


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Wait until nobody else has a lock, which a process that is killed gives back."""
    with path.open("ab") as file:
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

    with quietly():
        return JournalStorage(journal_of(folder))  # type: ignore[arg-type]


def study_of(folder: Folder, directions: Sequence[str], **parts: Any) -> Study:
    """The study of the search in a folder; made if it is not there.

    Args:
        folder: of the search.
        directions: of the objectives.
        parts: sampler and pruner.

    Raises:
        ModelError: as `storage_of`.
    """
    package, storage = optuna(), storage_of(folder)
    words = [{"maximise": "maximize", "minimise": "minimize"}[each] for each in directions]
    with quietly():
        made: Study = package.create_study(
            storage=storage, study_name=NAME, directions=words, load_if_exists=True, **parts
        )
        return made


def trials_of(folder: Folder) -> list[Any]:
    """The trials in the journal of a folder, as Optuna has them; nothing is written.

    Raises:
        ModelError: as `storage_of`.
    """
    storage = storage_of(folder)
    studies = storage.get_all_studies()
    return storage.get_all_trials(studies[0]._study_id, deepcopy=False) if studies else []
