"""Write a network as a script of PyNN that runs unchanged on pyNN.nest, pyNN.brian2 and sPyNNaker.

Random values, and arrays that would be too long for a script, are written to a file beside it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from neuro import (
    ModelError,
    Network,
    spinnaker_learning,
    static,
    stdp,
    stdp_dopa,
    stdp_nn_symm,
    stdp_triplet,
    tsodyks2,
    vogels_sprekeler,
)
from neuro.apps import Quantity, Where, check, compile_network, file_path, marked, output, sealed, some
from neuro.extend import Floats, Ints, Population, Program, Projection
from neuro_exchange.pynn.cells import BY_MODEL, DEPENDENCES, Cell, difference
from neuro_exchange.templates import filled
from neuro_exchange.verdict import APPROXIMATE, Verdict, Verdicts

__all__ = ["to_pynn"]

_MARK = "# written by neuro"
_SCRIPT = sealed("a script that neuro wrote", _MARK, ", digest {}")
_ARRAYS = marked("arrays of a script that neuro wrote", "written_by_neuro.npy", anywhere=True)
_SEED = Quantity(kind="integer", at_least=0, at_most=2**63 - 1)
_DURATION = Quantity(unit="ms", above=0)
_DEFAULT_DURATION = 1000.0
_WIDTH = 116
_EARLY = 0.5
"""Part of a step by which a spike time lies before the end of its step. NEST and sPyNNaker round times up to a step.
Brian2 rounds down, and counts from the beginning of a step. With times inside the step all agree."""
_OFF_VALUES = {
    **{"V_min": -np.inf, "refractory_input": 0.0, "rk4_substeps": 0.0, "gsl_error_tol": 1e-6},
    **{"reset_by_subtraction": 0.0, "max_spikes": 1.0, "threshold_rises": 0.0},
}
"""Parameters that no cell of PyNN has, with the values that switch them off."""
_PEAK = 30.0
"""Threshold of Izhikevich's neuron in PyNN, mV."""

_SPINNAKER_RULES = (stdp_nn_symm, stdp_triplet, vogels_sprekeler, stdp_dopa, spinnaker_learning)
"""Learning rules that only sPyNNaker has."""
_NO_PROBE = "left out: no counterpart in PyNN"
_ONE_SOURCE = "plastic projections onto a population have one source of dopamine in sPyNNaker"
_EXTRA = "sim.extra_models"
_PAIR = {word: word for word in ("tau_plus", "tau_minus", "A_plus", "A_minus")}
_COUNTS = ("accumulator_depression", "accumulator_potentiation", "mean_pre_window", "mean_post_window")
_TIMINGS = {
    "pair": ("sim.SpikePairRule", _PAIR),
    "nearest": (f"{_EXTRA}.SpikeNearestPairRule", _PAIR),
    "triplet": (f"{_EXTRA}.PfisterSpikeTriplet", _PAIR | {"tau_x": "tau_x", "tau_y": "tau_y"}),
    "vogels": (
        f"{_EXTRA}.Vogels2011Rule",
        {"tau": "tau_plus", "alpha": "alpha", "A_plus": "A_plus", "A_minus": "A_minus"},
    ),
    "recurrent": (f"{_EXTRA}.RecurrentRule", {word: word for word in (*_COUNTS, "A_plus", "A_minus")}),
}
"""For each timing, the rule of sPyNNaker, and the parameter here for each parameter of the rule."""
_PAIRS = 16.0
"""Number of spike pairs that an eligibility can hold before it saturates."""

_DELTA = """if not hasattr(sim.IF_curr_delta, "variable_map"):  # pyNN.nest 0.13 lacks its potential
    sim.IF_curr_delta.variable_map, sim.IF_curr_delta.scale_factors = {"v": "V_m"}, {"v": 1.0}"""


def to_pynn(net: Network, path: str | os.PathLike[str], *, seed: int = 0, duration: Any = None) -> Verdicts:
    """Write a network as a script of PyNN, with its arrays in a file `.npz` of the same name.

    Weights and delays are in PyNN's units. Random connections, weights, delays, parameters and initial values are drawn
    with the seed and written as numbers, so every simulator has the same network.

    Args:
        net: the network.
        path: name of the script, which ends in `.py`.
        seed: seed of random values.
        duration: duration of the script's run in ms; default: 1000. With a duration, spikes of random generators are
            drawn for that time and written as lists. Without a duration, the simulator draws the spikes of
            `poisson_generator`.

    Returns:
        Verdicts for the parts that differ in PyNN.

    Raises:
        ModelError: parts have no counterpart in PyNN (the error lists all of them), or a file cannot be written.
    """
    if not isinstance(net, Network):
        raise ModelError(f"to_pynn: found {net!r:.60}: expected a Network")
    file = file_path(path, "path")
    if file.suffix != ".py":
        raise ModelError(f"{file}: cannot be written: expected a name ending in .py")
    number = int(check(_SEED, seed, "seed"))
    duration_ms = None if duration is None else float(check(_DURATION, duration, "duration"))
    builder = _Script(net, number, duration_ms)
    text, arrays = builder.text(file)
    with output(file, _SCRIPT) as script:
        script.write_text(_SCRIPT.seal(text), "utf-8")
        if arrays:
            with output(file.with_suffix(".npz"), _ARRAYS) as part, part.open("wb") as stream:
                np.savez(stream, allow_pickle=False, written_by_neuro=np.zeros(0), **arrays)
    notes = (Verdict(part, kind, APPROXIMATE, note) for part, kind, note in builder.notes)
    return Verdicts(f"{net.name} for PyNN", tuple(notes))


class _Script:
    """Builder of a script: its lines, arrays, problems and notes."""

    def __init__(self, net: Network, seed: int, duration: float | None) -> None:
        self.net, self.seed, self.duration = net, seed, duration
        self.program: Program = compile_network(net, seed)
        self.step = self.program.resolution
        self.lines: list[str] = []
        self.arrays: dict[str, Any] = {}
        self.problems: list[ModelError] = []
        self.notes: list[tuple[str, str, str]] = []
        self.trains: dict[str, tuple[Floats, Ints]] = {}
        self.spinnaker = any(isinstance(part.synapse, _SPINNAKER_RULES) for part in self.program.projections)
        self.dopamine: dict[int, tuple[str, list[str]]] = {}

    def text(self, file: Path) -> tuple[str, dict[str, Any]]:
        """Return the script, and the arrays for the file beside it."""
        self._draw_trains()
        if any(part.model.name == "iaf_psc_delta" for part in self.program.populations):
            self.lines.append(_DELTA)
        for part in self.program.populations:
            self._try(part.origin, f"population '{part.name}'", self._population, part)
        for index, projection in enumerate(self.program.projections):
            self._try(projection.origin, f"projection '{projection.name}'", self._projection, index)
        for _, call in self.dopamine.values():
            if call:
                self._call("sim.Projection(", call)
        self._add_unsupported()
        if self.problems:
            count = f"{len(self.problems)} problem" + "s" * (len(self.problems) > 1)
            message = f"network '{self.net.name}' cannot be written for PyNN ({count})"
            raise ModelError(message, others=tuple(self.problems))
        self._probes()
        steps = [part.delay_span[1] for part in self.program.projections] or [1]
        text = filled(
            "pynn/script.txt",
            name=self.net.name,
            script=file.name,
            mark=_MARK,
            duration=repr(self.duration or _DEFAULT_DURATION),
            data='np.load(Path(__file__).with_suffix(".npz"))' if self.arrays else "{}",
            simulators="spiNNaker" if self.spinnaker else "nest | brian2 | spiNNaker",
            simulator="spiNNaker" if self.spinnaker else "nest",
            step=repr(self.step),
            longest=repr(max(steps) * self.step),
            lines="\n".join(self.lines),
        )
        return text, self.arrays

    def _try(self, place: Where | None, subject: str, add: Any, part: Any) -> None:
        try:
            add(part)
        except ModelError as error:
            self.problems.append(error.at(place, subject))

    def _note(self, part: str, kind: str, note: str) -> None:
        self.notes.append((part, kind, note))

    def _call(self, head: str, arguments: Iterable[str], tail: str = ")") -> None:
        """Add a call, on one line or with an argument per line."""
        arguments = list(arguments)
        line = f"{head}{', '.join(arguments)}{tail}"
        if len(line) > _WIDTH:
            line = head + "".join(f"\n    {word}," for word in arguments) + "\n" + tail
        self.lines.append(line)

    def _value(self, name: str, values: Any) -> str:
        """Return the text of a parameter: a number if all values are equal, else an entry of the arrays."""
        values = np.asarray(values, dtype=float)
        if values.size and (values == values.flat[0]).all():
            return repr(float(values.flat[0]))
        self.arrays[name] = values
        return f'data["{name}"]'

    # -- populations

    def _draw_trains(self) -> None:
        """Simulate the generators that are random or play a stream, if the script has a duration."""
        generators = [part for part in self.program.populations if self._is_random(part)]
        if self.duration is None or not generators:
            return
        from neuro import compile

        net = Network(self.net.name, resolution=self.step)
        net.populations = {part.name: self.net.populations[part.name] for part in generators}
        for part in generators:
            net.probe(f"{part.name}.spikes", part.name)
        sim = compile(net, seed=self.seed)
        sim.run(np.ceil(self.duration / self.step - 1e-6) * self.step)
        self.trains = {part.name: sim.spikes(part.name) for part in generators}

    @staticmethod
    def _is_random(part: Population) -> bool:
        return part.kind in ("poisson", "generator") or part.stream is not None

    def _population(self, part: Population) -> None:
        if part.kind == "current":
            return  # `_current` writes current sources
        if part.kind == "neuron":
            if part.model.name not in BY_MODEL:
                raise ModelError(f"{part.model_name} has no standard cell in PyNN")
            cell, values = self._cell(part)
        else:
            cell, values = self._source(part)
        arguments = [f"{word}={value}" for word, value in values.items()]
        options = [*self._initial(part), f'label="{part.name}"']
        self._call(
            f'populations["{part.name}"] = sim.Population(',
            [f"{part.size}", f"sim.{cell}({', '.join(arguments)})", *options],
        )

    def _cell(self, part: Population) -> tuple[str, dict[str, str]]:
        cell, parameters = BY_MODEL[part.model.name], part.parameters
        for word, default in (_OFF_VALUES | ({"V_th": _PEAK} if cell.name == "Izhikevich" else {})).items():
            if word in parameters and np.any(parameters[word] != default):
                raise ModelError(f"'{word}' has no counterpart in PyNN's {cell.name}")
        values = cell.to_pynn({word: np.broadcast_to(value, part.size) for word, value in parameters.items()})
        return cell.name, {word: self._value(f"{part.name}.{word}", value) for word, value in values.items()}

    def _initial(self, part: Population) -> list[str]:
        if part.kind != "neuron":
            return []
        variables = {state: (variable, f) for variable, (state, f) in BY_MODEL[part.model.name].states.items()}
        entries = []
        for state, values in part.initial.items():
            if state in variables:
                variable, factor = variables[state]
                value = np.broadcast_to(values / factor, part.size)
                if state in ("V_m", "U_m") or np.any(value != 0.0):
                    entries.append(f'"{variable}": {self._value(f"{part.name}.initial.{variable}", value)}')
            elif np.any(values != 0.0):
                raise ModelError(f"the initial value of '{state}' has no counterpart in PyNN")
        return [f"initial_values={{{', '.join(entries)}}}"] if entries else []

    def _source(self, part: Population) -> tuple[str, dict[str, str]]:
        if part.name in self.trains:
            times, ids = self.trains[part.name]
            return self._spike_lists(part, np.rint(times / self.step), ids)
        if part.model.graded:
            raise ModelError(f"{part.model_name} has no counterpart in PyNN, whose spikes have no payloads")
        if part.kind == "listed" and part.stream is None:
            return self._spike_lists(part, part.spike_steps, part.spike_ids)
        if part.kind == "poisson" and part.schedule is None:
            parameters = {"rate": self._value(f"{part.name}.rate", np.broadcast_to(part.parameters["rate"], part.size))}
            parameters["start"] = repr(part.start * self.step)
            if part.stop < 1e15:
                parameters["duration"] = repr((part.stop - part.start) * self.step)
            return "SpikeSourcePoisson", parameters
        raise ModelError(
            f"{part.model_name} has no standard cell in PyNN",
            hint="duration=100.0 writes its spikes of 100 ms as lists",
        )

    def _spike_lists(self, part: Population, steps: Any, ids: Any) -> tuple[str, dict[str, str]]:
        if n_lost := int(np.count_nonzero(np.asarray(steps) == 1)):
            note = f"pyNN.nest loses the {some(n_lost, 'spike')} of the first step, of {len(ids):,} spikes"
            self._note(part.name, "population", note)
        if extra := len(ids) - np.unique(np.column_stack((steps, ids)), axis=0).shape[0]:
            note = f"pyNN.brian2 refuses several spikes of a neuron in a step: {some(extra, 'spike')} beyond the first"
            self._note(part.name, "population", note)
        self.arrays[f"{part.name}.times"] = (np.asarray(steps, dtype=float) - _EARLY) * self.step
        self.arrays[f"{part.name}.ids"] = np.asarray(ids)
        return "SpikeSourceArray", {"spike_times": f'trains("{part.name}", {part.size})'}

    # -- projections

    def _projection(self, index: int) -> None:
        part = self.program.projections[index]
        target = self.program.populations[part.target]
        if target.kind != "neuron" or target.model.name not in BY_MODEL:
            raise ModelError(f"population '{target.name}' has no counterpart in PyNN")
        if not part.as_by_sign(part.weight) or (part.receptor is not None and part.carries == "current"):
            raise ModelError("the receptor does not follow from the sign of the weights, as PyNN's receptors do")
        if part.carries == "current":
            self._current(index)
            return
        cell = BY_MODEL[target.model.name]
        synapse = self._synapse_call(part, target, cell)
        weight = part.arriving(part.weight) / cell.weight
        pre, post, place = self.program.synapses(index)
        weights = np.broadcast_to(weight, part.size)[place]
        delays = (
            np.broadcast_to(part.delay, part.size)[place] * self.step if part.grid is None else part.delay * self.step
        )
        delays = np.broadcast_to(delays, pre.size)
        largest = getattr(part.synapse, "Wmax", None)
        negative = weights < 0.0 if largest is None else np.full(pre.size, np.max(largest) < 0)
        if self.spinnaker:
            weights = abs(weights)  # the receptor determines the sign
        for receptor, selected in (("excitatory", ~negative), ("inhibitory", negative)):
            if selected.any():
                sign = -1.0 if receptor == "inhibitory" and cell.conductance and not self.spinnaker else 1.0
                columns = (pre[selected], post[selected], weights[selected] * sign, delays[selected])
                name = part.name if selected.all() else f"{part.name}.{receptor}"
                for layer, rows in enumerate(_unique_pairs(columns[0], columns[1])):
                    label = f"{name}.{layer + 1}" if layer else name
                    self._connect(part, label, receptor, tuple(column[rows] for column in columns), synapse)

    def _connect(self, part: Projection, name: str, receptor: str, columns: tuple[Any, ...], synapse: str) -> None:
        pre, post, weights, delays = columns
        source, target = self.program.populations[part.source], self.program.populations[part.target]
        are_equal = (weights == weights[0]).all() and (delays == delays[0]).all()
        is_complete = are_equal and pre.size == part.size and part.grid is None
        connector = {"one_to_one": "OneToOneConnector()", "dense": "AllToAllConnector()"}.get(part.layout, "")
        if part.size == 1:
            connector = "AllToAllConnector()"  # the only one of PyNN 0.13 for single neurons and NumPy >= 2.1
        if not (is_complete and connector):
            self.arrays[name] = np.column_stack((pre, post, weights, delays))
            connector = f'FromListConnector(data["{name}"], column_names=["weight", "delay"])'
        numbers = f"weight={float(weights[0])!r}, delay={float(delays[0])!r}"
        arguments = [
            f'populations["{source.name}"]',
            f'populations["{target.name}"]',
            f"sim.{connector}",
            f"sim.{synapse}{numbers})",
            f'receptor_type="{receptor}"',
            f'label="{name}"',
        ]
        self._call("sim.Projection(", arguments)

    def _synapse_call(self, part: Projection, target: Population, cell: Cell) -> str:
        """Return the beginning of the call that makes the synapse. Weight and delay are its last arguments."""
        rule = part.synapse
        if isinstance(rule, static):
            return "StaticSynapse("
        if isinstance(rule, tsodyks2):
            shares = np.unique(rule.U)
            if shares.size > 1:
                raise ModelError("'U' differs from synapse to synapse: expected one number, as in PyNN")
            share, tau_rec, tau_fac = float(shares[0]), float(rule.tau_rec), float(rule.tau_fac)
            tau_syn = target.parameters.get("tau_syn_in" if np.all(part.arriving(part.weight) < 0.0) else "tau_syn_ex")
            if tau_syn is not None:
                self._note(part.name, rule.name, difference(share, tau_rec, tau_fac, float(np.mean(tau_syn))))
            return f"TsodyksMarkramSynapse({_words({'U': share, 'tau_rec': tau_rec, 'tau_facil': tau_fac})}, "
        if not isinstance(rule, (stdp, *_SPINNAKER_RULES)):
            raise ModelError(f"{rule.name} has no standard synapse in PyNN")
        if cell.weight == 1.0:
            raise ModelError(f"{rule.name} with weights in mV: simulators of PyNN disagree about the unit of 'w_max'")
        parameters = {word: np.unique(rule.parameters()[word]) for word in rule.numbers()}
        parameters.setdefault("tau_minus", np.unique(target.parameters.get("tau_minus", 0.0)))
        for word, values in parameters.items():
            if values.size > 1:
                raise ModelError(f"'{word}' differs from synapse to synapse: expected one number, as in PyNN")
        p = {word: float(values[0]) for word, values in parameters.items()}
        mechanism = self._stdp(rule, p, cell) if isinstance(rule, (stdp, stdp_nn_symm)) else ""
        mechanism = mechanism or self._spinnaker_rule(part, p, cell)
        if self.spinnaker and self.dopamine.setdefault(part.target, ("", []))[0] != self._dopamine_call(part):
            raise ModelError(_ONE_SOURCE)
        return f"STDPMechanism({mechanism}, dendritic_delay_fraction=dendritic, "

    def _stdp(self, rule: stdp | stdp_nn_symm, p: dict[str, float], cell: Cell) -> str:
        """Return the calls for timing and weight dependence of `stdp` and `stdp_nn_symm`."""
        up, down, plus, minus, largest = (p[word] for word in ("lambda", "alpha", "mu_plus", "mu_minus", "Wmax"))
        if up == 0.0 and down:
            up = down = 0.0
        pair = {"tau_plus": p["tau_plus"], "tau_minus": p["tau_minus"], "A_plus": up, "A_minus": up * down}
        bounds = {"w_min": 0.0, "w_max": largest / cell.weight * (-1.0 if largest < 0 and cell.conductance else 1.0)}
        if self.spinnaker:
            bounds["w_max"] = abs(largest) / cell.weight
        dependence = next((name for name, mus in DEPENDENCES.items() if mus == (plus, minus)), "GutigWeightDependence")
        if dependence == "GutigWeightDependence":
            bounds |= {"mu_plus": plus, "mu_minus": minus}
        arguments = _words(pair)
        if dependence == "AdditiveWeightDependence":
            steps = (f"A_{side}=additive({pair[f'A_{side}']!r}, {bounds['w_max']!r})" for side in ("plus", "minus"))
            arguments = ", ".join((_words({word: pair[word] for word in ("tau_plus", "tau_minus")}), *steps))
        if isinstance(rule, stdp_nn_symm):
            if plus != minus or plus not in (0.0, 1.0) or not rule.pre_at_start:
                raise ModelError("stdp_nn_symm: expected mu_plus and mu_minus both 0 or both 1, and pre_at_start: true")
            return f"{_EXTRA}.SpikeNearestPairRule({arguments}), sim.{dependence}({_words(bounds)})"
        return f"sim.SpikePairRule({arguments}), sim.{dependence}({_words(bounds)})"

    def _spinnaker_rule(self, part: Projection, p: dict[str, float], cell: Cell) -> str:
        """Return the calls for timing and weight dependence of a rule of sPyNNaker, and add its source of dopamine."""
        rule, unit = part.synapse, cell.weight
        largest, multiplicative, timing = abs(p["Wmax"]), False, "pair"
        bounds = {"w_min": abs(p.get("Wmin", 0.0)) / unit, "w_max": largest / unit}
        if isinstance(rule, stdp_dopa):
            self._add_dopamine(part, p, bounds, step := self._dopamine_step(part, p))
            p |= {word: p[word] / (step * p["tau_n"] * unit) for word in ("A_plus", "A_minus")}
            bounds |= {"w_min": 0.0}
        elif isinstance(rule, stdp_triplet):
            timing = "triplet"
            p |= {"tau_x": p["tau_plus_triplet"], "tau_y": p["tau_minus_triplet"]}
            p |= {"A_plus": p["Aplus"] / largest, "A_minus": p["Aminus"] / largest}
            p |= {"A3_plus": p["Aplus_triplet"] / largest, "A3_minus": p["Aminus_triplet"] / largest}
        elif isinstance(rule, vogels_sprekeler):
            timing = "vogels"
            p |= {"tau_plus": p["tau"], "A_plus": p["eta"] / unit, "A_minus": 0.0}
        elif isinstance(rule, spinnaker_learning):
            timing, multiplicative = rule.timing, rule.dependence == "multiplicative"
            if rule.taught:
                self._add_dopamine(part, p, bounds, p["concentration"])
                bounds = {"w_min": p["c_min"] / unit, "w_max": p["c_max"] / unit}
            if not multiplicative and timing != "triplet":
                p |= {word: p[word] * bounds["w_max"] for word in ("A_plus", "A_minus")}
        name, keys = _TIMINGS[timing]
        values = {word: int(p[key]) if word.startswith("acc") else p[key] for word, key in keys.items()}
        dependence = "sim.MultiplicativeWeightDependence" if multiplicative else "sim.AdditiveWeightDependence"
        if timing == "triplet":
            dependence = f"{_EXTRA}.WeightDependenceAdditiveTriplet"
            bounds |= {word: p[word] for word in ("A3_plus", "A3_minus")}
        return f"{name}({_words(values)}), {dependence}({_words(bounds)})"

    def _dopamine_step(self, part: Projection, p: dict[str, float]) -> float:
        """Return the step of dopamine per spike with which the eligibility of `stdp_dopa` can hold `_PAIRS` pairs."""
        if p["b"] != 0.0:
            raise ModelError(f"stdp_dopa.b = {p['b']:g}: dopamine of sPyNNaker has no baseline")
        if p["A_plus"] < 0.0 or p["A_minus"] < 0.0 or (p["c_min"] != 0.0 and p["A_minus"] > 0.0):
            message = "stdp_dopa: eligibility of sPyNNaker has one sign: expected A_plus and A_minus >= 0, and c_min: 0"
            raise ModelError(message)
        share = max(p["A_plus"], p["A_minus"]) / (p["tau_n"] * abs(p["Wmax"]))
        step = min(max(_PAIRS * share, 1.0 / 32.0), 1.0)
        if share > step / _PAIRS:
            note = f"in sPyNNaker the eligibility saturates after {step / share:.2g} pairs of spikes, at w_max"
            self._note(part.name, "stdp_dopa", note)
        return step

    def _dopamine_call(self, part: Projection) -> str:
        """Return the call that connects the projection's dopamine, or ""."""
        return "" if part.dopamine < 0 else self.dopamine[part.target][0]

    def _add_dopamine(self, part: Projection, p: dict[str, float], bounds: dict[str, float], step: float) -> None:
        """Add the projection that releases dopamine.

        Raises:
            ModelError: no population releases dopamine, or the same neurons have another source of dopamine.
        """
        if part.dopamine < 0:
            raise ModelError(f"{part.synapse.name} without 'dopamine': PyNN has no signals")
        source, target = self.program.populations[part.dopamine], self.program.populations[part.target]
        parameters = {"weight": abs(step), "tau_c": p["tau_c"], "tau_d": p["tau_n"]}
        if part.dopamine_delay != 1:
            self._note(part.name, part.synapse.name, "dopamine has no delay in sPyNNaker")
        connector = "OneToOneConnector()" if part.dopamine_one_to_one else "AllToAllConnector()"
        ends = [f'populations["{source.name}"]', f'populations["{target.name}"]', f"sim.{connector}"]
        synapse = f"{_EXTRA}.Neuromodulation({_words(parameters | bounds)})"
        call = [*ends, synapse, f'receptor_type="{"reward" if step > 0 else "punishment"}"']
        if self.dopamine.setdefault(part.target, (", ".join(call), call))[1] != call:
            raise ModelError(_ONE_SOURCE)

    # -- currents, probes

    def _current(self, index: int) -> None:
        """Add a current source per generator and weight. PyNN's currents have no delay, so the sources start later."""
        part = self.program.projections[index]
        source, target = self.program.populations[part.source], self.program.populations[part.target]
        pre, post, rows = self.program.synapses(index)
        weights = np.broadcast_to(part.weight, part.size)[rows]
        delays = np.broadcast_to(part.delay, part.size)[rows]
        groups = np.column_stack((pre, weights, delays))
        for row in np.unique(groups, axis=0):
            ids = post[(groups == row).all(axis=1)].tolist()
            call = self._electrode(source, int(row[0]), float(row[1]), int(row[2]))
            view = f'populations["{target.name}"]' + ("" if len(ids) == target.size else f"[{ids}]")
            self.lines.append(f"sim.{call}.inject_into({view})")

    def _electrode(self, source: Population, neuron: int, weight: float, delay: int) -> str:
        p = {word: float(np.broadcast_to(v, source.size)[neuron]) for word, v in source.parameters.items()}
        delay_ms, scale = delay * self.step, weight / 1000.0
        window = {"start": source.start * self.step + delay_ms}
        window |= {"stop": source.stop * self.step + delay_ms} if source.stop < 1e15 else {}
        match source.model.name:
            case "dc_generator":
                return f"DCSource({_words({'amplitude': p['amplitude'] * scale, **window})})"
            case "ac_generator":
                phase = p["phase"] + 360.0 * p["frequency"] * source.start * self.step / 1000.0
                sizes = {word: p[word] * scale for word in ("amplitude", "offset")}
                return f"ACSource({_words({**sizes, 'frequency': p['frequency'], 'phase': phase, **window})})"
            case "step_current_generator" if source.schedule is not None:
                values = source.schedule.values
                column = values[:, neuron if values.shape[1] > 1 else 0] * scale
                times = source.schedule.steps * self.step + delay_ms
                if "stop" in window or source.start > 0:
                    raise ModelError(
                        f"'start' or 'stop' of {source.model_name} '{source.name}' has no counterpart in PyNN"
                    )
                return f"StepCurrentSource(times={times.tolist()}, amplitudes={column.tolist()})"
        raise ModelError(f"{source.model_name} '{source.name}' has no counterpart in PyNN with the same current")

    def _add_unsupported(self) -> None:
        """Add a problem for each signal, group and trial, which PyNN lacks."""
        for kind, parts in (("signal", self.net.signals), ("group", self.net.groups)):
            for name, part in parts.items():
                self.problems.append(ModelError(f"{kind} '{name}': PyNN has no {kind}s", where=part.origin))
        if self.net.trials_section is not None:
            self.problems.append(ModelError("trials: PyNN has no trials", where=self.net.trials_origin))

    def _probes(self) -> None:
        recorded = [part.name for part in self.program.populations if part.kind != "current"]
        self.lines.append(f'\nrecorded = {recorded!r}\nfor name in recorded:\n    populations[name].record("spikes")')
        for probe in self.program.probes:
            part = self.program.populations[probe.population]
            if probe.record == "spikes":
                continue
            states = {} if part.model.name not in BY_MODEL else BY_MODEL[part.model.name].states
            variable = next((name for name, (state, _) in states.items() if state == probe.record), None)
            if variable is None or probe.mean:
                self._note(probe.name, "probe", _NO_PROBE)
                continue
            view = f'populations["{part.name}"]' + ("" if probe.ids is None else f"[{probe.ids.tolist()}]")
            self.lines.append(f'{view}.record("{variable}", sampling_interval={probe.every * self.step!r})')
        for synapse_probe in self.program.synapse_probes:
            self._note(synapse_probe.name, "probe", _NO_PROBE)


def _unique_pairs(pre: Ints, post: Ints) -> Iterator[Any]:
    """Yield sets of rows in which each pair of neurons occurs once.

    pyNN.brian2 gives all synapses of a pair in a projection the same weight. The pairs ab, ab, ac give [0, 2] and [1].
    """
    order = np.lexsort((post, pre))
    is_new_pair = (np.diff(pre[order], prepend=-1) != 0) | (np.diff(post[order], prepend=-1) != 0)
    first = np.flatnonzero(is_new_pair)
    repeated = np.arange(order.size) - np.repeat(first, np.diff(first, append=order.size))
    for layer in range(int(repeated.max()) + 1):
        yield np.sort(order[repeated == layer])


def _words(values: dict[str, float]) -> str:
    return ", ".join(f"{word}={value!r}" for word, value in values.items())
