"""A drone that learns to follow a ball or a line with an event camera, by dopamine STDP; thesis chapter 7.

Importing this package registers ``neuro/Drone-v0`` with gymnasium.
"""

import gymnasium

ID = "neuro/Drone-v0"

if ID not in gymnasium.registry:  # gymnasium 1.0 and later load no plug-ins by themselves
    gymnasium.register(id=ID, entry_point="neuro_drone.env:DroneEnv")
