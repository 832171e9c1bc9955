"""A training between two epochs, in a file beside the model that it is going to be.

```
/            attributes: format "neuro remus training 1", told (JSON: what the training was told)
/history     float64, (epochs,) so far
/state       uint8, the file that `Simulation.save` wrote
```
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import neuro
from neuro.apps import reading, writing

FORMAT = "neuro remus training 1"


def beside(model: Path) -> Path:
    """Where the checkpoint of a model lies."""
    return model.with_name(f"{model.name}.training")


def keep(file: Path, sim: neuro.Simulation, history: list[float], told: Mapping[str, Any]) -> None:
    """Write a checkpoint in place of the one before."""
    with tempfile.TemporaryDirectory() as folder:
        sim.save(Path(folder) / "state.h5")
        state = np.fromfile(Path(folder) / "state.h5", np.uint8)
    with writing(file, FORMAT) as f:
        f.attrs["told"] = json.dumps(told)
        f["history"] = np.array(history)
        f.create_dataset("state", data=state, compression="gzip", compression_opts=1)


def resume(file: Path, sim: neuro.Simulation, told: Mapping[str, Any]) -> list[float]:
    """Take up a training where its checkpoint left it.

    Args:
        file: the checkpoint; there may be none.
        sim: the network before learning; it is restored.
        told: what the training is told now.

    Returns:
        The history so far.

    Raises:
        ModelError: the checkpoint is of a training that was told something else, or damaged.
    """
    if not file.exists():
        return []
    with reading(file, FORMAT) as f:
        _check(file, _flat(json.loads(f.attrs["told"])), _flat(json.loads(json.dumps(told))))
        history: list[float] = f["history"][()].tolist()
        state = f["state"][()]
    with tempfile.TemporaryDirectory() as folder:
        state.tofile(Path(folder) / "state.h5")
        sim.restore(Path(folder) / "state.h5")
    return history


def _check(file: Path, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    for name in sorted(before.keys() | now.keys()):
        if before.get(name) != now.get(name):
            raise neuro.ModelError(
                f"{file}: an unfinished training with {name} = {before.get(name, 'its default')}: "
                f"found {now.get(name, 'its default')} now",
                hint="give the same options to continue it, or delete the file",
            )


def _flat(told: Mapping[str, Any]) -> dict[str, Any]:
    """Values inside of others with the names of both."""
    flat: dict[str, Any] = {}
    for name, value in told.items():
        flat |= {f"{name}.{k}": v for k, v in _flat(value).items()} if isinstance(value, dict) else {name: value}
    return flat
