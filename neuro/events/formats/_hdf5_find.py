"""The recording of an HDF5 file among all else that lies in it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np

from neuro.events.formats._columns import Names, find_names
from neuro.events.formats._format import Damage
from neuro.events.formats._hdf5_chunks import FAILURES, one_line
from neuro.events.formats._hdf5_recording import Recording, of_columns, of_rows, of_table
from neuro.events.formats._hdf5_table import is_table

DEPTH = 3
"""Levels of a file that are looked at: ``/davis/left/events``."""
LIMIT = 100
"""Most members of a group, below the first level, that are looked at to tell what a file is."""


def find(file: Any, where: str = "") -> Recording:
    """The recording of a file.

    Args:
        file: an open h5py file.
        where: the group or dataset, such as ``/davis/left``, where there are several; ``:txyp`` behind it tells the
            order of the columns of a table.

    Raises:
        Damage: there is none, or more than one; or part of it is kept in another file.
    """
    recording = _find(file, where)
    for dataset in recording.datasets:
        if not _own(file, dataset):
            raise Damage(f"{dataset.name} is kept in another file, expected all of a recording in one", None)
    return recording


def member(group: Any, name: str) -> Any:
    """What a name in an open h5py group leads to, None where nothing is there.

    Raises:
        Damage: it cannot be followed, as a link to itself.
    """
    try:
        return group.get(name)
    except FAILURES as error:
        place = name if name.startswith("/") else f"{group.name.rstrip('/')}/{name}"
        raise Damage(f"{place} cannot be opened: {one_line(error)}", None) from None


def _own(file: Any, dataset: Any) -> bool:
    """Whether a dataset has its items in this file: links and storage may name any other that the user can read."""
    from h5py import h5o

    return (
        not (dataset.is_virtual or dataset.external) and h5o.get_info(dataset.id).fileno == h5o.get_info(file.id).fileno
    )


def _find(file: Any, where: str) -> Recording:
    place, order = _parted(where)
    if place:
        return _at(file, place, order)
    for group in (member(file, "events"), file):
        if names := _columns(group):
            return of_columns(group, names, _offset(file, group))
    found = list(_candidates(file))
    found = [node for node in found if node.name == "/CD/events"] or found
    if not found:
        told = ", ".join(list(file)[:8]) or "nothing"
        raise Damage(f"has {told}; expected /events/t, x, y, p, rows at /CD/events or /<class>/<sample>", None)
    if len(found) > 1:
        raise Damage(_several(found), None)
    return _recording(file, found[0], order)


def _parted(where: str) -> tuple[str, str]:
    """A place, and the order of columns behind it."""
    place, _, order = where.rpartition(":")
    return (place, order) if sorted(order) == sorted("txyp") else (where, "")


def _at(file: Any, place: str, order: str) -> Recording:
    """The recording at a place, or below it."""
    import h5py

    node = member(file, place)
    if isinstance(node, h5py.Group) and not _columns(node):
        found = list(_candidates(node))
        if len(found) > 1:
            raise Damage(_several(found), None)
        node = found[0] if found else node
    elif isinstance(node, h5py.Dataset) and not _rows(node) and not is_table(node):
        raise Damage(f"{node.name} has items of {node.dtype} in shape {node.shape}, expected rows of events", None)
    if node is None or (isinstance(node, h5py.Group) and not _columns(node)):
        told = ", ".join(one.name for one in islice(_candidates(file), 4))
        raise Damage(f"has no recording at {place}, expected {told or 'another file: it has none'}", None)
    return _recording(file, node, order)


def _recording(file: Any, node: Any, order: str) -> Recording:
    if names := _columns(node):
        return of_columns(node, names, _offset(file, node))
    return of_rows(node) or of_table(node, order)


def _several(found: list[Any]) -> str:
    told = f"{len(found)} recordings or more ({', '.join(node.name for node in found[:3])}), expected one"
    if all(_rows(node) for node in found):
        return f"is a data set with {told}; neuro.events.Dataset reads it"
    name = f"hdf5:{found[0].name}"
    return f"has {told}: name it, as in format={name!r} or --from {name}"


def _candidates(group: Any, depth: int = DEPTH) -> Iterator[Any]:
    """What can be a recording below a group: groups with columns, rows, and tables that are called events."""
    import h5py

    for name in list(group)[: None if depth == DEPTH else LIMIT]:
        node = member(group, name)
        if isinstance(node, h5py.Dataset):
            if _rows(node) or (is_table(node) and name.lower().startswith("event")):
                yield node
        elif isinstance(node, h5py.Group) and depth > 1:
            if _columns(node):
                yield node
            else:
                yield from _candidates(node, depth - 1)


def _rows(node: Any) -> bool:
    return find_names(node.dtype.names or ()) is not None if hasattr(node, "dtype") else False


def _columns(group: Any) -> Names | None:
    """Which datasets of a group are columns of events, if it is one and they are there."""
    import h5py

    if not isinstance(group, h5py.Group):
        return None
    return find_names(name for name in group if isinstance(member(group, name), h5py.Dataset))


def _offset(file: Any, group: Any) -> int:
    for node in (file, group):
        if "t_offset" in node:
            value = node["t_offset"][()]
            if np.ndim(value) or np.asarray(value).dtype.kind not in "iu":
                raise Damage(f"t_offset is {value}, expected one whole number of us", None)
            return int(value)
    return 0
