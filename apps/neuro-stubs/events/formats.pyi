from neuro_events.formats import *
