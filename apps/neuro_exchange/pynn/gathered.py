"""What a script of PyNN has built, as a network here."""

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
"""What PyNN's rules call the time constant of post spikes."""
TIMINGS = {
    **{"SpikePairRule": "pair", "SpikeNearestPairRule": "nearest", "PfisterSpikeTriplet": "triplet"},
    **{"Vogels2011Rule": "vogels", "RecurrentRule": "recurrent"},
}
DEPENDENCES_OF_PROGRAMS = {
    **dict.fromkeys(("AdditiveWeightDependence", "WeightDependenceAdditiveTriplet"), "additive"),
    "MultiplicativeWeightDependence": "multiplicative",
}
"""Rules of sPyNNaker by the words of `spinnaker_learning`."""
_NEVER = 1e10
"""PyNN's default for the duration of a source; its current sources stop at 100 times that."""
_ALMOST = 1e-6
"""Of a step: what a time may lie above the grid and still be on it, since PyNN's scripts compute with floats."""


class Incomplete(Exception):
    """A part cannot come; the message says why."""


@dataclass(frozen=True, slots=True)
class Synapses:
    """The synapses between two populations, as ids in each and numbers in PyNN's units."""

    made: Projection
    source: Any
    target: Any
    pre: NDArray[np.int64]
    post: NDArray[np.int64]
    chosen: Any

    def numbers(self, name: str) -> Any:
        """A parameter: a number where all have the same, else an array."""
        return shared(self.made.column(name)[self.chosen])

    def number(self, name: str) -> float:
        """A parameter that all share.

        Raises:
            Incomplete: they differ.
        """
        value = self.numbers(name)
        if np.ndim(value):
            raise Incomplete(f"'{name}' differs from synapse to synapse, expected one number")
        return float(value)


def shared(values: Any) -> Any:
    """One number where all values are equal, else the values."""
    values = np.asarray(values)
    return values.flat[0].item() if values.size and (values == values.flat[0]).all() else values


class Gathered:
    """The network of a script, as it begins to run. Problems and notes are added to those of the experiment.

    Args:
        experiment: what the script has built.
        name: of the network.

    Attributes:
        net: the network.
    """

    def __init__(self, experiment: Experiment, name: str) -> None:
        self.experiment, self.step = experiment, experiment.timestep
        self.net = Network(_name(name), resolution=experiment.timestep)
        self.names: dict[Any, str] = {}
        self.first = np.array([int(part.first_id) for part in experiment.populations], dtype=np.int64)
        self.tau_minus: dict[Any, float] = {}
        made = experiment.projections
        self.bundles = [bundle for one in made for bundle in self._bundles(one)]
        self.modulators = [one for one in self.bundles if _kind(one) == "Neuromodulation"]
        self._each((bundle.made.where, self._learning, bundle) for bundle in self.bundles)
        self._each((part.where, self._population, part) for part in experiment.populations)
        self._each((bundle.made.where, self._projection, bundle) for bundle in self.bundles)
        self._each((where, self._current, (source, ids)) for source, ids, where in experiment.currents)
        self._each((part.where, self._probes, part) for part in experiment.populations)

    def close(self) -> Network:
        """The network, with the rates that the script has set while it ran."""
        for part, name in self.names.items():
            if part.rates and name in self.net.populations:
                first: Any = self.net.populations[self.names[part]].model
                rates = {self.step: np.broadcast_to(first.rate, part.size)}
                rates |= {max(self.step, self._rounded(time, "times")): values for time, values in part.rates}
                table = np.array(list(rates.values()))
                values = table[:, 0] if (table == table[:, :1]).all() else table.T
                window = {"start": first.start, "stop": first.stop}
                self.net.populations[name] = replace(
                    self.net.populations[name],
                    model=inhomogeneous_poisson_generator(rate_times=list(rates), rate_values=values, **window),
                )
                part.rates = []
        return self.net

    def _each(self, parts: Iterable[tuple[Where | None, Callable[[Any], None], Any]]) -> None:
        for where, add, part in parts:
            self.net.place = where
            try:
                add(part)
            except Incomplete as error:
                if str(error):
                    self.experiment.problems.setdefault((where, str(error)))
            except ModelError as error:
                self.experiment.problems.setdefault((where, error.message))

    def _note(self, message: str) -> None:
        self.experiment.notes.setdefault((self.net.place, message))

    # -- populations

    def _population(self, part: Any) -> None:
        label = part.label if part.named else f"population{len(self.names)}"
        name = self.names[part] = _free(_name(label), {*self.names.values()})
        kind, what = type(part.celltype).__name__, f"population '{name}'"
        if kind == "Placeholder":
            return  # its line is a problem already
        if kind.startswith("SpikeSource"):
            model, initial = self._source(kind, part.values, what), {}
        elif kind in BY_NAME:
            cell = BY_NAME[kind]
            found = {word: shared(value) for word, value in cell.here(part.values).items()}
            found["t_ref"] = self._rounded(found["t_ref"], "refractory periods") if "t_ref" in found else 0.0
            if "t_ref" not in cell.words and "t_ref" not in cell.fixed:
                del found["t_ref"]
            if part in self.tau_minus:
                found["tau_minus"] = self.tau_minus[part]
            model = getattr(neuro, cell.model)(**found)
            initial = self._initial(part, cell)
        else:
            raise Incomplete(f"{what}: {kind} has no counterpart")
        positions = np.ascontiguousarray(part.positions.T) if part.laid_out else None
        self.net.population(name, part.size, model, initial=initial, positions=positions)

    def _initial(self, part: Any, cell: Cell) -> dict[str, Any]:
        found = {}
        for variable, values in part.initial.items():
            state, factor = cell.states.get(variable, ("", 1.0))
            value = shared(values * factor)
            if state and (np.ndim(value) or value != 0.0 or state in ("V_m", "U_m")):
                found[state] = value
            elif not state and np.any(values != 0.0):
                self._note(f"the initial value of '{variable}' has no counterpart")
        return found

    def _rounded(self, times: Any, what: str, least: float = 0.0) -> Any:
        """Times on the grid, as NEST rounds them."""
        steps = np.maximum(np.floor(np.asarray(times) / self.step + 0.5 + _ALMOST), least)
        off = np.max(np.abs(steps * self.step - times), initial=0.0)
        if off > _ALMOST * self.step:
            self._note(f"{what} are rounded to steps of {self.step:g} ms, by {off:.2g} ms at most")
        found = np.round(steps * self.step, 9)
        return found if np.ndim(times) else float(found)

    def _spike_times(self, values: dict[str, Any]) -> Any:
        rows, off = [], 0.0
        for given in values["spike_times"]:
            times = np.asarray(given.value, dtype=float)
            if np.any(times < 0.0):
                raise Incomplete(f"a spike at {times.min():g} ms: expected times of at least 0 ms")
            steps = np.ceil(times / self.step - _ALMOST)
            off = max(off, np.max(steps * self.step - times, initial=0.0))
            if np.any(steps < 1):
                self._note("spikes at 0 ms leave in the first step")
            rows.append((np.round(np.maximum(np.sort(steps), 1) * self.step, 9)).tolist())
        if off > _ALMOST * self.step:
            self._note(
                f"spike times are rounded up to steps of {self.step:g} ms, by {off:.2g} ms at most, as NEST does"
            )
        return spike_generator(spike_times=rows)

    def _source(self, kind: str, values: dict[str, Any], what: str) -> Any:
        """Return the generator that a spike source of PyNN is."""
        match kind:
            case "SpikeSourceArray":
                return self._spike_times(values)
            case "SpikeSourcePoisson":
                return poisson_generator(rate=shared(values["rate"]), **self._window(values))
            case "SpikeSourceGamma":
                shape, rate = values["alpha"], values["beta"] / values["alpha"]
                if np.any(shape != np.rint(shape)):
                    raise Incomplete("SpikeSourceGamma: 'alpha' is no whole number")
                numbers: dict[str, Any] = {"gamma_shape": shared(shape.astype(int)), "rate": shared(rate)}
                return gamma_sup_generator(**numbers | self._window(values))
            case "SpikeSourcePoissonVariable":
                times = [np.asarray(one.value) for one in values["starts"]]
                rates = np.array([one.value for one in values["rates"]])
                if any(not np.array_equal(times[0], other) for other in times):
                    raise Incomplete("SpikeSourcePoissonVariable: rates change at different times")
                grid = np.maximum(self._rounded(times[0], "times", 0), self.step)
                return inhomogeneous_poisson_generator(rate_times=grid, rate_values=rates)
        raise Incomplete(f"{what}: {kind} has no counterpart")

    def _window(self, values: dict[str, Any]) -> dict[str, float]:
        start, duration = shared(values["start"]), shared(values["duration"])
        if np.ndim(start) or np.ndim(duration):
            raise Incomplete("'start' and 'duration' differ from neuron to neuron, expected one number")
        found = {"start": self._rounded(start, "times")} if start > 0 else {}
        if start + duration < _NEVER:
            found["stop"] = self._rounded(start + duration, "times")
        return found

    # -- projections

    def _bundles(self, made: Projection) -> Iterator[Synapses]:
        """The synapses of a projection by source and target, of which an assembly has several."""
        ends = made.ends()
        ids = [
            np.array(part.all_cells, dtype=np.int64)[end] for part, end in zip((made.pre, made.post), ends, strict=True)
        ]
        at = [np.searchsorted(self.first, one, side="right") - 1 for one in ids]
        for source, target in sorted(set(zip(*(one.tolist() for one in at), strict=True))):
            chosen = np.flatnonzero((at[0] == source) & (at[1] == target))
            pre, post = ids[0][chosen] - self.first[source], ids[1][chosen] - self.first[target]
            order = np.lexsort((post, pre))
            parts = self.experiment.populations
            yield Synapses(made, parts[source], parts[target], pre[order], post[order], chosen[order])

    def _projection(self, bundle: Synapses) -> None:
        if _kind(bundle) == "Neuromodulation":
            return
        source, target = self._end(bundle.source), self._end(bundle.target)
        kind = type(bundle.target.celltype).__name__
        if kind not in BY_NAME:
            raise Incomplete(f"{kind} receives no spikes")
        cell = BY_NAME[kind]
        label = _name(bundle.made.label) if bundle.made.named else f"{source}_{target}"
        name = _free(label, {*self.net.projections, *self.net.populations})
        delay = self._rounded(bundle.numbers("delay"), "delays", 1)
        factor = self._factor(bundle, cell)
        weight = bundle.numbers("weight") * factor
        rule = _rule(bundle)
        synapse = self._synapse(bundle, factor, rule)
        place = {"weight": self._laid(weight, rule, bundle), "delay": self._laid(delay, rule, bundle)}
        self.net.connect(source, target, rule, synapse, name=name, **place)

    def _end(self, part: Any) -> str:
        """The name of a population; what follows from one that cannot come is no problem of its own."""
        name = self.names.get(part, "")
        if name not in self.net.populations:
            raise Incomplete("")
        return name

    def _factor(self, bundle: Synapses, cell: Cell) -> Any:
        """What makes of PyNN's weights ours, with the sign of the receptor."""
        spinnaker, inhibitory = self.experiment.spinnaker, bundle.made.receptor_type == "inhibitory"
        if bundle.made.receptor_type not in ("excitatory", "inhibitory"):
            raise Incomplete(f"the receptor '{bundle.made.receptor_type}' has no counterpart")
        factor: Any = cell.weight
        if spinnaker and cell.name == "IF_curr_delta":
            factor = delta_jump(bundle.target.values, self.step)[bundle.post]
            factor = shared(factor)
        if spinnaker:
            signs = np.where(bundle.made.column("weight")[bundle.chosen] < 0.0, -1.0, 1.0)
            return shared(signs * (-factor if inhibitory else factor))
        return -factor if inhibitory and cell.conductance else factor

    def _laid(self, value: Any, rule: Rule, bundle: Synapses) -> Any:
        if np.ndim(value) and isinstance(rule, all_to_all):
            return value.reshape(bundle.source.size, bundle.target.size)
        return value

    def _learning(self, bundle: Synapses) -> None:
        """Note the time constant that rules onto a population share."""
        rule = getattr(bundle.made.synapse_type, "timing_dependence", None)
        word = _OF_POST.get(type(rule).__name__)
        if word is None:
            return
        value = bundle.number(word)
        if self.tau_minus.setdefault(bundle.target, value) != value:
            raise Incomplete(
                f"'{word}' = {value:g} ms: rules onto one population share one time constant of post spikes"
            )

    def _synapse(self, bundle: Synapses, factor: Any, rule: Rule) -> Any:
        kind = _kind(bundle)
        if kind == "StaticSynapse":
            return static()
        if kind == "TsodyksMarkramSynapse":
            share, tau_rec, tau_fac = bundle.numbers("U"), bundle.number("tau_rec"), bundle.number("tau_facil")
            active = bundle.target.values.get(f"tau_syn_{'I' if bundle.made.receptor_type == 'inhibitory' else 'E'}")
            if active is not None:
                self._note(difference(float(np.mean(share)), tau_rec, tau_fac, float(np.mean(active))))
            return tsodyks2(U=self._laid(share, rule, bundle), tau_rec=tau_rec, tau_fac=tau_fac)
        if kind != "STDPMechanism":
            raise Incomplete(f"{kind} has no counterpart")
        if np.ndim(factor):
            raise Incomplete("weights of synapses that learn have one sign")
        if bundle.number("dendritic_delay_fraction") != 1.0:
            raise Incomplete("'dendritic_delay_fraction' is not 1: here a delay is dendritic")
        mechanism = bundle.made.synapse_type
        timing, dependence = type(mechanism.timing_dependence).__name__, type(mechanism.weight_dependence).__name__
        modulators = [one for one in self.modulators if one.target is bundle.target]
        least = bundle.number("w_min")
        if modulators and factor > 0:
            rewards = len(modulators) == 1 and modulators[0].made.receptor_type == "reward"
            if (timing, dependence, least) == ("SpikePairRule", "AdditiveWeightDependence", 0.0) and rewards:
                return self._dopamine(bundle, modulators, factor)
            return self._program(bundle, modulators, factor)
        if timing == "RecurrentRule" or (least != 0.0 and self.experiment.spinnaker):
            return self._program(bundle, (), factor)
        if least != 0.0:
            raise Incomplete("'w_min' is not 0: weights that learn end at 0")
        if timing == "Vogels2011Rule" and dependence == "AdditiveWeightDependence":
            return self._vogels(bundle, factor)
        if timing == "PfisterSpikeTriplet" and dependence == "WeightDependenceAdditiveTriplet":
            return self._triplet(bundle, factor)
        if timing not in ("SpikePairRule", "SpikeNearestPairRule"):
            raise Incomplete(f"{timing} with {dependence} has no counterpart")
        return self._pair(bundle, dependence, factor, timing == "SpikeNearestPairRule")

    def _triplet(self, bundle: Synapses, factor: float) -> Any:
        largest = bundle.number("w_max") * factor
        words = {"Aplus": "A_plus", "Aminus": "A_minus", "Aplus_triplet": "A3_plus", "Aminus_triplet": "A3_minus"}
        taus = {"tau_plus": "tau_plus", "tau_plus_triplet": "tau_x", "tau_minus_triplet": "tau_y"}
        steps = {ours: bundle.number(word) * abs(largest) for ours, word in words.items()}
        return stdp_triplet(Wmax=largest, **steps, **{ours: bundle.number(word) for ours, word in taus.items()})

    def _pair(self, bundle: Synapses, dependence: str, factor: float, nearest: bool) -> Any:
        if dependence in DEPENDENCES:
            plus, minus = DEPENDENCES[dependence]
        elif dependence == "GutigWeightDependence":
            plus, minus = bundle.number("mu_plus"), bundle.number("mu_minus")
        else:
            raise Incomplete(f"{dependence} has no counterpart")
        up, down = bundle.number("A_plus"), bundle.number("A_minus")
        if up == 0.0 and down != 0.0:
            raise Incomplete("'A_plus' is 0 and 'A_minus' is not: here depression is relative to potentiation")
        # Since October 2021 sPyNNaker's additive steps are weights, not shares of the largest.
        share = (
            bundle.number("w_max") if self.experiment.spinnaker and dependence == "AdditiveWeightDependence" else 1.0
        )
        rule = {"lambda_": up / share, "alpha": down / up if up else 1.0, "mu_plus": plus, "mu_minus": minus}
        rule |= {"tau_plus": bundle.number("tau_plus"), "Wmax": bundle.number("w_max") * factor}
        return stdp_nn_symm(pre_at_start=True, **rule) if nearest else stdp(**rule)

    def _vogels(self, bundle: Synapses, factor: float) -> Any:
        largest = bundle.number("w_max")
        if "alpha" in bundle.made.numbers():  # sPyNNaker's
            eta, alpha = bundle.number("A_plus"), bundle.number("alpha")
        else:
            eta, alpha = bundle.number("eta"), 2.0 * bundle.number("rho") * bundle.number("tau") / 1000.0
        rule = {"tau": bundle.number("tau"), "alpha": alpha, "eta": eta * abs(factor)}
        return vogels_sprekeler(Wmax=largest * factor, **rule)

    def _dopamine(self, bundle: Synapses, modulators: Sequence[Synapses], factor: float) -> Any:
        """sPyNNaker's: a spike raises dopamine by the weight of its synapse, here by 1 / tau_n."""
        by, words = self._released(modulators, factor)
        scale = by.number("weight") * by.number("tau_d") * factor
        steps: dict[str, Any] = {word: bundle.number(word) * scale for word in ("A_plus", "A_minus")}
        return stdp_dopa(tau_plus=bundle.number("tau_plus"), c_min=0.0, **steps, **words)

    def _released(self, modulators: Sequence[Synapses], factor: float) -> tuple[Synapses, dict[str, Any]]:
        """The synapses that release dopamine, and the words of a rule that say so."""
        if len(modulators) > 1:
            kinds = " and ".join(sorted({f"'{one.made.receptor_type}'" for one in modulators}))
            raise Incomplete(f"dopamine by {len(modulators)} projections to {kinds}: expected one")
        by, rule = modulators[0], _rule(modulators[0])
        if not isinstance(rule, all_to_all | one_to_one):
            raise Incomplete("dopamine reaches some neurons: expected all to all, or one to one")
        return by, {
            "dopamine": self._end(by.source),
            "dopamine_rule": "one_to_one" if isinstance(rule, one_to_one) else "all_to_all",
            "dopamine_delay": self._rounded(by.number("delay"), "delays", 1),
            "tau_c": by.number("tau_c"),
            "tau_n": by.number("tau_d"),
            "Wmin": by.number("w_min") * factor,
            "Wmax": by.number("w_max") * factor,
        }

    def _program(self, bundle: Synapses, modulators: Sequence[Synapses], factor: float) -> Any:
        """A rule of sPyNNaker that has no words but those of the machine."""
        mechanism = bundle.made.synapse_type
        kinds = [type(part).__name__ for part in (mechanism.timing_dependence, mechanism.weight_dependence)]
        timing, dependence = TIMINGS.get(kinds[0]), DEPENDENCES_OF_PROGRAMS.get(kinds[1])
        known = {*bundle.made.numbers()}
        if timing is None or dependence is None:
            raise Incomplete(f"{kinds[0]} with {kinds[1]} has no counterpart")
        if "dual_fsm" in known and not bundle.number("dual_fsm"):
            raise Incomplete("'dual_fsm' is False: the program of two machines is expected")
        words: dict[str, Any] = {w: bundle.number(w) for w in spinnaker_learning.numbers() if w in known}
        words |= {word: int(words[word]) for word in words if word.startswith("accumulator")}
        largest, least = bundle.number("w_max"), bundle.number("w_min")
        if "tau" in known:
            words["tau_plus"] = bundle.number("tau")
        if dependence == "additive" and timing != "triplet":
            words |= {word: words[word] / largest for word in ("A_plus", "A_minus")}
        words |= {"Wmin": least * factor, "Wmax": largest * factor}
        if modulators:
            by, said = self._released(modulators, factor)
            sign = 1.0 if by.made.receptor_type == "reward" else -1.0
            words |= said | {
                "concentration": sign * by.number("weight"),
                "c_min": least * factor,
                "c_max": largest * factor,
            }
        return spinnaker_learning(timing=timing, dependence=dependence, **words)

    # -- currents and probes

    def _current(self, injected: tuple[Any, list[int]]) -> None:
        source, cells = injected
        kind, values = type(source).__name__, source.values()
        if kind not in ("DCSource", "ACSource", "NoisyCurrentSource", "StepCurrentSource"):
            raise Incomplete(f"{kind} has no counterpart")
        name = _free(kind, {*self.net.populations, *self.net.projections})
        self.net.population(name, 1, self._generator(kind, values))
        ids = np.array(cells, dtype=np.int64)
        at = np.searchsorted(self.first, ids, side="right") - 1
        for place in sorted({*at.tolist()}):
            target = self._end(self.experiment.populations[place])
            post = np.sort(ids[at == place] - self.first[place])
            rule = pairs(pre=np.zeros(post.size, dtype=np.int64), post=post)
            label = _free(f"{name}_{target}", {*self.net.populations, *self.net.projections})
            self.net.connect(name, target, rule, weight=1.0, delay=self._lead(), name=label)

    def _lead(self) -> float:
        """A current takes so long; it leaves so much earlier, as in pyNN.nest."""
        return float(self._rounded(self.experiment.min_delay, "delays", 1))

    def _early(self, time: float) -> float:
        return float(self._rounded(max(0.0, float(time) - self._lead()), "times"))

    def _generator(self, kind: str, values: dict[str, Any]) -> Any:
        """Return the generator that a current source of PyNN is, whose amplitudes are in nA."""
        if kind == "StepCurrentSource":
            times = np.maximum([self._early(time) for time in values["times"]], self.step)
            last = np.flatnonzero(np.diff(times, append=np.inf) > 0)
            amplitudes = np.asarray(values["amplitudes"], dtype=float) * 1000.0
            steps: dict[str, Any] = {"amplitude_times": times[last], "amplitude_values": amplitudes[last]}
            return step_current_generator(**steps)
        window: dict[str, Any] = {"start": self._early(values["start"])}
        window |= {"stop": self._early(values["stop"])} if values["stop"] < _NEVER else {}
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
        every = float(self._rounded(part.recorder.sampling_interval, "sampling intervals", 1))
        for variable, cells in sorted(part.recorder.recorded.items(), key=lambda item: item[0].name):
            ids = np.sort(np.array(list(cells), dtype=np.int64) - int(part.first_id))
            if not ids.size or (variable.name == "spikes" and not kind.startswith("SpikeSource")):
                continue
            if variable.name == "spikes":
                record, often = "spikes", None
            else:
                record, often = self._state(kind, variable.name), None if every == self.step else every
            if not record:
                continue
            of: Any = self.net.populations[name]
            label = _free(f"{name}_{variable.name}", {*self.net.probes})
            self.net.probe(label, of if ids.size == part.size else of[ids.tolist()], record, every=often)

    def _state(self, kind: str, variable: str) -> str:
        states = BY_NAME[kind].states
        if variable not in states and self.experiment.spinnaker:
            variable = variable.replace("gsyn", "isyn")
        if variable not in states:
            self._note(f"'{variable}' of {kind} is no state here and is not recorded")
            return ""
        return states[variable][0]


def _kind(bundle: Synapses) -> str:
    return type(bundle.made.synapse_type).__name__


def _rule(bundle: Synapses) -> Rule:
    """The rule that makes these synapses, where they are all or one to one; else the pairs."""
    source, target, count = bundle.source.size, bundle.target.size, bundle.pre.size
    ascending = np.arange(count)
    if source == target == count and np.array_equal(bundle.pre, bundle.post) and np.array_equal(bundle.pre, ascending):
        return one_to_one()
    if count == source * target and np.array_equal(bundle.pre * target + bundle.post, ascending):
        return all_to_all()
    return pairs(pre=bundle.pre, post=bundle.post)


def _name(label: str) -> str:
    """A name of a part, from any text."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", label).strip("_") or "part"


def _free(name: str, taken: set[str]) -> str:
    """The name, with a number where it is taken."""
    number, found = 1, name
    while found in taken:
        number += 1
        found = f"{name}_{number}"
    return found
