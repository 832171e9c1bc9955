"""The methods, one file each; a method of one's own is a subclass of `Method`, made known by `neuro.register`."""

from __future__ import annotations

from neuro_recognise.method import METHODS
from neuro_recognise.methods.boe import Boe
from neuro_recognise.methods.edhmax_tempotron import EdhmaxTempotron
from neuro_recognise.methods.hats import Hats
from neuro_recognise.methods.hfirst import HFirst
from neuro_recognise.methods.hots import Hots
from neuro_recognise.methods.masquelier_thorpe import MasquelierThorpe
from neuro_recognise.methods.mozafari import Mozafari
from neuro_recognise.methods.must import Must
from neuro_recognise.methods.remus import Remus
from neuro_recognise.methods.tar_hats import TarHats

__all__ = ["METHODS"]

for _method in (Remus, Boe, EdhmaxTempotron, Hats, HFirst, Hots, MasquelierThorpe, Mozafari, Must, TarHats):
    METHODS.add(_method)
