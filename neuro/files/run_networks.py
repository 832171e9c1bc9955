"""The network of a run that is over: its recordings, which results name and do not hold, and what it compiles to."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from neuro.core.errors import ModelError
from neuro.model.network import Network
from neuro.model.neurons import event_camera, spike_generator
from neuro.program.program import Program

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
                message = "the network plays events of a program, which results do not hold"
                raise ModelError(message, hint=f"describe it again with these events; {READABLE} them")
            looked = ", ".join(map(str, self._folders))
            hint = f"results.network(recordings=FOLDER) says where it lies; {READABLE} it"
            raise ModelError(f"the network plays the recording {name!r}: not found in {looked}", hint=hint)


class Over(Protocol):
    """What is asked of results."""

    @property
    def about(self) -> dict[str, Any]:
        """Attributes of its file."""

    @property
    def populations(self) -> Mapping[str, Any]:
        """Spikes by population."""


def resolved(results: Over, net: Network) -> Program:
    """What ran; what a camera emitted is listed in it, so that no recording is needed.

    Args:
        results: of the run.
        net: what ran.
    """
    from neuro.compiler import compile_network

    return compile_network(without_recordings(results, net), int(results.about["seed"]))


def without_recordings(results: Over, net: Network) -> Network:
    """The same network with a list of spikes, of which none are there, for each event camera."""
    listed = copy.copy(net)
    listed.populations = {
        name: replace(part, model=spike_generator(), shape=results.populations[name].shape)
        if isinstance(part.model, event_camera)
        else part
        for name, part in net.populations.items()
    }
    return listed
