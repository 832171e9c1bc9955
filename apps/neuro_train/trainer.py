"""The training: epochs of batches, with checkpoints beside the output file, so that a kill costs little.

The random numbers of an epoch depend on the seed and the epoch only, and the learning rate on the step only. On one
thread, a training that resumes after a kill is therefore bit-identical.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

import neuro
import neuro_torch
from neuro import ModelError
from neuro.apps import Checkpoint, fingerprint
from neuro_train.data import BatchData, moved, probe
from neuro_train.plan import TrainingPlan

Array = npt.NDArray[Any]

FORMAT = "neuro training by gradients 1"
KEEP_S = 2.0
"""Shortest time between two checkpoints, s."""

WAYS = {
    "data": "the recordings are not those of the checkpoint: give those with which the training began to continue it",
    "network": "the network is not that of the checkpoint: give the one with which the training began to continue it",
}
"""Hints for the settings that a checkpoint stores as a hash only, if the hash differs."""

PATIENCE = 10
"""Number of successive epochs without output spikes after which a training warns."""

CURVES = ("loss", "right", "joules", "rate")
"""Figures of each epoch: mean loss, share of right decisions, joules of a recording, learning rate.

For regression, "right" is R2, the explained share of the targets' variance; NaN if the targets are constant.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Trained:
    """Result of a training.

    Attributes:
        net: the trained network.
        module: the trained module.
        curves: a value for each epoch, by name of `CURVES`.
        cpu_s: processor seconds, including those before a kill.
        rates: largest learning rate of the weights by projection, in their unit.
    """

    net: neuro.Network
    module: neuro_torch.Module
    curves: Mapping[str, npt.NDArray[np.float64]]
    cpu_s: float
    rates: Mapping[str, float]


def module_of(net: neuro.Network, plan: TrainingPlan, outputs: Sequence[str] | None = None) -> neuro_torch.Module:
    """Return the network as a module on the device of the plan.

    Args:
        net: the network.
        plan: the settings of the training.
        outputs: populations whose spikes are returned; by default the output of the plan.

    Raises:
        ModelError: the network cannot learn by gradients, or there is no such device.
    """
    try:
        torch.zeros(1, device=torch.device(plan.device)).cpu()
    except (RuntimeError, AssertionError, NotImplementedError):
        devices = ", ".join(["cpu", *(f"cuda:{k}" for k in range(torch.cuda.device_count()))])
        message = f"--device {plan.device}: torch has no such device here: expected one of {devices}"
        raise ModelError(message) from None
    currents = {name for name, part in net.populations.items() if part.model.role == "current"}
    spiking_projections = (name for name, part in net.projections.items() if part.source not in currents)
    module = neuro_torch.Module(
        net,
        plan.learns or dict.fromkeys(spiking_projections, ("weight",)),
        surrogate=plan.surrogate,
        slope=plan.slope,
        duration=plan.duration,
        outputs=outputs or [plan.output],
        seed=plan.seed,
    )
    module.to(torch.device(plan.device))
    return module


def sizes(module: neuro_torch.Module) -> dict[str, float]:
    """Return the size of the weights of each projection as a power of ten: 1 for weights of about 0.1 in their unit.

    The learning rate holds for weights of about 0.1 and is multiplied by this size, so that weights in pA learn like
    those in mV.
    """
    powers = {}
    for name, weight in module.weights.items():
        mean = float(weight.detach().double().square().mean().sqrt())
        powers[name] = 10.0 ** math.trunc(math.log10(mean / 0.1)) if mean > 0.0 else 1.0
    return powers


def training_checkpoint(
    net: neuro.Network, out: Path, samples: BatchData, plan: TrainingPlan, which: str = ""
) -> Checkpoint:
    """Return the checkpoint of a training.

    Args:
        net: the untrained network.
        out: file of the trained network.
        samples: recordings to learn from.
        plan: settings of the training.
        which: name of the part of the recordings; "" for all.
    """
    settings = identity(net, samples, plan) | {"recordings": len(samples), "part": which}
    return Checkpoint(out, FORMAT, settings, WAYS)


def identity(net: neuro.Network, samples: BatchData, plan: TrainingPlan) -> dict[str, Any]:
    """Return all values that decide the result of a training, as plain data."""
    return plan.as_words() | {"network": fingerprint(module_of(net, plan).program), "data": samples.digest}


def learn(
    net: neuro.Network,
    samples: BatchData,
    plan: TrainingPlan,
    checkpoint: Checkpoint | None = None,
    report: Callable[[int, Mapping[str, float]], None] = lambda epoch, figures: None,
) -> Trained:
    """Train a network, or resume the training of a checkpoint.

    Args:
        net: the network; it is not changed.
        samples: recordings to learn from.
        plan: the settings of the training.
        checkpoint: checkpoint of the training; by default none.
        report: called with the number of finished epochs, and the figures of the last epoch.

    Raises:
        ModelError: the network cannot be trained with these settings, the loss does not fit the targets, the loss or a
            learning parameter became NaN or infinite, or the checkpoint belongs to another training.
    """
    training = _Training(net, samples, plan, "" if checkpoint is None else f" in {checkpoint.path}")
    arrays = {} if checkpoint is None else checkpoint.resume()
    if arrays:
        training.restore(arrays)
        report(training.done, training.last())
    saved_at = time.monotonic()
    while training.done < plan.epochs:
        state_before = training.state()
        try:
            training.epoch()
        except (ModelError, KeyboardInterrupt):
            if checkpoint is not None and training.done:
                checkpoint.keep(**state_before)
            raise
        training.warn_of_silence()
        report(training.done, training.last())
        if checkpoint is not None and time.monotonic() - saved_at > KEEP_S:
            checkpoint.keep(**training.state())
            saved_at = time.monotonic()
    return training.trained()


class _Training:
    """State of a running training."""

    def __init__(self, net: neuro.Network, samples: BatchData, plan: TrainingPlan, place: str) -> None:
        self._samples, self._plan, self._net, self._place = samples, plan, net, place
        self.done, self._cpu_s = 0, 0.0  # finished epochs, and their processor time in s
        self._remaining: dict[str, Array] = {}
        self._curves: dict[str, list[float]] = {name: [] for name in CURVES}
        self._labels, self._batches = torch.from_numpy(samples.labels), math.ceil(len(samples) / plan.batch)
        self._variance = _variance(samples, plan)
        self._silent_epochs = 0
        self._has_warned = plan.loss not in ("count", "first_spike")  # other losses need no spikes
        module = module_of(net, plan)
        self._sizes = sizes(module)
        self._use_module(module)

    def _use_module(self, module: neuro_torch.Module) -> None:
        """Replace the module, and make its bills and the optimiser."""
        plan = self._plan
        self._module = module if plan.bits is None else neuro_torch.quantised(module, plan.bits, plan.chip)
        self._bills = {
            chip: neuro_torch.Bill(self._module, chip, neurons_per_core=plan.neurons_per_core) for chip in plan.cost
        }
        # Weights that are `size` times as large have gradients `size` times as small, so their steps must be larger.
        weights: dict[float, list[Tensor]] = {}
        for name, weight in self._module.weights.tensors().items():
            weights.setdefault(self._sizes[name], []).append(weight)
        groups: list[dict[str, Any]] = [
            {"params": parameters, "size": size, "weight_decay": plan.decay / size, "eps": 1e-8 / size}
            for size, parameters in weights.items()
        ]
        undecayed_parameters = [*self._module.delays.parameters(), *self._module.neurons.parameters()]
        if undecayed_parameters:  # delays and parameters of neurons do not decay
            groups.append({"params": undecayed_parameters, "size": 1.0, "weight_decay": 0.0})
        self._optimiser = torch.optim.AdamW(groups, lr=plan.rate, fused=True)

    def epoch(self) -> None:
        """Show every recording once.

        Raises:
            ModelError: the loss or a learning parameter is NaN.
        """
        plan, began = self._plan, time.process_time()
        if plan.prune and self.done == (plan.epochs + 1) // 2:
            self._prune()
        rng = np.random.default_rng((plan.seed, self.done))
        order = rng.permutation(len(self._samples))
        self._module.train()
        self._silent_epochs += 1
        sums, recordings = dict.fromkeys(CURVES, 0.0), 0
        for k in range(self._batches):
            indices = order[k * plan.batch : (k + 1) * plan.batch]
            if self._variance is not None and bool(self._labels[torch.from_numpy(indices)].isnan().all()):
                continue  # these recordings have no targets
            recordings += len(indices)
            for name, value in self._batch(indices, k, rng).items():
                sums[name] += value * len(indices)
        for name, value in sums.items():
            self._curves[name].append(value / recordings)
        self.done += 1
        self._cpu_s += time.process_time() - began

    def _batch(self, indices: npt.NDArray[np.int64], k: int, rng: np.random.Generator) -> dict[str, float]:
        """Take one step of learning; return its figures."""
        plan, labels = self._plan, self._labels[torch.from_numpy(indices)].to(self._plan.device)
        events = self._samples.events[indices.tolist()]
        if plan.shift or plan.warp or plan.mirror:
            events = moved(events, plan.input, self._samples.shape, plan.shift, plan.warp, rng, plan.mirror)
        # the rate rises in the first three tenths, then falls to nothing, along cosines (Smith, arXiv:1803.09820)
        share, top = (self.done * self._batches + k) / max(1, plan.epochs * self._batches), 0.3
        phase = share / top if share < top else (share - top) / (1.0 - top)
        low, high = (0.04, 1.0) if share < top else (1.0, 1e-5)
        rate = plan.rate * (high + (low - high) * 0.5 * (1.0 + math.cos(math.pi * phase)))
        for group in self._optimiser.param_groups:
            group["lr"] = rate * group["size"]
        activity = self._module(events)
        losses, spikes, scale = neuro_torch.losses, activity.spikes[plan.output], 1.0 / plan.temperature
        if plan.loss == "count":
            loss = losses.count_cross_entropy(spikes, labels, scale=scale)
        elif plan.loss == "potential":
            loss = losses.potential_cross_entropy(activity.V_m[plan.output], labels, scale=scale)
        elif plan.loss == "mse":
            loss = losses.potential_mse(activity.V_m[plan.output], labels)
        else:
            loss = losses.first_spike(spikes, labels, tau=plan.temperature * activity.step, resolution=activity.step)
        if self._variance is None:
            accuracy = float((losses.decisions(spikes.detach()) == labels).double().mean())
        else:
            accuracy = 1.0 - float(loss.detach()) / self._variance if self._variance > 0.0 else math.nan
        if self._silent_epochs and bool(spikes.detach().any()):
            self._silent_epochs = 0
        joules = {chip: bill(activity) for chip, bill in self._bills.items()}
        for chip, energy in joules.items():
            loss = loss + plan.cost[chip] * 1e6 * energy.to(loss.dtype)
        if not math.isfinite(float(loss.detach())):
            self._stop(k, f"the loss is {float(loss.detach())}: expected a number")
        self._optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self._optimiser.step()
        try:
            self._module.hold()  # learning parameters stay within their bounds
        except ModelError as error:
            self._stop(k, error.message)
        joules_of_chip = next(iter(joules.values()), torch.zeros(()))
        figures = (float(loss.detach()), accuracy, float(joules_of_chip.detach()), rate)
        return dict(zip(CURVES, figures, strict=True))

    def _stop(self, batch: int, message: str) -> NoReturn:
        place = f"epoch {self.done + 1}, batch {batch + 1} of {self._batches}"
        is_saved = self.done and self._place
        note = f"; what was learnt until the end of epoch {self.done} is kept{self._place}" if is_saved else ""
        hint = "lower --rate or --cost" + (", with another --out" if is_saved else "")
        raise ModelError(f"{place}: {message}{note}", hint=hint)

    def warn_of_silence(self) -> None:
        """Warn once of output neurons that stay silent for `PATIENCE` epochs, or in the last epoch.

        A network may be silent at first: surrogate gradients raise the weights until neurons fire.
        """
        if self._has_warned or not self._silent_epochs:
            return
        if self._silent_epochs < PATIENCE and self.done < self._plan.epochs:
            return
        self._has_warned = True
        first = self.done - self._silent_epochs + 1
        epochs = f"epoch {self.done}" if first == self.done else f"epochs {first} to {self.done}"
        message = f"population '{self._plan.output}': no neuron fired in {epochs}, so no recording is decided"
        if reason := why_silent(self._module.network(), self._samples, self._plan):
            message += f": {reason}"
        warnings.warn(message, neuro.ModelWarning, stacklevel=3)

    def _prune(self, stay: Mapping[str, Array] | None = None) -> None:
        """Remove the smallest weights, or all weights outside the masks `stay`. The rest gets a new optimiser."""
        self._remaining = dict(stay) if stay else neuro_torch.largest(self._module, 1.0 - self._plan.prune)
        self._use_module(neuro_torch.prune(self._module, stay=self._remaining))

    def last(self) -> dict[str, float]:
        """Return the figures of the last epoch."""
        return {name: values[-1] for name, values in self._curves.items() if values}

    def state(self) -> dict[str, Array | dict[str, Array]]:
        """Return the state from which `restore` continues, as arrays."""
        steps = self._optimiser.state_dict()["state"]
        moments = {f"{k}.{word}": _array(value) for k, part in steps.items() for word, value in part.items()}
        parts: dict[str, Array | dict[str, Array]] = {
            "progress": np.array([self.done, self._cpu_s]),
            "curves": {name: np.array(values) for name, values in self._curves.items()},
            "weights": {name: _array(value) for name, value in self._module.state_dict().items()},
        }
        if moments:
            parts["moments"] = moments
        if self._remaining:
            parts["stay"] = self._remaining
        return parts

    def restore(self, arrays: Mapping[str, Any]) -> None:
        """Restore the result of `state`."""
        self.done, self._cpu_s = int(arrays["progress"][0]), float(arrays["progress"][1])
        self._curves = {name: arrays["curves"][name].tolist() for name in CURVES}
        if "stay" in arrays:
            self._prune(arrays["stay"])
        weights = {name: torch.from_numpy(np.asarray(value)) for name, value in arrays["weights"].items()}
        self._module.load_state_dict(weights)
        state: dict[int, dict[str, Tensor]] = {}
        for name, value in arrays.get("moments", {}).items():
            k, _, word = name.partition(".")
            state.setdefault(int(k), {})[word] = torch.from_numpy(np.asarray(value))
        groups = self._optimiser.state_dict()["param_groups"]
        self._optimiser.load_state_dict({"state": state, "param_groups": groups})

    def trained(self) -> Trained:
        """Return the result of the training."""
        module = self._module.eval()
        with torch.no_grad():  # the grid of a chip is chosen for the last weights
            module(self._samples.events[[0]])
        curves = {name: np.array(values) for name, values in self._curves.items()}
        rates = {name: self._plan.rate * size for name, size in self._sizes.items()}
        net, output = module.network(), self._plan.output
        if self._variance is None:
            net.readout(**self._plan.readout(self._samples.classes))
        elif probe(output) not in net.probes:
            net.probe(probe(output), output, "V_m", every=net.resolution)
        return Trained(net, module, curves, self._cpu_s, rates)


def why_silent(net: neuro.Network, samples: BatchData, plan: TrainingPlan) -> str:
    """Return the doctor's reason for a silent output in the recording with most spikes; "" if it finds no reason."""
    train = samples.events.trains[plan.input]
    fullest_train = train.of([int(np.argmax(np.diff(train.ends)))])
    times = (fullest_train.step + 1.0) * net.resolution
    pixels = neuro.spike_train(spikes=np.stack([times, fullest_train.neuron.astype(np.float64)], axis=1))
    net.populations[plan.input] = replace(net.populations[plan.input], model=pixels)
    diagnosis = neuro.doctor(net, (samples.events.steps + 1) * net.resolution)
    reasons = [finding for finding in diagnosis.faults if plan.output in finding.what] or list(diagnosis.faults)
    return f"{reasons[0].evidence}; {reasons[0].remedy}" if reasons else ""


def _variance(samples: BatchData, plan: TrainingPlan) -> float | None:
    """Return the variance of targets; None for labels.

    Raises:
        ModelError: the loss does not fit labels or targets.
    """
    targets = samples.labels.ndim != 1
    if targets != (plan.loss == "mse"):
        expected = "labels of classes" if targets else "targets, (recordings, steps, neurons)"
        kind = "targets" if targets else "labels of classes"
        raise ModelError(f"loss {plan.loss}: found {kind}: expected {expected}", hint="use mse for targets only")
    return samples.variance if targets else None


def _array(value: Any) -> Array:
    return value.detach().cpu().numpy().copy() if isinstance(value, Tensor) else np.asarray(value)
