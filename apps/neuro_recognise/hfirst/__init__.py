"""HFirst: the network `hfirst`, what turns a recording into its input, its templates and its decisions."""

from neuro_recognise.hfirst.decisions import READINGS, decide, decisive, scores
from neuro_recognise.hfirst.network import Heard, Spikes, c1_spikes, network, s2_alone, s2_heard
from neuro_recognise.hfirst.settings import HFirst
from neuro_recognise.hfirst.templates import c1_counts, templates

__all__ = [
    "READINGS",
    "HFirst",
    "Heard",
    "Spikes",
    "c1_counts",
    "c1_spikes",
    "decide",
    "decisive",
    "network",
    "s2_alone",
    "s2_heard",
    "scores",
    "templates",
]
