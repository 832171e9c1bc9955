"""The neurons of one population for a batch of recordings, stepped by the arithmetic of their model."""

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
        states: a tensor each, shape (batch, size).
        parameters: by word, as they are now, on the host.
        constants: what follows from them: a number that all neurons share, or a tensor of one each.

    Args:
        part: the population.
        batch: recordings.
        resolution: length of a step in ms.
        seed: of the draws of neurons that fire at random.
        device: where its tensors are.
        learnt: parameters that are tensors, with a gradient, by word; shape (1,) or (size,).
    """

    def __init__(
        self,
        part: Population,
        batch: int,
        resolution: float,
        seed: int,
        device: torch.device,
        learnt: Mapping[str, Tensor] | None = None,
    ) -> None:
        assert isinstance(part.model, Neuron)
        self.part, self.model, self.shape, self.device = part, part.model, (batch, part.size), device
        self.names = [state.name for state in part.model.states]
        self.receptors = max(2, part.model.receptors)
        self._h, self._key = resolution, keyed_random.key(seed, drawn_for(part), part.name)
        self.parameters = {word: values.copy() for word, values in part.parameters.items()}
        self._learnt = dict(learnt or {})
        self._held = self.names.index("refractory") if "refractory" in self.names else -1
        self.start_anew()
        self.refresh()

    def start_anew(self) -> None:
        """As at step 0; parameters stay."""
        self.states = [self._whole(self.part.initial[name]) for name in self.names]

    def put(self, name: str, values: Floats) -> None:
        """Set a state of all recordings."""
        self.states[self.names.index(name)] = self._whole(values)

    def _whole(self, values: Floats) -> Tensor:
        return torch.tensor(np.broadcast_to(values, self.part.size), device=self.device).expand(self.shape)

    def refresh(self) -> None:
        """Work out the constants after a change of parameters."""
        if self._learnt:
            self._constants_with_gradient()
            return
        columns = constants_of(self.part, self.parameters, self._h).T
        self.constants: list[Any] = [
            float(column[0]) if bool((column == column[0]).all()) else torch.tensor(column, device=self.device)
            for column in columns
        ]

    def _constants_with_gradient(self) -> None:
        values: list[Any] = [
            self._learnt[word]
            if word in self._learnt
            else float(v[0])
            if v.size == 1
            else torch.tensor(v, device=self.device)
            for word, v in self.parameters.items()
        ]
        self.constants = [0.0] * self.model.width
        Lanes(self.device).run(self.model.arithmetic.constants, values, self._h, self.constants)

    def scale(self) -> Tensor | float:
        """The unit of surrogates: V_th - V_reset in mV, of graded neurons vth; infinite where every change is sent."""
        if self.model.graded:
            vth = torch.as_tensor(self._learnt.get("vth", self.parameters.get("vth", 0.0)), device=self.device)
            unit = 2.0 ** sum(float(self.parameters.get(word, [0.0])[0]) for word in ("spike_exp", "state_exp"))
            return torch.where(vth > 0.0, vth * unit, torch.inf)
        both = [self._learnt.get(word, self.parameters[word]) for word in ("V_th", reset_of(self.part))]
        top, bottom = (each if isinstance(each, Tensor) else torch.tensor(each, device=self.device) for each in both)
        return top - bottom

    def step(
        self, x: Tensor | list[Tensor], current: Tensor | float, step: int, surrogate: Surrogate | None = None
    ) -> Tensor:
        """Step every neuron; return how often each spiked, of graded neurons the payloads, as doubles.

        Args:
            x: arrived input, shape (receptors, batch, size), or one of (batch, size) for each receptor.
            current: external, in pA; a number or shape (size,).
            step: which it is.
            surrogate: stands in for the derivative of what fired or is sent; without one that has no gradient.
        """
        gate = self._gate(surrogate) if self.model.graded and surrogate is not None else None
        lanes, arithmetic = Lanes(self.device, gate=gate), self.model.arithmetic
        states, fired = LaneRows(self.states, self.shape), LaneRows([0.0])
        free = self.states[self._held] == 0.0 if self._held >= 0 else None
        uniform = keyed_random.uniform(self._key, step, np.arange(self.part.size)) if self.model.draws else None
        drawn = () if uniform is None else (LaneRows([torch.tensor(uniform, device=self.device)]),)
        arriving, flowing = LaneRows(list(x)), LaneRows([current])
        lanes.run(arithmetic.step, states, self.constants, arriving, flowing, ALL, ALL, fired, *drawn)
        reached = fired.rows[0]
        self.states = states.rows
        if self.model.graded:
            return self.states[self.names.index(PAYLOAD)]
        spikes = spread(reached, self.shape, self.device)
        who = spikes != 0.0
        if self.model.relay:
            spikes = x[0] * who
        elif surrogate is not None and (margin := getattr(reached, "margin", None)) is not None:
            x, free = margin / self.scale(), free if free is not None else torch.ones_like(who)
            apply: Any = Surrogated.apply
            spikes = apply(spikes, x, free, surrogate)
        if not self.model.resets_in_step and bool(who.any()):
            states = LaneRows(self.states, self.shape)
            Lanes(self.device, who).run(arithmetic.fire, states, self.constants, ALL)
            self.states = states.rows
        return spikes

    def _gate(self, surrogate: Surrogate) -> Callable[[Tensor], Tensor]:
        unit = self.scale()
        return lambda margin: surrogate.derivative(margin / unit) / unit


def constants_of(part: Population, parameters: dict[str, Floats], resolution: float) -> Floats:
    """The constants of every neuron, shape (size, width), or of the one that all are like, shape (1, width)."""
    model = part.model
    size = max((values.size for values in parameters.values()), default=1)
    values = [np.broadcast_to(each, size) for each in parameters.values()]
    rows, back = (
        np.unique(np.stack(values, axis=1), axis=0, return_inverse=True)
        if values
        else (np.zeros((1, 0)), np.zeros(1, int))
    )
    found: Floats = np.zeros((len(rows), model.width))
    for row, constants in zip(rows, found, strict=True):
        model.arithmetic.constants(row.tolist(), resolution, constants)  # type: ignore[attr-defined]
    every: Floats = found[back.reshape(-1)]
    return every


class Surrogated(torch.autograd.Function):
    """Spikes as they are; the surrogate stands in for their derivative."""

    @staticmethod
    def forward(ctx, spikes, x, free, surrogate):  # type: ignore[no-untyped-def]
        """The spikes; `x` is how far above the threshold each neuron is, `free` which are not refractory."""
        ctx.surrogate = surrogate
        ctx.save_for_backward(x, free)
        return spikes.clone()

    @staticmethod
    def backward(ctx, g):  # type: ignore[no-untyped-def]
        """The gradient of `x`."""
        x, free = ctx.saved_tensors
        return None, g * ctx.surrogate.derivative(x) * free, None, None


def graded_payloads(part: Population, drive: Tensor, task: ScanTask, resolution: float) -> Tensor:
    """The payloads that a population sends, (batch, steps, neurons).

    Args:
        part: the population, whose neurons draw nothing.
        drive: its input, of the same shape.
        task: what the pass is about.
        resolution: length of a step in ms.
    """
    cells = TensorCells(part, task.batch, resolution, 0, task.device)
    none = torch.zeros_like(drive[:, 0], dtype=torch.float64)
    sent = [cells.step([x.double(), none], 0.0, t, task.surrogate) for t, x in enumerate(drive.unbind(1), 1)]
    return torch.stack(sent, 1).to(task.dtype)


def graded_messages(part: Population, sent: Tensor, surrogate: Surrogate) -> Tensor:
    """1 where a payload is sent, else 0; the gradient lowers a payload towards the threshold of sending.

    Args:
        part: the population.
        sent: payloads, (batch, steps, neurons).
        surrogate: stands in for the derivative at the threshold.
    """
    p: Any = part.parameters
    least = p.get("vth", 0.0) * 2.0 ** p.get("spike_exp", 0.0)
    threshold = torch.as_tensor(least, dtype=sent.dtype, device=sent.device)
    counted: Tensor = _Messages.apply(sent, threshold, surrogate)  # type: ignore[no-untyped-call]
    return counted


class _Messages(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, sent: Tensor, threshold: Tensor, surrogate: Surrogate) -> Tensor:
        ctx.save_for_backward(sent, threshold)
        ctx.surrogate = surrogate
        return (sent != 0).to(sent.dtype)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        sent, threshold = ctx.saved_tensors
        x = (sent.abs() - threshold) / threshold
        lowered = grads[0] * sent.sign() * ctx.surrogate.derivative(x) / threshold
        return torch.where((sent != 0) & (threshold > 0), lowered, 0.0), None, None
