"""A network as a `torch.nn.Module`: weights are parameters, and a batch of spikes makes spikes with gradients.

`network_of` makes the network with what was learnt, for every other backend.
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
from neuro_torch.outcome import Outcome, Told, active_updates
from neuro_torch.problems import problems, without_gradient
from neuro_torch.scan import compiled, layers, operations
from neuro_torch.scan.layers import Plan, ScanTask, plan_of
from neuro_torch.stepping import Learning, Stepper, stepped
from neuro_torch.surrogates import Plain, Surrogate, surrogate_of
from neuro_torch.trainable import Named

__all__ = ["Module"]


class Module(torch.nn.Module):
    """A network whose weights learn by gradients, and whose spikes are those of every other backend.

    Args:
        net: the network; it is not changed.
        trainable: names of the projections whose weights learn; or what learns by name of a projection or a population:
            {"in_hidden": ["weight", "delay"], "hidden": ["tau_m", "V_th"]}. Weights that synapses share, such as
            kernels of a grid or one number for a projection, are one parameter.
        surrogate: stands in for the derivative of a spike, by name or itself, see `neuro_torch.surrogates`; or a plain
            function of x and slope, see `neuro_torch.surrogates.Own`.
        slope: of a surrogate that is given by name or as a function.
        duration: of a recording in ms; that of each batch if not given.
        outputs: populations whose spikes and potentials are wanted in time; if not given those from which no
            projection starts.
        seed: of everything random.
        dtype: of all numbers, torch's default if not given. With `torch.float64` spikes are those of `event`.
        damping: what gradients are multiplied by each time they go along a synapse of a recurrent part, 0 to 1.
        by: "kernels" (compiled, for CPUs), "torch" (torch's operations, for any device) or "steps"; what is fastest
            where the parameters are if not given. What no scan fits is stepped anyway. Gradients have gradients by
            "torch" only.

    Attributes:
        weights: the parameters by projection, in mV or pA as the network has them: rows by source of an `all_to_all`,
            kernels of a grid, else one for each synapse.
        delays: those that learn, by projection, in ms. While training they lie between two steps, and a spike arrives
            in both in shares; after `module.eval()`, and in `module.network()`, they are the nearest whole steps. One
            below a step counts as one.
        neurons: parameters of neurons that learn, by population and word; `hold` keeps them in their bounds.
        program: the network as backends see it.
        outputs: names of the populations that are wanted in time.

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
        self.surrogate, self.damping = surrogate_of(surrogate, slope), _share(damping)
        self._net, self._seed, self._by = net, seed, _one_of("by", by, (None, "kernels", "torch", "steps"))
        self._refuse()
        self._index = {part.name: k for k, part in enumerate(self.program.populations)}
        self._steps = None if duration is None else _steps(duration, net.resolution)
        self.outputs = self._outputs(outputs)
        kind = _floating(dtype or torch.get_default_dtype())
        projections, neurons = words.trainable(self.program, trainable)
        self.weights = Named(
            "projection whose weights learn",
            {name: self._first_weight(name, kind) for name, each in projections.items() if "weight" in each},
        )
        self.delays = Named(
            "projection whose delays learn",
            {name: self._first_delay(name, kind) for name, each in projections.items() if "delay" in each},
        )
        self.neurons = Named(
            "population whose parameters learn",
            {
                name: Named(f"parameter of '{name}' that learns", {w: self._first(name, w, kind) for w in each})
                for name, each in neurons.items()
            },
        )
        self._plan = plan_of(self.program, by, neurons)
        self._kept: dict[Any, Any] = {}
        self._listed: dict[int, layers.Synapses] = {}
        self._steppers: dict[torch.device, Stepper] = {}

    @property
    def plan(self) -> Plan:
        """Which part runs by what on the device where the parameters are; `str` shows it."""
        return replace(self._plan, by=self._scans()[1])

    def forward(self, batch: Events | Mapping[str, Any]) -> Outcome:
        """Run a batch from step 0.

        Args:
            batch: `Events`, or by population of generators a tensor of spikes or of any numbers by which weights are
                multiplied, (batch, steps, neurons) or (batch, steps, *shape of the population); it may have a gradient.
                A spike_generator that is not named emits what the network lists.

        Raises:
            ModelError: a name or a shape is wrong, something is NaN, delays or parameters of neurons are out of
                their bounds, or the batch needs more memory than is free.
        """
        size, steps = feeding.sizes(self.program, batch, self._steps)
        task = self._task(size, steps)
        named = batch.trains if isinstance(batch, Events) else batch
        asked = {
            k: feeding.checked(part, named.get(part.name))
            for k, part in enumerate(self.program.populations)
            if part.kind in ("listed", "poisson", "generator")
        }
        if not torch.compiler.is_compiling():
            memory.refuse_large(self._need(asked, task), task)
        given = {k: feeding.given_to(self.program.populations[k], each, task) for k, each in asked.items()}
        emitted, potentials = self._scanned(given, task) if self._plan.parts else self._stepped(given, task)
        return self._outcome(batch, emitted, potentials, task)

    def _need(self, asked: Mapping[int, Any], task: ScanTask) -> memory.Need:
        """What a batch takes; how much steps keep is counted once."""
        parts = self.program.populations

        def run(steps: int) -> None:
            few = replace(task, batch=1, steps=steps)
            begun = {k: feeding.beginning(each, steps) for k, each in asked.items()}
            self._stepped({k: feeding.given_to(parts[k], each, few) for k, each in begun.items()}, few)

        def tape() -> float:
            if "tape" not in self._kept:
                self._kept["tape"] = memory.kept_by_steps(run, task.steps)
            kept: float = self._kept["tape"]
            return kept

        return memory.need(self.program, self.plan, asked, task, tape)

    def _scanned(self, given: Mapping[int, Any], task: ScanTask) -> tuple[dict[int, Any], dict[int, Tensor]]:
        """What populations emit, and potentials at the ends of steps."""
        scans = self._scans()[0]
        populations = self.program.populations
        emitted = {k: feeding.emitted(self.program, populations[k], each, task, scans) for k, each in given.items()}
        weights = {q: self._weight(q, task) for q, p in enumerate(self.program.projections) if p.carries == "spikes"}
        potentials: dict[int, Tensor] = {}
        for part in self._plan.parts:
            drives: dict[int, Tensor] = {}
            for each, weight in self._ways(part.outside, weights):
                arrived = scans.drive(each, emitted[each.source], weight, task)
                drives[each.target] = drives[each.target] + arrived if each.target in drives else arrived
            for k in part.cells.keys() - drives.keys():
                drives[k] = torch.zeros(
                    task.batch, task.steps, part.cells[k].size, dtype=task.dtype, device=task.device
                )
            if any(populations[k].model.graded for k in part.cells):
                resolution = self.program.resolution
                emitted |= {k: graded_payloads(populations[k], drive, task, resolution) for k, drive in drives.items()}
                continue
            inside = self._ways(part.inside, weights)
            spikes, before = scans.scan(layers.component(part, inside), drives, [weight for _, weight in inside], task)
            emitted |= spikes
            for k in before.keys() & task.wanted:
                reset = torch.as_tensor(populations[k].parameters["V_reset"]).to(task.device, task.dtype)
                potentials[k] = torch.where(spikes[k] > 0, reset, before[k])
        return emitted, potentials

    def _ways(self, parts: Iterable[layers.Synapses], weights: Mapping[int, Tensor]) -> list[layers.Way]:
        """What spikes go along, with its weights: a projection, or two of shares of its weights where delays learn."""
        found: list[layers.Way] = []
        for part in parts:
            name = self.program.projections[part.projection].name
            if name not in self.delays:
                found.append((part, weights[part.projection]))
                continue
            listed, weight = self._one_by_one(part.projection), weights[part.projection]
            steps = words.in_steps(self.delays[name], self.program.resolution, name)
            found += layers.ways(listed, weight, steps, self.training)
        return found

    def _one_by_one(self, projection: int) -> layers.Synapses:
        """The synapses of a projection, listed."""
        if projection not in self._listed:
            self._listed[projection] = layers.synapses(self.program, projection, listed=True)
        return self._listed[projection]

    def _whole_steps(self, projection: int) -> layers.Synapses:
        """The synapses of a projection as its network has them."""
        name = self.program.projections[projection].name
        if name not in self.delays:
            return layers.synapses(self.program, projection)
        steps = words.in_steps(self.delays[name], self.program.resolution, name)
        return layers.delayed(self._one_by_one(projection), layers.rounded(steps))

    def _stepped(self, given: Mapping[int, Any], task: ScanTask) -> tuple[dict[int, Any], dict[int, Tensor]]:
        """The same, step by step."""
        populations = self.program.populations
        parameters = {name: dict(each.items()) for name, each in self.neurons.items()}
        inputs = {
            populations[k].name: feeding.dense(each, populations[k], task)
            for k, each in given.items()
            if each is not None
        }
        if task.device not in self._steppers:
            with torch.inference_mode(False):
                self._steppers = {task.device: Stepper(self.program, device=task.device, surrogate=self.surrogate)}
        delays = {name: delay if self.training else self._whole(name) for name, delay in self.delays.items()}
        tensors = Learning(dict(self.weights.items()), delays, parameters)
        return stepped(self._steppers[task.device], task, tensors, inputs)

    def _whole(self, name: str) -> Tensor:
        """The nearest whole steps of the delays of a projection, in ms."""
        steps = words.in_steps(self.delays[name].detach().double(), self.program.resolution, name)
        return steps.round() * self.program.resolution

    def hold(self) -> None:
        """Put what left its bounds back into them: for after each step of an optimiser.

        Delays are at least one step, parameters of neurons within the bounds that their model has, and V_th is above
        V_reset. What may not reach its bound, such as tau_m 0, is put 0.001 of its unit (ms, mV, pF) inside. Nothing
        else is changed.

        Raises:
            ModelError: what learns has become NaN or infinite, or a delay is longer than any may be; it says what.
        """
        words.hold(self.program, self.weights, self.delays, self.neurons)

    def network(self) -> neuro.Network:
        """The network with what was learnt, which every backend runs; what was drawn at random is listed in it.

        Raises:
            ModelError: something that was learnt is NaN or out of its bounds.
        """
        words.check(self.program, self.weights, self.delays, self.neurons)
        found = {part.name: q for q, part in enumerate(self.program.projections)}
        taken = {found[name]: w.detach().cpu().double().numpy().reshape(-1) for name, w in self.weights.items()}
        parameters = {
            (self._index[name], word): values.detach().cpu().double().numpy()
            for name, each in self.neurons.items()
            for word, values in each.items()
        }
        delays = {name: self._whole(name).cpu().numpy() for name in self.delays}
        return network_of(self._net, self._seed, taken, parameters, delays)

    def __getstate__(self) -> dict[str, Any]:
        """What a copy or a pickle has of it: all but what is made again when a batch asks for it."""
        return self.__dict__ | {"_kept": {}, "_listed": {}, "_steppers": {}}

    def on(self, net: neuro.Network) -> Module:
        """A module of another network that learns the same projections in the same way, with the same outputs.

        Its weights are not quantised.
        """
        like, learns = self._like(), {name: ["weight"] for name in self.weights}
        for name in self.delays:
            learns[name] = [*learns.get(name, []), "delay"]
        made = Module(
            net,
            learns | {name: list(each) for name, each in self.neurons.items()},
            surrogate=self.surrogate,
            duration=None if self._steps is None else self._steps * net.resolution,
            outputs=self.outputs,
            seed=self._seed,
            dtype=like.dtype,
            damping=self.damping,
            by=self._by,
        )
        made.to(like.device)
        return made

    def extra_repr(self) -> str:
        """What torch shows of it."""
        return f"{self.program.name!r}, outputs={list(self.outputs)}, surrogate={self.surrogate}"

    def _refuse(self) -> None:
        """Refuse a network that cannot be run or differentiated, with all reasons."""
        found = [*problems(self.program), *without_gradient(self.program)]
        if found:
            reasons = "".join(
                f"\n{f'{each.origin}: ' if each.origin else ''}{each.what}: {each.why}"
                f"{f'{chr(10)}  hint: {each.way_out}' if each.way_out else ''}"
                for each in found
            )
            count = f"{len(found)} problem{'s' * (len(found) > 1)}"
            raise ModelError(f"network '{self.program.name}' cannot be trained by gradients ({count}){reasons}")

    def _outputs(self, named: Sequence[str] | None) -> tuple[str, ...]:
        neurons = [part.name for part in self.program.populations if part.kind == "neuron"]
        named = [named] if isinstance(named, str) else named
        if named is None:
            sending = {self.program.populations[p.source].name for p in self.program.projections}
            return tuple(name for name in neurons if name not in sending) or tuple(neurons)
        for name in named:
            if name not in neurons:
                raise unknown("population of neurons", name, neurons)
        return tuple(named)

    def _scans(self) -> tuple[Any, str]:
        """What does the scans where the parameters are, and its name."""
        like = self._like()
        fits = like.device.type == "cpu" and like.dtype in (torch.float32, torch.float64)
        by = self._by or ("kernels" if fits else "torch")
        if not self._plan.parts:
            by = "steps"
        if by == "kernels" and not fits:
            message = f"by = 'kernels': parameters are {like.dtype} on '{like.device}': expected 32 or 64 bits on a CPU"
            raise ModelError(message, hint="by='torch' runs them")
        return compiled if by == "kernels" else operations, by

    def _like(self) -> Tensor:
        """A parameter, whose type and device are those of all."""
        return next(self.parameters())

    def _task(self, batch: int, steps: int) -> ScanTask:
        like, wanted = self._like(), frozenset(self._index[name] for name in self.outputs)
        if self._kept.get("steps") != steps:
            cells = {k: cell for part in self._plan.parts for k, cell in part.cells.items()}
            self._kept["steps"] = steps
            self._kept["push"] = {k: layers.push(self.program, cell, steps) for k, cell in cells.items()}
        push = self._kept["push"]
        return ScanTask(batch, steps, like.dtype, like.device, self.surrogate, self.damping, push, wanted)

    def _weight(self, projection: int, task: ScanTask) -> Tensor:
        """The weights of a projection; those that do not learn are the network's in the type of the others."""
        name, key = self.program.projections[projection].name, (projection, task.dtype, task.device)
        if name not in self.weights and key not in self._kept:
            # What is made in inference mode could never be trained with.
            with torch.inference_mode(False):
                self._kept[key] = torch.tensor(self._shaped(projection), dtype=task.dtype, device=task.device)
        weight: Tensor = self.weights[name] if name in self.weights else self._kept[key]
        part = self.program.projections[projection]
        sizes = self.program.populations[part.source].size, self.program.populations[part.target].size
        if weight.shape != (shape := layers.shape_of(part, sizes)):
            raise ModelError(f"weights of '{name}': found {tuple(weight.shape)}: expected the shape {shape}")
        return weight

    def _first_weight(self, name: str, dtype: torch.dtype) -> torch.nn.Parameter:
        index = [part.name for part in self.program.projections].index(name)
        return torch.nn.Parameter(torch.tensor(self._shaped(index), dtype=dtype))

    def _first_delay(self, name: str, dtype: torch.dtype) -> torch.nn.Parameter:
        part = next(part for part in self.program.projections if part.name == name)
        return torch.nn.Parameter(torch.tensor(part.delay * self.program.resolution, dtype=dtype))

    def _first(self, population: str, word: str, dtype: torch.dtype) -> torch.nn.Parameter:
        values = self.program.populations[self._index[population]].parameters[word]
        return torch.nn.Parameter(torch.tensor(values, dtype=dtype))

    def _shaped(self, projection: int) -> Floats:
        part = self.program.projections[projection]
        sizes = self.program.populations[part.source].size, self.program.populations[part.target].size
        return part.weight.reshape(layers.shape_of(part, sizes))

    def _outcome(self, batch: Any, emitted: dict[int, Any], potentials: dict[int, Tensor], task: ScanTask) -> Outcome:
        outs = {name: self._index[name] for name in self.outputs}
        sent = {k: self._messages(k, each) for k, each in emitted.items()}
        counts = {n: partial(self._count, batch, k, sent[k], task) for n, k in self._index.items() if k in sent}
        active = {
            part.name: partial(self._active, k, sent, task)
            for k, part in enumerate(self.program.populations)
            if part.kind == "neuron"
        }
        return Outcome(
            {name: emitted[k] for name, k in outs.items()},
            {name: potentials[k] for name, k in outs.items() if k in potentials},
            Told("population", counts),
            Told("population of neurons", active),
            task.steps,
            self.program.resolution,
            self.program,
        )

    def _messages(self, population: int, emitted: Any) -> Any:
        """What a population emitted as spikes, each of which counts as one where it carries a payload."""
        part = self.program.populations[population]
        if not part.model.graded or not isinstance(emitted, Tensor):
            return emitted
        return graded_messages(part, emitted, self.surrogate)

    def _count(self, batch: Any, index: int, emitted: Any, task: ScanTask) -> Tensor:
        """The spikes of each neuron of a population."""
        if isinstance(emitted, Tensor):
            summed: Tensor = torch.sum(emitted, 1)
            return summed
        part = self.program.populations[index]
        return torch.from_numpy(batch.counts(part.name, part.size)).to(task.device, task.dtype)

    def _active(self, population: int, emitted: Mapping[int, Any], task: ScanTask) -> Tensor:
        """The updates of a population that something arrives at, or a spike ends; delays that learn are whole."""
        parts = enumerate(self.program.projections)
        wired = [self._whole_steps(q) for q, part in parts if part.target == population and part.carries == "spikes"]
        return active_updates(population, emitted, wired, task, self._scans()[0])


def _steps(duration: Any, resolution: float) -> int:
    number = isinstance(duration, (int, float)) and not isinstance(duration, bool)
    if not number or duration <= 0.0:
        raise ModelError(f"duration = {duration!r}: expected a time > 0 in ms")
    return Clock(resolution).step(float(duration), "duration")


def _floating(dtype: Any) -> torch.dtype:
    if not isinstance(dtype, torch.dtype) or not dtype.is_floating_point:
        raise ModelError(f"dtype = {dtype!r}: expected a floating type of torch, such as torch.float64")
    return dtype


def _share(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value <= 1.0:
        raise ModelError(f"damping = {value!r}: expected a number from 0 to 1")
    return float(value)


def _one_of(word: str, value: Any, known: Sequence[Any]) -> Any:
    if value not in known:
        raise unknown(word, value, [each for each in known if each])
    return value


Parameters = Mapping[tuple[int, str], Floats]
"""By population and word."""


class Still:
    """A backend that runs nothing: it holds what was learnt, so that a simulation makes a network of it.

    Args:
        weights: by index of the projection; the others are the program's.
        parameters: of neurons, likewise.
    """

    name = "torch"
    description = "holds what was learnt"

    def __init__(self, weights: Mapping[int, Floats], parameters: Parameters) -> None:
        self._weights, self._parameters = weights, parameters

    def problems(self, program: Program, **options: Any) -> list[Any]:
        """Nothing is run, so nothing is refused."""
        return []

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> Any:
        """What answers for an engine at step 0."""
        return _Held(program, self._weights, self._parameters)


class _Held:
    step = 0

    def __init__(self, program: Program, weights: Mapping[int, Floats], parameters: Parameters) -> None:
        self._program, self._weights, self._parameters = program, weights, parameters

    def get(self, population: int, name: str, ids: NDArray[np.int64] | None = None) -> Floats:
        """A parameter of all neurons."""
        part = self._program.populations[population]
        return np.broadcast_to(self._parameters.get((population, name), part.parameters[name]), part.size)

    def get_synapses(self, projection: int, name: str) -> Floats:
        """The weight of every synapse."""
        part = self._program.projections[projection]
        return np.broadcast_to(self._weights.get(projection, part.weight), part.size)


def network_of(
    net: neuro.Network,
    seed: int,
    weights: Mapping[int, Floats],
    parameters: Parameters,
    delays: Mapping[str, Floats],
) -> neuro.Network:
    """A network with other weights, parameters and delays (ms); what was drawn at random is listed in it."""
    held: Any = Still(weights, parameters)
    sim = neuro.compile(net, backend=held, seed=seed)
    made, sizes = sim.network(), {part.name: part.size for part in sim.program.populations}
    for name, delay in delays.items():
        part = made.projections[name]
        shaped: Any = float(delay[0]) if delay.size == 1 else delay
        if isinstance(part.rule, neuro.all_to_all) and delay.size > 1:
            shaped = delay.reshape(sizes[part.source], sizes[part.target])
        made.projections[name] = replace(part, delay=shaped)
    return made
