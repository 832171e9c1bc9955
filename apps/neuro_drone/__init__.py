"""A drone that learns to follow a ball or a line with an event camera, by dopamine STDP; thesis chapter 7."""
