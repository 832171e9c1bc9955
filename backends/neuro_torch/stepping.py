"""The step of a program for a batch of recordings, differentiable; `neuro_torch.Module` uses it where no scan fits.

Tensors may stand for numbers of the program: they are checked to fit it, and delays may lie between two steps.
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
from neuro_torch.wires import Arrivals, Emitted, Learnt, TorchProjection

if TYPE_CHECKING:
    from neuro_torch.surrogates import Surrogate


Tensors = Mapping[str, Tensor]


def check(program: Program, weights: Tensors, delays: Tensors, parameters: Mapping[str, Tensors]) -> None:
    """Refuse tensors for what is not there, of another shape, or parameters out of their bounds.

    Raises:
        ModelError: it says which.
    """
    projections = {part.name: part for part in program.projections if part.carries == "spikes"}
    for word, tensors in (("weights", weights), ("delays", delays)):
        for name, values in tensors.items():
            if name not in projections:
                raise unknown("projection of spikes", name, projections)
            _check_shape(f"{word} of '{name}'", values, projections[name].size)
    for name in delays:
        if projections[name].grid is not None or program.populations[projections[name].target].model.name == _RELAY:
            what = "shares its weights" if projections[name].grid is not None else "ends at parrots"
            raise ModelError(f"delays of '{name}' cannot be learnt: it {what}", hint="learn its weights")
    neurons = {part.name: part for part in program.populations if part.kind == "neuron"}
    for name, words in parameters.items():
        if name not in neurons:
            raise unknown("population of neurons", name, neurons)
        for word, values in words.items():
            if word not in neurons[name].parameters:
                raise unknown(f"parameter of '{name}'", word, neurons[name].parameters)
            _check_shape(f"{word} of '{name}'", values, neurons[name].size)
        check_parameters(neurons[name], words)


_RELAY = "parrot_neuron"


def _check_shape(what: str, values: Tensor, size: int) -> None:
    if values.shape not in ((1,), (size,)) or values.dtype is not torch.float64:
        found = f"{tuple(values.shape)} of {values.dtype}"
        raise ModelError(f"{what}: found {found}: expected (1,) or ({size},) of torch.float64")


def between_steps(
    program: Program, index: int, device: torch.device, delays: Tensor, weights: Tensor
) -> list[tuple[TorchProjection, Tensor]]:
    """A projection whose delays lie between two steps: wires for the later and for the earlier, with their weights.

    A spike arrives in both, in shares that say how near the delay is to each, so that a gradient moves it.

    Args:
        program: the network.
        index: which projection.
        device: where its arrays are.
        delays: in ms, of all synapses or of each.
        weights: likewise.

    Raises:
        ModelError: a delay is NaN, or longer than any may be.
    """
    steps = in_steps(delays, program.resolution, program.projections[index].name)
    whole = steps.detach().floor()
    late = steps - whole
    earlier = whole.cpu().numpy().astype(np.int64)
    shares = ((earlier + 1, weights * late), (earlier, weights * (1.0 - late)))
    return [(TorchProjection(program, index, device, delay), share) for delay, share in shares]


class Stepper:
    """A program in execution for a batch, from step 0; without a gradient each recording is what it would be alone.

    ```python
    stepper = Stepper(program, surrogate=FastSigmoid())
    stepper.begin(batch=20, weights={"in_hidden": w}, parameters={"hidden": {"tau_m": t}})   # for each batch
    for k in range(steps):
        spikes = stepper.step({"input": events[:, k]})     # {population: (batch, neurons)}, doubles
        v = stepper.state("hidden", "V_m")                 # (batch, neurons), mV, after the step and its resets
    ```

    Gradients go to `weights`, `parameters`, inputs that ask for them, and, through time, to all spikes. Of a spike that
    is derivative(x) / (V_th - V_reset) per mV, at x = (V_m - V_th) / (V_th - V_reset) before the reset, where V_m and
    V_th are what the model compares, also where a threshold adapts; it is 0 while the neuron is refractory. A reset
    has no gradient: what a neuron was before its spike is gone. A Poisson generator and a neuron that draws are keyed
    by step, so all recordings of a batch see one draw.

    Attributes:
        now: the last finished step.
        spikes: what each population emitted in it, by index; None before the first.
        heard: which neurons an input or a spike of their own concerned in it, by index, if `hears`.

    Args:
        program: the network; `neuro_torch.backend.problems` says what of one cannot run here.
        batch: recordings.
        device: "cpu", "cuda" or a torch.device.
        surrogate: with `derivative(x)`; None leaves spikes without a gradient.
        weights: tensors of doubles in the unit of the network in place of the program's, by projection: shape (1,)
            where all share one, else (synapses,) in the order of the program's weights.
        parameters: likewise of neurons, by population and word, shape (1,) or (neurons,).
        delays: likewise of projections, in ms; between two steps a spike arrives in shares in both.
        hears: whether `heard` is kept.

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
            raise ModelError("\n".join(f"{each.what}: {each.why}" for each in refused), hint=refused[0].way_out)
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
        """Begin at step 0 with other tensors, which stand for the program's numbers as above; much faster than anew."""
        program, named, late = self.program, dict(weights or {}), dict(delays or {})
        check(program, named, late, parameters or {})
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
                own = named[part.name] if part.name in named else torch.tensor(part.weight, device=self.device)
                self.versions[k] = [(0, own)]
                if part.name in late:
                    self._between[k] = between_steps(program, k, self.device, late[part.name], own)
        between = [wires for pair in self._between.values() for wires, _ in pair]
        self._longest = max([1, *(w.delays[0] for w in (*self.wires.values(), *between) if w.delays)])
        self.start_anew()

    def start_anew(self) -> None:
        """Back to step 0; weights and parameters stay."""
        self.now = 0
        self._learnt: dict[TorchProjection, Learnt] = {}
        parts: list[TensorCells | TensorSource | Flow] = [
            *self.cells.values(),
            *self.sources.values(),
            *self.flows.values(),
        ]
        for each in parts:
            each.start_anew()
        self.versions = {k: [(0, versions[-1][1])] for k, versions in self.versions.items()}
        self.sent: dict[int, list[tuple[int, Emitted]]] = {k: [] for k in range(len(self.program.populations))}
        self.spikes: list[Tensor | None] = [None] * len(self.program.populations)
        self.heard: dict[int, Tensor] = {}

    def state(self, population: str, name: str) -> Tensor:
        """A state of all neurons, shape (batch, neurons)."""
        cells = self.cells[self._numbers[population]]
        return cells.states[cells.names.index(name)]

    def emitted(self, population: int) -> Emitted | None:
        """What a population emitted in the last step; None of one that emits no spikes, or before the first step."""
        sent = self.sent[population]
        return sent[-1][1] if sent and sent[-1][0] == self.now else None

    def parameters(self, population: int) -> dict[str, Floats]:
        """The parameters of a population, as they are now, by word."""
        part = self.cells.get(population) or self.sources.get(population)
        return self.emitters[population] if part is None else part.parameters

    def memory(self) -> dict[str, int]:
        """Bytes of states and synapses."""
        cells = sum(8 * len(each.states) * each.shape[0] * each.shape[1] for each in self.cells.values())
        weights = sum(8 * w.numel() for versions in self.versions.values() for _, w in versions)
        return {"neurons": cells, "synapses": weights + sum(wires.nbytes for wires in self.wires.values())}

    def weights(self, projection: int) -> Tensor:
        """The weights with which spikes are sent now."""
        return self.versions[projection][-1][1]

    def set_weights(self, projection: int, weights: Tensor) -> None:
        """Replace the weights of spikes that were not sent: of neurons, those of the last step are among them."""
        part = self.program.projections[projection]
        since = self.now + 1 if self.now and self.program.sends_at_once(part) else self.now
        kept = [version for version in self.versions[projection] if version[0] < since]
        while len(kept) > 1 and kept[1][0] + self._longest < self.now:
            del kept[0]
        self.versions[projection] = [*kept, (since, weights)]

    def step(self, inputs: Mapping[str, Tensor] | None = None) -> dict[str, Tensor]:
        """One step.

        Args:
            inputs: spikes that populations of a `spike_generator` emit beside those listed, shape (batch, neurons).

        Returns:
            What each population that emits spikes emitted, shape (batch, neurons).

        Raises:
            ModelError: an input is of no population of a `spike_generator`, or has another shape.
        """
        step, given = self.now + 1, self._given(inputs or {})
        arrived = {k: self._arrived(k, step) for k in self.cells}
        for k, cells in self.cells.items():
            self.spikes[k] = cells.step(*arrived[k], step, self._surrogate)
        for k in self.sources:
            self.spikes[k] = self._emitted(k, step, given.get(k))
        for flow in self.flows.values():
            flow.charge(self.cells[flow.part.target], step)
            flow.send(step)
        self._send(step)
        self.now = step
        return {part.name: s for part, s in zip(self.program.populations, self.spikes, strict=True) if s is not None}

    def _given(self, inputs: Tensors) -> dict[int, Tensor]:
        """Inputs by the index of their population."""
        listed = {name: k for name, k in self._numbers.items() if self.program.populations[k].kind == "listed"}
        for name, spikes in inputs.items():
            if name not in listed:
                raise unknown("population of a spike_generator", name, listed)
            expected = (self.batch, self.program.populations[listed[name]].size)
            if tuple(spikes.shape) != expected or spikes.dtype is not torch.float64:
                found = f"{tuple(spikes.shape)} of {spikes.dtype}"
                raise ModelError(f"input '{name}': found {found}: expected {expected} of torch.float64")
        return {listed[name]: spikes for name, spikes in inputs.items()}

    def _emitted(self, k: int, step: int, given: Tensor | None) -> Tensor:
        numbers = self.sources[k].emit(step)
        if given is not None and not numbers.any():
            return given
        own = torch.from_numpy(numbers.astype("float64")).to(self.device).expand(self.batch, -1)
        return own if given is None else given + own

    def _send(self, step: int) -> None:
        for k, spikes in enumerate(self.spikes):
            if spikes is not None:
                kept = [(since, each) for since, each in self.sent[k] if since + self._longest > step]
                self.sent[k] = [*kept, (step, Emitted(spikes))]

    def _arrived(self, k: int, step: int) -> tuple[Tensor, Any]:
        """Input by receptor, shape (receptors, batch, neurons), and current in pA of a population."""
        cells = self.cells[k]
        x = torch.zeros(cells.receptors, *cells.shape, dtype=torch.float64, device=self.device)
        heard = torch.zeros(cells.shape, dtype=torch.bool, device=self.device) if self._hears else None
        for q, wires in self.wires.items():
            if wires.part.target == k:
                for each, versions in self._ways(q):
                    x = self._added(x, heard, each, versions, step)
        if heard is not None:
            self.heard[k] = heard
        current: Any = 0.0
        for flow in self.flows.values():
            if flow.part.target == k and flow.part.receptor is None:
                current = current + torch.from_numpy(flow.arrive(step)).to(self.device)
        return x, current

    def _ways(self, q: int) -> list[tuple[TorchProjection, Versions]]:
        """The wires of a projection with their weights: one, or two where delays are learnt."""
        if q in self._between:
            return [(wires, [(0, weights)]) for wires, weights in self._between[q]]
        return [(self.wires[q], self.versions[q])]

    def _added(self, x: Tensor, heard: Tensor | None, wires: TorchProjection, versions: Versions, step: int) -> Tensor:
        """Input with what arrives along wires, by weights of one time after the other."""
        emitted = dict(self.sent[wires.part.source])
        sent = [(d, emitted[step - delay]) for d, delay in enumerate(wires.delays) if step - delay in emitted]
        sent = [(d, each) for d, each in sent if len(each.neuron) or each.spikes is not None]
        if not sent:
            return x
        learnt = versions[-1][1].requires_grad or any(each.spikes is not None for _, each in sent)
        if learnt and torch.is_grad_enabled():
            if heard is not None:
                wires.hear(heard, sent)
            arrivals: Any = Arrivals.apply
            if wires not in self._learnt:
                self._learnt[wires] = Learnt(versions[-1][1])
            known = self._learnt[wires]
            found: Tensor = arrivals(wires, known, known.token, self.batch, sent, *(each.spikes for _, each in sent))
            return x + found
        own = torch.zeros_like(x)
        for since, until, weights in _times(versions):
            some = [(d, each) for d, each in sent if since <= step - wires.delays[d] < until]
            wires.add(own, heard, weights, some)
        return x + own


Versions = list[tuple[int, Tensor]]
"""Weights with the first step whose spikes are sent with them."""


def _times(versions: Versions) -> Iterator[tuple[int, int, Tensor]]:
    """Weights with the first step whose spikes are sent with them, and the first whose do not."""
    ends = [since for since, _ in versions[1:]] + [NEVER]
    yield from ((since, end, weights) for (since, weights), end in zip(versions, ends, strict=True))


Named = Mapping[str, Tensor]


class Learning(NamedTuple):
    """What learns: weights and delays (ms) by projection, parameters by population and word."""

    weights: Named
    delays: Named
    parameters: Mapping[str, Named]


def stepped(
    stepper: Stepper, task: ScanTask, learning: Learning, given: Named
) -> tuple[dict[int, Tensor], dict[int, Tensor]]:
    """Spikes of all populations that emit some, and potentials of those that are wanted, (batch, steps, neurons).

    Args:
        stepper: of the network.
        task: what the pass is about.
        learning: what learns.
        given: the spikes that inputs are given, (batch, steps, neurons).
    """
    program = stepper.program
    stepper.begin(
        batch=task.batch,
        weights={name: values.double().reshape(-1) for name, values in learning.weights.items()},
        delays={name: values.double().reshape(-1) for name, values in learning.delays.items()},
        parameters={name: {word: v.double() for word, v in each.items()} for name, each in learning.parameters.items()},
    )
    names = [part.name for part in program.populations]
    with_v = [k for k in task.wanted if "V_m" in [s.name for s in program.populations[k].model.states]]
    inputs = {name: tensor.double() for name, tensor in given.items()}
    spikes: dict[int, list[Tensor]] = {}
    potentials: dict[int, list[Tensor]] = {k: [] for k in with_v}
    for t in range(task.steps):
        for name, emitted in stepper.step({name: tensor[:, t] for name, tensor in inputs.items()}).items():
            spikes.setdefault(names.index(name), []).append(emitted)
        for k in with_v:
            potentials[k].append(stepper.state(names[k], "V_m"))
    neurons = [each for words in learning.parameters.values() for each in words.values()]
    learns = [*learning.weights.values(), *learning.delays.values(), *neurons]
    return _stacked(spikes, task, learns), _stacked(potentials, task, learns)


def _stacked(found: Mapping[int, list[Any]], task: ScanTask, learns: list[Tensor]) -> dict[int, Tensor]:
    return {k: joined(torch.stack(each, 1).to(task.dtype), learns) for k, each in found.items()}
