"""From a program and a chip to cores, tiles and chips, and the ways of spikes between them."""
