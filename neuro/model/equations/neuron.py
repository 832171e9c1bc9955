"""Model classes of neurons that equations define. Parameters are fields, and arithmetic is a generated module."""

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
from neuro.model.equations.definition import CURRENT_NAME, REFRACTORY_STEPS, Definition, read
from neuro.model.equations.dimensions import refuse
from neuro.model.equations.divisions import Divisions, InEquations, Words
from neuro.model.equations.exact import buffer_size, matrix_lines, quiet_lines, slope_of, system
from neuro.model.equations.functions import PUBLIC
from neuro.model.equations.parameters import refuse_attributes
from neuro.model.equations.twin import Twin, twin
from neuro.model.equations.writing import Constants, function, module
from neuro.model.neurons.base import Neuron, State

_RESERVED = dict.fromkeys(("spikes", "rate", "counts"), "a quantity that probes and ports read")
_HEAD = f"""\
import math

from neuro.model.equations.exact import change, lasting, positive, relaxed
from neuro.model.equations.functions import {", ".join(PUBLIC)}
"""


class EquationNeuron(InEquations, Neuron):
    """Base of the neurons in equations."""

    @classmethod
    def twin(cls) -> Twin:
        """Return the built-in model with the same equations.

        Raises:
            ModelError: there is no such model. The message is the reason.
        """
        return twin(read(cls.__name__, cls.definition))

    @classmethod
    def initial(cls, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return the initial states of the definition. By default V_m starts at E_L if both exist."""
        words = list(cls.quantities())
        rows = np.broadcast_arrays(*(np.atleast_1d(parameters[word]) for word in words))
        values = np.zeros((rows[0].size, len(cls.states)))
        arithmetic: Any = cls.arithmetic
        for z, *p in zip(values, *rows, strict=True):
            arithmetic.begin([float(value) for value in p], z)
        return {state.name: values[:, k] for k, state in enumerate(cls.states)}

    @classmethod
    def check_steps(cls, parameters: Mapping[str, Any], resolution: float) -> None:
        """Raise an error for a constant that is not finite, e.g. after a division by 0."""
        try:
            refuse(cls.divisions.mistakes(parameters))
        except ModelError as error:
            raise error.at(None, cls.__name__) from None


def neuron(name: str, words: Mapping[str, Any]) -> type[EquationNeuron]:
    """Create the class of a neuron in equations from the words of its definition.

    Raises:
        ModelError: the first mistake in the definition.
    """
    definition = read(name, words)
    refuse_attributes(definition.parameters, EquationNeuron)
    steps.refuse_reserved(
        definition, _RESERVED | dict.fromkeys(EquationNeuron.quantities(), "a parameter of every neuron")
    )
    constants = Constants(
        definition.parameters,
        1,
        {*definition.states, *definition.let, *(r.name for r in definition.receptors), CURRENT_NAME},
        definition.full,
    )
    expressions: dict[Words, Expression] = {
        ("receptors", r.name, "tau"): r.tau for r in definition.receptors if r.tau is not None
    }
    taus = [*expressions]
    if definition.threshold is not None:
        expressions["threshold",] = definition.threshold
    for section, expressions_by_name in (
        ("equations", definition.states),
        ("reset", definition.reset),
        ("initial", definition.initial),
    ):
        expressions |= {(section, word): expression for word, expression in expressions_by_name.items()}
    divisions = Divisions(definition.parameters, constants.variables, definition.let, expressions, taus)
    refuse(divisions.mistakes({name: p.default for name, p in definition.parameters.items()}))
    linear = system(definition)
    neuron_steps = steps.check_integrator(steps.NeuronSteps(definition, linear, constants))
    text, width = _text(neuron_steps)
    arithmetic = module(text)
    positive_names = {
        *_divisors(definition),
        *(r.tau.tree.name for r in definition.receptors if r.tau and isinstance(r.tau.tree, Name)),
    }
    quantities = {word: p.quantity(word in positive_names) for word, p in definition.parameters.items()}
    if (p := definition.parameters.get("t_ref")) is not None:
        quantities["t_ref"] = Quantity(unit=p.unit, doc=p.doc or "refractory period", at_least=0, arrays=True)
    threshold = definition.plain.get("threshold", "")
    texts = [f"{state}' = {expression.text.strip()}" for state, expression in definition.states.items()]
    texts += [f"{word} = {expression.text.strip()}" for word, expression in definition.let.items()]
    result: type[EquationNeuron] = EquationNeuron.create(
        definition.name,
        [
            (field_of(word), Value, field(default=p.default, metadata={"quantity": quantities[word]}))
            for word, p in definition.parameters.items()
        ],
        arithmetic,
        __doc__=definition.plain.get("doc") or f"A neuron in equations, integrated by {neuron_steps.integrator}.",
        definition=definition.plain,
        divisions=divisions,
        equation="; ".join([*texts, *([f"spike at {threshold}"] if threshold else [])]),
        source=definition.plain.get("source", ""),
        states=_states(neuron_steps),
        receptors=max(1, len(definition.receptors)),
        receptor_names=tuple(r.name for r in definition.receptors),
        conductances=tuple(r.name for r in definition.receptors if r.magnitude),
        linear=neuron_steps.integrator == "exact",
        width=width,
        resets_in_step=neuron_steps.resets_in_step,
        takes_current=definition.takes_current,
    )
    return result


def _divisors(definition: Definition) -> set[str]:
    """Return the names of the parameters by which an equation divides."""

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

    return set().union(*(inner(definition.full(e.tree)) for e in definition.states.values()))


def _states(neuron_steps: steps.NeuronSteps) -> tuple[State, ...]:
    definition = neuron_steps.definition
    slopes = {slope_of(r): r for r in definition.receptors if r.kernel == "alpha"}
    states = []
    for name in neuron_steps.rows:
        if name in slopes:
            dimension = times(definition.dimensions[slopes[name].name], TIME, -1)
            states.append(State(name, unit_of(dimension), f"slope of {slopes[name].name}"))
        elif name in definition.dimensions:
            lowest = 0.0 if any(r.name == name and r.magnitude for r in definition.receptors) else None
            if name in definition.states:
                doc = f"{name}' = {definition.states[name].text.strip()}"
            else:
                doc = f"response to spikes, an {next(r.kernel for r in definition.receptors if r.name == name)} kernel"
            states.append(State(name, unit_of(definition.dimensions[name]), doc, at_least=lowest))
        else:
            doc = "remaining refractory steps" if name == REFRACTORY_STEPS else "size of the next substep"
            states.append(State(name, "steps" if name == REFRACTORY_STEPS else "ms", doc, hidden=True))
    return tuple(states)


def _text(neuron_steps: steps.NeuronSteps) -> tuple[str, int]:
    """Return the text of the module, and the number of constants."""
    definition, constants, linear = neuron_steps.definition, neuron_steps.constants, neuron_steps.linear
    if "V_th" in definition.parameters:
        constants.place(Name("V_th", 0))
    step = steps.step_lines(neuron_steps)
    fire = steps.fire_lines(neuron_steps)
    quiet = None
    if neuron_steps.integrator == "exact" and linear is not None:
        quiet = quiet_lines(definition, linear, constants, neuron_steps.rows.get(REFRACTORY_STEPS))
    initial = {name: e.tree for name, e in definition.initial.items()}
    if "V_m" in definition.states and "E_L" in definition.parameters:
        initial.setdefault("V_m", Name("E_L", 0))
    begin = [f"z[{neuron_steps.rows[name]}] = {constants.of_parameters(tree)}" for name, tree in initial.items()]
    functions = [
        function("begin(p, z)", "Set the states at time 0.", [*constants.locals(), *begin] or ["pass"]),
        function(steps.HEAD, f"Advance one step by {neuron_steps.integrator}.", step),
        function("fire(s, c, i)", "Apply the effects of a spike.", fire),
        function(
            "quiet(s, c, i_0, lo, hi)",
            "Return whether no neuron can fire before its next input.",
            quiet or ["return False"],
        ),
    ]
    if neuron_steps.resets_in_step:
        arguments, lines = steps.rates_function(neuron_steps)
        functions.append(function(f"rates({arguments})", "Return the derivative of each state.", lines))
    constant_lines = list(constants.lines())
    place_lines, places = "", len(constants.places)
    if neuron_steps.integrator == "exact" and linear is not None:
        constant_lines += matrix_lines(linear, constants, "SYSTEM")
        place_lines, places = f"SYSTEM = {places}\n", places + buffer_size(linear)
        if "HELD_SYSTEM" in "".join(step):
            constant_lines += matrix_lines(linear, constants, "HELD_SYSTEM", neuron_steps.hold)
            place_lines, places = place_lines + f"HELD_SYSTEM = {places}\n", places + buffer_size(linear)
    functions.insert(0, function("constants(p, h, c)", "Compute the constants.", constant_lines or ["pass"]))
    text = "\n\n".join(["\n".join([f'"""{definition.name}"""', _HEAD, place_lines]).rstrip() + "\n", *functions])
    return text, max(Neuron.width, len(definition.parameters) + 1, places)
