"""Modules without knowledge of networks, on which every layer is built: errors, checks, files, processes."""
