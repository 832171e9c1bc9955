"""HFirst: the network `hfirst`, what turns a recording into its input, its templates and its decisions."""

from neuro_recognise.hfirst.network import (
    READINGS,
    c1_alone,
    c1_spikes,
    decide,
    decisive,
    network,
    s2_alone,
    s2_heard,
    scores,
    show,
)
from neuro_recognise.hfirst.s1 import s1_spikes, shown
from neuro_recognise.hfirst.settings import HFirstSettings
from neuro_recognise.hfirst.spikes import LayerResponse, LayerSpikes
from neuro_recognise.hfirst.templates import c1_counts, templates

__all__ = [
    "READINGS",
    "HFirstSettings",
    "LayerResponse",
    "LayerSpikes",
    "c1_alone",
    "c1_counts",
    "c1_spikes",
    "decide",
    "decisive",
    "network",
    "s1_spikes",
    "s2_alone",
    "s2_heard",
    "scores",
    "show",
    "shown",
    "templates",
]
