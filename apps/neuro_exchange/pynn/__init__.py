"""Scripts of PyNN as networks, and networks as scripts of PyNN."""
