"""The built-in methods, one file each. A custom method is a subclass of `Method`, registered by `neuro.register`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from neuro.apps import unknown
from neuro_recognise.method import METHODS, Method
from neuro_recognise.methods.descriptor import Boe, Hats, TarHats
from neuro_recognise.methods.frame_networks import EdhmaxTempotron, MasquelierThorpe, Mozafari, Must, Remus
from neuro_recognise.methods.gradients import Conv, Dense, LearntDelays, Recurrent
from neuro_recognise.methods.hfirst import HFirst
from neuro_recognise.methods.hots import Hots
from neuro_recognise.methods.layered import Layered

__all__ = ["METHODS", "method_of"]

_LOCAL = (Remus, Layered, Boe, EdhmaxTempotron, Hats, HFirst, Hots, MasquelierThorpe, Mozafari, Must, TarHats)
for _method in (*_LOCAL, Dense, Conv, Recurrent, LearntDelays):
    METHODS.add(_method)


def method_of(name: str, settings: str = "", values: Mapping[str, Any] | None = None) -> Method:
    """Return a method by its name.

    Args:
        name: name of a method, see `neuro recognise list`.
        settings: name of one of its presets; "" for the defaults.
        values: settings that differ from the preset, by name.

    Raises:
        ModelError: there is no such method or preset, or a value is wrong.
    """
    if name not in METHODS:
        raise unknown("method", name, METHODS)
    method = METHODS[name]()
    return (method.preset(settings) if settings else method).changed(values or {})
