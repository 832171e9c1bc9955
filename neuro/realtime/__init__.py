"""Networks at the pace of the clock: `Loop` brings live events to a network and its action to the world."""

from __future__ import annotations

from neuro.realtime.loop import LATE, Loop, empty_loop
from neuro.realtime.report import Histogram, LiveRun
from neuro.realtime.sources import Player, Source

__all__ = ["LATE", "Histogram", "LiveRun", "Loop", "Player", "Source", "empty_loop"]
