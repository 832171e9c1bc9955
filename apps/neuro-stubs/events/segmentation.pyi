from neuro_events.segmentation import *
