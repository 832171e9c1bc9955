"""Regression: recordings with targets, which the potentials of the output follow step by step."""

from __future__ import annotations

import hashlib
import io
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

import neuro
from neuro import ModelError
from neuro.apps import record_input
from neuro_train.data import BatchData
from neuro_train.plan import TrainingPlan

Array = npt.NDArray[Any]
LARGEST = 1e15
"""mV; the square of a larger error is not a number of float32."""
HINT = "numpy.savez(path, spikes=..., targets=...)"


def read(path: Path, net: neuro.Network, plan: TrainingPlan) -> BatchData:
    """Recordings with targets of a ``.npz``.

    Its `spikes` are 0 or 1, (recordings, steps, neurons of the input), also with the axes of its shape; its `targets`
    are the potentials wanted of the output at the end of each step in mV, (recordings, steps, neurons), NaN where
    nothing is asked.

    Raises:
        ModelError: the file cannot be read, lacks one of these, or they do not fit the network.
    """
    from neuro_torch import Events

    record_input(path)
    try:
        content = path.read_bytes()
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            spikes, targets = file["spikes"], np.asarray(file["targets"], dtype=np.float64)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror or error}", hint=HINT) from None
    except (ValueError, TypeError, AttributeError, EOFError, BadZipFile):
        raise ModelError(f"{path}: is no .npz: expected one of spikes and targets", hint=HINT) from None
    except KeyError as error:
        raise ModelError(f"{path}: {error.args[0]}: expected spikes and targets", hint=HINT) from None
    inward, outward = (tuple(int(side) for side in net.populations[name].shape) for name in (plan.input, plan.output))
    sizes = int(np.prod(inward)), int(np.prod(outward))
    for name, found, size in (("spikes", spikes, sizes[0]), ("targets", targets, sizes[1])):
        if found.ndim >= 2 and not len(found):
            raise ModelError(f"{path}: {name}: found no recording: expected at least one", hint=HINT)
        if found.ndim < 3 or not found.shape[1] or found[0, 0].size != size or found.shape[:2] != spikes.shape[:2]:
            expected = f"(recordings, steps, {size}), as many of both"
            raise ModelError(f"{path}: {name}: found the shape {found.shape}: expected {expected}", hint=HINT)
    if (large := np.abs(targets) > LARGEST).any():
        recording, step = np.argwhere(large)[0][:2]
        message = f"{path}: targets: recording {recording}, step {step}: found {targets[large][0]:g}"
        raise ModelError(f"{message}: expected at most {LARGEST:g} mV, or NaN where nothing is asked", hint=HINT)
    if np.isnan(targets).all():
        raise ModelError(f"{path}: targets: all are NaN, so nothing is asked: expected some numbers in mV", hint=HINT)
    if not spikes.any():
        raise ModelError(f"{path}: spikes: all are 0: expected a recording with an event", hint=HINT)
    events = Events.of_dense({plan.input: spikes.reshape(*spikes.shape[:2], -1)})
    digest = hashlib.sha256(content).hexdigest()[:32]
    wanted = targets.astype(np.float32).reshape(*targets.shape[:2], -1)
    return BatchData(events, wanted, (), inward, digest)


def probe(output: str) -> str:
    """The name of the probe of what a trained network says."""
    return f"{output}_V_m"


def r_squared(said: Array, wanted: Array) -> float:
    """Return R2, the explained share of the targets' variance, as the mean over the neurons whose targets vary.

    1 is all of it; the mean of the targets alone has 0. NaN if no neuron's targets vary.

    Args:
        said: (..., neurons).
        wanted: likewise; NaN where nothing is asked.
    """
    wanted = np.asarray(wanted, dtype=np.float64)
    but = tuple(range(wanted.ndim - 1))
    asked = ~np.isnan(wanted).all(axis=but)
    said, wanted = np.asarray(said)[..., asked], wanted[..., asked]
    varies = np.nanmin(wanted, axis=but) < np.nanmax(wanted, axis=but)
    said, wanted = said[..., varies], wanted[..., varies]
    if not wanted.size:
        return float("nan")
    return float(np.mean(1.0 - np.nanmean((said - wanted) ** 2, axis=but) / np.nanvar(wanted, axis=but)))


def r_squared_text(value: float) -> str:
    """Return R2 with three digits, or why there is none."""
    return "no R2 (constant targets)" if np.isnan(value) else f"R2 {value:.3f}"
