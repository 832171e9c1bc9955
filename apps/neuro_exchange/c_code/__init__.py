"""Export of a network, in the integers of an emulated chip, as C for a microcontroller."""
