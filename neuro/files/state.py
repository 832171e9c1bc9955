"""HDF5 files with the state of a simulation, or with the checkpoint of a training.

A checkpoint has these parts:
```
/            attributes: format, settings (JSON: the settings of the training)
/NAME        an array, or a group of arrays
```
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.choice import Choice
from neuro.core.errors import ModelError
from neuro.core.hdf5 import is_whole, put, reading, take, writing
from neuro.model.synapses import Synapse
from neuro.program.program import WHOLE, Program, Projection

FORMAT, EARLIER = "neuro state 2", "neuro state 1"
_NETWORK = "network_files/"
Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Identity:
    """Network, backend and seed of a state. A simulation restores only states with an equal identity.

    Attributes:
        network: name of the network.
        backend: name of the backend.
        seed: seed of the simulation.
        fingerprint: hash of the resolved network.
    """

    network: str
    backend: str
    seed: int
    fingerprint: str


def write_state(
    path: Path,
    identity: Identity,
    arrays: Arrays,
    record: Mapping[str, Any] | None = None,
    files: Mapping[str, bytes] | None = None,
) -> None:
    """Write a state. An existing state with the same name is replaced atomically.

    Args:
        path: path of the file.
        identity: identity of the simulation.
        arrays: arrays by name.
        record: provenance, see `neuro.core.provenance`.
        files: files of the network by name.

    Raises:
        ModelError: the file cannot be written, or a file of another kind has that name.
    """
    with writing(path, FORMAT, record=record) as file:
        for field in fields(identity):
            file.attrs[field.name] = getattr(identity, field.name)
        for name, values in arrays.items():
            file.create_dataset(name, data=values)
        for name, content in (files or {}).items():
            file[f"{_NETWORK}{name}"] = np.frombuffer(content, np.uint8)


def read_state(path: Path, identity: Identity) -> Arrays:
    """Read a state of the same network, backend and seed.

    Raises:
        ModelError: the file does not exist, has no state, has a state of another identity, or is damaged.
    """
    import h5py

    if path.is_file() and is_whole(path, EARLIER):
        message = f"{path}: a state of neuro 0.2 or before: expected a state of this version"
        raise ModelError(message, hint="restore it with that version and save the result of sim.network()")
    arrays: Arrays = {}
    with reading(path, FORMAT, "write it again with sim.save", "a state written by sim.save") as file:
        for name, hint in (
            ("backend", "compile the network for that backend"),
            ("seed", "compile the network with that seed"),
            ("network", ""),
        ):
            value, expected = file.attrs.get(name), getattr(identity, name)
            if value != expected:
                value = value.item() if isinstance(value, np.generic) else value
                raise ModelError(f"{path}: a state of {name} {value!r}: expected {name} {expected!r}", hint=hint)
        if file.attrs.get("fingerprint") != identity.fingerprint:
            raise ModelError(
                f"{path}: a state of another network '{identity.network}': its populations, connections or "
                "parameters differ from this one's",
                hint="restore into the network that was saved; sim.set changes parameters after restoring",
            )

        def collect(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and not name.startswith(_NETWORK):
                arrays[name] = item[()]

        file.visititems(collect)
    return arrays


_IGNORED_FIELDS = {
    "origin",
    "kind",
    "carries",
    "receptor",
    "stream",
    "declared",
    "span",
    "by_delay",
    "share",
    "whole_layout",
}
"""Fields of a program that have no effect on a run, follow from other fields, or depend on the machine."""


def fingerprint(program: Program) -> str:
    """Return a hash of all fields of a program that affect a run. Positions in YAML files are ignored."""
    digest = hashlib.blake2b(digest_size=16)
    _feed(digest, program)
    return digest.hexdigest()


@dataclass(frozen=True)
class _Pieces:
    """An array that is generated piece by piece, as one flat array of `size` values."""

    kind: np.dtype[Any]
    size: int
    pieces: Iterator[NDArray[Any]]


def _whole(part: Projection) -> Projection:
    """Return a projection with the synapses of all processes that share it. Large arrays are `_Pieces`."""
    rows, gather = part.rows, part.share.gather

    def joined(values: NDArray[Any], kind: Any) -> Any:
        if gather(np.array([values.size == 1])).all() and np.unique(all_values := gather(values)).size == 1:
            return all_values[:1]  # one value for all synapses
        pieces = (gather(values[stretch.own])[stretch.order].astype(kind) for stretch in rows.stretches())
        return _Pieces(np.dtype(kind), part.size, pieces)

    delay_dtype = part.delay.dtype if part.delay_span[1] <= np.iinfo(part.delay.dtype).max else np.int32
    numbers = part.synapse.parameters()
    per_synapse = {name: rows.joined(numbers[word]) for name, word in part.synapse.per_synapse_fields().items()}
    arrays: dict[str, Any] = {"weight": joined(part.weight, np.float64), "delay": joined(part.delay, delay_dtype)}
    if part.whole_layout == "csr":
        arrays["row_ends"] = np.concatenate(([0], np.cumsum(rows.fan_out())))
        arrays["targets"] = joined(part.targets, np.int32)
    else:
        arrays |= {"row_ends": np.zeros(0, dtype=np.int64), "targets": np.zeros(0, dtype=np.int32)}
    return replace(part, share=WHOLE, layout=part.whole_layout, synapse=replace(part.synapse, **per_synapse), **arrays)


def _feed(digest: hashlib.blake2b, value: Any) -> None:
    if isinstance(value, _Pieces):
        digest.update(f"{value.kind.str}{(value.size,)}".encode())
        for piece in value.pieces:
            digest.update(np.ascontiguousarray(piece).data)
    elif isinstance(value, Projection) and value.share.number > 1:
        _feed(digest, _whole(value))
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).data)
    elif isinstance(value, Choice):
        digest.update(value.name.encode())
        digest.update(value.identity().encode())
        counted = (str, float, int, np.ndarray) if isinstance(value, Synapse) else (str, float, int)
        _feed(digest, {k: v for k, v in value.parameters().items() if isinstance(v, counted)})
    elif is_dataclass(value):
        for field in fields(value):
            field_value = getattr(value, field.name)
            # Defaults are not hashed, so that states stay valid when a field is added.
            if field.name not in _IGNORED_FIELDS and field_value is not field.default:
                digest.update(field.name.encode())
                _feed(digest, field_value)
        if (stream := getattr(value, "stream", None)) is not None:
            digest.update(stream.identity.encode())
    elif isinstance(value, Mapping):
        for key in sorted(value):
            digest.update(key.encode())
            _feed(digest, value[key])
    elif isinstance(value, tuple):
        digest.update(f"{len(value)}".encode())
        for item in value:
            _feed(digest, item)
    else:
        digest.update(repr(value).encode())


class Checkpoint:
    """The file from which a killed training continues.

    Args:
        model: file of the model; the checkpoint is written beside it.
        format: format of the checkpoint, e.g. "neuro drone training 1".
        settings: settings of the training as plain data. Only a training with equal settings continues.
        ways: hints by name of the setting. A hint is shown if the value of its setting differs.

    Attributes:
        path: path of the checkpoint.
    """

    def __init__(
        self, model: Path, format: str, settings: Mapping[str, Any], ways: Mapping[str, str] | None = None
    ) -> None:
        self.path = model.with_name(f"{model.name}.training")
        self._format, self._settings, self._ways = format, json.dumps(settings), ways or {}

    def keep(self, **parts: NDArray[Any] | Mapping[str, NDArray[Any]]) -> None:
        """Write arrays and groups of arrays to a new checkpoint, which replaces the last one.

        Raises:
            Unwritable: the file cannot be written.
        """
        with writing(self.path, self._format) as file:
            file.attrs["settings"] = self._settings
            for name, part in parts.items():
                put(file, name, part)

    def resume(self) -> dict[str, Any]:
        """Return the arrays of the last `keep`, or {} if there is no checkpoint.

        Raises:
            ModelError: the checkpoint has other settings, or is damaged.
        """
        if not self.path.exists():
            return {}
        with reading(self.path, self._format, "delete the file to start again") as file:
            parts = {name: take(file, name) for name in file}
            saved_settings, present = _flat(json.loads(str(file.attrs["settings"]))), _flat(json.loads(self._settings))
        for name in sorted(saved_settings.keys() | present.keys()):
            if saved_settings.get(name) != present.get(name):
                raise ModelError(
                    f"{self.path}: an unfinished training with {name} = {saved_settings.get(name, 'its default')}: "
                    f"found {present.get(name, 'its default')} now",
                    hint=f"{self._ways.get(name, 'give the same options to continue it')}, or delete the file",
                )
        return parts

    def remove(self) -> None:
        """Remove the file at the end of the training."""
        self.path.unlink(missing_ok=True)


def _flat(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested settings as one level, with names joined by dots."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        flat |= {f"{name}.{k}": v for k, v in _flat(value).items()} if isinstance(value, Mapping) else {name: value}
    return flat
