"""A neuron in equations as a class like any other: its parameters as fields, its arithmetic as a generated module."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np

from neuro.core.errors import ModelError
from neuro.core.grammar import Binary, Call, Expression, Name, Negative, Tree
from neuro.core.quantities import Quantity, Value, field_of
from neuro.core.units import TIME, times, unit_of
from neuro.model.equations import steps
from neuro.model.equations.definition import CURRENT_NAME, HELD, Definition, read
from neuro.model.equations.dimensions import refuse
from neuro.model.equations.divisions import Divisions, InEquations, Words
from neuro.model.equations.exact import matrix_lines, quiet_lines, room, slope_of, system
from neuro.model.equations.functions import PUBLIC
from neuro.model.equations.parameters import refuse_attributes
from neuro.model.equations.twin import Twin, twin
from neuro.model.equations.writing import Constants, function, module
from neuro.model.neurons.base import Neuron, State

_READ_OTHERWISE = dict.fromkeys(("spikes", "rate", "counts"), "what probes and ports read of every neuron")
_HEAD = f"""\
import math

from neuro.model.equations.exact import change, lasting, positive, relaxed
from neuro.model.equations.functions import {", ".join(PUBLIC)}
"""


class EquationNeuron(InEquations, Neuron):
    """Base of the neurons in equations."""

    @classmethod
    def twin(cls) -> Twin:
        """The model of the package with the same equations.

        Raises:
            ModelError: none has them; it says why.
        """
        return twin(read(cls.__name__, cls.definition))

    @classmethod
    def initial(cls, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """The states as the definition says; V_m starts at E_L if nothing is said and there is one."""
        words = list(cls.quantities())
        rows = np.broadcast_arrays(*(np.atleast_1d(parameters[word]) for word in words))
        values = np.zeros((rows[0].size, len(cls.states)))
        arithmetic: Any = cls.arithmetic
        for z, *p in zip(values, *rows, strict=True):
            arithmetic.begin([float(value) for value in p], z)
        return {state.name: values[:, k] for k, state in enumerate(cls.states)}

    @classmethod
    def check_steps(cls, parameters: Mapping[str, Any], resolution: float) -> None:
        """Refuse a division by 0, and any other constant that is not finite."""
        try:
            refuse(cls.divisions.mistakes(parameters))
        except ModelError as error:
            raise error.at(None, cls.__name__) from None


def neuron(name: str, said: Mapping[str, Any]) -> type[EquationNeuron]:
    """Make the class of a neuron in equations.

    Raises:
        ModelError: the first mistake in the words.
    """
    d = read(name, said)
    refuse_attributes(d.parameters, EquationNeuron)
    steps.refuse_added(d, _READ_OTHERWISE | dict.fromkeys(EquationNeuron.quantities(), "a parameter of every neuron"))
    constants = Constants(d.parameters, 1, {*d.states, *d.let, *(r.name for r in d.receptors), CURRENT_NAME}, d.full)
    expressions: dict[Words, Expression] = {
        ("receptors", r.name, "tau"): r.tau for r in d.receptors if r.tau is not None
    }
    taus = [*expressions]
    if d.threshold is not None:
        expressions["threshold",] = d.threshold
    for section, named in (("equations", d.states), ("reset", d.reset), ("initial", d.initial)):
        expressions |= {(section, word): expression for word, expression in named.items()}
    divisions = Divisions(d.parameters, constants.variables, d.let, expressions, taus)
    refuse(divisions.mistakes({name: p.default for name, p in d.parameters.items()}))
    linear = system(d)
    whole = steps.checked(steps.NeuronSteps(d, linear, constants))
    text, width = _text(whole)
    arithmetic = module(text)
    positive = {*_divisors(d), *(r.tau.tree.name for r in d.receptors if r.tau and isinstance(r.tau.tree, Name))}
    quantities = {word: p.quantity(word in positive) for word, p in d.parameters.items()}
    if (p := d.parameters.get("t_ref")) is not None:
        quantities["t_ref"] = Quantity(unit=p.unit, doc=p.doc or "refractory period", at_least=0, arrays=True)
    threshold = d.plain.get("threshold", "")
    texts = [f"{state}' = {expression.text.strip()}" for state, expression in d.states.items()]
    texts += [f"{word} = {expression.text.strip()}" for word, expression in d.let.items()]
    result: type[EquationNeuron] = EquationNeuron.made(
        d.name,
        [
            (field_of(word), Value, field(default=p.default, metadata={"quantity": quantities[word]}))
            for word, p in d.parameters.items()
        ],
        arithmetic,
        __doc__=d.plain.get("doc") or f"A neuron in equations, integrated by {whole.integrator}.",
        definition=d.plain,
        divisions=divisions,
        equation="; ".join([*texts, *([f"spike at {threshold}"] if threshold else [])]),
        source=d.plain.get("source", ""),
        states=_states(whole),
        receptors=max(1, len(d.receptors)),
        receptor_names=tuple(r.name for r in d.receptors),
        conductances=tuple(r.name for r in d.receptors if r.magnitude),
        linear=whole.integrator == "exact",
        width=width,
        resets_in_step=whole.resets_in_step,
        takes_current=d.takes_current,
    )
    return result


def _divisors(d: Definition) -> set[str]:
    """The parameters by which is divided."""

    def inner(tree: Tree) -> set[str]:
        match tree:
            case Binary("/", left, Name(name)):
                return {name, *inner(left)}
            case Binary(_, left, right):
                return inner(left) | inner(right)
            case Negative(of):
                return inner(of)
            case Call(_, arguments):
                return set().union(*map(inner, arguments))
        return set()

    return set().union(*(inner(d.full(e.tree)) for e in d.states.values()))


def _states(whole: steps.NeuronSteps) -> tuple[State, ...]:
    d = whole.definition
    slopes = {slope_of(r): r for r in d.receptors if r.kernel == "alpha"}
    states = []
    for name in whole.rows:
        if name in slopes:
            dimension = times(d.dimensions[slopes[name].name], TIME, -1)
            states.append(State(name, unit_of(dimension), f"slope of {slopes[name].name}"))
        elif name in d.dimensions:
            lowest = 0.0 if any(r.name == name and r.magnitude for r in d.receptors) else None
            if name in d.states:
                doc = f"{name}' = {d.states[name].text.strip()}"
            else:
                doc = f"what spikes leave, an {next(r.kernel for r in d.receptors if r.name == name)} kernel"
            states.append(State(name, unit_of(d.dimensions[name]), doc, at_least=lowest))
        else:
            doc = "steps left to hold" if name == HELD else "size of the next part of a step"
            states.append(State(name, "steps" if name == HELD else "ms", doc, hidden=True))
    return tuple(states)


def _text(whole: steps.NeuronSteps) -> tuple[str, int]:
    """The module, and how many constants it has room for."""
    d, constants, linear = whole.definition, whole.constants, whole.linear
    if "V_th" in d.parameters:
        constants.place(Name("V_th", 0))
    step = steps.step_lines(whole)
    fire = steps.fire_lines(whole)
    quiet = None
    if whole.integrator == "exact" and linear is not None:
        quiet = quiet_lines(d, linear, constants, whole.rows.get(HELD))
    initial = {name: e.tree for name, e in d.initial.items()}
    if "V_m" in d.states and "E_L" in d.parameters:
        initial.setdefault("V_m", Name("E_L", 0))
    begin = [f"z[{whole.rows[name]}] = {constants.of_parameters(tree)}" for name, tree in initial.items()]
    functions = [
        function("begin(p, z)", "The states at time 0.", [*constants.locals(), *begin] or ["pass"]),
        function(steps.HEAD, f"One step, by {whole.integrator}.", step),
        function("fire(s, c, i)", "What a spike does.", fire),
        function("quiet(s, c, i_0, lo, hi)", "Whether none can fire before its next input.", quiet or ["return False"]),
    ]
    if whole.resets_in_step:
        arguments, lines = steps.rates_function(whole)
        functions.append(function(f"rates({arguments})", "How fast each state changes.", lines))
    filled = list(constants.lines())
    numbers, places = "", len(constants.places)
    if whole.integrator == "exact" and linear is not None:
        filled += matrix_lines(linear, constants, "SYSTEM")
        numbers, places = f"SYSTEM = {places}\n", places + room(linear)
        if "HELD_SYSTEM" in "".join(step):
            filled += matrix_lines(linear, constants, "HELD_SYSTEM", whole.hold)
            numbers, places = numbers + f"HELD_SYSTEM = {places}\n", places + room(linear)
    functions.insert(0, function("constants(p, h, c)", "What is worked out once.", filled or ["pass"]))
    text = "\n\n".join(["\n".join([f'"""{d.name}"""', _HEAD, numbers]).rstrip() + "\n", *functions])
    return text, max(Neuron.width, len(d.parameters) + 1, places)
