"""Wiring diagrams: tables of neurons and lists of their connections in files, read a piece at a time."""
