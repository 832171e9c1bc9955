"""Reading scripts of PyNN as networks, and writing networks as scripts of PyNN."""
