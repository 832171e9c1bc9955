from neuro_events.files import *
