"""Diagnosis of networks: checks of the description and of a short run give findings with evidence and remedy."""
