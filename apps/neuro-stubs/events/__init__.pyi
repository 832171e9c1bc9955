from neuro_events import *
