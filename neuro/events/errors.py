"""What is raised for an event file that cannot be read or written."""

from __future__ import annotations

import traceback

from neuro.core.errors import ModelError, Where


class EventFileWarning(UserWarning):
    """A damaged event file was read as far as it is whole, or some of its events were left out."""


class EventFileError(ModelError):
    """An event file is damaged, unknown, missing, or cannot hold what should be saved.

    The message reads ``PATH: byte OFFSET: what is wrong, and what was expected``.

    Attributes:
        path: the file, as the user named it; ``<bytes>`` for data without a name.
        what: the message without the place.
        offset: the byte at which the fault was seen; None where no byte is to blame.
    """

    path: str  # type: ignore[assignment]  # of the file, not of words inside a part of a network

    def __init__(self, path: str, what: str, offset: int | None = None, hint: str = "") -> None:
        place = path if offset is None else f"{path}: byte {offset}"
        super().__init__(f"{place}: {what}", hint=hint)
        self.path = path
        self.what = what
        self.offset = offset

    def at(self, where: Where | None, context: str = "") -> EventFileError:
        """The same error: its file is the place."""
        return self

    def __reduce__(self) -> tuple[type[EventFileError], tuple[str, str, int | None, str]]:
        return (EventFileError, (self.path, self.what, self.offset, self.hint))


def let_go(error: BaseException) -> None:
    """Clear the frames of an error, and of those behind it: a kept error would keep mapped and open files."""
    behind: BaseException | None = error
    while behind is not None:
        traceback.clear_frames(behind.__traceback__)
        behind = behind.__context__


def with_notes(error: EventFileError, cause: BaseException) -> EventFileError:
    """Return an error with the notes of the one that it stands for."""
    for note in getattr(cause, "__notes__", ()):
        error.add_note(note)
    return error
