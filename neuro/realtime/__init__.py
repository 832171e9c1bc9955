"""Networks at the pace of the clock: `Loop` passes live events to a network, and its actions to the world."""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import public_names

if TYPE_CHECKING:
    from neuro.realtime.loop import Loop as Loop
    from neuro.realtime.pace import LATE as LATE, empty_loop as empty_loop
    from neuro.realtime.report import Histogram as Histogram, LiveRun as LiveRun
    from neuro.realtime.sources import Source as Source
    from neuro_events.player import Player as Player


if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = public_names(__name__, __file__)
