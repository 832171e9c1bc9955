"""Labelled recordings in a folder, a zip or an HDF5 file: listed, sampled, split, cached and loaded one at a time."""

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
from neuro_events.dataset._recordings import UNKNOWN, Recording, Recordings, Sample, list_recordings, recordings
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
class _Composition:
    """Composition of two functions. Unlike a lambda, an instance can be sent to another process."""

    first: Callable[[Events], Any]
    second: Callable[[Any], Any]

    def __call__(self, events: Events) -> Any:
        return self.second(self.first(events))


class Dataset(Sequence[tuple[Any, int]]):
    """Labelled recordings of a folder, a zip or an HDF5 file.

    ``data[i]`` is (events, label), as PyTorch's ``DataLoader`` expects. ``data[10:20]``, an array of indices and a mask
    such as ``data.labels == 3`` give a data set of those samples. Recordings are read on access. Sampling and splitting
    return new data sets and change nothing.

    Args:
        path: the folder, zip or HDF5 file (``/<class>/<sample>``, as aertb and `to_hdf5` write).
        part: part of a folder or zip with parts, such as ``Train`` or ``Test``. None: all.
        classes: class names in the order of their labels. None: the classes of the data.
        layout: name of the layout of a folder or zip, see `neuro.events.dataset.LAYOUTS`. None: detected.
        ending: ending of the files to list, such as ``bin``. None: all.
        sensor_size: width and height of all recordings, px. None: as the files state.

    Attributes:
        path: the folder, zip or HDF5 file.
        classes: class names; a label is an index into them.
        samples: name, path, label and ``load()`` of each recording.
        layout: name of the layout.

    Raises:
        EventFileError: no labelled recordings, or no such part; the message says what was expected.
        ModelError: `path` is not a file name, or a part, an ending or a layout is specified for an HDF5 file.
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
        self._cache: dict[Sample, Events] | None = None
        self.samples: tuple[Sample, ...]
        if is_hdf5(self.path):
            for name, value in (("part", part), ("layout", layout), ("ending", ending)):
                if value not in (None, "hdf5" if name == "layout" else None):
                    raise ModelError(f"{name}={value!r}: expected None, since {self.path} is an HDF5 file")
            self.classes, self.samples = stored_samples(self.path, classes)
            self.layout = "hdf5"
        else:
            listing = list_recordings(self.path, part, classes, layout, ending, whole=False)
            self.classes, self.samples, self.layout = listing.classes, tuple(listing), listing.layout

    def _with(self, **changes: Any) -> Self:
        copy = object.__new__(type(self))
        copy.__dict__.update(self.__dict__ | changes)
        return copy

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
            events = self._events_of(sample)
            return (events if self._transform is None else self._transform(events)), sample.label
        indices = np.asarray(index)
        if indices.dtype == bool:
            if len(indices) != len(self):
                raise ModelError(f"mask of length {len(indices)}: expected {len(self)}, one for each sample")
            indices = np.flatnonzero(indices)
        return self._with(samples=tuple(self.samples[k] for k in indices.tolist()))

    def _events_of(self, sample: Sample) -> Events:
        """Return the events of a sample, from the cache if this data set has one. Derived data sets share the cache."""
        if self._cache is None:
            return sample.load(sensor_size=self._size)
        if sample not in self._cache:
            self._cache[sample] = sample.load(sensor_size=self._size)
        return self._cache[sample]

    def __iter__(self) -> Iterator[tuple[Any, int]]:
        return (self[k] for k in range(len(self)))

    def __repr__(self) -> str:
        return f"<Dataset {len(self)} of {len(self.classes)} classes in {self.path}>"

    @property
    def labels(self) -> Any:
        """Label of each sample, (samples,) int64."""
        return np.array([sample.label for sample in self.samples], np.int64)

    def only(self, *names: str) -> Self:
        """Return the samples of some classes. The labels do not change.

        Args:
            names: names of the classes.

        Raises:
            ModelError: no such class.
        """
        for name in names:
            if name not in self.classes:
                raise unknown("class", name, self.classes)
        selected = {self.classes.index(name) for name in names}
        return self._with(samples=tuple(sample for sample in self.samples if sample.label in selected))

    def shuffled(self, seed: int) -> Self:
        """Return all samples in random order.

        Args:
            seed: seed of the order, >= 0.
        """
        order: list[int] = np.random.default_rng(seed).permutation(len(self)).tolist()
        return self[order]

    def per_class(self, n: int, *, seed: int | None = None) -> Self:
        """Return n samples of each class that has samples. The order of the data set does not change.

        Args:
            n: number of samples per class.
            seed: seed for a random choice. None: the first n samples.

        Raises:
            ModelError: a class has fewer samples.
        """
        indices: list[int] = []
        for label, members in self._by_class(seed):
            if not 1 <= n <= len(members):
                raise ModelError(
                    f"per_class(n={n!r}): class '{self.classes[label]}' has {len(members)} samples, "
                    f"expected n from 1 to {len(members)}"
                )
            indices += members[:n]
        return self[sorted(indices)]

    def split(self, share: float, *, seed: int) -> tuple[Self, Self]:
        """Split into two parts with the same share of each class. Every sample is in exactly one part.

        Of a class of k samples, round(share * k) (half rounded up) are drawn for the first part.

        Args:
            share: share of the first part, between 0 and 1.
            seed: seed of the draw, >= 0.

        Returns:
            The two parts, each in the order of the data set.

        Raises:
            ModelError: the share is not between 0 and 1.
        """
        if not 0 < share < 1:
            raise ModelError(f"split(share={share!r}): expected a share between 0 and 1")
        first: list[int] = []
        for _, members in self._by_class(seed):
            first += members[: int(np.floor(share * len(members) + 0.5))]
        first_indices = set(first)
        return self[sorted(first)], self[[k for k in range(len(self)) if k not in first_indices]]

    def _by_class(self, seed: int | None) -> Iterator[tuple[int, list[int]]]:
        """Yield each label with the indices of its samples, in order or shuffled."""
        for label in sorted({sample.label for sample in self.samples}):
            members = [k for k, sample in enumerate(self.samples) if sample.label == label]
            if seed is not None:
                members = np.random.default_rng((seed, label)).permutation(members).tolist()
            yield label, members

    def mapped(self, transform: Callable[[Events], Any]) -> Self:
        """Return the same samples with a transform: ``data[i]`` is (transform(events), label).

        Args:
            transform: function of events, such as a representation. Applied after earlier transforms.
        """
        previous = self._transform
        return self._with(_transform=transform if previous is None else _Composition(previous, transform))

    def cached(self, path: str | os.PathLike[str] | None = None, *, jobs: int | None = None) -> Self:
        """Return the same samples with a cache, so that each sample is decoded once.

        Args:
            path: an HDF5 file, written with `to_hdf5` if missing. None: events stay in memory after their first access.
            jobs: number of processes that write the file. None: one per core.

        Raises:
            EventFileError: a sample is damaged, or the file belongs to other samples.
        """
        if path is None:
            return self._with(_cache={})
        self.to_hdf5(path, jobs=jobs, damaged="stop")
        _, samples = stored_samples(os.fspath(path), self.classes)
        lookup = {sample.number: sample for sample in samples}
        return self._with(samples=tuple(lookup[k] for k in range(len(self))), path=os.fspath(path), layout="hdf5")

    def to_hdf5(
        self,
        path: str | os.PathLike[str],
        *,
        jobs: int | None = None,
        damaged: str = "skip",
        report: Report | None = None,
    ) -> StoredDataSet:
        """Write all samples to one HDF5 file as ``/<class>/<sample>``, with several processes.

        After an interruption, the same call resumes, because finished samples are stored in a folder beside the file.
        The file appears when all samples are finished. A script that calls this method needs
        ``if __name__ == "__main__":``, like every script that starts processes.

        Args:
            path: the file. It may exist only if it is the result of the same call.
            jobs: number of processes. None: one per core.
            damaged: treatment of damaged samples: ``"skip"`` omits them, ``"mend"`` reads them up to the damage,
                ``"stop"`` raises an error.
            report: called with the activity, the number of finished samples, and the number of samples.

        Returns:
            The number of samples, and the damaged samples.

        Raises:
            EventFileError: the file or its folder belongs to something else, or a sample is damaged, with ``"stop"``.
        """
        return store(self.samples, self.classes, Path(path), self._size, jobs=jobs, damaged=damaged, report=report)
