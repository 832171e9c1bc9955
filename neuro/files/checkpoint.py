"""A training under way, in a file beside the model that it is going to be.

```
/            attributes: format, settings (JSON: the settings of the training)
/NAME        an array, or a group of arrays
```
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy.typing as npt

from neuro.core.errors import ModelError
from neuro.core.hdf5 import put, reading, take, writing

__all__ = ["Checkpoint"]

_ANEW = "delete the file to begin anew"

Array: TypeAlias = npt.NDArray[Any]


class Checkpoint:
    """What a training needs to go on after a kill.

    Args:
        model: file of the model; the checkpoint lies beside it.
        format: of the checkpoint, e.g. "neuro drone training 1".
        settings: of the training, as plain data; only a training with the same settings continues.
        ways: by name of a setting: what to do where it differs.

    Attributes:
        path: where it lies.
    """

    def __init__(
        self, model: Path, format: str, settings: Mapping[str, Any], ways: Mapping[str, str] | None = None
    ) -> None:
        self.path = model.with_name(f"{model.name}.training")
        self._format, self._settings, self._ways = format, json.dumps(settings), ways or {}

    def keep(self, **parts: Array | Mapping[str, Array]) -> None:
        """Write arrays, and groups of arrays, in place of those before.

        Raises:
            Unwritable: the file cannot be written.
        """
        with writing(self.path, self._format) as file:
            file.attrs["settings"] = self._settings
            for name, part in parts.items():
                put(file, name, part)

    def resume(self) -> dict[str, Any]:
        """What `keep` wrote last, empty if there is none.

        Raises:
            ModelError: it is of a training that has other settings, or damaged.
        """
        if not self.path.exists():
            return {}
        with reading(self.path, self._format, _ANEW) as file:
            parts = {name: take(file, name) for name in file}
            before, now = _flat(json.loads(str(file.attrs["settings"]))), _flat(json.loads(self._settings))
        for name in sorted(before.keys() | now.keys()):
            if before.get(name) != now.get(name):
                raise ModelError(
                    f"{self.path}: an unfinished training with {name} = {before.get(name, 'its default')}: "
                    f"found {now.get(name, 'its default')} now",
                    hint=f"{self._ways.get(name, 'give the same options to continue it')}, or delete the file",
                )
        return parts

    def remove(self) -> None:
        """The training is done."""
        self.path.unlink(missing_ok=True)


def _flat(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Values inside of others with the names of both."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        flat |= {f"{name}.{k}": v for k, v in _flat(value).items()} if isinstance(value, Mapping) else {name: value}
    return flat
