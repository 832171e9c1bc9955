"""Which receptor of its target a projection goes to, where its synapse names one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError, unknown
from neuro.model.neurons import Neuron
from neuro.model.parts import Population
from neuro.model.synapses import Synapse, static
from neuro.program.program import Receptor


def named_by(synapse: Synapse) -> str | None:
    """Return the name of a receptor that a synapse has; a number called `receptor` is a rule's own parameter."""
    name = getattr(synapse, "receptor", None)
    return name if isinstance(name, str) else None


def receptor_of(synapse: Synapse, target: Population) -> Receptor | None:
    """The receptor that a synapse names; None if weights are routed by sign.

    Args:
        synapse: the model of the synapse.
        target: the population of neurons that it goes to.

    Raises:
        ModelError: the neurons have no receptor of that name, or so many that one must be named.
    """
    model = target.model
    assert isinstance(model, Neuron)
    known = model.named_receptors()
    name = named_by(synapse)
    if name is None:
        if len(known) > 2 or not model.signed:
            rule = synapse.name if hasattr(synapse, "receptor") else "static"
            message = f"{_shown(target)} has {len(known)} receptors: the synapse must name one"
            raise ModelError(message, hint=f"write {rule} with 'receptor', one of {', '.join(known)}")
        return None
    if not known:
        found = f"{synapse.name}.receptor = '{name}': {_shown(target)} has one input without a name"
        raise ModelError(f"{found}: expected no receptor", hint="leave it out", path=(synapse.name, "receptor"))
    if name not in known:
        raise _unknown(synapse, target, name, known)
    index, conductance = known.index(name), name in model.conductances
    # Models with two conductances expect negative numbers at the second, as they get them by sign.
    return Receptor(name, index, conductance, negated=conductance and len(known) == 2 and index == 1)


def receptor_of_current(synapse: Synapse, target: Population, source: str) -> Receptor | None:
    """The receptor whose filter a current passes; None if the current acts on V_m directly.

    Raises:
        ModelError: the neurons have no such receptor.
    """
    model = target.model
    assert isinstance(model, Neuron)
    name = synapse.receptor if isinstance(synapse, static) else None
    if name is None:
        return None
    if not model.filters:
        found = f"static.receptor = '{name}' of a current from '{source}': {_shown(target)} takes currents at V_m alone"
        raise ModelError(f"{found}: expected no receptor", hint="leave it out", path=("static", "receptor"))
    if name not in model.filters:
        raise _unknown(synapse, target, name, model.filters)
    return Receptor(name, model.named_receptors().index(name), conductance=False, negated=False)


def _shown(target: Population) -> str:
    return f"'{target.name}' ({target.model.name})"


def _unknown(synapse: Synapse, target: Population, name: str, known: Iterable[str]) -> ModelError:
    error = unknown("receptor of", name, known, path=(synapse.name, "receptor"))
    return error.but(message=f"{_shown(target)} has no receptor '{name}'")


def check_conductance(receptor: Receptor | None, *weights: NDArray[np.floating[Any]]) -> None:
    """Refuse negative weights to a conductance that is named; weights in several arrays have no places.

    Raises:
        ModelError: for the first one.
    """
    if receptor is None or not receptor.conductance:
        return
    for weight in weights:
        bad = np.flatnonzero(weight < 0.0)
        if not bad.size:
            continue
        first, place = weight[bad[0]], f"[{bad[0]}]" if len(weights) == 1 else ""
        message = f"weight{place} = {first:g} to receptor '{receptor.name}', a conductance: expected at least 0"
        hint = f"write {-first:g}, or leave out 'receptor', so that the sign chooses"
        raise ModelError(message, hint=hint, path=("weight",), about=("receptor",))
