"""Classifier: spiking neurons learn by reward what recordings show. Next: python learn.py."""

from pathlib import Path

from neuro.events import recordings
from neuro_recognise import fit
from neuro_recognise.methods import method_of

DATA = Path(__file__).with_name("shapes.zip")  # any folder, zip or HDF5 file of class folders: neuro events info DATA
MODEL = Path(__file__).with_name("model.h5")


def halves():
    """Return every second recording for learning, and the others for the test."""
    data = recordings(DATA)
    return data[::2], data[1::2]


def trained(data, out=None, **settings):
    """Return a recogniser that has learnt the recordings. 'neuro recognise list remus' lists the settings."""
    method = method_of("remus", "early", {"per_class": 2, "epochs": 4} | settings)
    return fit(data, method, seed=0, out=out)


def accuracy(recogniser, data):
    """Return the share of recordings with a right decision."""
    return float((recogniser.predict(data) == [item.label for item in data]).mean())


if __name__ == "__main__":
    learning, unseen = halves()
    recogniser = trained(learning, MODEL)
    print(f"{len(unseen)} unseen recordings: {accuracy(recogniser, unseen):.0%} right, 33% by chance")
