"""File format of an agent (HDF5).

```
/            attributes: format "neuro agent 1", seed, kind, settings, observations and actions (JSON)
/learnt      weights by projection, mV, (places, neurons)
/scales      scale of rewards (factor, first); middle and spread of each dimension of observations; visits of places
/seen        observations of the last control steps
/log         returns, lengths and steps of the episodes of the last training; solved: 1, 0, or -1 without a goal
```
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import gymnasium
import numpy as np
from gymnasium import spaces

from neuro import ModelError
from neuro.apps import Log, hdf5, provenance, record_input

if TYPE_CHECKING:
    from neuro_agent.learner import Learner

A = TypeVar("A", bound="Learner")
FORMAT = "neuro agent 1"


def save(agent: Learner, path: Path) -> None:
    """Write an agent, see `ActorCritic.save`."""
    with hdf5.writing(path, FORMAT, record=provenance(seed=agent.seed)) as file:
        file.attrs["seed"] = agent.seed
        for name, value in plain_of(agent).items():
            file.attrs[name] = json.dumps(value)
        for name, part in _arrays_of(agent).items():
            hdf5.put(file, name, part)
        hdf5.put(file, "log", agent.log.arrays())


def load(path: Path, kind: type[A]) -> A:
    """Read an agent, see `ActorCritic.load`."""
    with hdf5.reading(path, FORMAT) as file:
        record_input(path)
        kind_name = json.loads(file.attrs.get("kind", '"spiking"'))
        if kind_name != kind.kind:
            raise ModelError(f"{path}: an agent of kind '{kind_name}': expected '{kind.kind}', as {kind.__name__} is")
        observations, actions, settings = (
            json.loads(file.attrs[name]) for name in ("observations", "actions", "settings")
        )
        agent = kind(space_of(observations), space_of(actions), seed=int(file.attrs["seed"]), **settings)
        _put_arrays(agent, {name: hdf5.take(file, name) for name in ("learnt", "scales", "seen")})
        agent.log = Log.of(hdf5.take(file, "log"))
    return agent


def plain_of(agent: Learner) -> dict[str, Any]:
    """Return the kind, settings and spaces of an agent as plain data."""
    return {
        "kind": agent.kind,
        "settings": agent.settings.plain(),
        "observations": plain_space(agent.observations),
        "actions": plain_space(agent.actions.space),
    }


def _arrays_of(agent: Learner) -> dict[str, dict[str, Any]]:
    """Return what an agent has learnt, as arrays of its file."""
    bounds, teacher = (agent.arrays()[name] for name in ("encoder.places", "teacher.error"))
    *rewards, has_scale = teacher["scale"]
    counts = {"explored": np.array([agent.explored, has_scale], dtype=np.bool_), "begun": np.array(agent.begun)}
    visits = {"visits": teacher["visits"]} if "visits" in teacher else {}
    scales = {"rewards": np.array(rewards), **bounds, **counts, **visits}
    return {"learnt": agent.weights, "scales": scales, "seen": {"vectors": agent.last_vectors}}


def _put_arrays(agent: Learner, arrays: dict[str, dict[str, Any]]) -> None:
    """Restore what an agent has learnt from `_arrays_of`."""
    scales = arrays["scales"]
    agent.explored, has_scale = (bool(flag) for flag in scales["explored"])
    agent.begun = (int(scales["begun"][0]), int(scales["begun"][1]))
    teacher = {"scale": np.array([*scales["rewards"], has_scale]), "visits": scales.get("visits")}
    agent.put({**arrays, "encoder.places": scales, "teacher.error": teacher})


def plain_space(space: gymnasium.Space[Any]) -> dict[str, Any]:
    """Return a space as plain data."""
    match space:
        case spaces.Discrete():
            return {"Discrete": int(space.n), "start": int(space.start), "dtype": str(space.dtype)}
        case spaces.MultiDiscrete():
            return {"MultiDiscrete": space.nvec.tolist(), "start": space.start.tolist(), "dtype": str(space.dtype)}
        case spaces.MultiBinary():
            return {"MultiBinary": space.n if isinstance(space.n, int) else list(space.shape)}
        case spaces.Box():
            return {"Box": [space.low.tolist(), space.high.tolist()], "dtype": str(space.dtype)}
        case spaces.Dict():
            return {"Dict": {key: plain_space(part) for key, part in space.spaces.items()}}
        case spaces.Tuple():
            return {"Tuple": [plain_space(part) for part in space.spaces]}
    raise ModelError(f"space: found {type(space).__name__}: expected one that agents support")


def space_of(plain: dict[str, Any]) -> gymnasium.Space[Any]:
    """Return the space of plain data."""
    kind, value = next(iter(plain.items()))
    dtype: Any = np.dtype(plain["dtype"]).type if "dtype" in plain else None
    match kind:
        case "Discrete":
            return spaces.Discrete(value, start=plain["start"], dtype=dtype)
        case "MultiDiscrete":
            return spaces.MultiDiscrete(np.array(value), dtype=dtype, start=np.array(plain["start"]))
        case "MultiBinary":
            return spaces.MultiBinary(value)
        case "Box":
            return spaces.Box(np.array(value[0], dtype=dtype), np.array(value[1], dtype=dtype), dtype=dtype)
        case "Dict":
            return spaces.Dict({key: space_of(part) for key, part in value.items()})
        case "Tuple":
            return spaces.Tuple([space_of(part) for part in value])
    raise ModelError(f"a space of kind {kind}: expected one that agents support")
