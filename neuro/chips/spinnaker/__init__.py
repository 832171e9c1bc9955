"""SpiNNaker 1's arithmetic: s16.15 neurons and 16-bit weight slots."""
