"""A network in a chip's integers as C for a microcontroller."""
