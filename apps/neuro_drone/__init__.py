"""A drone that learns by dopamine STDP to follow a ball or a line with an event camera (thesis, chapter 7).

Importing this package registers ``neuro/Drone-v0`` with gymnasium.
"""

import gymnasium

ID = "neuro/Drone-v0"

if ID not in gymnasium.registry:  # gymnasium 1.0 and later do not load plug-ins
    gymnasium.register(id=ID, entry_point="neuro_drone.env:DroneEnv")
