"""MATLAB ``.mat``: four vectors, in the file itself or in structs and cells at any depth.

Names and units are as in `_columns`. Versions 5 to 7 are decoded here, version 7.3 by h5py, both completely into
memory. SciPy also reads version 5, but crashes with a segmentation fault on some damaged files.

Version 5 has 128 bytes of header, then elements. An element is a type, a size and content, padded to 8 bytes. Type and
size take 8 bytes, or 4 bytes if the content has at most 4. A matrix is an element that contains elements: flags and
class, shape, name, content. Compressed elements are zlib streams. Numbers become arrays (flat, in the file's order).
Structs become mappings. Cells and arrays of structs become lists. Text, sparse matrices, objects and functions are
skipped.

A struct with ``ts`` beside ``x``, ``y``, ``p`` counts columns and rows from 1, so 1 is subtracted. Its polarities may
be 1 for OFF and 2 for ON. Examples: ``TD`` of Orchard's scripts, the cells of ``ROI`` in DVS-BARREL. Columns and rows
are counted from 0 in a struct with ``timeStamp`` (jAER's AedatTools: ``aedat.data.polarity``), and in vectors outside
of structs.
``metadata`` has ``variable`` and ``counted_from``. `load` reads files with one recording, `samples` with any number.

Sources: MathWorks, "MAT-File Format", R2024b, chapter 1; ``Read_Ndataset.m`` of the N-MNIST data set ("first pixel
having index 1", "1 means off, 2 means on"); aertb's ``mat_loader.py`` for DVS-BARREL; AedatTools' ``ImportAedat``.
"""

from __future__ import annotations

import io
import math
import zlib
from collections.abc import Iterator, Mapping
from struct import Struct
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.apps import LazyModule
from neuro_events._events import Events
from neuro_events.formats._columns import Names, find_names, to_piece, unit_of
from neuro_events.formats._format import Damage, Format, Found
from neuro_events.formats._hdf5_recording import FAILURES, check_length
from neuro_events.source import WHOLE, EventFileError, FileInput, Source

h5py = LazyModule("h5py")

MAGIC = b"MATLAB "


Columns = Mapping[str, npt.NDArray[Any]]
Candidate = tuple[str, Columns, Names]


def open_mat(source: Source) -> Found:
    """Read a ``.mat`` file.

    Raises:
        Damage: the file is damaged, or does not have exactly one recording.
    """
    candidates = _candidates(source)
    if len(candidates) > 1:
        names = ", ".join(name for name, _, _ in candidates[:4])
        hint = "neuro.events.formats.mat.samples(path) returns all"
        raise Damage(f"has {len(candidates)} recordings ({names}), expected one; {hint}", None)
    return _recording(*candidates[0])


def samples(file: FileInput) -> dict[str, Events]:
    """Return all recordings of a ``.mat``, such as the cells of DVS-BARREL's ``ROI``.

    Args:
        file: a path, bytes or an open file.

    Returns:
        The events by the name of their variable, ``ROI{3}`` for a cell.

    Raises:
        EventFileError: the file is damaged or has no recording.
        ValueError: an event is impossible; the message names the first one.
        OSError: the path cannot be opened.
    """
    recordings: dict[str, Events] = {}
    with Source(file) as source:
        try:
            for candidate in _candidates(source):
                recording = _recording(*candidate)
                (piece,) = recording.pieces(WHOLE)
                size = int(piece.x.max(initial=0)) + 1, int(piece.y.max(initial=0)) + 1
                metadata = {"format": "mat", **recording.metadata}
                recordings[candidate[0]] = Events(piece.t, piece.x, piece.y, piece.p, size, metadata)
        except Damage as damage:
            raise EventFileError(source.name, damage.what, damage.offset) from None
    return recordings


def _candidates(source: Source) -> list[Candidate]:
    """Return the recordings of a file, at least one."""
    data = source.all()
    if not data.size:
        raise Damage("is empty, expected a MAT file", 0)
    try:
        file_variables = _version_73(data.data) if b"MATLAB 7.3" in source.head(128) else variables(data.data)
    except Damage:
        raise
    except FAILURES as error:
        raise Damage(f"not an intact MAT file: {' '.join(str(error).split())}", None) from None
    # A recording of top-level vectors has no name.
    top_level = find_names(name for name, value in file_variables.items() if _is_vector(value))
    parts = {"": file_variables} if top_level else file_variables
    candidates = [candidate for name, value in parts.items() for candidate in _search(name, value, DEPTH)]
    if not candidates:
        names = ", ".join(file_variables) or "nothing"
        raise Damage(f"has {names}; expected vectors t (or ts), x, y and p (or pol), also in a struct", None)
    return candidates


def _recording(variable: str, columns: Columns, names: Names) -> Found:
    vectors = {key: np.ravel(columns[getattr(names, key)]) for key in "txyp"}
    lengths = {name: vector.size for name, vector in vectors.items()}
    if len(set(lengths.values())) != 1:
        lengths_text = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise Damage(f"{variable or 'its vectors'}: lengths are {lengths_text}, expected equal ones", None)
    positions = vectors["x"], vectors["y"]
    from_one = all(
        not position.size or (position.dtype.kind in "iuf" and position.min() >= 1) for position in positions
    )
    base = 1 if variable and names.t.lower() == "ts" and from_one else 0
    if base:
        vectors |= {key: np.asarray(vectors[key], np.float64) - 1 for key in "xy"}
    if vectors["p"].size and vectors["p"].dtype.kind in "iuf" and vectors["p"].max() == 2:
        vectors["p"] = np.asarray(vectors["p"], np.float64) - 1
    unit = unit_of(vectors["t"]) if names.unit is None else names.unit
    piece, fault = to_piece(vectors, unit, 0, None)
    metadata = {"variable": variable, "counted_from": base} if variable else {"counted_from": base}
    return Found(None, metadata, (piece,), Damage(fault, None) if fault else None)


def _search(name: str, value: Any, depth: int) -> Iterator[Candidate]:
    """Yield the recordings in a variable. Four vectors in one struct are a recording."""
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


def _version_73(data: Any) -> dict[str, Any]:
    """Return the variables of version 7.3, which is HDF5: structs are groups, cells are references."""
    with h5py.File(io.BytesIO(data), "r") as file:
        return {name: _of_hdf5(file, node, DEPTH) for name, node in file.items() if not name.startswith("#")}


def _of_hdf5(file: Any, node: Any, depth: int) -> Any:
    if not depth:
        return None
    if isinstance(node, h5py.Group):
        return {name: _of_hdf5(file, item, depth - 1) for name, item in node.items()}
    check_length(node)
    if node.dtype == h5py.ref_dtype:
        return [_of_hdf5(file, file[reference], depth - 1) for reference in node[()].ravel()[:ITEMS]]
    return node[()]


# codes of MATLAB for the types of stored numbers, the types of elements, and the classes of matrices
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
MATRIX, COMPRESSED = 14, 15
CELL, STRUCT = 1, 2
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}

DEPTH = 8
"""Largest depth of nested structs and cells. Structs and cells deeper in the file are skipped."""
ITEMS = 1000
"""Largest number of items that are read from one cell array, array of structs or struct."""
UNPACKED = 1 << 32
"""Largest unpacked size of a compressed variable, bytes."""


def variables(data: Any) -> dict[str, Any]:
    """Return the variables of a file of version 5 to 7 by their names; see the module's docstring for the format.

    Args:
        data: the bytes of the file.

    Raises:
        ValueError: the file is damaged.
    """
    data = memoryview(data)
    mark = bytes(data[126:128])
    if mark not in (b"IM", b"MI"):
        raise ValueError("is not a MAT file of version 5 to 7.3: expected one that MATLAB saved with -v7 or -v7.3")
    order = "<" if mark == b"IM" else ">"
    return dict(_matrix(content, order, DEPTH) for kind, content in _elements(data[128:], order) if kind == MATRIX)


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield the types and contents of elements. Compressed elements are unpacked."""
    at = 0
    tag = Struct(order + "II")
    while at < len(data):
        kind, size = tag.unpack(data[at : at + 8].tobytes().ljust(8, b"\0"))
        start = at + 8
        if kind >> 16:
            kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
        content = data[start : start + size]
        if len(content) < size or len(data) - at < 8:
            raise ValueError("an element ends beyond the file or its parent element")
        if kind == COMPRESSED:
            try:
                plain = zlib.decompressobj().decompress(content, UNPACKED)
            except zlib.error as error:
                raise ValueError(f"a compressed variable is damaged: {error}") from None
            yield from _elements(memoryview(plain), order)
            at = start + size
        else:
            yield kind, content
            at = start + size + (-size % 8 if start == at + 8 else 4 - size)


def _matrix(content: memoryview, order: str, depth: int) -> tuple[str, Any]:
    """Return the name and the value of a matrix. The value is None for a matrix that is skipped, such as text."""
    parts = _elements(content, order)
    try:
        flags, shape, name = (next(parts)[1] for _ in range(3))
    except StopIteration:
        if not len(content):
            return "", np.zeros(0)
        raise ValueError("a variable has no name or no shape") from None
    if len(flags) < 4 or len(shape) % 4:
        raise ValueError("a variable has no class or no shape")
    word = int(np.frombuffer(flags[:4], order + "u4")[0])
    count = math.prod(np.frombuffer(shape, order + "i4").tolist())
    matrix_class, is_complex = word & 0xFF, bool(word & 0x800)
    return bytes(name).decode("utf-8", "replace"), _value(matrix_class, is_complex, count, parts, order, depth)


def _value(kind: int, complex_: bool, count: int, parts: Any, order: str, depth: int) -> Any:
    if kind in CLASSES and not complex_:
        stored_type, content = next(parts, (0, memoryview(b"")))
        if stored_type not in TYPES:
            raise ValueError(f"numbers of the unknown type {stored_type}")
        dtype = np.dtype(order + TYPES[stored_type])
        if count < 0 or len(content) != count * dtype.itemsize:
            raise ValueError(f"a variable has {len(content)} bytes, expected {count} numbers of {dtype.itemsize}")
        return np.frombuffer(content, dtype).astype(CLASSES[kind], copy=False)
    if kind == CELL and depth:
        return [_matrix(cell, order, depth - 1)[1] for (_, cell), _ in zip(parts, range(ITEMS), strict=False)]
    if kind == STRUCT and depth:
        return _structs(parts, order, depth - 1)
    return None


def _structs(parts: Any, order: str, depth: int) -> Any:
    """Return a struct as a mapping, or an array of structs as a list of mappings.

    The first part is the length of a field's name, the second all names. The rest are the fields, struct by struct.
    """
    try:
        width, names = (next(parts)[1] for _ in range(2))
    except StopIteration:
        raise ValueError("a struct has no fields") from None
    length = int.from_bytes(width, "little" if order == "<" else "big")
    if not 1 <= length <= 64:
        raise ValueError(f"a struct has names of {length} bytes")
    fields = [bytes(names[at : at + length]).split(b"\0")[0] for at in range(0, len(names), length)]
    keys = [name.decode("utf-8", "replace") for name in fields]
    values = [_matrix(field, order, depth)[1] for (_, field), _ in zip(parts, range(ITEMS), strict=False)]
    structs = [
        dict(zip(keys, values[at : at + len(keys)], strict=False)) for at in range(0, len(values), len(keys) or 1)
    ]
    return structs[0] if len(structs) == 1 else structs


MAT = Format("mat", "MATLAB", (".mat",), lambda head: head.startswith(MAGIC), open_mat)
"""MATLAB, read only."""
