"""The fast path: all steps of a layer in one pass, spikes kept sparse, adjoints written by hand."""
