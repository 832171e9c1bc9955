"""A network as a `torch.nn.Module`: weights are parameters, and a batch of spikes makes spikes with gradients."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

import neuro
from neuro.compiler import compile_network
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, unknown
from neuro.core.memory import free_memory
from neuro_torch import learnt
from neuro_torch.active import active_updates
from neuro_torch.events import Events, Train
from neuro_torch.outcome import Outcome, Told, input_counts
from neuro_torch.plan import Plan, plan_of
from neuro_torch.scan import compiled, layers
from neuro_torch.surrogates import Surrogate, surrogate_of

__all__ = ["Module"]


class Module(torch.nn.Module):
    """A network whose weights learn by gradients, and whose spikes are those of every other backend.

    Args:
        net: the network; it is not changed.
        trainable: names of the projections whose weights learn. Weights that synapses share, such as kernels of a grid
            or one number for a projection, are one parameter.
        surrogate: stands in for the derivative of a spike, by name or itself, see `neuro_torch.surrogates`.
        slope: of a surrogate that is given by name.
        duration: of a recording in ms; that of each batch if not given.
        outputs: populations whose spikes and potentials are wanted in time; if not given those from which no
            projection starts.
        seed: of everything random.
        dtype: of all numbers, torch's default if not given. With `torch.float64` spikes are those of `event`.
        damping: what gradients are multiplied by each time they go along a synapse of a recurrent part, 0 to 1.

    Attributes:
        weights: the parameters by projection, in mV or pA as the network has them: rows by source of an `all_to_all`,
            kernels of a grid, else one for each synapse.
        program: the network as backends see it.
        plan: which part runs by what; `str` tells it.

    Raises:
        ModelError: a name is unknown, nothing is trainable, or the network cannot be differentiated.
    """

    def __init__(
        self,
        net: neuro.Network,
        trainable: Iterable[str],
        *,
        surrogate: str | Surrogate = "fast_sigmoid",
        slope: float | None = None,
        duration: float | None = None,
        outputs: Sequence[str] | None = None,
        seed: int = 0,
        dtype: torch.dtype | None = None,
        damping: float = 1.0,
    ) -> None:
        super().__init__()
        self.program = compile_network(net, seed)
        self.surrogate, self.damping = surrogate_of(surrogate, slope), damping
        self._net, self._seed = net, seed
        self._index = {part.name: k for k, part in enumerate(self.program.populations)}
        self._steps = None if duration is None else Clock(net.resolution).step(float(duration), "duration")
        self.outputs = self._outputs(outputs)
        self.plan: Plan = plan_of(self.program)
        self.weights = torch.nn.ParameterDict(self._learning(list(trainable), dtype or torch.get_default_dtype()))
        self._pushes: dict[int, dict[int, Any]] = {}

    def forward(self, batch: Events | Mapping[str, Any]) -> Outcome:
        """Run a batch from step 0.

        Args:
            batch: `Events`, or by population of generators a dense tensor, (batch, steps, neurons), of spikes or of any
                numbers by which weights are multiplied; it may have a gradient. A spike_generator that is not named
                emits what the network lists.

        Raises:
            ModelError: a name or a shape is wrong, or the batch needs more memory than is free.
        """
        given = dict(batch.trains) if isinstance(batch, Events) else dict(batch)
        size, steps = self._sizes(batch)
        self._refuse_large(size, steps)
        dtype = next(iter(self.weights.values())).dtype
        task = compiled.Task(
            size,
            steps,
            dtype,
            self.surrogate,
            self.damping,
            self._push(steps),
            frozenset(self._index[n] for n in self.outputs),
        )
        emitted: dict[int, Any] = {
            k: self._emitted(k, given.get(part.name), task)
            for k, part in enumerate(self.program.populations)
            if part.kind == "listed"
        }
        weights = {q: self._weight(q, dtype) for q, p in enumerate(self.program.projections) if p.carries == "spikes"}
        potentials: dict[int, Tensor] = {}
        for part in self.plan.parts:
            drives = {k: torch.zeros(size, steps, cell.size, dtype=dtype) for k, cell in part.cells.items()}
            fresh = set(drives)
            for each in part.outside:
                arrived = compiled.drive(each, emitted[each.source], weights[each.projection], task)
                drives[each.target] = arrived if each.target in fresh else drives[each.target] + arrived
                fresh.discard(each.target)
            spikes, before = compiled.scan(part, drives, [weights[s.projection] for s in part.inside], task)
            emitted |= spikes
            potentials |= before
        return self._outcome(batch, emitted, potentials, task)

    def network(self) -> neuro.Network:
        """The network with what was learnt, which every backend runs; what was drawn at random is listed in it."""
        found = {part.name: q for q, part in enumerate(self.program.projections)}
        taken = {found[name]: w.detach().double().cpu().numpy().reshape(-1) for name, w in self.weights.items()}
        return learnt.network_of(self._net, self._seed, taken)

    def extra_repr(self) -> str:
        """What torch shows of it."""
        return f"{self.program.name!r}, outputs={list(self.outputs)}, surrogate={self.surrogate}"

    def _outputs(self, named: Sequence[str] | None) -> tuple[str, ...]:
        neurons = [part.name for part in self.program.populations if part.kind == "neuron"]
        if named is None:
            sending = {self.program.populations[p.source].name for p in self.program.projections}
            return tuple(name for name in neurons if name not in sending) or tuple(neurons)
        for name in named:
            if name not in neurons:
                raise unknown("population of neurons", name, neurons)
        return tuple(named)

    def _learning(self, names: list[str], dtype: torch.dtype) -> dict[str, torch.nn.Parameter]:
        known = {part.name: q for q, part in enumerate(self.program.projections) if part.carries == "spikes"}
        if not names:
            raise ModelError("trainable: found no projection: expected at least one", hint=f"known: {', '.join(known)}")
        made = {}
        for name in names:
            if name not in known:
                raise unknown("projection", name, known)
            part = self.program.projections[known[name]]
            sizes = self.program.populations[part.source].size, self.program.populations[part.target].size
            values = part.weight.reshape(layers.shape_of(part, sizes))
            made[name] = torch.nn.Parameter(torch.tensor(values, dtype=dtype))
        return made

    def _weight(self, projection: int, dtype: torch.dtype) -> Tensor:
        part = self.program.projections[projection]
        if part.name in self.weights:
            return self.weights[part.name]
        sizes = self.program.populations[part.source].size, self.program.populations[part.target].size
        return torch.tensor(part.weight.reshape(layers.shape_of(part, sizes)), dtype=dtype)

    def _sizes(self, batch: Events | Mapping[str, Any]) -> tuple[int, int]:
        inputs = [part.name for part in self.program.populations if part.kind == "listed"]
        for name in batch.trains if isinstance(batch, Events) else batch:
            if name not in inputs:
                raise unknown("population of inputs", name, inputs)
        if isinstance(batch, Events):
            size, steps = batch.batch, batch.steps
        else:
            shapes = {tuple(each.shape[:2]) for each in batch.values()}
            if len(shapes) != 1:
                raise ModelError(f"batch: found (batch, steps) of {sorted(shapes)}: expected one of all inputs")
            size, steps = shapes.pop()
        if self._steps is not None and steps != self._steps:
            raise ModelError(f"batch: found {steps} steps: expected {self._steps}, the module's duration")
        return size, steps

    def _push(self, steps: int) -> dict[int, Any]:
        if steps not in self._pushes:
            self._pushes = {
                steps: {
                    k: layers.push(self.program, c, steps) for part in self.plan.parts for k, c in part.cells.items()
                }
            }
        return self._pushes[steps]

    def _emitted(self, index: int, given: Any, task: compiled.Task) -> Any:
        """The spikes of a generator, a dense tensor or packed."""
        part = self.program.populations[index]
        if given is None:
            inside = part.spike_steps <= task.steps
            steps, ids = part.spike_steps[inside] - 1, part.spike_ids[inside]
            every = np.repeat(np.arange(task.batch), len(steps))
            dense = np.zeros((task.batch, task.steps, part.size))
            np.add.at(dense, (every, np.tile(steps, task.batch), np.tile(ids, task.batch)), 1.0)
            return torch.tensor(dense, dtype=task.dtype)
        if isinstance(given, Train):
            if given.neuron.size and int(given.neuron.max()) >= part.size:
                raise ModelError(f"'{part.name}': found neuron {given.neuron.max()}: expected 0 to {part.size - 1}")
            ones = np.ones(len(given.neuron), dtype=np.float32 if task.dtype == torch.float32 else np.float64)
            return compiled.Packed(given.rows(task.steps), given.neuron, ones)
        if given.ndim != 3 or given.shape[2] != part.size:
            told = f"'{part.name}': found the shape {tuple(given.shape)}"
            raise ModelError(f"{told}: expected (batch, steps, {part.size})")
        return given.to(task.dtype)

    def _outcome(
        self, batch: Any, emitted: dict[int, Any], potentials: dict[int, Tensor], task: compiled.Task
    ) -> Outcome:
        outs = {name: self._index[name] for name in self.outputs}
        counts = {}
        for name, k in self._index.items():
            if isinstance(emitted.get(k), Tensor):
                counts[name] = lambda k=k: emitted[k].sum(1)
            elif k in emitted:
                size = self.program.populations[k].size
                counts[name] = lambda name=name, size=size: input_counts(batch, name, size)
        reset = {
            name: (lambda k=k: torch.where(emitted[k] > 0, self._reset(k, emitted[k]), potentials[k]))
            for name, k in outs.items()
        }
        wired = [each for part in self.plan.parts for each in (*part.outside, *part.inside)]
        active = {
            name: lambda k=k: active_updates(k, emitted, [each for each in wired if each.target == k], task)
            for name, k in self._index.items()
            if self.program.populations[k].kind == "neuron"
        }
        return Outcome(
            {name: emitted[k] for name, k in outs.items()},
            Told("population of the outputs", reset),
            Told("population", counts),
            Told("population of neurons", active),
            task.steps,
            self.program.resolution,
        )

    def _reset(self, population: int, like: Tensor) -> Tensor:
        return torch.as_tensor(self.program.populations[population].parameters["V_reset"], dtype=like.dtype)

    def _refuse_large(self, batch: int, steps: int) -> None:
        """Refuse a batch for which memory does not suffice, before any is taken."""
        neurons = sum(part.size for part in self.program.populations if part.kind == "neuron")
        bytes_ = torch.finfo(next(iter(self.weights.values())).dtype).bits // 8
        one = neurons * steps * (5 * bytes_ + 1)
        free = free_memory()
        if free is not None and batch * one > free:
            raise ModelError(
                f"a batch of {batch} recordings of {steps} steps needs about {batch * one / 1e9:.1f} GB: expected at "
                f"most what is free, {free / 1e9:.1f} GB",
                hint=f"a batch of {max(1, free // (2 * one))} takes half of it",
            )
