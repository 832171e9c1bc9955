"""A recording in HDF5: four datasets, or one of rows, read in chunks."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from neuro.events.formats import _hdf5_table as table
from neuro.events.formats._columns import Names, find_names, to_piece, unit_of
from neuro.events.formats._format import Damage, Piece
from neuro.events.formats._hdf5_chunks import FAILURES, believable, chunks_check, one_line, place, unpackable
from neuro.events.formats._seek import bisected

_ROW = 13


@dataclass(slots=True)
class Recording:
    """Four datasets, or one of rows.

    Attributes:
        node: the open group or dataset, which has the attributes.
        datasets: those of t, x, y and p; or the one of rows.
        keys: which field or column of a row is t, x, y and p; () where there are four datasets.
        unit: power of ten by which a time becomes us, None where the times have to be looked at.
        offset: added to all times, us.
    """

    node: Any
    datasets: tuple[Any, ...]
    keys: tuple[str | int, ...]
    unit: int | None
    offset: int = 0

    def told(self) -> dict[str, str]:
        """The order of columns without names, as metadata."""
        if not self.keys or isinstance(self.keys[0], str):
            return {}
        return {"columns": " ".join("txyp"[self.keys.index(k)] for k in range(len(self.keys)))}

    def pieces(self, block: int, start_us: int | None = None) -> Iterator[Piece]:
        """The events; see `neuro.events.formats.Reader` and `Seeker`."""
        total, chunk = self._checked(), (self.datasets[0].chunks or (1 << 15,))[0]
        unit, step = self.unit, max(1, block // _ROW // chunk) * chunk
        at = 0 if start_us is None else self._sought(step, start_us)
        checks = [chunks_check(dataset) for dataset in self.datasets]
        while at < total or not at:
            try:
                read = self._read(at, min(at + step, total), checks)
            except FAILURES as error:
                if step > chunk:
                    step = chunk
                    continue
                raise Damage(f"event {at} on cannot be read: {one_line(error)}", place(self.datasets[0], at)) from None
            unit = unit_of(read["t"][:chunk]) if unit is None else unit
            piece, fault = to_piece(read, unit, at, None)
            yield self._moved(piece, at)
            if fault:
                raise Damage(fault, place(self.datasets[0], at + len(piece.t)))
            at += len(read["t"])
            if at >= total:
                return

    def _checked(self) -> int:
        """The number of events, if the datasets can hold so many."""
        shapes = {dataset.shape for dataset in self.datasets}
        axes = 2 if self.keys and isinstance(self.keys[0], int) else 1
        if len(shapes) != 1 or len(self.datasets[0].shape or ()) != axes:
            told = ", ".join(f"{dataset.name} {dataset.shape}" for dataset in self.datasets)
            raise Damage(f"its columns have the shapes {told}, expected one axis and equal lengths", None)
        for dataset in self.datasets:
            unpackable(dataset)
            believable(dataset)
        return len(self.datasets[0])

    def _sought(self, step: int, start_us: int) -> int:
        """A multiple of a step before which all events are earlier; 0 where the times have no order."""
        unit, scale = self.unit or 0, 10 ** abs(self.unit or 0)

        def first(number: int) -> int:
            t = self._time(number * step)
            us: int = t * scale if unit >= 0 else t // scale + 1
            return us + self.offset

        try:
            return step * bisected(first, -(-len(self.datasets[0]) // step), start_us)
        except FAILURES:
            return 0

    def _time(self, event: int) -> int:
        """The time of an event as the file has it.

        Raises:
            TypeError: it is no whole number: its unit is to be seen in the first times.
        """
        value = self.datasets[0][event]
        return operator.index(value[self.keys[0]] if self.keys else value)

    def _read(self, first: int, last: int, checks: list[Callable[[int, int], None]]) -> dict[str, npt.NDArray[Any]]:
        for check in checks:
            check(first, last)
        read = [dataset[first:last] for dataset in self.datasets]
        columns = [read[0][:, key] if isinstance(key, int) else read[0][key] for key in self.keys] or read
        return dict(zip("txyp", columns, strict=True))

    def _moved(self, piece: Piece, first: int) -> Piece:
        """A piece on the clock of the recording."""
        if not self.offset or not piece.t.size:
            return piece
        if not -(1 << 63) <= int(piece.t.min()) + self.offset <= int(piece.t.max()) + self.offset < 1 << 63:
            raise Damage(f"events {first} on: t_offset {self.offset} leads beyond 2^63 us", None)
        return Piece(piece.t + self.offset, piece.x, piece.y, piece.p)


def of_columns(group: Any, names: Names, offset: int) -> Recording:
    """Four datasets of a group."""
    return Recording(group, tuple(group[name] for name in _keys(names)), (), names.unit, offset)


def of_rows(dataset: Any) -> Recording | None:
    """A dataset of rows with named fields, None where they are no events."""
    names = find_names(dataset.dtype.names or ())
    return None if names is None else Recording(dataset, (dataset,), _keys(names), names.unit)


def of_table(dataset: Any, order: str = "") -> Recording:
    """A dataset of rows without names.

    Args:
        dataset: one that `_hdf5_table.is_table`.
        order: of its columns, such as "txyp"; "" finds it.

    Raises:
        Damage: the order cannot be found.
    """
    found = order or table.order(dataset)
    return Recording(dataset, (dataset,), tuple(found.index(name) for name in "txyp"), table.unit(dataset))


def _keys(names: Names) -> tuple[str, ...]:
    return names.t, names.x, names.y, names.p
