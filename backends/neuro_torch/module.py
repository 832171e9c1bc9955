"""A network as a `torch.nn.Module`: weights are parameters, and a batch of spikes makes spikes with gradients."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import torch
from torch import Tensor

import neuro
from neuro.compiler import compile_network
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, unknown
from neuro.program.program import Floats
from neuro_torch import feeding, learnt
from neuro_torch.active import active_updates
from neuro_torch.events import Events
from neuro_torch.outcome import Outcome, Told
from neuro_torch.plan import Plan, plan_of
from neuro_torch.scan import compiled, layers, operations
from neuro_torch.scan.task import Task
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
        by: "kernels" (compiled, for CPUs) or "torch" (torch's operations, for any device); that of the device of the
            parameters if not given.

    Attributes:
        weights: the parameters by projection, in mV or pA as the network has them: rows by source of an `all_to_all`,
            kernels of a grid, else one for each synapse.
        program: the network as backends see it.
        outputs: names of the populations that are wanted in time.

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
        by: str | None = None,
    ) -> None:
        super().__init__()
        if not isinstance(net, neuro.Network):
            raise ModelError(f"neuro_torch.Module: found {net!r}: expected a Network", hint="neuro.load reads one")
        self.program = compile_network(net, seed)
        self.surrogate, self.damping = surrogate_of(surrogate, slope), _share(damping)
        self._net, self._seed, self._by = net, seed, _one_of("by", by, (None, "kernels", "torch"))
        self._index = {part.name: k for k, part in enumerate(self.program.populations)}
        self._steps = None if duration is None else Clock(net.resolution).step(float(duration), "duration")
        self.outputs = self._outputs(outputs)
        self._plan = plan_of(self.program)
        known = {part.name: q for q, part in enumerate(self.program.projections) if part.carries == "spikes"}
        names = _trainable(trainable, known)
        kind = dtype or torch.get_default_dtype()
        self.weights = torch.nn.ParameterDict(
            {name: torch.nn.Parameter(torch.tensor(self._shaped(known[name]), dtype=kind)) for name in names}
        )
        self._kept: dict[Any, Any] = {}

    @property
    def plan(self) -> Plan:
        """Which part runs by what on the device where the parameters are; `str` tells it."""
        return Plan(self.program, self._plan.parts, self._scans()[1], self._plan.why)

    def forward(self, batch: Events | Mapping[str, Any]) -> Outcome:
        """Run a batch from step 0.

        Args:
            batch: `Events`, or by population of generators a dense tensor, (batch, steps, neurons), of spikes or of any
                numbers by which weights are multiplied; it may have a gradient. A spike_generator that is not named
                emits what the network lists.

        Raises:
            ModelError: a name or a shape is wrong, or the batch needs more memory than is free.
        """
        size, steps = feeding.sizes(self.program, batch, self._steps)
        task, scans = self._task(size, steps), self._scans()[0]
        feeding.refuse_large(self.program, size, steps, task.dtype)
        given = batch.trains if isinstance(batch, Events) else batch
        emitted: dict[int, Any] = {
            k: feeding.emitted(part, given.get(part.name), task, scans)
            for k, part in enumerate(self.program.populations)
            if part.kind == "listed"
        }
        weights = {q: self._weight(q, task) for q, p in enumerate(self.program.projections) if p.carries == "spikes"}
        potentials: dict[int, Tensor] = {}
        for part in self._plan.parts:
            drives: dict[int, Tensor] = {}
            for each in part.outside:
                arrived = scans.drive(each, emitted[each.source], weights[each.projection], task)
                drives[each.target] = drives[each.target] + arrived if each.target in drives else arrived
            for k in part.cells.keys() - drives.keys():
                drives[k] = torch.zeros(size, steps, part.cells[k].size, dtype=task.dtype, device=task.device)
            spikes, before = scans.scan(part, drives, [weights[s.projection] for s in part.inside], task)
            emitted |= spikes
            potentials |= before
        return self._outcome(batch, emitted, potentials, task)

    def network(self) -> neuro.Network:
        """The network with what was learnt, which every backend runs; what was drawn at random is listed in it."""
        found = {part.name: q for q, part in enumerate(self.program.projections)}
        taken = {found[name]: w.detach().cpu().double().numpy().reshape(-1) for name, w in self.weights.items()}
        return learnt.network_of(self._net, self._seed, taken)

    def on(self, net: neuro.Network) -> Module:
        """A module of another network that learns the same projections in the same way, with the same outputs."""
        like = self._like()
        made = Module(
            net,
            list(self.weights),
            surrogate=self.surrogate,
            duration=None if self._steps is None else self._steps * net.resolution,
            outputs=self.outputs,
            seed=self._seed,
            dtype=like.dtype,
            damping=self.damping,
            by=self._by,
        )
        return made.to(like.device)

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

    def _scans(self) -> tuple[Any, str]:
        """What does the scans where the parameters are, and its name."""
        by = self._by or ("kernels" if self._like().device.type == "cpu" else "torch")
        return {"kernels": compiled, "torch": operations}[by], by

    def _like(self) -> Tensor:
        """A parameter, whose type and device are those of all."""
        return next(iter(self.weights.values()))

    def _task(self, batch: int, steps: int) -> Task:
        like, wanted = self._like(), frozenset(self._index[name] for name in self.outputs)
        if self._kept.get("steps") != steps:
            cells = {k: cell for part in self._plan.parts for k, cell in part.cells.items()}
            self._kept["steps"] = steps
            self._kept["push"] = {k: layers.push(self.program, cell, steps) for k, cell in cells.items()}
        push = self._kept["push"]
        return Task(batch, steps, like.dtype, like.device, self.surrogate, self.damping, push, wanted)

    def _weight(self, projection: int, task: Task) -> Tensor:
        """The weights of a projection; those that do not learn are the network's in the type of the others."""
        name, key = self.program.projections[projection].name, (projection, task.dtype, task.device)
        if name in self.weights:
            return self.weights[name]
        if key not in self._kept:
            self._kept[key] = torch.tensor(self._shaped(projection), dtype=task.dtype, device=task.device)
        kept: Tensor = self._kept[key]
        return kept

    def _shaped(self, projection: int) -> Floats:
        part = self.program.projections[projection]
        sizes = self.program.populations[part.source].size, self.program.populations[part.target].size
        return part.weight.reshape(layers.shape_of(part, sizes))

    def _outcome(self, batch: Any, emitted: dict[int, Any], potentials: dict[int, Tensor], task: Task) -> Outcome:
        outs = {name: self._index[name] for name in self.outputs}
        counts = {
            name: partial(self._count, batch, k, emitted[k], task) for name, k in self._index.items() if k in emitted
        }
        wired = [each for part in self._plan.parts for each in (*part.outside, *part.inside)]
        active = {
            part.name: partial(active_updates, k, emitted, [w for w in wired if w.target == k], task, self._scans()[0])
            for k, part in enumerate(self.program.populations)
            if part.kind == "neuron"
        }
        after = {name: partial(self._after, k, emitted[k], potentials[k]) for name, k in outs.items()}
        return Outcome(
            {name: emitted[k] for name, k in outs.items()},
            Told("population of the outputs", after),
            Told("population", counts),
            Told("population of neurons", active),
            task.steps,
            self.program.resolution,
        )

    def _count(self, batch: Any, index: int, emitted: Any, task: Task) -> Tensor:
        """The spikes of each neuron of a population."""
        if isinstance(emitted, Tensor):
            summed: Tensor = torch.sum(emitted, 1)
            return summed
        part = self.program.populations[index]
        return torch.from_numpy(batch.counts(part.name, part.size)).to(task.device, task.dtype)

    def _after(self, index: int, spikes: Tensor, before: Tensor) -> Tensor:
        """The potential after the resets."""
        reset = torch.as_tensor(self.program.populations[index].parameters["V_reset"])
        after: Tensor = torch.where(spikes > 0, reset.to(before.device, before.dtype), before)
        return after


def _trainable(given: Iterable[str], known: Mapping[str, int]) -> list[str]:
    names = [given] if isinstance(given, str) else list(given)
    if not names:
        raise ModelError("trainable: found no projection: expected at least one", hint=f"known: {', '.join(known)}")
    for name in names:
        if name not in known:
            raise unknown("projection", name, known)
        if "." in name:
            raise ModelError(f"trainable: '{name}': torch takes no '.' in a name: expected a projection without one")
    return names


def _share(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value <= 1.0:
        raise ModelError(f"damping = {value!r}: expected a number from 0 to 1")
    return float(value)


def _one_of(word: str, value: Any, known: Sequence[Any]) -> Any:
    if value not in known:
        raise unknown(word, value, [each for each in known if each])
    return value
