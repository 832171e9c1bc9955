from neuro_events.streams import *
