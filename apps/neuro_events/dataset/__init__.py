"""Labelled recordings: found in a folder, a zip or an HDF5 file, drawn, split, cached and loaded one at a time."""

from __future__ import annotations

import operator
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, overload

import numpy as np

from neuro import ModelError
from neuro.apps import file_path, unknown
from neuro_events._events import Events
from neuro_events.dataset._layouts import LAYOUTS, Layout, is_hdf5
from neuro_events.dataset._recordings import UNKNOWN, Recording, Recordings, Sample, labelled, recordings
from neuro_events.dataset._store import Report, StoredDataSet, store, stored_samples

__all__ = [
    "LAYOUTS",
    "UNKNOWN",
    "Dataset",
    "Layout",
    "Recording",
    "Recordings",
    "Sample",
    "StoredDataSet",
    "recordings",
]


@dataclass(frozen=True, slots=True)
class _Both:
    """One function after the other; unlike a lambda it can be sent to another process."""

    first: Callable[[Events], Any]
    second: Callable[[Any], Any]

    def __call__(self, events: Events) -> Any:
        return self.second(self.first(events))


class Dataset(Sequence[tuple[Any, int]]):
    """Labelled recordings of a folder, a zip or an HDF5 file.

    ``data[i]`` is (events, label), so that PyTorch's ``DataLoader`` takes it as it is; ``data[10:20]``, an array of
    indices and a mask such as ``data.labels == 3`` give a data set of those samples. Nothing is read before it is
    asked for. Drawing and splitting give new data sets of the same samples and change nothing.

    Args:
        path: the folder, zip or HDF5 file (``/<class>/<sample>``, as aertb lays it out and `to_hdf5` writes it).
        part: of a folder or zip with parts, such as ``Train`` and ``Test``, only this one.
        classes: class names in the order of their labels; None takes those found.
        layout: name of the layout of a folder or zip, see `neuro.events.dataset.LAYOUTS`; None finds it.
        ending: only files whose names end so, such as ``bin``.
        sensor_size: width and height of all recordings, px; None takes those that the files tell.

    Attributes:
        path: where it lies.
        classes: class names; a label is an index into them.
        samples: name, path, label and ``load()`` of each.
        layout: how it lies there.

    Raises:
        EventFileError: there are no labelled recordings, or no such part; the message says what was expected.
        ModelError: `path` is no name of a file; a part, an ending or a layout of an HDF5 file.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        part: str | None = None,
        classes: Sequence[str] | None = None,
        layout: str | None = None,
        ending: str | None = None,
        sensor_size: tuple[int, int] | None = None,
    ) -> None:
        file_path(path, "path")
        self.path = os.fspath(path)
        self._size = sensor_size
        self._transform: Callable[[Events], Any] | None = None
        self._kept: dict[Sample, Events] | None = None
        self.samples: tuple[Sample, ...]
        if is_hdf5(self.path):
            for name, value in (("part", part), ("layout", layout), ("ending", ending)):
                if value not in (None, "hdf5" if name == "layout" else None):
                    raise ModelError(f"{name}={value!r}: expected None, since {self.path} is an HDF5 file")
            self.classes, self.samples = stored_samples(self.path, classes)
            self.layout = "hdf5"
        else:
            found = labelled(self.path, part, classes, layout, ending, whole=False)
            self.classes, self.samples, self.layout = found.classes, tuple(found), found.layout

    def _with(self, **changed: Any) -> Self:
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__ | changed)
        return other

    def __len__(self) -> int:
        return len(self.samples)

    @overload
    def __getitem__(self, index: int) -> tuple[Any, int]: ...
    @overload
    def __getitem__(self, index: slice | Sequence[int]) -> Self: ...
    def __getitem__(self, index: int | slice | Sequence[int]) -> tuple[Any, int] | Self:
        if isinstance(index, slice):
            return self._with(samples=self.samples[index])
        if np.ndim(index) == 0:
            sample = self.samples[operator.index(index)]  # type: ignore[arg-type]
            events = self._loaded(sample)
            return (events if self._transform is None else self._transform(events)), sample.label
        chosen = np.asarray(index)
        if chosen.dtype == bool:
            if len(chosen) != len(self):
                raise ModelError(f"mask of length {len(chosen)}: expected {len(self)}, one for each sample")
            chosen = np.flatnonzero(chosen)
        return self._with(samples=tuple(self.samples[k] for k in chosen.tolist()))

    def _loaded(self, sample: Sample) -> Events:
        """The events of a sample, which are kept if they are to be; views of a data set share what is kept."""
        if self._kept is None:
            return sample.load(sensor_size=self._size)
        if sample not in self._kept:
            self._kept[sample] = sample.load(sensor_size=self._size)
        return self._kept[sample]

    def __iter__(self) -> Iterator[tuple[Any, int]]:
        return (self[k] for k in range(len(self)))

    def __repr__(self) -> str:
        return f"<Dataset {len(self)} of {len(self.classes)} classes in {self.path}>"

    @property
    def labels(self) -> Any:
        """(samples,) int64, the label of each."""
        return np.array([sample.label for sample in self.samples], np.int64)

    def only(self, *names: str) -> Self:
        """The samples of some classes; labels stay as they are.

        Args:
            names: of classes.

        Raises:
            ModelError: there is no such class.
        """
        for name in names:
            if name not in self.classes:
                raise unknown("class", name, self.classes)
        kept = {self.classes.index(name) for name in names}
        return self._with(samples=tuple(sample for sample in self.samples if sample.label in kept))

    def shuffled(self, seed: int) -> Self:
        """All samples in an order that the seed decides.

        Args:
            seed: >= 0.
        """
        order: list[int] = np.random.default_rng(seed).permutation(len(self)).tolist()
        return self[order]

    def per_class(self, n: int, *, seed: int | None = None) -> Self:
        """Equally many samples of each class that has any, in the order of the data set.

        Args:
            n: of each class.
            seed: which ones are drawn; None takes the first.

        Raises:
            ModelError: a class has fewer.
        """
        taken: list[int] = []
        for label, mine in self._by_class(seed):
            if not 1 <= n <= len(mine):
                raise ModelError(
                    f"per_class(n={n!r}): class '{self.classes[label]}' has {len(mine)} samples, "
                    f"expected n from 1 to {len(mine)}"
                )
            taken += mine[:n]
        return self[sorted(taken)]

    def split(self, share: float, *, seed: int) -> tuple[Self, Self]:
        """Two parts with the same share of each class; every sample is in one of them.

        Of a class of k samples, round(share * k) are in the first part, halves rounded up, drawn by the seed.

        Args:
            share: of the first part, between 0 and 1.
            seed: of the draw, >= 0.

        Returns:
            The two parts, each in the order of the data set.

        Raises:
            ModelError: the share is not between 0 and 1.
        """
        if not 0 < share < 1:
            raise ModelError(f"split(share={share!r}): expected a share between 0 and 1")
        first: list[int] = []
        for _, mine in self._by_class(seed):
            first += mine[: int(np.floor(share * len(mine) + 0.5))]
        chosen = set(first)
        return self[sorted(first)], self[[k for k in range(len(self)) if k not in chosen]]

    def _by_class(self, seed: int | None) -> Iterator[tuple[int, list[int]]]:
        """Each label with the indices of its samples, in order or shuffled."""
        for label in sorted({sample.label for sample in self.samples}):
            mine = [k for k, sample in enumerate(self.samples) if sample.label == label]
            if seed is not None:
                mine = np.random.default_rng((seed, label)).permutation(mine).tolist()
            yield label, mine

    def mapped(self, transform: Callable[[Events], Any]) -> Self:
        """The same samples, of which ``data[i]`` is (transform(events), label).

        Args:
            transform: makes what is wanted of events, such as a representation; after an earlier one.
        """
        before = self._transform
        return self._with(_transform=transform if before is None else _Both(before, transform))

    def cached(self, path: str | os.PathLike[str] | None = None, *, jobs: int | None = None) -> Self:
        """The same samples, decoded once.

        Args:
            path: an HDF5 file that is made with `to_hdf5` if it is not there; None keeps events in memory as they are
                asked for.
            jobs: processes that make it; None: one for each core.

        Raises:
            EventFileError: a sample is damaged, or the file is of other samples.
        """
        if path is None:
            return self._with(_kept={})
        self.to_hdf5(path, jobs=jobs, damaged="stop")
        _, samples = stored_samples(os.fspath(path), self.classes)
        in_order = {sample.number: sample for sample in samples}
        return self._with(samples=tuple(in_order[k] for k in range(len(self))), path=os.fspath(path), layout="hdf5")

    def to_hdf5(
        self,
        path: str | os.PathLike[str],
        *,
        jobs: int | None = None,
        damaged: str = "skip",
        report: Report | None = None,
    ) -> StoredDataSet:
        """Write all samples to one HDF5 file as ``/<class>/<sample>``, by several processes.

        After a kill the same call goes on where it was: what is done lies in a folder beside the file, which appears
        when it is whole. A script that calls this needs ``if __name__ == "__main__":``, as all do that use processes.

        Args:
            path: the file; it may exist only if it is the result of the same call.
            jobs: processes; None: one for each core.
            damaged: what to do with a damaged sample: ``"skip"`` leaves it out, ``"mend"`` takes what is whole,
                ``"stop"`` stops.
            report: called with what is going on, samples done, and all samples.

        Returns:
            How many samples there are, and which are damaged.

        Raises:
            EventFileError: the file or its folder belongs to something else; or damage with ``"stop"``.
        """
        return store(self.samples, self.classes, Path(path), self._size, jobs=jobs, damaged=damaged, report=report)
