from neuro_events.dvs import *
