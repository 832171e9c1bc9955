from neuro_events.parts import *
