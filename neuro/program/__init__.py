"""The interface between compiler and backends: compiled networks, the engine protocol, counts, currents and spikes."""
