from neuro_events.playing import *
