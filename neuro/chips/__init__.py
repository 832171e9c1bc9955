"""What is known of chips: limits, costs, and how a float program becomes one of integers on cores.

from neuro.chips.chip import chip
from neuro.chips.placing.place import place
from neuro.chips.quantising.quantise import quantise

print(quantise(sim.program, chip("loihi")))     # registers, words, and what rounding does
print(place(sim.program, chip("loihi")))        # cores, memory, hops
"""
