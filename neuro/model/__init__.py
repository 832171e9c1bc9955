"""Descriptions of networks: models of neurons and synapses, connection rules, distributions, and the YAML language."""
