"""Exchangeable parts of methods: cleaners, segmenters, filter banks, encoders and readouts."""
