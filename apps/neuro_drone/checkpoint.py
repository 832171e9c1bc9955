"""A training between two episodes, in a file beside the model that it is going to be.

```
/            attributes: format "neuro drone training 1", told (JSON: what the training was told)
/state       arrays, all that the controller needs to go on
/history     arrays, one value an episode so far
```
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy.typing as npt

import neuro
from neuro.apps import reading, writing
from neuro_drone.controllers import Learner
from neuro_drone.model import put, take

__all__ = ["beside", "keep", "resume"]

FORMAT = "neuro drone training 1"


def beside(model: Path) -> Path:
    """Where the checkpoint of a model lies."""
    return model.with_name(f"{model.name}.training")


def keep(file: Path, learner: Learner, history: Mapping[str, npt.NDArray[Any]], told: Mapping[str, Any]) -> None:
    """Write a checkpoint in place of the one before."""
    with writing(file, FORMAT) as f:
        f.attrs["told"] = json.dumps(told)
        put(f, "state", learner.state())
        put(f, "history", history)


def resume(file: Path, learner: Learner, told: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]]:
    """Take up a training where its checkpoint left it.

    Args:
        file: the checkpoint; there may be none.
        learner: the controller before learning; it is restored.
        told: what the training is told now.

    Returns:
        The history so far, empty if there is none.

    Raises:
        ModelError: the checkpoint is of a training that was told something else, or damaged.
    """
    if not file.exists():
        return {}
    with reading(file, FORMAT) as f:
        before, now = json.loads(f.attrs["told"]), json.loads(json.dumps(told))
        state, history = take(f, "state"), take(f, "history")
    for name in sorted(before.keys() | now.keys()):
        if before.get(name) != now.get(name):
            raise neuro.ModelError(
                f"{file}: an unfinished training with another {name}: {before.get(name)}: found {now.get(name)} now",
                hint="give the same options to continue it, or delete the file",
            )
    learner.restore(state)
    return history
