"""How each family of chips runs here: its registers in the arrays of the loop, and the integer steps of its neurons."""
