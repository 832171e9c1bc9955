"""MATLAB ``.mat``: four vectors, in the file itself or in structs and cells at any depth.

Names and units as in `_columns`. Versions 4 to 7 are read as in `_mat5`, 7.3 by h5py, both at once into memory.

A struct with ``ts`` beside ``x``, ``y``, ``p`` (the ``TD`` of Orchard's scripts, and in DVS-BARREL also the cells of
``ROI``) counts columns and rows from 1, so 1 is taken from them; its polarities may be 1 for OFF and 2 for ON. One with
``timeStamp`` (jAER's AedatTools: ``aedat.data.polarity``) and vectors in the file itself count from 0.
``metadata`` tells ``variable`` and ``counted_from``. `load` takes files with one recording, `samples` any number.

Source: ``Read_Ndataset.m`` of the N-MNIST data set ("first pixel having index 1", "1 means off, 2 means on"); aertb's
``mat_loader.py`` for DVS-BARREL; AedatTools' ``ImportAedat``.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.errors import EventFileError
from neuro.events.formats._columns import Names, find_names, to_piece, unit_of
from neuro.events.formats._format import Damage, Format, Found, Piece
from neuro.events.formats._hdf5_chunks import believable
from neuro.events.formats._mat5 import DEPTH, ITEMS, variables
from neuro.events.source import WHOLE, Given, Source

MAGIC = b"MATLAB "

_FAILURES = (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError, MemoryError, OverflowError)

Columns = Mapping[str, npt.NDArray[Any]]
Candidate = tuple[str, Columns, Names]


def open_mat(source: Source) -> Found:
    """Read a ``.mat``.

    Raises:
        Damage: it is damaged, or has no recording or several.
    """
    found = _candidates(source)
    if len(found) > 1:
        told = ", ".join(name for name, _, _ in found[:4])
        hint = "neuro.events.formats.mat.samples(path) gives all"
        raise Damage(f"has {len(found)} recordings ({told}), expected one; {hint}", None)
    return _recording(*found[0])


def samples(given: Given) -> dict[str, Events]:
    """All recordings of a ``.mat``, such as the cells of DVS-BARREL's ``ROI``.

    Args:
        given: a path, bytes or an open file.

    Returns:
        events by the name of their variable, ``ROI{3}`` for a cell.

    Raises:
        EventFileError: it is damaged or has no recording.
        ValueError: an event is impossible; the first is named.
        OSError: the path cannot be opened.
    """
    with Source(given) as source:
        try:
            return {candidate[0]: _events(_recording(*candidate)) for candidate in _candidates(source)}
        except Damage as damage:
            raise EventFileError(source.name, damage.what, damage.offset) from None


def _events(found: Found) -> Events:
    piece = next(found.pieces(WHOLE))
    if isinstance(found, _Part):
        raise Damage(found.fault, None)
    size = int(piece.x.max(initial=0)) + 1, int(piece.y.max(initial=0)) + 1
    return Events(piece.t, piece.x, piece.y, piece.p, size, {"format": "mat", **found.metadata})


def _candidates(source: Source) -> list[Candidate]:
    """The recordings of a file, at least one."""
    data = source.all()
    if not data.size:
        raise Damage("is empty, expected a MAT file", 0)
    try:
        known = _version_73(data.data) if b"MATLAB 7.3" in source.head(128) else variables(data.data)
    except Damage:
        raise
    except _FAILURES as error:
        raise Damage(f"no whole MAT file: {' '.join(str(error).split())}", None) from None
    found = [candidate for name, value in _named(known).items() for candidate in _search(name, value, DEPTH)]
    if not found:
        told = ", ".join(known) or "nothing"
        raise Damage(f"has {told}; expected vectors t (or ts), x, y and p (or pol), also in a struct", None)
    return found


def _recording(variable: str, columns: Columns, names: Names) -> Found:
    vectors = {key: np.ravel(columns[getattr(names, key)]) for key in "txyp"}
    lengths = {name: vector.size for name, vector in vectors.items()}
    if len(set(lengths.values())) != 1:
        told = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise Damage(f"{variable or 'its vectors'}: lengths are {told}, expected equal ones", None)
    base = 1 if variable and names.t.lower() == "ts" and _from_one(vectors) else 0
    if base:
        vectors |= {key: np.asarray(vectors[key], np.float64) - 1 for key in "xy"}
    if vectors["p"].size and vectors["p"].dtype.kind in "iuf" and vectors["p"].max() == 2:
        vectors["p"] = np.asarray(vectors["p"], np.float64) - 1
    unit = unit_of(vectors["t"]) if names.unit is None else names.unit
    piece, fault = to_piece(vectors, unit, 0, None)
    metadata = {"variable": variable, "counted_from": base} if variable else {"counted_from": base}
    return _Part(None, metadata, (piece,), fault) if fault else Found(None, metadata, (piece,))


class _Part(Found):
    """A recording that is right up to an event."""

    def __init__(self, size: None, metadata: Mapping[str, Any], parts: tuple[Piece, ...], fault: str) -> None:
        super().__init__(size, metadata, parts)
        self.fault = fault

    def pieces(self, block: int) -> Iterator[Piece]:
        """What is right, then the damage."""
        yield from self.parts
        raise Damage(self.fault, None)


def _from_one(vectors: Columns) -> bool:
    """Whether no column and row is below 1."""
    return all(not vectors[key].size or (vectors[key].dtype.kind in "iuf" and vectors[key].min() >= 1) for key in "xy")


def _search(name: str, value: Any, depth: int) -> Iterator[Candidate]:
    """The recordings in a variable; four vectors beside each other are one."""
    if isinstance(value, Mapping):
        vectors = {key: item for key, item in value.items() if _is_vector(item)}
        if names := find_names(vectors):
            yield name, vectors, names
        elif depth:
            for key, item in value.items():
                yield from _search(f"{name}.{key}" if name else key, item, depth - 1)
    elif isinstance(value, list) and depth:
        for k, item in enumerate(value[:ITEMS]):
            yield from _search(f"{name}{{{k + 1}}}", item, depth - 1)


def _is_vector(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.size == max(value.shape, default=1)


def _named(found: dict[str, Any]) -> dict[str, Any]:
    """Variables; those that are a recording together, under no name."""
    return {"": found} if find_names(_vectors(found)) else found


def _vectors(variables: Mapping[str, Any]) -> list[str]:
    return [name for name, value in variables.items() if _is_vector(value)]


def _version_73(data: Any) -> dict[str, Any]:
    """Variables of version 7.3, which is HDF5: structs are groups, cells are references."""
    import h5py

    with h5py.File(io.BytesIO(data), "r") as file:
        return {name: _of_hdf5(file, node, DEPTH) for name, node in file.items() if not name.startswith("#")}


def _of_hdf5(file: Any, node: Any, depth: int) -> Any:
    import h5py

    if not depth:
        return None
    if isinstance(node, h5py.Group):
        return {name: _of_hdf5(file, item, depth - 1) for name, item in node.items()}
    believable(node)
    if node.dtype == h5py.ref_dtype:
        return [_of_hdf5(file, file[reference], depth - 1) for reference in node[()].ravel()[:ITEMS]]
    return node[()]


MAT = Format("mat", "MATLAB", (".mat",), lambda head: head.startswith(MAGIC), open_mat)
"""Read only."""
