"""A drone that learns to follow a ball or a line with an event camera, by dopamine STDP; thesis chapter 7.

Importing this package tells gymnasium of ``neuro/Drone-v0``.
"""

import gymnasium

ID = "neuro/Drone-v0"

if ID not in gymnasium.registry:  # gymnasium 1.0 and later look for no plug-ins of themselves
    gymnasium.register(id=ID, entry_point="neuro_drone.env:DroneEnv")
