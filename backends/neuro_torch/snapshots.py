"""The state of a stepper of one recording, with what it has left behind, as named arrays, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neuro.program.backend import Spikes
from neuro_torch.record import TensorRecord
from neuro_torch.stepping import Stepper
from neuro_torch.wires import Emitted

Arrays = Mapping[str, NDArray[Any]]


def take(stepper: Stepper, records: Sequence[TensorRecord]) -> dict[str, NDArray[Any]]:
    """Copies of everything that changes while it runs."""
    found: dict[str, NDArray[Any]] = {"step": np.array(stepper.now)}
    for k, cells in stepper.cells.items():
        found[f"cells/{k}"] = (
            torch.stack([state[0] for state in cells.states]).cpu().numpy() if cells.states else np.zeros(0)
        )
    for k, source in stepper.sources.items():
        found |= {f"sources/{k}/{name}": getattr(source, name).copy() for name in ("states", "steps", "ids")}
    for k, flow in stepper.flows.items():
        found |= {f"flows/{k}/{name}": getattr(flow, name).copy() for name in ("due", "held", "weights")}
    for k in range(len(records)):
        found |= {f"parameters/{k}/{word}": values.copy() for word, values in stepper.parameters(k).items()}
        found[f"sent/{k}"] = _listed(stepper.sent[k])
    for k, versions in stepper.versions.items():
        rows = [[float(since), *weights.cpu().tolist()] for since, weights in versions]
        widest = max(len(row) for row in rows)
        found[f"weights/{k}"] = np.array(
            [row if len(row) == widest else row[:1] + row[1:] * (widest - 1) for row in rows]
        )
    for k, record in enumerate(records):
        spikes = record.since(-1)
        found |= {f"records/{k}/{name}": getattr(spikes, name) for name in ("steps", "ids", "multiplicity")}
        found |= {f"records/{k}/counted_{name}": getattr(record, name).copy() for name in ("events", "spikes")}
        found[f"records/{k}/active"] = np.array(record.active)
    return found


def put(stepper: Stepper, records: Sequence[TensorRecord], arrays: Arrays) -> None:
    """Set a stepper of the same program to what `take` gave."""
    stepper.start_anew()
    stepper.now = int(arrays["step"])
    for k in range(len(records)):
        for word in stepper.parameters(k):
            stepper.parameters(k)[word] = arrays[f"parameters/{k}/{word}"].copy()
        stepper.sent[k] = _emitted(arrays[f"sent/{k}"], stepper.program.populations[k].size, stepper.device)
    for k, cells in stepper.cells.items():
        for name, values in zip(cells.names, arrays[f"cells/{k}"], strict=True):
            cells.put(name, values)
        cells.refresh()
    for k, source in stepper.sources.items():
        for name in ("states", "steps", "ids"):
            setattr(source, name, arrays[f"sources/{k}/{name}"].copy())
        source.refresh()
    for k, flow in stepper.flows.items():
        for name in ("due", "held", "weights"):
            setattr(flow, name, arrays[f"flows/{k}/{name}"].copy())
    for k in stepper.versions:
        rows = arrays[f"weights/{k}"]
        stepper.versions[k] = [(int(row[0]), torch.tensor(row[1:], device=stepper.device)) for row in rows]
    for k, record in enumerate(records):
        steps, ids, multiplicity = (arrays[f"records/{k}/{name}"] for name in ("steps", "ids", "multiplicity"))
        record.keep(Spikes(steps, ids, multiplicity))
        record.events, record.spikes = (arrays[f"records/{k}/counted_{name}"].copy() for name in ("events", "spikes"))
        record.active = int(arrays[f"records/{k}/active"])


def _listed(sent: Sequence[tuple[int, Emitted]]) -> NDArray[Any]:
    """Step, neuron and multiplicity of all spikes that are under way, shape (3, spikes)."""
    columns = [np.zeros((3, 0), dtype=np.int64)]
    for step, emitted in sent:
        of: Tensor = torch.stack([emitted.neuron, emitted.multiplicity.to(torch.int64)]).cpu()
        columns.append(np.concatenate([np.full((1, of.shape[1]), step), of.numpy()]))
    return np.concatenate(columns, axis=1)


def _emitted(listed: NDArray[Any], size: int, device: torch.device) -> list[tuple[int, Emitted]]:
    found = []
    for step in np.unique(listed[0]).tolist():
        _, ids, multiplicity = listed[:, listed[0] == step]
        spikes = torch.zeros(1, size, dtype=torch.float64, device=device)
        spikes[0, torch.from_numpy(ids).to(device)] = torch.from_numpy(multiplicity).to(torch.float64).to(device)
        found.append((step, Emitted(spikes)))
    return found
