"""Convert the network that a script of PyNN built."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import neuro
from neuro import (
    ModelError,
    Network,
    ac_generator,
    all_to_all,
    dc_generator,
    gamma_sup_generator,
    inhomogeneous_poisson_generator,
    noise_generator,
    one_to_one,
    pairs,
    poisson_generator,
    spike_generator,
    spinnaker_learning,
    static,
    stdp,
    stdp_dopa,
    stdp_nn_symm,
    stdp_triplet,
    step_current_generator,
    tsodyks2,
    vogels_sprekeler,
)
from neuro.apps import Where
from neuro.extend import Rule
from neuro_exchange.pynn.cells import BY_NAME, DEPENDENCES, Cell, difference
from neuro_exchange.pynn.parts import Projection
from neuro_exchange.pynn.session import Experiment
from neuro_exchange.pynn.standard import delta_jump

_OF_POST = {
    **dict.fromkeys(("SpikePairRule", "SpikeNearestPairRule", "PfisterSpikeTriplet"), "tau_minus"),
    "Vogels2011Rule": "tau",
}
"""For each rule of PyNN, the name of its time constant of target spikes."""
TIMINGS = {
    **{"SpikePairRule": "pair", "SpikeNearestPairRule": "nearest", "PfisterSpikeTriplet": "triplet"},
    **{"Vogels2011Rule": "vogels", "RecurrentRule": "recurrent"},
}
DEPENDENCES_OF_PROGRAMS = {
    **dict.fromkeys(("AdditiveWeightDependence", "WeightDependenceAdditiveTriplet"), "additive"),
    "MultiplicativeWeightDependence": "multiplicative",
}
"""Values of `dependence` (and above, in `TIMINGS`, of `timing`) of `spinnaker_learning` for sPyNNaker's rules."""
_NEVER = 1e10
"""PyNN's default duration of a source, in ms; current sources stop at 100 times this time by default."""
_ALMOST = 1e-6
"""Tolerance, in steps, for times on the grid of steps, since scripts compute with floating-point numbers."""


class Incomplete(Exception):
    """Raised for a part that cannot be converted. With an empty message, the reason is a problem of another part."""


@dataclass(frozen=True, slots=True)
class Synapses:
    """The synapses of a projection between two populations. A projection of an assembly has several such bundles.

    Attributes:
        projection: PyNN's projection.
        source, target: PyNN's populations.
        pre, post: indices of the source and target neuron of each synapse, in their populations.
        rows: index of each synapse in the projection.
    """

    projection: Projection
    source: Any
    target: Any
    pre: NDArray[np.int64]
    post: NDArray[np.int64]
    rows: Any

    def numbers(self, name: str) -> Any:
        """Return a parameter in PyNN's unit: a number if all synapses share it, else an array."""
        return shared(self.projection.column(name)[self.rows])

    def number(self, name: str) -> float:
        """Return a parameter that all synapses share, in PyNN's unit.

        Raises:
            Incomplete: the parameter differs between synapses.
        """
        value = self.numbers(name)
        if np.ndim(value):
            raise Incomplete(f"'{name}' differs from synapse to synapse: expected one number")
        return float(value)


def shared(values: Any) -> Any:
    """Return a single number if all values are equal, else the values."""
    values = np.asarray(values)
    return values.flat[0].item() if values.size and (values == values.flat[0]).all() else values


class NetworkBuilder:
    """Converter of the parts that a script built before its run. Problems and notes are added to the experiment.

    Args:
        experiment: the populations, projections and currents of the script.
        name: name of the network.

    Attributes:
        net: the network.
    """

    def __init__(self, experiment: Experiment, name: str) -> None:
        self.experiment, self.step = experiment, experiment.timestep
        self.net = Network(_name(name), resolution=experiment.timestep)
        self.names: dict[Any, str] = {}
        self.first_ids = np.array([int(part.first_id) for part in experiment.populations], dtype=np.int64)
        self.tau_minus: dict[Any, float] = {}
        self.bundles = [bundle for projection in experiment.projections for bundle in self._bundles(projection)]
        self.modulators = [bundle for bundle in self.bundles if _kind(bundle) == "Neuromodulation"]
        self._try_all((bundle.projection.where, self._learning, bundle) for bundle in self.bundles)
        self._try_all((part.where, self._population, part) for part in experiment.populations)
        self._try_all((bundle.projection.where, self._projection, bundle) for bundle in self.bundles)
        self._try_all((place, self._current, (source, ids)) for source, ids, place in experiment.currents)
        self._try_all((part.where, self._probes, part) for part in experiment.populations)

    def close(self) -> Network:
        """Return the network. Rates that the script set during its run become a schedule."""
        for part, name in self.names.items():
            if part.rates and name in self.net.populations:
                poisson: Any = self.net.populations[self.names[part]].model
                rates = {self.step: np.broadcast_to(poisson.rate, part.size)}
                rates |= {max(self.step, self._rounded(time, "times")): values for time, values in part.rates}
                table = np.array(list(rates.values()))
                values = table[:, 0] if (table == table[:, :1]).all() else table.T
                window = {"start": poisson.start, "stop": poisson.stop}
                self.net.populations[name] = replace(
                    self.net.populations[name],
                    model=inhomogeneous_poisson_generator(rate_times=list(rates), rate_values=values, **window),
                )
                part.rates = []
        return self.net

    def _try_all(self, parts: Iterable[tuple[Where | None, Callable[[Any], None], Any]]) -> None:
        for place, add, part in parts:
            self.net.place = place
            try:
                add(part)
            except Incomplete as error:
                if str(error):
                    self.experiment.problems.setdefault((place, str(error)))
            except ModelError as error:
                self.experiment.problems.setdefault((place, error.message))

    def _note(self, message: str) -> None:
        self.experiment.notes.setdefault((self.net.place, message))

    # -- populations

    def _population(self, part: Any) -> None:
        label = part.label if part.named else f"population{len(self.names)}"
        name = self.names[part] = _unused_name(_name(label), {*self.names.values()})
        kind, part_text = type(part.celltype).__name__, f"population '{name}'"
        if kind == "Placeholder":
            return  # already a problem
        if kind.startswith("SpikeSource"):
            model, initial = self._source(kind, part.values, part_text), {}
        elif kind in BY_NAME:
            cell = BY_NAME[kind]
            parameters = {word: shared(value) for word, value in cell.from_pynn(part.values).items()}
            if "t_ref" in parameters:
                parameters["t_ref"] = self._rounded(parameters["t_ref"], "refractory periods")
            if part in self.tau_minus:
                parameters["tau_minus"] = self.tau_minus[part]
            model = getattr(neuro, cell.model)(**parameters)
            initial = self._initial(part, cell)
        else:
            raise Incomplete(f"{part_text}: {kind} has no counterpart")
        positions = np.ascontiguousarray(part.positions.T) if part.laid_out else None
        self.net.population(name, part.size, model, initial=initial, positions=positions)

    def _initial(self, part: Any, cell: Cell) -> dict[str, Any]:
        states = {}
        for variable, values in part.initial.items():
            state, factor = cell.states.get(variable, ("", 1.0))
            value = shared(values * factor)
            if state and (np.ndim(value) or value != 0.0 or state in ("V_m", "U_m")):
                states[state] = value
            elif not state and np.any(values != 0.0):
                self._note(f"the initial value of '{variable}' has no counterpart")
        return states

    def _rounded(self, times: Any, subject: str, smallest: float = 0.0) -> Any:
        """Return times in ms, rounded to whole steps as NEST does. `smallest` is the smallest number of steps."""
        steps = np.maximum(np.floor(np.asarray(times) / self.step + 0.5 + _ALMOST), smallest)
        error = np.max(np.abs(steps * self.step - times), initial=0.0)
        if error > _ALMOST * self.step:
            self._note(f"{subject} are rounded to steps of {self.step:g} ms, by {error:.2g} ms at most")
        rounded = np.round(steps * self.step, 9)
        return rounded if np.ndim(times) else float(rounded)

    def _spike_times(self, values: dict[str, Any]) -> Any:
        rows, error = [], 0.0
        for sequence in values["spike_times"]:
            times = np.asarray(sequence.value, dtype=float)
            if np.any(times < 0.0):
                raise Incomplete(f"a spike at {times.min():g} ms: expected times of at least 0 ms")
            steps = np.ceil(times / self.step - _ALMOST)
            error = max(error, np.max(steps * self.step - times, initial=0.0))
            if np.any(steps < 1):
                self._note("spikes at 0 ms are sent in the first step")
            rows.append((np.round(np.maximum(np.sort(steps), 1) * self.step, 9)).tolist())
        if error > _ALMOST * self.step:
            self._note(
                f"spike times are rounded up to steps of {self.step:g} ms, by {error:.2g} ms at most, as in NEST"
            )
        return spike_generator(spike_times=rows)

    def _source(self, kind: str, values: dict[str, Any], subject: str) -> Any:
        """Return the generator of a spike source of PyNN."""
        match kind:
            case "SpikeSourceArray":
                return self._spike_times(values)
            case "SpikeSourcePoisson":
                return poisson_generator(rate=shared(values["rate"]), **self._window(values))
            case "SpikeSourceGamma":
                shape, rate = values["alpha"], values["beta"] / values["alpha"]
                if np.any(shape != np.rint(shape)):
                    raise Incomplete("SpikeSourceGamma: 'alpha' is not a whole number")
                numbers: dict[str, Any] = {"gamma_shape": shared(shape.astype(int)), "rate": shared(rate)}
                return gamma_sup_generator(**numbers | self._window(values))
            case "SpikeSourcePoissonVariable":
                times = [np.asarray(sequence.value) for sequence in values["starts"]]
                rates = np.array([sequence.value for sequence in values["rates"]])
                if any(not np.array_equal(times[0], row) for row in times):
                    raise Incomplete("SpikeSourcePoissonVariable: rates change at different times")
                grid = np.maximum(self._rounded(times[0], "times", 0), self.step)
                return inhomogeneous_poisson_generator(rate_times=grid, rate_values=rates)
        raise Incomplete(f"{subject}: {kind} has no counterpart")

    def _window(self, values: dict[str, Any]) -> dict[str, float]:
        start, duration = shared(values["start"]), shared(values["duration"])
        if np.ndim(start) or np.ndim(duration):
            raise Incomplete("'start' and 'duration' differ from neuron to neuron: expected one number")
        window = {"start": self._rounded(start, "times")} if start > 0 else {}
        if start + duration < _NEVER:
            window["stop"] = self._rounded(start + duration, "times")
        return window

    # -- projections

    def _bundles(self, projection: Projection) -> Iterator[Synapses]:
        """Split the synapses of a projection by source and target population, since an assembly has several."""
        ends = projection.ends()
        ids = [
            np.array(part.all_cells, dtype=np.int64)[end]
            for part, end in zip((projection.pre, projection.post), ends, strict=True)
        ]
        sources, targets = (np.searchsorted(self.first_ids, side, side="right") - 1 for side in ids)
        for source, target in sorted(set(zip(sources.tolist(), targets.tolist(), strict=True))):
            rows = np.flatnonzero((sources == source) & (targets == target))
            pre, post = ids[0][rows] - self.first_ids[source], ids[1][rows] - self.first_ids[target]
            order = np.lexsort((post, pre))
            parts = self.experiment.populations
            yield Synapses(projection, parts[source], parts[target], pre[order], post[order], rows[order])

    def _projection(self, bundle: Synapses) -> None:
        if _kind(bundle) == "Neuromodulation":
            return
        source, target = self._population_name(bundle.source), self._population_name(bundle.target)
        kind = type(bundle.target.celltype).__name__
        if kind not in BY_NAME:
            raise Incomplete(f"{kind} receives no spikes")
        cell = BY_NAME[kind]
        label = _name(bundle.projection.label) if bundle.projection.named else f"{source}_{target}"
        name = _unused_name(label, {*self.net.projections, *self.net.populations})
        delay = self._rounded(bundle.numbers("delay"), "delays", 1)
        factor = self._factor(bundle, cell)
        weight = bundle.numbers("weight") * factor
        rule = _rule(bundle)
        synapse = self._synapse(bundle, factor, rule)
        place = {"weight": self._as_matrix(weight, rule, bundle), "delay": self._as_matrix(delay, rule, bundle)}
        self.net.connect(source, target, rule, synapse, name=name, **place)

    def _population_name(self, part: Any) -> str:
        """Return the name of a population. If the population is a problem, its projections add no problems."""
        name = self.names.get(part, "")
        if name not in self.net.populations:
            raise Incomplete("")
        return name

    def _factor(self, bundle: Synapses, cell: Cell) -> Any:
        """Return the factor from PyNN's weights to weights here, with the sign of the receptor."""
        spinnaker, inhibitory = self.experiment.spinnaker, bundle.projection.receptor_type == "inhibitory"
        if bundle.projection.receptor_type not in ("excitatory", "inhibitory"):
            raise Incomplete(f"receptor '{bundle.projection.receptor_type}' has no counterpart")
        factor: Any = cell.weight
        if spinnaker and cell.name == "IF_curr_delta":
            factor = delta_jump(bundle.target.values, self.step)[bundle.post]
            factor = shared(factor)
        if spinnaker:
            signs = np.where(bundle.projection.column("weight")[bundle.rows] < 0.0, -1.0, 1.0)
            return shared(signs * (-factor if inhibitory else factor))
        return -factor if inhibitory and cell.conductance else factor

    def _as_matrix(self, value: Any, rule: Rule, bundle: Synapses) -> Any:
        if np.ndim(value) and isinstance(rule, all_to_all):
            return value.reshape(bundle.source.size, bundle.target.size)
        return value

    def _learning(self, bundle: Synapses) -> None:
        """Collect the time constant of target spikes, which all rules onto a population share."""
        rule = getattr(bundle.projection.synapse_type, "timing_dependence", None)
        word = _OF_POST.get(type(rule).__name__)
        if word is None:
            return
        value = bundle.number(word)
        if self.tau_minus.setdefault(bundle.target, value) != value:
            raise Incomplete(
                f"'{word}' = {value:g} ms: rules onto one population share one time constant of target spikes"
            )

    def _synapse(self, bundle: Synapses, factor: Any, rule: Rule) -> Any:
        kind = _kind(bundle)
        if kind == "StaticSynapse":
            return static()
        if kind == "TsodyksMarkramSynapse":
            share, tau_rec, tau_fac = bundle.numbers("U"), bundle.number("tau_rec"), bundle.number("tau_facil")
            tau_syn = bundle.target.values.get(
                f"tau_syn_{'I' if bundle.projection.receptor_type == 'inhibitory' else 'E'}"
            )
            if tau_syn is not None:
                self._note(difference(float(np.mean(share)), tau_rec, tau_fac, float(np.mean(tau_syn))))
            return tsodyks2(U=self._as_matrix(share, rule, bundle), tau_rec=tau_rec, tau_fac=tau_fac)
        if kind != "STDPMechanism":
            raise Incomplete(f"{kind} has no counterpart")
        if np.ndim(factor):
            raise Incomplete("plastic synapses have weights of both signs: expected one sign")
        if bundle.number("dendritic_delay_fraction") != 1.0:
            raise Incomplete("'dendritic_delay_fraction' is not 1: delays here are dendritic")
        mechanism = bundle.projection.synapse_type
        timing, dependence = type(mechanism.timing_dependence).__name__, type(mechanism.weight_dependence).__name__
        modulators = [m for m in self.modulators if m.target is bundle.target]
        smallest = bundle.number("w_min")
        if modulators and factor > 0:
            is_reward = len(modulators) == 1 and modulators[0].projection.receptor_type == "reward"
            if (timing, dependence, smallest) == ("SpikePairRule", "AdditiveWeightDependence", 0.0) and is_reward:
                return self._dopamine(bundle, modulators, factor)
            return self._machine_rule(bundle, modulators, factor)
        if timing == "RecurrentRule" or (smallest != 0.0 and self.experiment.spinnaker):
            return self._machine_rule(bundle, (), factor)
        if smallest != 0.0:
            raise Incomplete("'w_min' is not 0: plastic weights here have the bound 0")
        if timing == "Vogels2011Rule" and dependence == "AdditiveWeightDependence":
            return self._vogels(bundle, factor)
        if timing == "PfisterSpikeTriplet" and dependence == "WeightDependenceAdditiveTriplet":
            return self._triplet(bundle, factor)
        if timing not in ("SpikePairRule", "SpikeNearestPairRule"):
            raise Incomplete(f"{timing} with {dependence} has no counterpart")
        return self._pair(bundle, dependence, factor, timing == "SpikeNearestPairRule")

    def _triplet(self, bundle: Synapses, factor: float) -> Any:
        largest = bundle.number("w_max") * factor
        amplitudes = {"Aplus": "A_plus", "Aminus": "A_minus", "Aplus_triplet": "A3_plus", "Aminus_triplet": "A3_minus"}
        taus = {"tau_plus": "tau_plus", "tau_plus_triplet": "tau_x", "tau_minus_triplet": "tau_y"}
        steps = {word: bundle.number(pynn_word) * abs(largest) for word, pynn_word in amplitudes.items()}
        times = {word: bundle.number(pynn_word) for word, pynn_word in taus.items()}
        return stdp_triplet(Wmax=largest, **steps, **times)

    def _pair(self, bundle: Synapses, dependence: str, factor: float, nearest: bool) -> Any:
        if dependence in DEPENDENCES:
            plus, minus = DEPENDENCES[dependence]
        elif dependence == "GutigWeightDependence":
            plus, minus = bundle.number("mu_plus"), bundle.number("mu_minus")
        else:
            raise Incomplete(f"{dependence} has no counterpart")
        ltp, ltd = bundle.number("A_plus"), bundle.number("A_minus")
        if ltp == 0.0 and ltd != 0.0:
            raise Incomplete("'A_plus' is 0 and 'A_minus' is not: depression here is relative to potentiation")
        # Since October 2021 sPyNNaker's additive steps are weights instead of shares of the largest weight.
        share = (
            bundle.number("w_max") if self.experiment.spinnaker and dependence == "AdditiveWeightDependence" else 1.0
        )
        rule = {"lambda_": ltp / share, "alpha": ltd / ltp if ltp else 1.0, "mu_plus": plus, "mu_minus": minus}
        rule |= {"tau_plus": bundle.number("tau_plus"), "Wmax": bundle.number("w_max") * factor}
        return stdp_nn_symm(pre_at_start=True, **rule) if nearest else stdp(**rule)

    def _vogels(self, bundle: Synapses, factor: float) -> Any:
        largest = bundle.number("w_max")
        if "alpha" in bundle.projection.numbers():  # the rule of sPyNNaker
            eta, alpha = bundle.number("A_plus"), bundle.number("alpha")
        else:
            eta, alpha = bundle.number("eta"), 2.0 * bundle.number("rho") * bundle.number("tau") / 1000.0
        rule = {"tau": bundle.number("tau"), "alpha": alpha, "eta": eta * abs(factor)}
        return vogels_sprekeler(Wmax=largest * factor, **rule)

    def _dopamine(self, bundle: Synapses, modulators: Sequence[Synapses], factor: float) -> Any:
        """Convert sPyNNaker's learning by dopamine.

        A spike raises the dopamine by the weight of its synapse in sPyNNaker, and by 1 / tau_n here.
        """
        modulator, parameters = self._dopamine_source(modulators, factor)
        scale = modulator.number("weight") * modulator.number("tau_d") * factor
        steps: dict[str, Any] = {word: bundle.number(word) * scale for word in ("A_plus", "A_minus")}
        return stdp_dopa(tau_plus=bundle.number("tau_plus"), c_min=0.0, **steps, **parameters)

    def _dopamine_source(self, modulators: Sequence[Synapses], factor: float) -> tuple[Synapses, dict[str, Any]]:
        """Return the synapses that release dopamine, and the parameters of a learning rule that follow from them."""
        if len(modulators) > 1:
            kinds = " and ".join(sorted({f"'{m.projection.receptor_type}'" for m in modulators}))
            raise Incomplete(f"dopamine by {len(modulators)} projections to {kinds}: expected one")
        modulator, rule = modulators[0], _rule(modulators[0])
        if not isinstance(rule, all_to_all | one_to_one):
            raise Incomplete("dopamine reaches only some neurons: expected all to all, or one to one")
        return modulator, {
            "dopamine": self._population_name(modulator.source),
            "dopamine_rule": "one_to_one" if isinstance(rule, one_to_one) else "all_to_all",
            "dopamine_delay": self._rounded(modulator.number("delay"), "delays", 1),
            "tau_c": modulator.number("tau_c"),
            "tau_n": modulator.number("tau_d"),
            "Wmin": modulator.number("w_min") * factor,
            "Wmax": modulator.number("w_max") * factor,
        }

    def _machine_rule(self, bundle: Synapses, modulators: Sequence[Synapses], factor: float) -> Any:
        """Convert a rule of sPyNNaker to `spinnaker_learning`, the rule in the machine's own parameters."""
        mechanism = bundle.projection.synapse_type
        kinds = [type(part).__name__ for part in (mechanism.timing_dependence, mechanism.weight_dependence)]
        timing, dependence = TIMINGS.get(kinds[0]), DEPENDENCES_OF_PROGRAMS.get(kinds[1])
        names = {*bundle.projection.numbers()}
        if timing is None or dependence is None:
            raise Incomplete(f"{kinds[0]} with {kinds[1]} has no counterpart")
        if "dual_fsm" in names and not bundle.number("dual_fsm"):
            raise Incomplete("'dual_fsm' = False: expected True, the program with two state machines")
        parameters: dict[str, Any] = {w: bundle.number(w) for w in spinnaker_learning.numbers() if w in names}
        parameters |= {word: int(parameters[word]) for word in parameters if word.startswith("accumulator")}
        largest, smallest = bundle.number("w_max"), bundle.number("w_min")
        if "tau" in names:
            parameters["tau_plus"] = bundle.number("tau")
        if dependence == "additive" and timing != "triplet":
            parameters |= {word: parameters[word] / largest for word in ("A_plus", "A_minus")}
        parameters |= {"Wmin": smallest * factor, "Wmax": largest * factor}
        if modulators:
            modulator, dopamine = self._dopamine_source(modulators, factor)
            sign = 1.0 if modulator.projection.receptor_type == "reward" else -1.0
            parameters |= dopamine | {
                "concentration": sign * modulator.number("weight"),
                "c_min": smallest * factor,
                "c_max": largest * factor,
            }
        return spinnaker_learning(timing=timing, dependence=dependence, **parameters)

    # -- currents and probes

    def _current(self, injected: tuple[Any, list[int]]) -> None:
        source, cells = injected
        kind, values = type(source).__name__, source.values()
        if kind not in ("DCSource", "ACSource", "NoisyCurrentSource", "StepCurrentSource"):
            raise Incomplete(f"{kind} has no counterpart")
        name = _unused_name(kind, {*self.net.populations, *self.net.projections})
        self.net.population(name, 1, self._generator(kind, values))
        ids = np.array(cells, dtype=np.int64)
        populations = np.searchsorted(self.first_ids, ids, side="right") - 1
        for index in sorted({*populations.tolist()}):
            target = self._population_name(self.experiment.populations[index])
            post = np.sort(ids[populations == index] - self.first_ids[index])
            rule = pairs(pre=np.zeros(post.size, dtype=np.int64), post=post)
            label = _unused_name(f"{name}_{target}", {*self.net.populations, *self.net.projections})
            self.net.connect(name, target, rule, weight=1.0, delay=self._current_delay(), name=label)

    def _current_delay(self) -> float:
        """Return the delay of currents in ms. Sources start earlier by this delay, as in pyNN.nest."""
        return float(self._rounded(self.experiment.min_delay, "delays", 1))

    def _start_of_current(self, time: float) -> float:
        return float(self._rounded(max(0.0, float(time) - self._current_delay()), "times"))

    def _generator(self, kind: str, values: dict[str, Any]) -> Any:
        """Return the generator of a current source of PyNN, whose amplitudes are in nA."""
        if kind == "StepCurrentSource":
            times = np.maximum([self._start_of_current(time) for time in values["times"]], self.step)
            ends = np.flatnonzero(np.diff(times, append=np.inf) > 0)
            amplitudes = np.asarray(values["amplitudes"], dtype=float) * 1000.0
            steps: dict[str, Any] = {"amplitude_times": times[ends], "amplitude_values": amplitudes[ends]}
            return step_current_generator(**steps)
        window: dict[str, Any] = {"start": self._start_of_current(values["start"])}
        window |= {"stop": self._start_of_current(values["stop"])} if values["stop"] < _NEVER else {}
        if kind == "DCSource":
            return dc_generator(amplitude=values["amplitude"] * 1000.0, **window)
        if kind == "ACSource":
            phase = values["phase"] - 360.0 * values["frequency"] * window["start"] / 1000.0
            sizes = {"amplitude": values["amplitude"] * 1000.0, "offset": values["offset"] * 1000.0}
            return ac_generator(**sizes, frequency=values["frequency"], phase=phase, **window)
        sizes = {"mean": values["mean"] * 1000.0, "std": values["stdev"] * 1000.0}
        return noise_generator(**sizes, dt=self._rounded(values["dt"], "times", 1), **window)

    def _probes(self, part: Any) -> None:
        if self.names.get(part) not in self.net.populations:
            return
        name, kind = self.names[part], type(part.celltype).__name__
        interval = float(self._rounded(part.recorder.sampling_interval, "sampling intervals", 1))
        for variable, cells in sorted(part.recorder.recorded.items(), key=lambda item: item[0].name):
            ids = np.sort(np.array(list(cells), dtype=np.int64) - int(part.first_id))
            if not ids.size or (variable.name == "spikes" and not kind.startswith("SpikeSource")):
                continue
            if variable.name == "spikes":
                record, every = "spikes", None
            else:
                record, every = self._state(kind, variable.name), None if interval == self.step else interval
            if not record:
                continue
            population: Any = self.net.populations[name]
            label = _unused_name(f"{name}_{variable.name}", {*self.net.probes})
            view = population if ids.size == part.size else population[ids.tolist()]
            self.net.probe(label, view, record, every=every)

    def _state(self, kind: str, variable: str) -> str:
        states = BY_NAME[kind].states
        if variable not in states and self.experiment.spinnaker:
            variable = variable.replace("gsyn", "isyn")
        if variable not in states:
            self._note(f"'{variable}' of {kind} is not recorded: no such state here")
            return ""
        return states[variable][0]


def _kind(bundle: Synapses) -> str:
    return type(bundle.projection.synapse_type).__name__


def _rule(bundle: Synapses) -> Rule:
    """Return `one_to_one` or `all_to_all` if the rule makes exactly the synapses of the bundle, else `pairs`."""
    source, target, count = bundle.source.size, bundle.target.size, bundle.pre.size
    ascending = np.arange(count)
    if source == target == count and np.array_equal(bundle.pre, bundle.post) and np.array_equal(bundle.pre, ascending):
        return one_to_one()
    if count == source * target and np.array_equal(bundle.pre * target + bundle.post, ascending):
        return all_to_all()
    return pairs(pre=bundle.pre, post=bundle.post)


def _name(label: str) -> str:
    """Return a valid name of a part from any text, e.g. "my_cells" from "my cells"."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", label).strip("_") or "part"


def _unused_name(name: str, used: set[str]) -> str:
    """Return the name, with a number if the name is used already, e.g. "cells_2"."""
    number, unused = 1, name
    while unused in used:
        number += 1
        unused = f"{name}_{number}"
    return unused
