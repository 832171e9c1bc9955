"""Checks of values that may change during a run, and their conversion for the engine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from neuro.compiler.check import check_conductance, check_values
from neuro.compiler.values import per_neuron
from neuro.core.checks import check, is_number, numbers, refuse_masked
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import LARGEST, Quantity, word_of
from neuro.core.values import FromFile, shown
from neuro.model.distributions import Distribution
from neuro.model.neurons import Model
from neuro.model.space import of_distance
from neuro.model.synapses import Synapse
from neuro.program.backend import Engine
from neuro.program.program import Floats, Ints, Population, Program, Projection, synapse_states
from neuro.run.handles import Neurons

Chosen = NDArray[np.bool_] | Ints
"""Some synapses of a projection: a mask over all synapses, or indices in a chosen order."""
_WEIGHT = Quantity(arrays=True)
_FIXED = ("deliver_interval",)
"""Parameters of synapse models that are fixed once compiled."""
_RANGE = ("d_min", "d_max")
"""Bounds of rules that change delays; these rules keep them fixed too."""
_DRAWN = "weights are drawn when connections are made: net.connect(..., weight=...)"
_PAIRS = (("V_th", "V_reset"), ("V_peak", "V_reset"), ("std", "std_mod"), ("rate", "amplitude"))
_PARTNERS = (*_PAIRS, *((second, first) for first, second in _PAIRS))
"""Pairs of parameters that are checked together, in both orders."""


@cache
def _quantities(model: type[Model]) -> dict[str, Quantity]:
    """Return the parameters of a model. They are cached, since a closed loop needs them at every step."""
    return model.quantities()


@cache
def _states(model: type[Model]) -> dict[str, Quantity]:
    """Return the states of a model, cached like the parameters."""
    return {state.name: state.quantity() for state in model.states}


def states(part: Population) -> list[str]:
    """Return the names of the states of a population that can be read and set."""
    return [state.name for state in part.model.states if not state.hidden]


def new_values(neurons: Neurons, word: str, value: Any, engine: Engine, seed: int) -> Floats:
    """Return all values of a state or parameter of a population, shape (1,) or (size,), with some values changed.

    Args:
        neurons: the neurons whose values change.
        word: the state or parameter.
        value: a number, an array or a distribution.
        engine: source of the values that do not change. Draws depend on its step.
        seed: seed for the draws of a distribution.
    """
    part, ids = neurons.part, neurons.ids
    quantity = _settable_quantity(part, word)
    name = f"{part.name}.{word}"
    key = (seed, "set", f"{name}@{engine.step}")
    if ids is None:
        return _one_or_each(quantity, value, part.shape, name, key)
    values = engine.get(neurons.index, word)
    if isinstance(value, Distribution):
        # Values are drawn for all neurons: the value of a neuron does not depend on the view.
        values[ids] = _one_or_each(quantity, value, part.shape, name, key)[ids]
    else:
        values[ids] = _one_or_each(quantity, value, neurons.end.shape, name, key)
    return values


def _settable_quantity(part: Population, word: str) -> Quantity:
    """Return the quantity of a parameter or state that can be set; raise an error otherwise."""
    model: Any = type(part.model)
    if word in part.parameters and word not in part.model.fixed:
        quantity = _quantities(model)[word]
    elif word in states(part):
        if any(state.follows for state in part.model.states if state.name == word):
            raise ModelError(f"{part.model.name}.{word} of '{part.name}' follows from other states: set those")
        quantity = _states(model)[word]
    else:
        names = [*(name for name in part.parameters if name not in part.model.fixed), *states(part)]
        if word in _quantities(model):
            raise ModelError(
                f"{part.model.name}.{word} of '{part.name}' is fixed: change the network and compile again"
            )
        raise unknown("parameter or state", word, names).at(None, f"population '{part.name}'")
    return quantity


def quantity_of(part: Population, word: str) -> Quantity | None:
    """Return the quantity of a parameter or state of a population; None if it cannot be set."""
    try:
        return _settable_quantity(part, word)
    except ModelError:
        return None


def _one_or_each(
    quantity: Quantity, value: Any, shape: tuple[int, ...], label: str, key: tuple[int, str, str]
) -> Floats:
    """Check a value, and convert it for the neurons of a shape: (1,) for one value for all neurons, else (size,)."""
    size = math.prod(shape)
    if type(value) is np.ndarray and value.dtype == np.float64 and value.shape == (size,) and _inside(quantity, value):
        return value
    if quantity.kind == "boolean":
        return np.array([float(check(quantity, value, label))])
    accepted = check(quantity, value, label)
    array = per_neuron(accepted, shape, label, key)
    if isinstance(accepted, (Distribution, FromFile)):
        check(quantity, array, label)
    return array


def _inside(quantity: Quantity, array: Floats) -> bool:
    """Return whether all values of an array are certainly valid. Values that are not are checked again by `check`."""
    low, high = array.min(), array.max()
    finite = low > -np.inf and high < np.inf
    return bool(finite and all(holds(low, bound) and holds(high, bound) for _, bound, holds in quantity.bounds))


def check_together(program: Program, index: int, new: Mapping[str, Floats], engine: Engine, clock: Clock) -> None:
    """Refuse parameters that conflict with each other or with other parameters of their population.

    Args:
        program: the whole network.
        index: index of the population.
        new: new parameters and states by name.
        engine: source of the present values of the other parameters.
        clock: clock of the network.
    """
    part = program.populations[index]
    if "tau_minus" in new and any(p.target == index and p.synapse.learns == "pairs" for p in program.projections):
        message = f"{part.name}.tau_minus: plastic synapses read this trace, so it is fixed once compiled"
        raise ModelError(message, hint="change the network and compile again")
    combined = {word: array for word, array in new.items() if word in part.parameters}
    for word, partner in _PARTNERS:
        if word in combined and partner in part.parameters and partner not in combined:
            combined[partner] = engine.get(index, partner)
    try:
        check_values(part.model, combined, clock)
    except ModelError as error:
        raise error.at(None, f"population '{part.name}'") from None


def new_rule(part: Projection, rule: Synapse, values: Mapping[str, Any], chosen: Chosen | None = None) -> Synapse:
    """Return a synapse model with some parameters changed.

    Args:
        part: the projection.
        rule: present synapse model of the projection.
        values: new values by name: a number, or an array with a value for each synapse if the model accepts arrays.
        chosen: the synapses to change, None for all.
    """
    names = {word_of(entry.name): entry.name for entry in fields(rule)}
    fixed_taus = _postsynaptic_taus(rule)
    settable = [*settable_numbers(rule), *fixed_taus]
    for word in values:
        if word in fixed_taus:
            message = f"{rule.name}.{word} of '{part.name}': a trace of post spikes decays with it, so it is fixed"
            raise ModelError(message, hint="change the network and compile again")
        if word in names and word not in settable:
            raise ModelError(f"{rule.name}.{word} of '{part.name}' is fixed: change the network and compile again")
        if word not in settable:
            raise _no_parameter(part, rule, word, settable)
    new = {word: _changed_parameter(part, rule, word, value, chosen) for word, value in values.items()}
    return replace(rule, **{names[word]: value for word, value in new.items()})


def settable_numbers(rule: Synapse) -> list[str]:
    """Return the names of the parameters of a synapse model that can be set."""
    fixed = {
        *_FIXED,
        *(trace.starts for trace in rule.pre),
        *(_RANGE if rule.delays else ()),
        *_postsynaptic_taus(rule),
    }
    return [word for word in rule.numbers() if word not in fixed]


def _postsynaptic_taus(rule: Synapse) -> set[str]:
    """Return the names of the time constants of postsynaptic traces, for rules that learn from spike pairs."""
    return {trace.tau for trace in rule.post} if rule.learns == "pairs" else set()


def _changed_parameter(part: Projection, rule: Synapse, word: str, value: Any, chosen: Chosen | None) -> Any:
    """Return a parameter, one number or an array for all synapses, with some values changed."""
    subject, old_value = f"{rule.name}.{word} of '{part.name}'", rule.parameters()[word]
    new_value = check(replace(rule.quantities()[word], of_value=False), value, f"{rule.name}.{word}")
    if isinstance(new_value, (Distribution, FromFile, of_distance)):
        hint = "parameters are drawn when connections are made: net.connect(...)"
        raise ModelError(f"{subject} = {shown(new_value)}: expected a number or an array", hint=hint)
    size = part.size if chosen is None else _count(chosen)
    if np.ndim(new_value) and new_value.shape != (size,):
        raise ModelError(f"{subject}: an array of shape {list(new_value.shape)}: expected [{size}]")
    if chosen is None:
        return new_value if part.size or not np.ndim(new_value) else old_value
    if size == 0:
        return old_value
    values = np.full(part.size, old_value, dtype=np.float64)
    values[chosen] = new_value
    return values


def _count(chosen: Chosen) -> int:
    return int(np.count_nonzero(chosen)) if chosen.dtype == np.bool_ else chosen.size


def _no_parameter(part: Projection, rule: Synapse, word: str, names: list[str]) -> ModelError:
    """Return the error for a word that is not a settable parameter of a rule."""
    subject = f"{rule.name}.{word} of '{part.name}' is"
    if word in synapse_states(part):
        message = f"{subject} a state of its synapses, which is read and not set"
        return ModelError(message, hint=f"sim.get('{part.name}', '{word}') reads it")
    if word == "delay":
        return ModelError(f"{subject} fixed: change the network and compile again")
    return unknown(f"parameter of {rule.name}", word, names).at(None, f"projection '{part.name}'")


def rule_of(rule: Synapse, vector: Floats) -> Synapse:
    """Return a synapse model with new values of its numbers.

    Args:
        rule: the synapse model.
        vector: values in the order of `rule.numbers()`: (numbers,) for all synapses, or (synapses, numbers).
    """
    kinds = {word_of(entry.name): entry for entry in fields(rule)}
    convert = {"boolean": bool, "integer": int}
    changed: dict[str, Any] = {}
    for word, values in zip(rule.numbers(), vector.T, strict=True):
        is_shared = bool((values == values.flat[0]).all())
        kind = kinds[word].metadata["quantity"].kind
        changed[kinds[word].name] = convert.get(kind, float)(values.flat[0]) if is_shared else values
    return replace(rule, **changed)


def check_rule(part: Projection, rule: Synapse, weight: Floats) -> None:
    """Refuse weights out of the bounds of their rule."""
    bad = rule.outside(weight)
    if bad is not None:
        raise ModelError(
            f"projection '{part.name}': weight[{bad}] = {weight[bad]:g}: expected {rule.expected_weight(bad)}"
        )


def new_weights(
    part: Projection, rule: Synapse, weights: ArrayLike, current: tuple[Floats, Chosen] | None = None, unit: str = ""
) -> Floats:
    """Return the weights of all synapses (for a grid: of its kernels), shape (size,), with some weights changed.

    Args:
        part: the projection.
        rule: present synapse model of the projection.
        weights: new weights, a number or an array.
        current: the present weights of all synapses, and the chosen synapses; None to change all.
        unit: unit to which weights with a unit are converted.
    """
    checked = check(replace(_WEIGHT, taken_in=unit), weights, f"weights of '{part.name}'")
    if isinstance(checked, Distribution | FromFile):
        raise ModelError(f"weights of '{part.name}' = {shown(checked)}: expected a number or an array", hint=_DRAWN)
    array = np.asarray(checked, dtype=np.float64)
    size = part.size if current is None else _count(current[1])
    shapes: list[tuple[int, ...]] = [(size,)]
    if part.grid is not None:
        shapes.append(part.grid.kernels)
    if array.ndim and array.shape not in shapes:
        raise ModelError(
            f"weights of '{part.name}': an array of shape {list(array.shape)}: "
            f"expected {' or '.join(str(list(s)) for s in reversed(shapes))}"
        )
    all_weights = np.broadcast_to(array.reshape(-1), size) + 0.0  # a copy, in which -0.0 is 0.0
    if current is not None:
        present, chosen = current[0].copy(), current[1]
        present[chosen] = all_weights
        all_weights = present
    check_rule(part, rule, all_weights)
    try:
        check_conductance(part.receptor, all_weights)
    except ModelError as error:
        raise error.at(None, f"projection '{part.name}'") from None
    return all_weights


def new_spikes(
    clock: Clock, times: ArrayLike, ids: ArrayLike | None, of: Neurons, payloads: ArrayLike | None = None
) -> tuple[Ints, Ints, Ints | None]:
    """Return steps, neurons and payloads (if any) of spikes, sorted by step, then neuron.

    Without ids, each neuron emits at all times.
    """
    steps = clock.steps(_one_axis(numbers(times, "times"), "times"), "times")
    checked_payloads = None if payloads is None else _payloads(payloads, steps.size)
    if ids is None:
        emitting = np.flatnonzero(of.mask())
        checked_payloads = None if checked_payloads is None else np.repeat(checked_payloads, emitting.size)
        steps, ids = np.repeat(steps, emitting.size), np.tile(emitting, steps.size)
    neurons = _one_axis(neuron_ids(ids, of.part.size), "ids")
    if of.ids is not None and (outside := np.flatnonzero(~of.mask()[neurons])).size:
        raise ModelError(f"ids[{outside[0]}] = {neurons[outside[0]]}: expected a neuron of {of.text}")
    if steps.shape != neurons.shape:
        raise ModelError(f"{steps.size} times and {neurons.size} ids: expected as many of each")
    order = np.lexsort((neurons, steps))
    return steps[order], neurons[order], None if checked_payloads is None else checked_payloads[order]


def _payloads(payloads: ArrayLike, times: int) -> Ints:
    values = _one_axis(numbers(payloads, "payloads"), "payloads")
    if values.size != times:
        raise ModelError(f"{times} times and {values.size} payloads: expected as many of each")
    bad = np.flatnonzero((values != np.rint(values)) | (np.abs(values) > LARGEST))
    if bad.size:
        value = shown(float(values[bad[0]]))
        raise ModelError(f"payloads[{bad[0]}] = {value}: expected a whole number from -{LARGEST} to {LARGEST}")
    return values.astype(np.int64)


def _one_axis(array: NDArray[Any], label: str) -> NDArray[Any]:
    """Return a number or a list of numbers as an array with one axis."""
    if array.ndim > 1:
        raise ModelError(f"{label}: an array of shape {list(array.shape)}: expected a list, one for each spike")
    return np.atleast_1d(array)


def neuron_ids(ids: ArrayLike, size: int) -> Ints:
    """Check ids of neurons of a population of `size`, and return them as an array."""
    refuse_masked(ids, "ids")
    array = np.atleast_1d(np.asarray(ids))
    if array.size == 0:
        return np.zeros(0, dtype=np.int64)
    beyond_64_bits = array.dtype.kind == "O" and all(isinstance(item, int) and is_number(item) for item in array.flat)
    if array.dtype.kind not in "iu" and not beyond_64_bits:
        raise ModelError(f"ids: found {array.dtype}: expected whole numbers")
    bad = np.flatnonzero((array < 0) | (array >= size))
    if bad.size:
        raise ModelError(f"ids[{bad[0]}] = {array[bad[0]]}: expected a neuron from 0 to {size - 1}")
    return array.astype(np.int64)


def signal_values(name: str, values: ArrayLike, size: int) -> Floats:
    """Check values of a signal, and return them as an array (size,)."""
    array = numbers(values, f"signal '{name}'")
    if array.shape not in ((), (size,)):
        raise ModelError(f"signal '{name}': an array of shape {list(array.shape)}: expected a number or [{size}]")
    if not np.isfinite(array).all():
        raise ModelError(f"signal '{name}': a value is not finite: expected numbers in 1/ms")
    return array + 0.0 if array.ndim else np.full(size, array + 0.0)
