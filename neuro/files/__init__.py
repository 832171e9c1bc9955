"""Files of states and results, and one interface to the recordings of both and of simulations."""
