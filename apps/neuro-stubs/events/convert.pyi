from neuro_events.convert import *
