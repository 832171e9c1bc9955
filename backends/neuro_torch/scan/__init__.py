"""The fast path: all steps of a layer in one pass, with sparse spikes and hand-written adjoints."""
