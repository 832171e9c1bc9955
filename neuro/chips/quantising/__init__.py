"""From a float program to a chip's integers, and what that changes."""
