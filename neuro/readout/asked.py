"""Which recordings a network is asked about: files, folders, zips and data sets, with the names of their classes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from neuro.core.errors import ModelError
from neuro.events import recordings
from neuro.events.dataset import UNKNOWN, Sample
from neuro.model.parts import Readout


@dataclass(frozen=True, slots=True, eq=False)
class AskedRecordings:
    """Recordings of several places.

    Attributes:
        samples: the recordings.
        labels: the name of the class of each; None where it is not asked for.
        classes: those that were found, in order.
    """

    samples: tuple[Sample, ...]
    labels: tuple[str, ...] | None
    classes: tuple[str, ...]


def gather(paths: Iterable[Path], part: str | None, labelled: bool) -> AskedRecordings:
    """Find the recordings.

    Args:
        paths: recordings, folders or zips of class folders, HDF5 data sets.
        part: of data with parts only this one; a single recording has none.
        labelled: whether the class of each is known; a single recording has the name of its folder.

    Raises:
        EventFileError: there is nothing, or a part is not there.
        ModelError: a class is not known.
    """
    samples, labels, classes = list[Sample](), list[str](), dict[str, None]()
    for path in paths:
        found = recordings(path, part=part)
        alone = found.layout == "recording"
        classes |= dict.fromkeys([path.resolve().parent.name] if alone else found.classes)
        samples += found
        for item in found if labelled else ():
            if not alone and item.label == UNKNOWN:
                raise ModelError(f"{item.path}: its class is not known: expected recordings in folders of classes")
            labels.append(path.resolve().parent.name if alone else found.classes[item.label])
    return AskedRecordings(tuple(samples), tuple(labels) if labelled else None, tuple(classes))


def with_classes(readout: Readout, named: bool, found: Sequence[str]) -> Readout:
    """How a network is asked whose neurons may have no names: then they have those of the recordings.

    Args:
        readout: its classes are numbers where they have no names.
        named: whether they have.
        found: the classes of the recordings, in order; as many as neurons, or numbers of neurons.
    """
    if named or set(found) <= set(readout.classes) or len(found) != len(readout.classes):
        return readout
    return replace(readout, classes=tuple(found))
