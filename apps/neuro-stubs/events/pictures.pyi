from neuro_events.pictures import *
