"""What is known of chips: limits, costs, and how a float program becomes one of integers on cores.

fixed = neuro.chips.quantise(sim.program, neuro.chips.chip("loihi"));  print(fixed)
print(neuro.chips.place(sim.program, neuro.chips.chip("loihi")))
"""
