from neuro_events.filters import *
