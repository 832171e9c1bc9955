"""Events of event cameras: the type, files, data sets, filters, segmentation, representations and a pixel model.

`Events` holds a recording. `load`, `stream` and `save` read and write files. `recordings` lists a labelled folder or
zip. `listen` and `send` exchange events over the network. `filters` clean and change events, `segmentation` cuts a
recording into parts, `representations` turns events into arrays, and `DVS` turns images into events.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.apps import public_names

if TYPE_CHECKING:
    from neuro_events import filters as filters, representations as representations, segmentation as segmentation
    from neuro_events._events import EVENT as EVENT, Event as Event, Events as Events
    from neuro_events.dataset import (
        Dataset as Dataset,
        Recording as Recording,
        Recordings as Recordings,
        recordings as recordings,
    )
    from neuro_events.dvs import (
        DVS as DVS,
        DVSParameters as DVSParameters,
        dvs_events as dvs_events,
        frames_of as frames_of,
    )
    from neuro_events.files import load as load, save as save, stream as stream
    from neuro_events.segmentation import msd_segments as msd_segments
    from neuro_events.source import EventFileError as EventFileError, EventFileWarning as EventFileWarning
    from neuro_events.streams import (
        Listener as Listener,
        Sent as Sent,
        StreamCounts as StreamCounts,
        listen as listen,
        send as send,
    )
else:
    __getattr__, __dir__, __all__ = public_names(__name__, __file__)
