"""Labelled recordings: found in a folder, a zip or an HDF5 file, drawn, split, cached and loaded one at a time."""

from __future__ import annotations

from neuro.events.dataset._dataset import Dataset
from neuro.events.dataset._layouts import LAYOUTS, Layout
from neuro.events.dataset._recordings import UNKNOWN, Recording, Recordings, Sample, recordings
from neuro.events.dataset._store import StoredDataSet

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
