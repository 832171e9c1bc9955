"""Many runs of one function or network over a space of values. Each run is kept in its own folder."""
