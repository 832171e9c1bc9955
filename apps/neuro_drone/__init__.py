"""A drone that learns to follow a ball or a line with an event camera, by dopamine STDP; thesis chapter 7.

Importing this package tells gymnasium of ``neuro/Drone-v0``.
"""

from neuro_drone.register import register

register()
