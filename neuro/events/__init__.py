"""Events of event cameras: the type, files, data sets, segmentation and a pixel model.

`Events` holds a recording; `load` and `save` read and write files; `recordings` goes through a
labelled folder or zip; `msd_segments` cuts a recording into frames; `DVS` makes events from images.
"""

from __future__ import annotations

from neuro.events._events import EVENT, Events
from neuro.events.dataset import Recording, Recordings, recordings
from neuro.events.dvs import DVS, DVSParameters, dvs_events
from neuro.events.errors import EventFileError, EventFileWarning
from neuro.events.files import load, save, stream
from neuro.events.scenes import frames_of
from neuro.events.segmentation import msd_segments

__all__ = [
    "DVS",
    "EVENT",
    "DVSParameters",
    "EventFileError",
    "EventFileWarning",
    "Events",
    "Recording",
    "Recordings",
    "dvs_events",
    "frames_of",
    "load",
    "msd_segments",
    "recordings",
    "save",
    "stream",
]
