"""The whole state of a simulation, to a file and back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.files.state import Identity, fingerprint, read_state, write_state
from neuro.model.synapses import Synapse
from neuro.program.backend import Engine
from neuro.program.program import Program
from neuro.run import settable
from neuro.run.inputs import StreamFeeder
from neuro.run.records import Records
from neuro.run.trials import TrialLoop


class Saved:
    """Writes and reads states of one simulation.

    Args:
        program: the network.
        backend: the name of the backend.
        engine: runs it.
        records: what it has recorded.
        rules: the present synapse models of projections; changed in place.
        inflow: what it plays.
    """

    def __init__(
        self,
        program: Program,
        backend: str,
        engine: Engine,
        records: Records,
        rules: dict[int, Synapse],
        inflow: StreamFeeder,
    ) -> None:
        self._identity = Identity(program.name, backend, program.seed, fingerprint(program))
        self._engine, self._records, self._rules, self._inflow = engine, records, rules, inflow

    @property
    def fingerprint(self) -> str:
        """Hash of the resolved network."""
        return self._identity.fingerprint

    def write(
        self, path: Path, trials: TrialLoop | None, record: Mapping[str, Any], files: Mapping[str, bytes]
    ) -> None:
        """Write the state.

        Args:
            path: of the file.
            trials: of a network that has them.
            record: where it comes from, see `neuro.core.provenance`.
            files: of the network, by name.

        Raises:
            ModelError: the file cannot be written.
        """
        arrays = {f"engine/{name}": values for name, values in self._engine.snapshot().items()}
        arrays |= {f"probes/{name}": values for name, values in self._records.recorder.snapshot().items()}
        arrays |= {f"rules/{index}": rule.vector() for index, rule in self._rules.items()}
        arrays |= {f"streams/{name}": step for name, step in self._inflow.state().items()}
        arrays["held"] = np.array(self._records.held)
        if trials is not None:
            arrays["trials"] = trials.state()
        write_state(path, self._identity, arrays, record, files)

    def read(self, path: Path, trials: TrialLoop | None) -> None:
        """Go on from a state.

        Raises:
            ModelError: it is of something else; all stays as it is.
        """
        arrays = read_state(path, self._identity)
        self._engine.restore(_below("engine/", arrays))
        self._records.restore(_below("probes/", arrays), int(arrays.get("held", 0)))
        for index, rule in self._rules.items():
            self._rules[index] = settable.rule_of(rule, arrays[f"rules/{index}"])
        self._inflow.put(_below("streams/", arrays))
        if trials is not None:
            trials.put(arrays["trials"])


def _below(begin: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays of one part, by their names there."""
    return {name.removeprefix(begin): values for name, values in arrays.items() if name.startswith(begin)}
