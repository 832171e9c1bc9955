"""Events of event cameras: the type, files, data sets, filters, segmentation, representations and a pixel model.

`Events` holds a recording; `load`, `stream` and `save` read and write files; `recordings` goes through a labelled
folder or zip; `listen` and `send` are streams by the network; `filters` clean and change a stream; `segmentation` cuts
it; `representations` makes arrays of it; `DVS` makes events from images.
"""

from __future__ import annotations

from neuro_events import filters, representations, segmentation
from neuro_events._events import EVENT, Event, Events
from neuro_events.dataset import Dataset, Recording, Recordings, recordings
from neuro_events.dvs import DVS, DVSParameters, dvs_events, frames_of
from neuro_events.files import load, save, stream
from neuro_events.segmentation import msd_segments
from neuro_events.source import EventFileError, EventFileWarning
from neuro_events.streams import Listener, Sent, StreamCounts, listen, send

__all__ = [
    "DVS",
    "EVENT",
    "DVSParameters",
    "Dataset",
    "Event",
    "EventFileError",
    "EventFileWarning",
    "Events",
    "Listener",
    "Recording",
    "Recordings",
    "Sent",
    "StreamCounts",
    "dvs_events",
    "filters",
    "frames_of",
    "listen",
    "load",
    "msd_segments",
    "recordings",
    "representations",
    "save",
    "segmentation",
    "send",
    "stream",
]
