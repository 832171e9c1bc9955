"""What a backend sees: the arrays of a compiled network, the protocol of engines, counts, currents, spikes."""
