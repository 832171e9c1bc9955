from neuro_live import Page as Page
