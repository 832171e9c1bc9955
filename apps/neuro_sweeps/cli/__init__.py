"""The commands `neuro sweep`, `neuro tune` and `neuro rerun`."""
