"""A network as a script of PyNN that runs unchanged on pyNN.nest, pyNN.brian2 and sPyNNaker.

What is drawn here, and what a script would be too long for, is written as arrays into a file beside it.
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
"""Of a step: how much before its end a spike is listed. NEST and sPyNNaker round times up to a step. Brian2, which
names a step by its beginning, rounds down. So all take the step that the time lies in."""
_WITHOUT = {
    **{"V_min": -np.inf, "refractory_input": 0.0, "rk4_substeps": 0.0, "gsl_error_tol": 1e-6},
    **{"reset_by_subtraction": 0.0, "max_spikes": 1.0, "threshold_rises": 0.0},
}
"""Parameters that no cell of PyNN has, with the value that stands for none."""
_PEAK = 30.0
"""mV, the threshold of Izhikevich's neuron in PyNN."""

_OF_SPINNAKER = (stdp_nn_symm, stdp_triplet, vogels_sprekeler, stdp_dopa, spinnaker_learning)
"""Rules that only sPyNNaker has."""
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
"""Of each timing the rule of sPyNNaker, and its parameters with ours."""
_PAIRS = 16.0
"""Pairs of spikes for which an eligibility has room."""

_DELTA = """if not hasattr(sim.IF_curr_delta, "variable_map"):  # pyNN.nest 0.13 has forgotten its potential
    sim.IF_curr_delta.variable_map, sim.IF_curr_delta.scale_factors = {"v": "V_m"}, {"v": 1.0}"""


def to_pynn(net: Network, path: str | os.PathLike[str], *, seed: int = 0, duration: Any = None) -> Verdicts:
    """Write a network as a script of PyNN, with a file `.npz` beside it for arrays.

    Weights and delays are in PyNN's units. What the network draws for this seed (connections, weights, delays,
    parameters, initial values) is written as numbers, so every simulator has the same network.

    Args:
        net: the network.
        path: ends in `.py`.
        seed: of what is drawn.
        duration: ms for which the script runs, 1000 if not given. If it is given the trains of random generators are
            drawn for so long and written as spike times; otherwise a simulator draws those of `poisson_generator`.

    Returns:
        What is otherwise there.

    Raises:
        ModelError: the network has what PyNN's standard has not; `others` has each part. Or a file cannot be written.
    """
    if not isinstance(net, Network):
        raise ModelError(f"to_pynn: found {net!r:.60}: expected a Network")
    file = file_path(path, "path")
    if file.suffix != ".py":
        raise ModelError(f"{file}: cannot be written: expected a name ending in .py")
    number = int(check(_SEED, seed, "seed"))
    long = None if duration is None else float(check(_DURATION, duration, "duration"))
    written = _Script(net, number, long)
    text, arrays = written.text(file)
    with output(file, _SCRIPT) as script:
        script.write_text(_SCRIPT.seal(text), "utf-8")
        if arrays:
            with output(file.with_suffix(".npz"), _ARRAYS) as part, part.open("wb") as stream:
                np.savez(stream, allow_pickle=False, written_by_neuro=np.zeros(0), **arrays)
    notes = (Verdict(part, kind, APPROXIMATE, how) for part, kind, how in written.notes)
    return Verdicts(f"{net.name} for PyNN", tuple(notes))


class _Script:
    """The lines of a script, and its arrays."""

    def __init__(self, net: Network, seed: int, duration: float | None) -> None:
        self.net, self.seed, self.duration = net, seed, duration
        self.program: Program = compile_network(net, seed)
        self.step = self.program.resolution
        self.lines: list[str] = []
        self.arrays: dict[str, Any] = {}
        self.problems: list[ModelError] = []
        self.notes: list[tuple[str, str, str]] = []
        self.trains: dict[str, tuple[Floats, Ints]] = {}
        self.spinnaker = any(isinstance(part.synapse, _OF_SPINNAKER) for part in self.program.projections)
        self.dopamine: dict[int, tuple[str, list[str]]] = {}

    def text(self, file: Path) -> tuple[str, dict[str, Any]]:
        """The script, and the arrays for the file beside it."""
        self._draw()
        if any(part.model.name == "iaf_psc_delta" for part in self.program.populations):
            self.lines.append(_DELTA)
        for part in self.program.populations:
            self._try(part.origin, f"population '{part.name}'", self._population, part)
        for index, one in enumerate(self.program.projections):
            self._try(one.origin, f"projection '{one.name}'", self._projection, index)
        for _, call in self.dopamine.values():
            if call:
                self._call("sim.Projection(", call)
        self._others()
        if self.problems:
            count = f"{len(self.problems)} problem" + "s" * (len(self.problems) > 1)
            message = f"network '{self.net.name}' cannot be a script of PyNN ({count})"
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

    def _try(self, where: Where | None, what: str, add: Any, part: Any) -> None:
        try:
            add(part)
        except ModelError as error:
            self.problems.append(error.at(where, what))

    def _note(self, part: str, kind: str, how: str) -> None:
        self.notes.append((part, kind, how))

    def _call(self, head: str, words: Iterable[str], tail: str = ")") -> None:
        """A call on one line, or with an argument on each."""
        words = list(words)
        line = f"{head}{', '.join(words)}{tail}"
        if len(line) > _WIDTH:
            line = head + "".join(f"\n    {word}," for word in words) + "\n" + tail
        self.lines.append(line)

    def _value(self, name: str, values: Any) -> str:
        """A number where all are equal, else the name of an array beside the script."""
        values = np.asarray(values, dtype=float)
        if values.size and (values == values.flat[0]).all():
            return repr(float(values.flat[0]))
        self.arrays[name] = values
        return f'data["{name}"]'

    # -- populations

    def _draw(self) -> None:
        """The trains of generators that draw or play, where the script has a duration."""
        kinds = [part for part in self.program.populations if self._draws(part)]
        if self.duration is None or not kinds:
            return
        from neuro import compile

        alone = Network(self.net.name, resolution=self.step)
        alone.populations = {part.name: self.net.populations[part.name] for part in kinds}
        for part in kinds:
            alone.probe(f"{part.name}.spikes", part.name)
        sim = compile(alone, seed=self.seed)
        sim.run(np.ceil(self.duration / self.step - 1e-6) * self.step)
        self.trains = {part.name: sim.spikes(part.name) for part in kinds}

    @staticmethod
    def _draws(part: Population) -> bool:
        return part.kind in ("poisson", "generator") or part.stream is not None

    def _population(self, part: Population) -> None:
        if part.kind == "current":
            return  # written where it is injected
        if part.kind == "neuron":
            if part.model.name not in BY_MODEL:
                raise ModelError(f"{part.said} is no standard cell of PyNN")
            cell, values = self._cell(part)
        else:
            cell, values = self._source(part)
        words = [f"{word}={value}" for word, value in values.items()]
        end = [*self._initial(part), f'label="{part.name}"']
        self._call(
            f'populations["{part.name}"] = sim.Population(', [f"{part.size}", f"sim.{cell}({', '.join(words)})", *end]
        )

    def _cell(self, part: Population) -> tuple[str, dict[str, str]]:
        cell, own = BY_MODEL[part.model.name], part.parameters
        for word, none in (_WITHOUT | ({"V_th": _PEAK} if cell.name == "Izhikevich" else {})).items():
            if word in own and np.any(own[word] != none):
                raise ModelError(f"'{word}' has no counterpart in PyNN's {cell.name}")
        values = cell.there({word: np.broadcast_to(value, part.size) for word, value in own.items()})
        return cell.name, {word: self._value(f"{part.name}.{word}", value) for word, value in values.items()}

    def _initial(self, part: Population) -> list[str]:
        if part.kind != "neuron":
            return []
        known = {state: (theirs, factor) for theirs, (state, factor) in BY_MODEL[part.model.name].states.items()}
        found = []
        for state, values in part.initial.items():
            if state in known:
                theirs, factor = known[state]
                value = np.broadcast_to(values / factor, part.size)
                if state in ("V_m", "U_m") or np.any(value != 0.0):
                    found.append(f'"{theirs}": {self._value(f"{part.name}.initial.{theirs}", value)}')
            elif np.any(values != 0.0):
                raise ModelError(f"the initial value of '{state}' has no counterpart in PyNN")
        return [f"initial_values={{{', '.join(found)}}}"] if found else []

    def _source(self, part: Population) -> tuple[str, dict[str, str]]:
        if part.name in self.trains:
            times, ids = self.trains[part.name]
            return self._listed(part, np.rint(times / self.step), ids)
        if part.model.graded:
            raise ModelError(f"{part.said} has no counterpart in PyNN, whose spikes carry no payloads")
        if part.kind == "listed" and part.stream is None:
            return self._listed(part, part.spike_steps, part.spike_ids)
        if part.kind == "poisson" and part.schedule is None:
            words = {"rate": self._value(f"{part.name}.rate", np.broadcast_to(part.parameters["rate"], part.size))}
            words["start"] = repr(part.start * self.step)
            if part.stop < 1e15:
                words["duration"] = repr((part.stop - part.start) * self.step)
            return "SpikeSourcePoisson", words
        raise ModelError(f"{part.said} is no standard cell of PyNN", hint="duration=100.0 writes its trains of 100 ms")

    def _listed(self, part: Population, steps: Any, ids: Any) -> tuple[str, dict[str, str]]:
        if lost := np.count_nonzero(np.asarray(steps) == 1):
            how = f"{lost} of {some(len(ids), 'spike')} are in the first step, and are lost in pyNN.nest"
            self._note(part.name, "population", how)
        if twice := len(ids) - np.unique(np.column_stack((steps, ids)), axis=0).shape[0]:
            how = f"{some(twice, 'spike')} beyond the first of a neuron in a step, which pyNN.brian2 refuses"
            self._note(part.name, "population", how)
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
            raise ModelError("the receptor is named, and the sign of a weight says another; PyNN has none by name")
        if part.carries == "current":
            self._current(index)
            return
        cell = BY_MODEL[target.model.name]
        learns = self._learning(part, target, cell)
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
            weights = abs(weights)  # the receptor has the sign
        for receptor, chosen in (("excitatory", ~negative), ("inhibitory", negative)):
            if chosen.any():
                sign = -1.0 if receptor == "inhibitory" and cell.conductance and not self.spinnaker else 1.0
                ends = (pre[chosen], post[chosen], weights[chosen] * sign, delays[chosen])
                name = part.name if chosen.all() else f"{part.name}.{receptor}"
                for layer, rows in enumerate(_once(ends[0], ends[1])):
                    label = f"{name}.{layer + 1}" if layer else name
                    self._connect(part, label, receptor, tuple(column[rows] for column in ends), learns)

    def _connect(self, part: Projection, name: str, receptor: str, ends: tuple[Any, ...], learns: str) -> None:
        pre, post, weights, delays = ends
        source, target = self.program.populations[part.source], self.program.populations[part.target]
        alike = (weights == weights[0]).all() and (delays == delays[0]).all()
        whole = alike and pre.size == part.size and part.grid is None
        connector = {"one_to_one": "OneToOneConnector()", "dense": "AllToAllConnector()"}.get(part.layout, "")
        if part.size == 1:
            connector = "AllToAllConnector()"  # of single neurons PyNN 0.13 has no other with NumPy 2.1 and later
        if not (whole and connector):
            self.arrays[name] = np.column_stack((pre, post, weights, delays))
            connector = f'FromListConnector(data["{name}"], column_names=["weight", "delay"])'
        numbers = f"weight={float(weights[0])!r}, delay={float(delays[0])!r}"
        words = [
            f'populations["{source.name}"]',
            f'populations["{target.name}"]',
            f"sim.{connector}",
            f"sim.{learns}{numbers})",
            f'receptor_type="{receptor}"',
            f'label="{name}"',
        ]
        self._call("sim.Projection(", words)

    def _learning(self, part: Projection, target: Population, cell: Cell) -> str:
        """The beginning of the call that makes the synapse."""
        rule = part.synapse
        if isinstance(rule, static):
            return "StaticSynapse("
        if isinstance(rule, tsodyks2):
            shares = np.unique(rule.U)
            if shares.size > 1:
                raise ModelError("'U' differs from synapse to synapse; PyNN has one number")
            share, tau_rec, tau_fac = float(shares[0]), float(rule.tau_rec), float(rule.tau_fac)
            active = target.parameters.get("tau_syn_in" if np.all(part.arriving(part.weight) < 0.0) else "tau_syn_ex")
            if active is not None:
                self._note(part.name, rule.name, difference(share, tau_rec, tau_fac, float(np.mean(active))))
            return f"TsodyksMarkramSynapse({_words({'U': share, 'tau_rec': tau_rec, 'tau_facil': tau_fac})}, "
        if not isinstance(rule, (stdp, *_OF_SPINNAKER)):
            raise ModelError(f"{rule.name} is no standard synapse of PyNN")
        if cell.weight == 1.0:
            raise ModelError(f"{rule.name} of weights in mV: simulators of PyNN disagree about the unit of 'w_max'")
        described = {word: np.unique(rule.parameters()[word]) for word in rule.numbers()}
        described.setdefault("tau_minus", np.unique(target.parameters.get("tau_minus", 0.0)))
        for word, values in described.items():
            if values.size > 1:
                raise ModelError(f"'{word}' differs from synapse to synapse; PyNN has one number")
        p = {word: float(values[0]) for word, values in described.items()}
        mechanism = self._pairs(rule, p, cell) if isinstance(rule, (stdp, stdp_nn_symm)) else ""
        mechanism = mechanism or self._of_spinnaker(part, p, cell)
        if self.spinnaker and self.dopamine.setdefault(part.target, ("", []))[0] != self._teacher(part):
            raise ModelError("all that learn onto a population of sPyNNaker share one source of dopamine")
        return f"STDPMechanism({mechanism}, dendritic_delay_fraction=dendritic, "

    def _pairs(self, rule: stdp | stdp_nn_symm, p: dict[str, float], cell: Cell) -> str:
        """Timing and weight dependence of `stdp` and `stdp_nn_symm`."""
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
        words = _words(pair)
        if dependence == "AdditiveWeightDependence":
            steps = (f"A_{side}=additive({pair[f'A_{side}']!r}, {bounds['w_max']!r})" for side in ("plus", "minus"))
            words = ", ".join((_words({word: pair[word] for word in ("tau_plus", "tau_minus")}), *steps))
        if isinstance(rule, stdp_nn_symm):
            if plus != minus or plus not in (0.0, 1.0) or not rule.pre_at_start:
                raise ModelError("stdp_nn_symm: expected mu_plus and mu_minus both 0 or both 1, and pre_at_start: true")
            return f"{_EXTRA}.SpikeNearestPairRule({words}), sim.{dependence}({_words(bounds)})"
        return f"sim.SpikePairRule({words}), sim.{dependence}({_words(bounds)})"

    def _of_spinnaker(self, part: Projection, p: dict[str, float], cell: Cell) -> str:
        """Timing and weight dependence of the rules that only sPyNNaker has; notes where dopamine comes from."""
        rule, unit = part.synapse, cell.weight
        largest, multiplicative, timing = abs(p["Wmax"]), False, "pair"
        bounds = {"w_min": abs(p.get("Wmin", 0.0)) / unit, "w_max": largest / unit}
        if isinstance(rule, stdp_dopa):
            self._teach(part, p, bounds, rises := self._rise(part, p))
            p |= {word: p[word] / (rises * p["tau_n"] * unit) for word in ("A_plus", "A_minus")}
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
                self._teach(part, p, bounds, p["concentration"])
                bounds = {"w_min": p["c_min"] / unit, "w_max": p["c_max"] / unit}
            if not multiplicative and timing != "triplet":
                p |= {word: p[word] * bounds["w_max"] for word in ("A_plus", "A_minus")}
        name, words = _TIMINGS[timing]
        values = {theirs: int(p[ours]) if theirs.startswith("acc") else p[ours] for theirs, ours in words.items()}
        dependence = "sim.MultiplicativeWeightDependence" if multiplicative else "sim.AdditiveWeightDependence"
        if timing == "triplet":
            dependence = f"{_EXTRA}.WeightDependenceAdditiveTriplet"
            bounds |= {word: p[word] for word in ("A3_plus", "A3_minus")}
        return f"{name}({_words(values)}), {dependence}({_words(bounds)})"

    def _rise(self, part: Projection, p: dict[str, float]) -> float:
        """By how much a spike raises dopamine of `stdp_dopa`, so that eligibility has room for some pairs."""
        if p["b"] != 0.0:
            raise ModelError(f"stdp_dopa.b = {p['b']:g}: dopamine of sPyNNaker has no baseline")
        if p["A_plus"] < 0.0 or p["A_minus"] < 0.0 or (p["c_min"] != 0.0 and p["A_minus"] > 0.0):
            message = "stdp_dopa: eligibility of sPyNNaker has one sign: expected A_plus and A_minus at least 0"
            raise ModelError(f"{message}, and c_min: 0")
        share = max(p["A_plus"], p["A_minus"]) / (p["tau_n"] * abs(p["Wmax"]))
        rises = min(max(_PAIRS * share, 1.0 / 32.0), 1.0)
        if share > rises / _PAIRS:
            how = f"there the eligibility ends after {rises / share:.2g} pairs of spikes, at w_max"
            self._note(part.name, "stdp_dopa", how)
        return rises

    def _teacher(self, part: Projection) -> str:
        """What a projection hears of dopamine."""
        return "" if part.dopamine < 0 else self.dopamine[part.target][0]

    def _teach(self, part: Projection, p: dict[str, float], bounds: dict[str, float], rises: float) -> None:
        """Note the projection that brings dopamine.

        Raises:
            ModelError: no population releases it, or another one does for the same neurons.
        """
        if part.dopamine < 0:
            raise ModelError(f"{part.synapse.name} without 'dopamine': PyNN has no signals")
        source, target = self.program.populations[part.dopamine], self.program.populations[part.target]
        words = {"weight": abs(rises), "tau_c": p["tau_c"], "tau_d": p["tau_n"]}
        if part.dopamine_delay != 1:  # sPyNNaker's has no delay
            self._note(part.name, part.synapse.name, "there dopamine acts after the delay of the synapse alone")
        connector = "OneToOneConnector()" if part.dopamine_one_to_one else "AllToAllConnector()"
        ends = [f'populations["{source.name}"]', f'populations["{target.name}"]', f"sim.{connector}"]
        made = f"{_EXTRA}.Neuromodulation({_words(words | bounds)})"
        call = [*ends, made, f'receptor_type="{"reward" if rises > 0 else "punishment"}"']
        if self.dopamine.setdefault(part.target, (", ".join(call), call))[1] != call:
            raise ModelError("all that learn onto a population of sPyNNaker share one source of dopamine")

    # -- currents, probes

    def _current(self, index: int) -> None:
        """A source for each generator and weight; it acts at once in PyNN, so it is on later by the delay."""
        part = self.program.projections[index]
        source, target = self.program.populations[part.source], self.program.populations[part.target]
        pre, post, place = self.program.synapses(index)
        weights = np.broadcast_to(part.weight, part.size)[place]
        delays = np.broadcast_to(part.delay, part.size)[place]
        groups = np.column_stack((pre, weights, delays))
        for row in np.unique(groups, axis=0):
            ids = post[(groups == row).all(axis=1)].tolist()
            call = self._electrode(source, int(row[0]), float(row[1]), int(row[2]))
            of = f'populations["{target.name}"]' + ("" if len(ids) == target.size else f"[{ids}]")
            self.lines.append(f"sim.{call}.inject_into({of})")

    def _electrode(self, source: Population, neuron: int, weight: float, delay: int) -> str:
        own = {word: float(np.broadcast_to(v, source.size)[neuron]) for word, v in source.parameters.items()}
        late, scale = delay * self.step, weight / 1000.0
        window = {"start": source.start * self.step + late}
        window |= {"stop": source.stop * self.step + late} if source.stop < 1e15 else {}
        match source.model.name:
            case "dc_generator":
                return f"DCSource({_words({'amplitude': own['amplitude'] * scale, **window})})"
            case "ac_generator":
                phase = own["phase"] + 360.0 * own["frequency"] * source.start * self.step / 1000.0
                sizes = {word: own[word] * scale for word in ("amplitude", "offset")}
                return f"ACSource({_words({**sizes, 'frequency': own['frequency'], 'phase': phase, **window})})"
            case "step_current_generator" if source.schedule is not None:
                values = source.schedule.values
                column = values[:, neuron if values.shape[1] > 1 else 0] * scale
                times = source.schedule.steps * self.step + late
                if "stop" in window or source.start > 0:
                    raise ModelError(f"'start' or 'stop' of {source.said} '{source.name}' has no counterpart in PyNN")
                return f"StepCurrentSource(times={times.tolist()}, amplitudes={column.tolist()})"
        raise ModelError(f"{source.said} '{source.name}' has no counterpart in PyNN that gives the same current")

    def _others(self) -> None:
        """What PyNN has not."""
        parts: Iterator[tuple[str, Any]] = iter(
            [("signal", one) for one in self.net.signals.values()]
            + [("group", one) for one in self.net.groups.values()]
        )
        for word, one in parts:
            self.problems.append(ModelError(f"{word} '{one.name}': PyNN has no such part", where=one.origin))
        if self.net.trials_section is not None:
            self.problems.append(ModelError("trials: PyNN has none", where=self.net.trials_origin))

    def _probes(self) -> None:
        recorded = [part.name for part in self.program.populations if part.kind != "current"]
        self.lines.append(f'\nrecorded = {recorded!r}\nfor name in recorded:\n    populations[name].record("spikes")')
        for probe in self.program.probes:
            part = self.program.populations[probe.population]
            if probe.record == "spikes":
                continue
            states = {} if part.model.name not in BY_MODEL else BY_MODEL[part.model.name].states
            theirs = next((name for name, (state, _) in states.items() if state == probe.record), None)
            if theirs is None or probe.mean:
                self._note(probe.name, "probe", "has no counterpart in PyNN and is left out")
                continue
            of = f'populations["{part.name}"]' + ("" if probe.ids is None else f"[{probe.ids.tolist()}]")
            self.lines.append(f'{of}.record("{theirs}", sampling_interval={probe.every * self.step!r})')
        for other in self.program.synapse_probes:
            self._note(other.name, "probe", "has no counterpart in PyNN and is left out")


def _once(pre: Ints, post: Ints) -> Iterator[Any]:
    """Rows in which each pair is there once, since pyNN.brian2 gives all synapses of a pair the same weight."""
    order = np.lexsort((post, pre))
    fresh = (np.diff(pre[order], prepend=-1) != 0) | (np.diff(post[order], prepend=-1) != 0)
    first = np.flatnonzero(fresh)
    repeated = np.arange(order.size) - np.repeat(first, np.diff(first, append=order.size))
    for layer in range(int(repeated.max()) + 1):
        yield np.sort(order[repeated == layer])


def _words(values: dict[str, float]) -> str:
    return ", ".join(f"{word}={value!r}" for word, value in values.items())
