"""A network as a `torch.nn.Module`: weights are parameters, and a batch of input spikes gives differentiable spikes.

`network_of` returns the network with the learnt values, for every other backend.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

import neuro
from neuro.compiler import compile_network
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, unknown
from neuro.program.program import Floats, Program
from neuro_torch import feeding, memory, trainable as words
from neuro_torch.cells import graded_messages, graded_payloads
from neuro_torch.events import Events
from neuro_torch.outcome import LazyMapping, Outcome, active_updates
from neuro_torch.problems import problems, without_gradient
from neuro_torch.scan import compiled, layers, operations
from neuro_torch.scan.layers import Plan, ScanTask, plan_of
from neuro_torch.stepping import Learning, Stepper, stepped
from neuro_torch.surrogates import Plain, Surrogate, surrogate_of
from neuro_torch.trainable import Named

__all__ = ["Module"]


class Module(torch.nn.Module):
    """A network that learns by gradients and emits the same spikes as every other backend.

    Args:
        net: the network; it is not changed.
        trainable: names of the projections whose weights learn; or the names of quantities that learn, by projection or
            population: {"in_hidden": ["weight", "delay"], "hidden": ["tau_m", "V_th"]}. Weights that synapses share,
            such as kernels of a grid or one number for a projection, are one parameter.
        surrogate: derivative of a spike: a name, a `neuro_torch.surrogates.Surrogate`, or a plain function of x and
            slope, see `neuro_torch.surrogates.Own`.
        slope: slope of a surrogate given by name or as a function.
        duration: length of a recording in ms; by default the length of each batch.
        outputs: populations whose spikes and potentials are returned for every step; by default those that are the
            source of no projection.
        seed: seed of all random draws.
        dtype: dtype of all numbers, by default torch's default. With `torch.float64` spikes equal those of `event`.
        damping: factor of gradients each time they pass a synapse of a recurrent part, 0 to 1.
        by: "kernels" (compiled, for CPUs), "torch" (torch's operations, for any device) or "steps"; by default the
            fastest on the parameters' device. A network that no scan supports is stepped in any case. Second-order
            gradients need "torch".

    Attributes:
        weights: the weights that learn, by projection, in mV or pA as in the network: one row per source for
            `all_to_all`, kernels for a grid, else one weight per synapse.
        delays: the delays that learn, by projection, in ms. In training mode a delay may lie between two steps, and a
            spike arrives in both in shares. After `module.eval()`, and in `module.network()`, delays are rounded to
            steps. A delay below one step counts as one step.
        neurons: the parameters of neurons that learn, by population and name; `hold` keeps them in their bounds.
        program: the compiled network.
        outputs: names of the output populations.

    Raises:
        ModelError: a name is unknown, nothing is trainable, or the network cannot be differentiated.
    """

    def __init__(
        self,
        net: neuro.Network,
        trainable: Iterable[str] | Mapping[str, Iterable[str] | str],
        *,
        surrogate: str | Surrogate | Plain = "fast_sigmoid",
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
        self.surrogate, self.damping = surrogate_of(surrogate, slope), _check_damping(damping)
        self._net, self._seed, self._by = net, seed, _check_choice("by", by, (None, "kernels", "torch", "steps"))
        self._refuse()
        self._index = {part.name: k for k, part in enumerate(self.program.populations)}
        self._steps = None if duration is None else _duration_in_steps(duration, net.resolution)
        self.outputs = self._outputs(outputs)
        kind = _check_dtype(dtype or torch.get_default_dtype())
        projections, neurons = words.trainable(self.program, trainable)
        self.weights = Named(
            "projection whose weights learn",
            {name: self._initial_weight(name, kind) for name, names in projections.items() if "weight" in names},
        )
        self.delays = Named(
            "projection whose delays learn",
            {name: self._initial_delay(name, kind) for name, names in projections.items() if "delay" in names},
        )
        self.neurons = Named(
            "population whose parameters learn",
            {
                name: Named(
                    f"parameter of '{name}' that learns", {w: self._initial_parameter(name, w, kind) for w in names}
                )
                for name, names in neurons.items()
            },
        )
        self._plan = plan_of(self.program, by, neurons)
        self._cache: dict[Any, Any] = {}
        self._synapse_lists: dict[int, layers.Synapses] = {}
        self._steppers: dict[torch.device, Stepper] = {}

    @property
    def plan(self) -> Plan:
        """The scans or steps that run each part on the parameters' device; `str` shows them."""
        return replace(self._plan, by=self._scans()[1])

    def forward(self, batch: Events | Mapping[str, Any]) -> Outcome:
        """Run a batch from step 0.

        Args:
            batch: `Events`, or a tensor for each population of generators: spikes or real factors of the weights,
                (batch, steps, neurons) or (batch, steps, *shape of the population); it may have a gradient. A
                spike_generator that is not named emits the spikes that the network lists.

        Raises:
            ModelError: a name or a shape is wrong, an input is NaN, delays or parameters of neurons are out of their
                bounds, or the batch needs more memory than is free.
        """
        size, steps = feeding.sizes(self.program, batch, self._steps)
        task = self._task(size, steps)
        inputs = batch.trains if isinstance(batch, Events) else batch
        checked = {
            k: feeding.checked(part, inputs.get(part.name))
            for k, part in enumerate(self.program.populations)
            if part.kind in ("listed", "poisson", "generator")
        }
        if not torch.compiler.is_compiling():
            memory.refuse_large(self._need(checked, task), task)
        converted = {k: feeding.convert(self.program.populations[k], value, task) for k, value in checked.items()}
        emitted, potentials = self._run_scans(converted, task) if self._plan.parts else self._run_steps(converted, task)
        return self._outcome(batch, emitted, potentials, task)

    def _need(self, checked: Mapping[int, Any], task: ScanTask) -> memory.Need:
        """Return the memory of a batch; the bytes that steps save are measured once."""
        parts = self.program.populations

        def run(steps: int) -> None:
            short_task = replace(task, batch=1, steps=steps)
            beginnings = {k: feeding.beginning(value, steps) for k, value in checked.items()}
            self._run_steps(
                {k: feeding.convert(parts[k], value, short_task) for k, value in beginnings.items()}, short_task
            )

        def tape() -> float:
            if "tape" not in self._cache:
                self._cache["tape"] = memory.saved_per_step(run, task.steps)
            saved_bytes: float = self._cache["tape"]
            return saved_bytes

        return memory.need(self.program, self.plan, checked, task, tape)

    def _run_scans(self, inputs: Mapping[int, Any], task: ScanTask) -> tuple[dict[int, Any], dict[int, Tensor]]:
        """Return spikes by population, and potentials of the outputs at the ends of steps, by scans."""
        scans = self._scans()[0]
        populations = self.program.populations
        emitted = {k: feeding.emitted(self.program, populations[k], value, task, scans) for k, value in inputs.items()}
        weights = {q: self._weight(q, task) for q, p in enumerate(self.program.projections) if p.carries == "spikes"}
        potentials: dict[int, Tensor] = {}
        for part in self._plan.parts:
            drives: dict[int, Tensor] = {}
            for synapses, weight in self._paths(part.outside, weights):
                arrived = scans.drive(synapses, emitted[synapses.source], weight, task)
                drives[synapses.target] = drives[synapses.target] + arrived if synapses.target in drives else arrived
            for k in part.cells.keys() - drives.keys():
                drives[k] = torch.zeros(
                    task.batch, task.steps, part.cells[k].size, dtype=task.dtype, device=task.device
                )
            if any(populations[k].model.graded for k in part.cells):
                resolution = self.program.resolution
                emitted |= {k: graded_payloads(populations[k], drive, task, resolution) for k, drive in drives.items()}
                continue
            inside = self._paths(part.inside, weights)
            spikes, before = scans.scan(layers.component(part, inside), drives, [weight for _, weight in inside], task)
            emitted |= spikes
            for k in before.keys() & task.potentials_of:
                reset = torch.as_tensor(populations[k].parameters["V_reset"]).to(task.device, task.dtype)
                potentials[k] = torch.where(spikes[k] > 0, reset, before[k])
        return emitted, potentials

    def _paths(self, parts: Iterable[layers.Synapses], weights: Mapping[int, Tensor]) -> list[layers.Path]:
        """Return the paths of spikes with their weights: one per projection, or two if delays learn."""
        paths: list[layers.Path] = []
        for part in parts:
            name = self.program.projections[part.projection].name
            if name not in self.delays:
                paths.append((part, weights[part.projection]))
                continue
            synapse_list, weight = self._synapse_list(part.projection), weights[part.projection]
            steps = words.in_steps(self.delays[name], self.program.resolution, name)
            paths += layers.paths(synapse_list, weight, steps, self.training)
        return paths

    def _synapse_list(self, projection: int) -> layers.Synapses:
        """Return the synapses of a projection as a list."""
        if projection not in self._synapse_lists:
            self._synapse_lists[projection] = layers.synapses(self.program, projection, by_synapse=True)
        return self._synapse_lists[projection]

    def _rounded_synapses(self, projection: int) -> layers.Synapses:
        """Return the synapses of a projection with delays rounded to steps."""
        name = self.program.projections[projection].name
        if name not in self.delays:
            return layers.synapses(self.program, projection)
        steps = words.in_steps(self.delays[name], self.program.resolution, name)
        return layers.delayed(self._synapse_list(projection), layers.rounded(steps))

    def _run_steps(self, by_index: Mapping[int, Any], task: ScanTask) -> tuple[dict[int, Any], dict[int, Tensor]]:
        """Return spikes and potentials as `_run_scans`, step by step."""
        populations = self.program.populations
        parameters = {name: dict(values.items()) for name, values in self.neurons.items()}
        inputs = {
            populations[k].name: feeding.dense(values, populations[k], task)
            for k, values in by_index.items()
            if values is not None
        }
        if task.device not in self._steppers:
            with torch.inference_mode(False):
                self._steppers = {task.device: Stepper(self.program, device=task.device, surrogate=self.surrogate)}
        delays = {name: delay if self.training else self._rounded_delays(name) for name, delay in self.delays.items()}
        tensors = Learning(dict(self.weights.items()), delays, parameters)
        return stepped(self._steppers[task.device], task, tensors, inputs)

    def _rounded_delays(self, name: str) -> Tensor:
        """Return the delays of a projection rounded to steps, in ms."""
        steps = words.in_steps(self.delays[name].detach().double(), self.program.resolution, name)
        return steps.round() * self.program.resolution

    def hold(self) -> None:
        """Clip learnt values to their bounds; call this after each step of an optimiser.

        Delays become at least one step, parameters of neurons stay within the bounds of their model, and V_th stays
        above V_reset. Values stay 0.001 units (ms, mV, pF) away from an excluded bound, such as 0 of tau_m.
        Other values are not changed.

        Raises:
            ModelError: a learnt value is NaN or infinite, or a delay is too long; the message names it.
        """
        words.hold(self.program, self.weights, self.delays, self.neurons)

    def network(self) -> neuro.Network:
        """Return the network with the learnt values, which every backend runs; random draws are listed in it.

        Raises:
            ModelError: a learnt value is NaN or out of its bounds.
        """
        words.check(self.program, self.weights, self.delays, self.neurons)
        index_of = {part.name: q for q, part in enumerate(self.program.projections)}
        weights = {index_of[name]: w.detach().cpu().double().numpy().reshape(-1) for name, w in self.weights.items()}
        parameters = {
            (self._index[name], word): values.detach().cpu().double().numpy()
            for name, tensors in self.neurons.items()
            for word, values in tensors.items()
        }
        delays = {name: self._rounded_delays(name).cpu().numpy() for name in self.delays}
        return network_of(self._net, self._seed, weights, parameters, delays)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy or pickle, without the caches."""
        return self.__dict__ | {"_cache": {}, "_synapse_lists": {}, "_steppers": {}}

    def on(self, net: neuro.Network) -> Module:
        """Return a module of another network that learns the same projections in the same way, with the same outputs.

        The weights of the new module are not quantised.
        """
        like, learns = self._like(), {name: ["weight"] for name in self.weights}
        for name in self.delays:
            learns[name] = [*learns.get(name, []), "delay"]
        module = Module(
            net,
            learns | {name: list(names) for name, names in self.neurons.items()},
            surrogate=self.surrogate,
            duration=None if self._steps is None else self._steps * net.resolution,
            outputs=self.outputs,
            seed=self._seed,
            dtype=like.dtype,
            damping=self.damping,
            by=self._by,
        )
        module.to(like.device)
        return module

    def extra_repr(self) -> str:
        """Return the line that `repr` shows."""
        return f"{self.program.name!r}, outputs={list(self.outputs)}, surrogate={self.surrogate}"

    def _refuse(self) -> None:
        """Raise an error with all reasons why the network cannot run or be differentiated, if there are any."""
        refusals = [*problems(self.program), *without_gradient(self.program)]
        if refusals:
            reasons = "".join(
                f"\n{f'{refusal.origin}: ' if refusal.origin else ''}{refusal.what}: {refusal.why}"
                f"{f'{chr(10)}  hint: {refusal.way_out}' if refusal.way_out else ''}"
                for refusal in refusals
            )
            count = f"{len(refusals)} problem{'s' * (len(refusals) > 1)}"
            raise ModelError(f"network '{self.program.name}' cannot be trained by gradients ({count}){reasons}")

    def _outputs(self, names: Sequence[str] | None) -> tuple[str, ...]:
        neurons = [part.name for part in self.program.populations if part.kind == "neuron"]
        names = [names] if isinstance(names, str) else names
        if names is None:
            sending = {self.program.populations[p.source].name for p in self.program.projections}
            return tuple(name for name in neurons if name not in sending) or tuple(neurons)
        for name in names:
            if name not in neurons:
                raise unknown("population of neurons", name, neurons)
        return tuple(names)

    def _scans(self) -> tuple[Any, str]:
        """Return the implementation of the scans on the parameters' device, and its name."""
        like = self._like()
        fits = like.device.type == "cpu" and like.dtype in (torch.float32, torch.float64)
        implementation = self._by or ("kernels" if fits else "torch")
        if not self._plan.parts:
            implementation = "steps"
        if implementation == "kernels" and not fits:
            message = f"by = 'kernels': parameters are {like.dtype} on '{like.device}': expected 32 or 64 bits on a CPU"
            raise ModelError(message, hint="by='torch' runs them")
        return compiled if implementation == "kernels" else operations, implementation

    def _like(self) -> Tensor:
        """Return any parameter; all have the same dtype and device."""
        return next(self.parameters())

    def _task(self, batch: int, steps: int) -> ScanTask:
        like, outputs = self._like(), frozenset(self._index[name] for name in self.outputs)
        if self._cache.get("steps") != steps:
            cells = {k: cell for part in self._plan.parts for k, cell in part.cells.items()}
            self._cache["steps"] = steps
            self._cache["push"] = {k: layers.push(self.program, cell, steps) for k, cell in cells.items()}
        push = self._cache["push"]
        return ScanTask(batch, steps, like.dtype, like.device, self.surrogate, self.damping, push, outputs)

    def _weight(self, projection: int, task: ScanTask) -> Tensor:
        """Return the weights of a projection, with the parameters' dtype and device."""
        name, key = self.program.projections[projection].name, (projection, task.dtype, task.device)
        if name not in self.weights and key not in self._cache:
            # A tensor made in inference mode could not be used in a later training.
            with torch.inference_mode(False):
                self._cache[key] = torch.tensor(self._weight_in_shape(projection), dtype=task.dtype, device=task.device)
        weight: Tensor = self.weights[name] if name in self.weights else self._cache[key]
        part = self.program.projections[projection]
        sizes = self.program.populations[part.source].size, self.program.populations[part.target].size
        if weight.shape != (shape := layers.shape_of(part, sizes)):
            raise ModelError(f"weights of '{name}': found {tuple(weight.shape)}: expected the shape {shape}")
        return weight

    def _initial_weight(self, name: str, dtype: torch.dtype) -> torch.nn.Parameter:
        index = [part.name for part in self.program.projections].index(name)
        return torch.nn.Parameter(torch.tensor(self._weight_in_shape(index), dtype=dtype))

    def _initial_delay(self, name: str, dtype: torch.dtype) -> torch.nn.Parameter:
        part = next(part for part in self.program.projections if part.name == name)
        return torch.nn.Parameter(torch.tensor(part.delay * self.program.resolution, dtype=dtype))

    def _initial_parameter(self, population: str, word: str, dtype: torch.dtype) -> torch.nn.Parameter:
        values = self.program.populations[self._index[population]].parameters[word]
        return torch.nn.Parameter(torch.tensor(values, dtype=dtype))

    def _weight_in_shape(self, projection: int) -> Floats:
        part = self.program.projections[projection]
        sizes = self.program.populations[part.source].size, self.program.populations[part.target].size
        return part.weight.reshape(layers.shape_of(part, sizes))

    def _outcome(self, batch: Any, emitted: dict[int, Any], potentials: dict[int, Tensor], task: ScanTask) -> Outcome:
        outputs = {name: self._index[name] for name in self.outputs}
        messages = {k: self._messages(k, spikes) for k, spikes in emitted.items()}
        counts = {n: partial(self._count, batch, k, messages[k], task) for n, k in self._index.items() if k in messages}
        active = {
            part.name: partial(self._active, k, messages, task)
            for k, part in enumerate(self.program.populations)
            if part.kind == "neuron"
        }
        return Outcome(
            {name: emitted[k] for name, k in outputs.items()},
            {name: potentials[k] for name, k in outputs.items() if k in potentials},
            LazyMapping("population", counts),
            LazyMapping("population of neurons", active),
            task.steps,
            self.program.resolution,
            self.program,
        )

    def _messages(self, population: int, emitted: Any) -> Any:
        """Return the spikes of a population; each graded message counts as one."""
        part = self.program.populations[population]
        if not part.model.graded or not isinstance(emitted, Tensor):
            return emitted
        return graded_messages(part, emitted, self.surrogate)

    def _count(self, batch: Any, index: int, emitted: Any, task: ScanTask) -> Tensor:
        """Return the number of spikes of each neuron of a population."""
        if isinstance(emitted, Tensor):
            summed: Tensor = torch.sum(emitted, 1)
            return summed
        part = self.program.populations[index]
        return torch.from_numpy(batch.counts(part.name, part.size)).to(task.device, task.dtype)

    def _active(self, population: int, emitted: Mapping[int, Any], task: ScanTask) -> Tensor:
        """Return the number of active updates of a population, with learnt delays rounded to steps."""
        parts = enumerate(self.program.projections)
        incoming = [
            self._rounded_synapses(q) for q, part in parts if part.target == population and part.carries == "spikes"
        ]
        return active_updates(population, emitted, incoming, task, self._scans()[0])


def _duration_in_steps(duration: Any, resolution: float) -> int:
    number = isinstance(duration, (int, float)) and not isinstance(duration, bool)
    if not number or duration <= 0.0:
        raise ModelError(f"duration = {duration!r}: expected a time > 0 in ms")
    return Clock(resolution).step(float(duration), "duration")


def _check_dtype(dtype: Any) -> torch.dtype:
    if not isinstance(dtype, torch.dtype) or not dtype.is_floating_point:
        raise ModelError(f"dtype = {dtype!r}: expected a floating type of torch, such as torch.float64")
    return dtype


def _check_damping(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value <= 1.0:
        raise ModelError(f"damping = {value!r}: expected a number from 0 to 1")
    return float(value)


def _check_choice(word: str, value: Any, choices: Sequence[Any]) -> Any:
    if value not in choices:
        raise unknown(word, value, [choice for choice in choices if choice])
    return value


Parameters = Mapping[tuple[int, str], Floats]
"""Parameter values by index of the population and name."""


class LearntValues:
    """A backend that runs nothing but holds the learnt values, so that `Simulation.network` can list them.

    Args:
        weights: by index of the projection; other projections keep the program's weights.
        parameters: parameters of neurons, by index of the population and name.
    """

    name = "torch"
    description = "holds learnt values"

    def __init__(self, weights: Mapping[int, Floats], parameters: Parameters) -> None:
        self._weights, self._parameters = weights, parameters

    def problems(self, program: Program, **options: Any) -> list[Any]:
        """Return no problems, since nothing runs."""
        return []

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> Any:
        """Return an engine at step 0 that only answers `get` and `get_synapses`."""
        return _LearntValuesEngine(program, self._weights, self._parameters)


class _LearntValuesEngine:
    step = 0

    def __init__(self, program: Program, weights: Mapping[int, Floats], parameters: Parameters) -> None:
        self._program, self._weights, self._parameters = program, weights, parameters

    def get(self, population: int, name: str, ids: NDArray[np.int64] | None = None) -> Floats:
        """Return a parameter of all neurons."""
        part = self._program.populations[population]
        return np.broadcast_to(self._parameters.get((population, name), part.parameters[name]), part.size)

    def get_synapses(self, projection: int, name: str) -> Floats:
        """Return the weight of every synapse."""
        part = self._program.projections[projection]
        return np.broadcast_to(self._weights.get(projection, part.weight), part.size)


def network_of(
    net: neuro.Network,
    seed: int,
    weights: Mapping[int, Floats],
    parameters: Parameters,
    delays: Mapping[str, Floats],
) -> neuro.Network:
    """Return a network with other weights, parameters and delays (ms); random draws are listed in it."""
    backend: Any = LearntValues(weights, parameters)
    sim = neuro.compile(net, backend=backend, seed=seed)
    network, sizes = sim.network(), {part.name: part.size for part in sim.program.populations}
    for name, delay in delays.items():
        part = network.projections[name]
        shaped: Any = float(delay[0]) if delay.size == 1 else delay
        if isinstance(part.rule, neuro.all_to_all) and delay.size > 1:
            shaped = delay.reshape(sizes[part.source], sizes[part.target])
        network.projections[name] = replace(part, delay=shaped)
    return network
