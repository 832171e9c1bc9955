"""Wiring diagrams: tables of neurons and lists of edges in files, read in pieces."""
