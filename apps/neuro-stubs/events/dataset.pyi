from neuro_events.dataset import *
