from neuro_events.info import *
