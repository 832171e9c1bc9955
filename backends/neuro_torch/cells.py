"""Neurons of one population in a batch of recordings, stepped by the model's arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from neuro.core import keyed_random
from neuro.model.neurons import Neuron
from neuro.model.neurons.base import PAYLOAD
from neuro.program.program import Floats, Population, drawn_for
from neuro_torch.lanes import ALL, LaneRows, Lanes, spread
from neuro_torch.problems import reset_of
from neuro_torch.scan.layers import ScanTask
from neuro_torch.surrogates import Surrogate


class TensorCells:
    """States and parameters of a population.

    Attributes:
        states: one tensor per state, shape (batch, size).
        parameters: current values by name, on the host.
        constants: constants of the step, computed from the parameters: one number each, or a tensor of shape (size,).

    Args:
        part: the population.
        batch: number of recordings.
        resolution: length of a step in ms.
        seed: seed of neurons that fire at random.
        device: device of the tensors.
        trainable: tensors of the parameters that learn, by name, shape (1,) or (size,).
    """

    def __init__(
        self,
        part: Population,
        batch: int,
        resolution: float,
        seed: int,
        device: torch.device,
        trainable: Mapping[str, Tensor] | None = None,
    ) -> None:
        assert isinstance(part.model, Neuron)
        self.part, self.model, self.shape, self.device = part, part.model, (batch, part.size), device
        self.names = [state.name for state in part.model.states]
        self.receptors = max(2, part.model.receptors)
        self._h, self._key = resolution, keyed_random.key(seed, drawn_for(part), part.name)
        self.parameters = {word: values.copy() for word, values in part.parameters.items()}
        self._trainable = dict(trainable or {})
        self._refractory = self.names.index("refractory") if "refractory" in self.names else -1
        self.start_anew()
        self.refresh()

    def start_anew(self) -> None:
        """Return to step 0; parameters stay."""
        self.states = [self._expand(self.part.initial[name]) for name in self.names]

    def put(self, name: str, values: Floats) -> None:
        """Set a state in all recordings."""
        self.states[self.names.index(name)] = self._expand(values)

    def _expand(self, values: Floats) -> Tensor:
        return torch.tensor(np.broadcast_to(values, self.part.size), device=self.device).expand(self.shape)

    def refresh(self) -> None:
        """Compute the constants after a change of parameters."""
        if self._trainable:
            self._constants_with_gradient()
            return
        columns = constants_of(self.part, self.parameters, self._h).T
        self.constants: list[Any] = [
            float(column[0]) if bool((column == column[0]).all()) else torch.tensor(column, device=self.device)
            for column in columns
        ]

    def _constants_with_gradient(self) -> None:
        values: list[Any] = [
            self._trainable[word]
            if word in self._trainable
            else float(v[0])
            if v.size == 1
            else torch.tensor(v, device=self.device)
            for word, v in self.parameters.items()
        ]
        self.constants = [0.0] * self.model.width
        Lanes(self.device).run(self.model.arithmetic.constants, values, self._h, self.constants)

    def scale(self) -> Tensor | float:
        """Return the unit of x in surrogates.

        The unit is V_th - V_reset in mV. For graded neurons it is vth, or infinite where every change is sent.
        """
        if self.model.graded:
            vth = torch.as_tensor(self._trainable.get("vth", self.parameters.get("vth", 0.0)), device=self.device)
            unit = 2.0 ** sum(float(self.parameters.get(word, [0.0])[0]) for word in ("spike_exp", "state_exp"))
            return torch.where(vth > 0.0, vth * unit, torch.inf)
        pair = [self._trainable.get(word, self.parameters[word]) for word in ("V_th", reset_of(self.part))]
        top, bottom = (item if isinstance(item, Tensor) else torch.tensor(item, device=self.device) for item in pair)
        return top - bottom

    def step(
        self, x: Tensor | list[Tensor], current: Tensor | float, step: int, surrogate: Surrogate | None = None
    ) -> Tensor:
        """Step every neuron; return spike counts, or payloads if graded, as doubles (batch, size).

        Args:
            x: arrived input, shape (receptors, batch, size), or a list of (batch, size) tensors, one per receptor.
            current: external current in pA, a number or shape (size,).
            step: the step, from 1.
            surrogate: derivative of a spike or a payload; without one they have no gradient.
        """
        gate = self._gate(surrogate) if self.model.graded and surrogate is not None else None
        lanes, arithmetic = Lanes(self.device, gate=gate), self.model.arithmetic
        states, fired = LaneRows(self.states, self.shape), LaneRows([0.0])
        is_free = self.states[self._refractory] == 0.0 if self._refractory >= 0 else None
        uniform = keyed_random.uniform(self._key, step, np.arange(self.part.size)) if self.model.draws else None
        draws = () if uniform is None else (LaneRows([torch.tensor(uniform, device=self.device)]),)
        arriving, flowing = LaneRows(list(x)), LaneRows([current])
        lanes.run(arithmetic.step, states, self.constants, arriving, flowing, ALL, ALL, fired, *draws)
        reached = fired.rows[0]
        self.states = states.rows
        if self.model.graded:
            return self.states[self.names.index(PAYLOAD)]
        spikes = spread(reached, self.shape, self.device)
        fired_mask = spikes != 0.0
        if self.model.relay:
            spikes = x[0] * fired_mask
        elif surrogate is not None and (margin := getattr(reached, "margin", None)) is not None:
            x, is_free = margin / self.scale(), is_free if is_free is not None else torch.ones_like(fired_mask)
            apply: Any = Surrogated.apply
            spikes = apply(spikes, x, is_free, surrogate)
        if not self.model.resets_in_step and bool(fired_mask.any()):
            states = LaneRows(self.states, self.shape)
            Lanes(self.device, fired_mask).run(arithmetic.fire, states, self.constants, ALL)
            self.states = states.rows
        return spikes

    def _gate(self, surrogate: Surrogate) -> Callable[[Tensor], Tensor]:
        unit = self.scale()
        return lambda margin: surrogate.derivative(margin / unit) / unit


def constants_of(part: Population, parameters: dict[str, Floats], resolution: float) -> Floats:
    """Return the constants of the neurons, shape (size, width), or (1, width) if all neurons have the same."""
    model = part.model
    size = max((values.size for values in parameters.values()), default=1)
    values = [np.broadcast_to(array, size) for array in parameters.values()]
    rows, row_of_neuron = (
        np.unique(np.stack(values, axis=1), axis=0, return_inverse=True)
        if values
        else (np.zeros((1, 0)), np.zeros(1, int))
    )
    constants_by_row: Floats = np.zeros((len(rows), model.width))
    for row, constants in zip(rows, constants_by_row, strict=True):
        model.arithmetic.constants(row.tolist(), resolution, constants)  # type: ignore[attr-defined]
    per_neuron: Floats = constants_by_row[row_of_neuron.reshape(-1)]
    return per_neuron


class Surrogated(torch.autograd.Function):
    """The identity on spikes, with the derivative of a surrogate."""

    @staticmethod
    def forward(ctx, spikes, x, free, surrogate):  # type: ignore[no-untyped-def]
        """Return the spikes; `x` is the distance above threshold, `free` marks neurons that are not refractory."""
        ctx.surrogate = surrogate
        ctx.save_for_backward(x, free)
        return spikes.clone()

    @staticmethod
    def backward(ctx, g):  # type: ignore[no-untyped-def]
        """Return the gradient of `x`."""
        x, is_free = ctx.saved_tensors
        return None, g * ctx.surrogate.derivative(x) * is_free, None, None


def graded_payloads(part: Population, drive: Tensor, task: ScanTask, resolution: float) -> Tensor:
    """Return the payloads that a population sends, (batch, steps, neurons).

    Args:
        part: the population, of a model without random draws.
        drive: input of the population, of the same shape.
        task: sizes, dtype and device of the pass.
        resolution: length of a step in ms.
    """
    cells = TensorCells(part, task.batch, resolution, 0, task.device)
    no_input = torch.zeros_like(drive[:, 0], dtype=torch.float64)
    payloads = [cells.step([x.double(), no_input], 0.0, t, task.surrogate) for t, x in enumerate(drive.unbind(1), 1)]
    return torch.stack(payloads, 1).to(task.dtype)


def graded_messages(part: Population, payloads: Tensor, surrogate: Surrogate) -> Tensor:
    """Return 1 where a payload is sent, else 0. To send fewer messages, descent makes payloads smaller.

    Args:
        part: the population.
        payloads: payloads of each step, (batch, steps, neurons).
        surrogate: derivative at the threshold.
    """
    p: Any = part.parameters
    smallest = p.get("vth", 0.0) * 2.0 ** p.get("spike_exp", 0.0)
    threshold = torch.as_tensor(smallest, dtype=payloads.dtype, device=payloads.device)
    messages: Tensor = _Messages.apply(payloads, threshold, surrogate)  # type: ignore[no-untyped-call]
    return messages


class _Messages(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, payloads: Tensor, threshold: Tensor, surrogate: Surrogate) -> Tensor:
        ctx.save_for_backward(payloads, threshold)
        ctx.surrogate = surrogate
        return (payloads != 0).to(payloads.dtype)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        payloads, threshold = ctx.saved_tensors
        x = (payloads.abs() - threshold) / threshold
        lowered = grads[0] * payloads.sign() * ctx.surrogate.derivative(x) / threshold
        return torch.where((payloads != 0) & (threshold > 0), lowered, 0.0), None, None
