from neuro_events.opening import *
