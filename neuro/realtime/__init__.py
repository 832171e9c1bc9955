"""Networks at the pace of the clock: `Loop` brings live events to a network and its action to the world."""

from __future__ import annotations

from neuro.realtime.histogram import Histogram
from neuro.realtime.inlet import Source
from neuro.realtime.loop import LATE, Loop
from neuro.realtime.pace import empty_loop
from neuro.realtime.player import Player
from neuro.realtime.report import LiveRun

__all__ = ["LATE", "Histogram", "LiveRun", "Loop", "Player", "Source", "empty_loop"]
