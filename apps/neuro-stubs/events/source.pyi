from neuro_events.source import *
