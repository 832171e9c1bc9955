"""A trained ReMuS in one file.

```
/            attributes: format "neuro remus model 1", settings and training (JSON), and the versions of neuro,
             python, numpy and numba
/network     the network before learning, as YAML text
/kernels     float64, (maps, orientations, rows, columns), the learnt weights of its projection c1_s2
/classes     names of the classes
/history     float64, (epochs,), share of the frames that were decided rightly while learning
```
"""

from __future__ import annotations

import json
import platform
import tempfile
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro.apps import hdf5
from neuro_models import path as network_path
from neuro_remus.settings import Settings

FORMAT = "neuro remus model 1"
LEARNT = "c1_s2"
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """What training gives, and all that testing needs.

    Attributes:
        settings: of the training, front end included.
        classes: names.
        network: YAML text of the network before learning.
        kernels: (maps, orientations, rows, columns), learnt weights.
        history: (epochs,) share of the frames that were decided rightly while learning.
        training: what it was trained on and with: seed, backend and a hash of the recordings.
    """

    settings: Settings
    classes: tuple[str, ...]
    network: str
    kernels: Floats
    history: Floats
    training: dict[str, Any]

    @property
    def per_class(self) -> int:
        """Grids of each class."""
        return len(self.kernels) // len(self.classes)

    def learnt(self) -> neuro.Network:
        """The network with the learnt weights."""
        net = from_text(self.network)
        net.projections[LEARNT] = replace(net.projections[LEARNT], weight=self.kernels)
        return net

    def simulation(self, backend: str = "event") -> neuro.Simulation:
        """The learnt network, ready to be shown recordings."""
        return neuro.compile(self.learnt(), backend=backend, seed=self.training["seed"])

    def save(self, path: Path) -> None:
        """Write the file; another model of that name is replaced once the new one is complete."""
        with hdf5.writing(path, FORMAT) as file:
            file.attrs["settings"] = json.dumps(self.settings.as_words())
            file.attrs["training"] = json.dumps(self.training)
            file.attrs.update(versions())
            file["network"], file["classes"] = self.network, list(self.classes)
            file["kernels"], file["history"] = self.kernels, self.history

    @classmethod
    def load(cls, path: Path) -> Model:
        """Read a file.

        Raises:
            ModelError: there is no such file, or it is something else.
        """
        with hdf5.reading(path, FORMAT) as file:
            return cls(
                Settings.from_words(json.loads(file.attrs["settings"])),
                tuple(file["classes"].asstr()[:].tolist()),
                file["network"].asstr()[()],
                file["kernels"][()],
                file["history"][()],
                json.loads(file.attrs["training"]),
            )


def network_of(settings: Settings, classes: int) -> neuro.Network:
    """The network ``remus`` for a number of classes, before learning.

    Raises:
        ModelError: a setting is no parameter of the network, or out of its bounds.
    """
    front = settings.front
    orientations, rows, columns = front.shape
    follows = {"orientations": orientations, "rows": rows, "columns": columns, "window": front.window}
    follows["resolution"] = front.resolution
    file = network_path("remus")
    net = neuro.load(file, params={**settings.network, **follows})
    assert net.trials_section is not None
    maps = net.trials_section.labels.maps_per_label * classes
    return neuro.load(file, params={**settings.network, **follows, "maps": maps})


def to_text(net: neuro.Network) -> str:
    """A network without large arrays as YAML text."""
    with tempfile.TemporaryDirectory() as folder:
        net.save(Path(folder) / "network.yaml")
        return (Path(folder) / "network.yaml").read_text("utf-8")


def from_text(text: str) -> neuro.Network:
    """The network that a YAML text describes; its parts have no places, as there is no file to look into."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "network.yaml").write_text(text, "utf-8")
        net = neuro.load(Path(folder) / "network.yaml")
    parts: tuple[dict[str, Any], ...] = (net.populations, net.projections, net.signals, net.groups, net.probes)
    for group in parts:
        group.update({name: replace(part, origin=None) for name, part in group.items()})
    net.trials_origin = None
    return net


def versions() -> dict[str, str]:
    """What a file was written with."""
    packages = {"neuro": neuro.__version__} | {name: version(name) for name in ("numpy", "numba")}
    return {"python": platform.python_version()} | packages
