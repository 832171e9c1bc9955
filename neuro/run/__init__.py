"""The runtime: simulations with their trials, records and settings."""
