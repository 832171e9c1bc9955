"""Recognisers that version 0.1.0 wrote: files "neuro remus model 1".

```
/            attributes: format, settings and training (JSON)
/network     the network before learning, as YAML text
/kernels     float64, (maps, orientations, rows, columns), the learnt weights of its projection c1_s2
/classes     names of the classes
/history     float64, (epochs,), share of the frames that were decided rightly while learning
```
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from neuro.apps import hdf5
from neuro_recognise.methods.remus import Remus
from neuro_recognise.recogniser import Recogniser

__all__ = ["RENAMED", "load"]

FORMAT = "neuro remus model 1"
RENAMED = {"tau_msd": "tau", "theta_msd": "threshold", "literal_gabors": "literal"}
"""Settings of that version, and what they are called now."""


def load(path: Path) -> Recogniser:
    """Read a recogniser, of either kind of file.

    Raises:
        ModelError: there is no such file, or it is something else or damaged.
    """
    if not hdf5.has_format(path, FORMAT):
        return Recogniser.load(path)
    with hdf5.reading(path, FORMAT) as file:
        training = json.loads(file.attrs["training"])
        learnt = {"network": file["network"].asstr()[()], "c1_s2": file["kernels"][()], "history": file["history"][()]}
        method = _method(json.loads(file.attrs["settings"]))
        classes = tuple(file["classes"].asstr()[:].tolist())
        return Recogniser(method, classes, learnt | {"seed": np.array(training["seed"])}, training)


def _method(settings: Mapping[str, Any]) -> Remus:
    """The method with settings of that version."""
    front = {RENAMED.get(name, name): value for name, value in settings["front"].items()}
    own = {name: settings[name] for name in ("epochs", "order", "rate_decay", "vote")}
    return Remus().preset("thesis").changed({**settings["network"], **front, **own})
