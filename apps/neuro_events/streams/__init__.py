"""Streams of events over the network: receive while a program runs, and send in real time."""

from __future__ import annotations

from neuro_events.streams._listener import Listener, OfStream, StreamCounts, check_stream, listen
from neuro_events.streams._sender import Sent, send

__all__ = ["Listener", "OfStream", "Sent", "StreamCounts", "check_stream", "listen", "send"]
