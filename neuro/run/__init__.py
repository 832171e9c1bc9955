"""The runtime that users hold: simulations with their trials, records and settings."""
