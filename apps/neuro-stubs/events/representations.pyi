from neuro_events.representations import *
