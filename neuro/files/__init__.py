"""Files of states and results, and a common interface to the recordings of simulations and of results."""
