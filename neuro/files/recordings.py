"""Recordings that the network of a run plays, which results name and do not hold."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from neuro.core.errors import ModelError

READABLE = "spikes, traces and weights are read without"


class Sought:
    """Looks for recordings in folders, and remembers which are in none.

    Args:
        folders: where to look, in this order.
    """

    def __init__(self, folders: Iterable[Path]) -> None:
        self._folders = list(folders)
        self._missing: list[str | None] = []

    def find(self, name: str | None) -> Path | None:
        """The path of a recording; one in the first folder that is not there if it is in none. None of a program's."""
        if name is None:
            self._missing.append(None)
            return None
        places = [folder / part for folder in self._folders for part in dict.fromkeys((name, Path(name).name))]
        there = next((place for place in places if place.is_file()), None)
        if there is None:
            self._missing.append(name)
        return there or places[0]

    def check(self) -> None:
        """Refuse to go on without what was not found.

        Raises:
            ModelError: a recording is in none of the folders, or was made by a program.
        """
        for name in self._missing:
            if name is None:
                told = "the network plays events of a program, which results do not hold"
                raise ModelError(told, hint=f"describe it anew with these events; {READABLE} them")
            looked = ", ".join(map(str, self._folders))
            hint = f"results.network(recordings=FOLDER) says where it lies; {READABLE} it"
            raise ModelError(f"the network plays the recording {name!r}: not found in {looked}", hint=hint)
