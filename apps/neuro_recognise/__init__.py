"""Recognise objects in event-camera recordings."""
