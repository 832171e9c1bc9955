"""The commands `neuro sweep`, `tune` and `rerun`."""
