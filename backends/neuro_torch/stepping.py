"""A differentiable step of a program for a batch of recordings; `neuro_torch.Module` uses it where no scan fits.

Tensors may replace numbers of the program. Their shapes and bounds are checked, and delays may lie between two steps.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from neuro.core.clock import NEVER
from neuro.core.errors import ModelError, unknown
from neuro.model.neurons import Neuron
from neuro.program.program import Floats, Program
from neuro_torch.cells import TensorCells
from neuro_torch.problems import problems, without_gradient
from neuro_torch.scan.gradients import joined
from neuro_torch.scan.layers import ScanTask
from neuro_torch.sources import Flow, TensorSource
from neuro_torch.trainable import check_parameters, in_steps
from neuro_torch.wires import Arrivals, Emitted, TorchProjection, WeightAccumulator

if TYPE_CHECKING:
    from neuro_torch.surrogates import Surrogate


Tensors = Mapping[str, Tensor]
_RELAY = "parrot_neuron"


def check(program: Program, weights: Tensors, delays: Tensors, parameters: Mapping[str, Tensors]) -> None:
    """Refuse tensors with unknown names or wrong shapes, and parameters out of their bounds.

    Raises:
        ModelError: a name, a shape or a value is wrong. The message names the tensor.
    """
    projections = {part.name: part for part in program.projections if part.carries == "spikes"}
    for word, tensors in (("weights", weights), ("delays", delays)):
        for name, values in tensors.items():
            if name not in projections:
                raise unknown("projection of spikes", name, projections)
            _check_shape(f"{word} of '{name}'", values, projections[name].size)
    for name in delays:
        if projections[name].grid is not None or program.populations[projections[name].target].model.name == _RELAY:
            reason = "shares its weights" if projections[name].grid is not None else "ends at parrots"
            raise ModelError(f"delays of '{name}' cannot be learnt: it {reason}", hint="learn its weights")
    neurons = {part.name: part for part in program.populations if part.kind == "neuron"}
    for name, population_parameters in parameters.items():
        if name not in neurons:
            raise unknown("population of neurons", name, neurons)
        for word, values in population_parameters.items():
            if word not in neurons[name].parameters:
                raise unknown(f"parameter of '{name}'", word, neurons[name].parameters)
            _check_shape(f"{word} of '{name}'", values, neurons[name].size)
        check_parameters(neurons[name], population_parameters)


def _check_shape(name: str, values: Tensor, size: int) -> None:
    if values.shape not in ((1,), (size,)) or values.dtype is not torch.float64:
        actual = f"{tuple(values.shape)} of {values.dtype}"
        raise ModelError(f"{name}: found {actual}: expected (1,) or ({size},) of torch.float64")


def between_steps(
    program: Program, index: int, device: torch.device, delays: Tensor, weights: Tensor
) -> list[tuple[TorchProjection, Tensor]]:
    """Return the projection twice, with delays rounded up and down, and the share of the weights for each.

    A spike arrives in both steps, in shares by the distance of the delay to each, so that a gradient moves the delay.
    For example, a delay of 2.25 steps delivers 0.75 of the weight after 2 steps and 0.25 after 3 steps.

    Args:
        program: the network.
        index: index of the projection.
        device: device of its arrays.
        delays: delays in ms, one for all synapses or one each.
        weights: weights, one for all synapses or one each.

    Raises:
        ModelError: a delay is NaN or too long.
    """
    steps = in_steps(delays, program.resolution, program.projections[index].name)
    lower = steps.detach().floor()
    share_later = steps - lower
    earlier = lower.cpu().numpy().astype(np.int64)
    shares = ((earlier + 1, weights * share_later), (earlier, weights * (1.0 - share_later)))
    return [(TorchProjection(program, index, device, delay), share) for delay, share in shares]


class Stepper:
    """A program in execution for a batch, from step 0. A recording does not depend on the other recordings.

    ```python
    stepper = Stepper(program, surrogate=FastSigmoid())
    stepper.begin(batch=20, weights={"in_hidden": w}, parameters={"hidden": {"tau_m": t}})   # for each batch
    for k in range(steps):
        spikes = stepper.step({"input": events[:, k]})     # {population: (batch, neurons)}, doubles
        v = stepper.state("hidden", "V_m")                 # (batch, neurons), mV, after the step and its resets
    ```

    Gradients flow to `weights`, `parameters`, inputs that require them, and, through time, to all spikes. The gradient
    of a spike is derivative(x) / (V_th - V_reset) per mV, at x = (V_m - V_th) / (V_th - V_reset) before the reset. V_m
    and V_th are the values that the model compares, also if a threshold adapts. The gradient is 0 while the neuron is
    refractory. A reset has no gradient, since V_m before the spike no longer matters. Random numbers of
    generators and neurons depend on the step, not on the recording, so all recordings of a batch share them.

    Attributes:
        now: the last finished step.
        spikes: spikes of each population in the last step, by index; None before the first step.
        heard: masks of the neurons with an arrival or a spike in the last step, by index of the population, if `hears`.

    Args:
        program: the network; `neuro_torch.backend.problems` lists what cannot run here.
        batch: number of recordings.
        device: "cpu", "cuda" or a torch.device.
        surrogate: derivative of a spike; None leaves spikes without a gradient.
        weights: tensors of doubles that replace the program's weights, by projection, in its unit: shape (1,) for one
            shared weight, else (synapses,) in the order of the program's weights.
        parameters: tensors that replace parameters of neurons, by population and name, shape (1,) or (neurons,).
        delays: tensors that replace delays, by projection, in ms; a spike between two steps arrives in both in shares.
        hears: whether to record `heard`.

    Raises:
        ModelError: a name is unknown, a tensor has another shape, or spikes of a model have no gradient.
    """

    def __init__(
        self,
        program: Program,
        *,
        batch: int = 1,
        device: str | torch.device = "cpu",
        surrogate: Surrogate | None = None,
        weights: Tensors | None = None,
        parameters: Mapping[str, Tensors] | None = None,
        delays: Tensors | None = None,
        hears: bool = False,
    ) -> None:
        refused = [*problems(program), *(without_gradient(program) if surrogate is not None else ())]
        if refused:
            raise ModelError("\n".join(f"{item.what}: {item.why}" for item in refused), hint=refused[0].way_out)
        self.program, self.device = program, torch.device(device)
        self._surrogate, self._hears = surrogate, hears
        self._numbers = {part.name: k for k, part in enumerate(program.populations)}
        self.sources = {
            k: TensorSource(part, program.resolution, program.seed)
            for k, part in enumerate(program.populations)
            if part.kind in ("listed", "poisson", "generator")
        }
        carrying = [(k, part.carries == "spikes") for k, part in enumerate(program.projections)]
        self.wires = {k: TorchProjection(program, k, self.device) for k, spikes in carrying if spikes}
        self.emitters = {
            k: {word: values.copy() for word, values in part.parameters.items()}
            for k, part in enumerate(program.populations)
            if part.kind == "current"
        }
        sources = [part.source for part in program.projections]
        self.flows = {k: Flow(program, k, self.emitters[sources[k]]) for k, spikes in carrying if not spikes}
        self.begin(batch=batch, weights=weights, parameters=parameters, delays=delays)

    def begin(
        self,
        *,
        batch: int = 1,
        weights: Tensors | None = None,
        parameters: Mapping[str, Tensors] | None = None,
        delays: Tensors | None = None,
    ) -> None:
        """Begin a batch at step 0 with other tensors in place of the program's numbers, faster than a new stepper."""
        program, new_weights, new_delays = self.program, dict(weights or {}), dict(delays or {})
        check(program, new_weights, new_delays, parameters or {})
        self.batch = batch
        self.cells = {
            k: TensorCells(
                part, batch, program.resolution, program.seed, self.device, (parameters or {}).get(part.name)
            )
            for k, part in enumerate(program.populations)
            if isinstance(part.model, Neuron)
        }
        self.versions: dict[int, Versions] = {}
        self._between: dict[int, list[tuple[TorchProjection, Tensor]]] = {}
        for k, part in enumerate(program.projections):
            if k in self.wires:
                initial_weight = (
                    new_weights[part.name]
                    if part.name in new_weights
                    else torch.tensor(part.weight, device=self.device)
                )
                self.versions[k] = [(0, initial_weight)]
                if part.name in new_delays:
                    self._between[k] = between_steps(program, k, self.device, new_delays[part.name], initial_weight)
        all_wires = [wires for pair in self._between.values() for wires, _ in pair]
        self._longest = max([1, *(w.delays[0] for w in (*self.wires.values(), *all_wires) if w.delays)])
        self.start_anew()

    def start_anew(self) -> None:
        """Return to step 0; weights and parameters stay."""
        self.now = 0
        self._accumulators: dict[TorchProjection, WeightAccumulator] = {}
        parts: list[TensorCells | TensorSource | Flow] = [
            *self.cells.values(),
            *self.sources.values(),
            *self.flows.values(),
        ]
        for part in parts:
            part.start_anew()
        self.versions = {k: [(0, versions[-1][1])] for k, versions in self.versions.items()}
        self.sent: dict[int, list[tuple[int, Emitted]]] = {k: [] for k in range(len(self.program.populations))}
        self.spikes: list[Tensor | None] = [None] * len(self.program.populations)
        self.heard: dict[int, Tensor] = {}

    def state(self, population: str, name: str) -> Tensor:
        """Return a state of all neurons, shape (batch, neurons)."""
        cells = self.cells[self._numbers[population]]
        return cells.states[cells.names.index(name)]

    def emitted(self, population: int) -> Emitted | None:
        """Return the spikes of a population in the last step; None if it emits no spikes, or before the first step."""
        emissions = self.sent[population]
        return emissions[-1][1] if emissions and emissions[-1][0] == self.now else None

    def parameters(self, population: int) -> dict[str, Floats]:
        """Return the current parameters of a population, by name."""
        part = self.cells.get(population) or self.sources.get(population)
        return self.emitters[population] if part is None else part.parameters

    def memory(self) -> dict[str, int]:
        """Return bytes of states and synapses."""
        cells = sum(8 * len(cell.states) * cell.shape[0] * cell.shape[1] for cell in self.cells.values())
        weights = sum(8 * w.numel() for versions in self.versions.values() for _, w in versions)
        return {"neurons": cells, "synapses": weights + sum(wires.nbytes for wires in self.wires.values())}

    def weights(self, projection: int) -> Tensor:
        """Return the weights of spikes that are sent from now on."""
        return self.versions[projection][-1][1]

    def set_weights(self, projection: int, weights: Tensor) -> None:
        """Set the weights of spikes that are not sent yet. These include the spikes of neurons in the last step."""
        part = self.program.projections[projection]
        begin = self.now + 1 if self.now and self.program.sends_at_once(part) else self.now
        versions = [version for version in self.versions[projection] if version[0] < begin]
        while len(versions) > 1 and versions[1][0] + self._longest < self.now:
            del versions[0]
        self.versions[projection] = [*versions, (begin, weights)]

    def step(self, inputs: Mapping[str, Tensor] | None = None) -> dict[str, Tensor]:
        """Run one step.

        Args:
            inputs: spikes of `spike_generator` populations besides those listed, shape (batch, neurons).

        Returns:
            spikes of each population that emits spikes, shape (batch, neurons).

        Raises:
            ModelError: an input names no population of a `spike_generator`, or has another shape.
        """
        step, drives = self.now + 1, self._inputs_by_index(inputs or {})
        arrived = {k: self._input_of(k, step) for k in self.cells}
        for k, cells in self.cells.items():
            self.spikes[k] = cells.step(*arrived[k], step, self._surrogate)
        for k in self.sources:
            self.spikes[k] = self._generator_spikes(k, step, drives.get(k))
        for flow in self.flows.values():
            flow.charge(self.cells[flow.part.target], step)
            flow.send(step)
        self._send(step)
        self.now = step
        return {part.name: s for part, s in zip(self.program.populations, self.spikes, strict=True) if s is not None}

    def _inputs_by_index(self, inputs: Tensors) -> dict[int, Tensor]:
        """Return the inputs by the index of their population."""
        index_of = {name: k for name, k in self._numbers.items() if self.program.populations[k].kind == "listed"}
        for name, spikes in inputs.items():
            if name not in index_of:
                raise unknown("population of a spike_generator", name, index_of)
            expected = (self.batch, self.program.populations[index_of[name]].size)
            if tuple(spikes.shape) != expected or spikes.dtype is not torch.float64:
                actual = f"{tuple(spikes.shape)} of {spikes.dtype}"
                raise ModelError(f"input '{name}': found {actual}: expected {expected} of torch.float64")
        return {index_of[name]: spikes for name, spikes in inputs.items()}

    def _generator_spikes(self, k: int, step: int, added_spikes: Tensor | None) -> Tensor:
        numbers = self.sources[k].emit(step)
        if added_spikes is not None and not numbers.any():
            return added_spikes
        doubles = torch.from_numpy(numbers.astype("float64")).to(self.device).expand(self.batch, -1)
        return doubles if added_spikes is None else added_spikes + doubles

    def _send(self, step: int) -> None:
        for k, spikes in enumerate(self.spikes):
            if spikes is not None:
                in_flight = [(begin, emission) for begin, emission in self.sent[k] if begin + self._longest > step]
                self.sent[k] = [*in_flight, (step, Emitted(spikes))]

    def _input_of(self, k: int, step: int) -> tuple[Tensor, Any]:
        """Return the input of a population, shape (receptors, batch, neurons), and its current in pA."""
        cells = self.cells[k]
        x = torch.zeros(cells.receptors, *cells.shape, dtype=torch.float64, device=self.device)
        receives = torch.zeros(cells.shape, dtype=torch.bool, device=self.device) if self._hears else None
        for q, wires in self.wires.items():
            if wires.part.target == k:
                for path, versions in self._weighted_wires(q):
                    x = self._add_arrivals(x, receives, path, versions, step)
        if receives is not None:
            self.heard[k] = receives
        current: Any = 0.0
        for flow in self.flows.values():
            if flow.part.target == k and flow.part.receptor is None:
                current = current + torch.from_numpy(flow.arrive(step)).to(self.device)
        return x, current

    def _weighted_wires(self, q: int) -> list[tuple[TorchProjection, Versions]]:
        """Return the wires of a projection with their weights: one pair, or two if delays learn."""
        if q in self._between:
            return [(wires, [(0, weights)]) for wires, weights in self._between[q]]
        return [(self.wires[q], self.versions[q])]

    def _add_arrivals(
        self, x: Tensor, receives: Tensor | None, wires: TorchProjection, versions: Versions, step: int
    ) -> Tensor:
        """Return the input plus the spikes that arrive along some wires, each with the weights at its emission."""
        emitted = dict(self.sent[wires.part.source])
        arriving = [(d, emitted[step - delay]) for d, delay in enumerate(wires.delays) if step - delay in emitted]
        arriving = [(d, emission) for d, emission in arriving if len(emission.neuron) or emission.spikes is not None]
        if not arriving:
            return x
        has_gradient = versions[-1][1].requires_grad or any(emission.spikes is not None for _, emission in arriving)
        if has_gradient and torch.is_grad_enabled():
            if receives is not None:
                wires.mark_arrivals(receives, arriving)
            arrivals: Any = Arrivals.apply
            if wires not in self._accumulators:
                self._accumulators[wires] = WeightAccumulator(versions[-1][1])
            accumulator = self._accumulators[wires]
            spikes = [emission.spikes for _, emission in arriving]
            delivered: Tensor = arrivals(wires, accumulator, accumulator.token, self.batch, arriving, *spikes)
            return x + delivered
        version_sums = torch.zeros_like(x)
        for begin, end, weights in _intervals(versions):
            sent_then = [(d, emission) for d, emission in arriving if begin <= step - wires.delays[d] < end]
            wires.add(version_sums, receives, weights, sent_then)
        return x + version_sums


Versions = list[tuple[int, Tensor]]
"""Weights over time: pairs of a first step, and the weights of all spikes that are sent from this step on."""


def _intervals(versions: Versions) -> Iterator[tuple[int, int, Tensor]]:
    """Yield for each version the first step of its use, the first step after its use, and the weights."""
    ends = [begin for begin, _ in versions[1:]] + [NEVER]
    yield from ((begin, end, weights) for (begin, weights), end in zip(versions, ends, strict=True))


Named = Mapping[str, Tensor]


class Learning(NamedTuple):
    """Tensors that learn: weights and delays (ms) by projection, parameters by population and name."""

    weights: Named
    delays: Named
    parameters: Mapping[str, Named]


def stepped(
    stepper: Stepper, task: ScanTask, learning: Learning, input_spikes: Named
) -> tuple[dict[int, Tensor], dict[int, Tensor]]:
    """Return spikes of all populations that emit spikes, and potentials of the outputs, (batch, steps, neurons).

    Args:
        stepper: stepper of the network.
        task: sizes, dtype and device of the pass.
        learning: the tensors that learn.
        input_spikes: input spikes by population, (batch, steps, neurons).
    """
    program = stepper.program
    stepper.begin(
        batch=task.batch,
        weights={name: values.double().reshape(-1) for name, values in learning.weights.items()},
        delays={name: values.double().reshape(-1) for name, values in learning.delays.items()},
        parameters={k: {word: v.double() for word, v in group.items()} for k, group in learning.parameters.items()},
    )
    names = [part.name for part in program.populations]
    with_v = [k for k in task.potentials_of if "V_m" in [s.name for s in program.populations[k].model.states]]
    inputs = {name: tensor.double() for name, tensor in input_spikes.items()}
    spikes: dict[int, list[Tensor]] = {}
    potentials: dict[int, list[Tensor]] = {k: [] for k in with_v}
    for t in range(task.steps):
        for name, emitted in stepper.step({name: tensor[:, t] for name, tensor in inputs.items()}).items():
            spikes.setdefault(names.index(name), []).append(emitted)
        for k in with_v:
            potentials[k].append(stepper.state(names[k], "V_m"))
    neurons = [tensor for group in learning.parameters.values() for tensor in group.values()]
    learns = [*learning.weights.values(), *learning.delays.values(), *neurons]
    return _stack(spikes, task, learns), _stack(potentials, task, learns)


def _stack(by_step: Mapping[int, list[Any]], task: ScanTask, learns: list[Tensor]) -> dict[int, Tensor]:
    return {k: joined(torch.stack(spikes, 1).to(task.dtype), learns) for k, spikes in by_step.items()}
