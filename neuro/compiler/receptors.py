"""Which receptor of its target a projection goes to, where its synapse names one."""

from __future__ import annotations

import numpy as np

from neuro.core.english import a
from neuro.core.errors import ModelError, unknown
from neuro.model.neurons import Neuron
from neuro.model.parts import Population
from neuro.model.synapses import MoveRule, Synapse, static
from neuro.program.program import Floats, Receptor


def receptor_of(synapse: Synapse, target: Population) -> Receptor | None:
    """The receptor that a synapse names; None where weights go by their sign.

    Args:
        synapse: the model of the synapse.
        target: the population of neurons that it goes to.

    Raises:
        ModelError: the neurons have no receptor of that name, or so many that one must be named.
    """
    model = target.model
    assert isinstance(model, Neuron)
    names = model.named_receptors()
    named = synapse.receptor if isinstance(synapse, (static, MoveRule)) else None
    if named is None:
        if len(names) > 2 or not model.signed:
            one, rule = ", ".join(names), synapse.name if isinstance(synapse, MoveRule) else "static"
            message = f"'{target.name}', {a(model.name)}, has {len(names)} receptors: expected a synapse that names one"
            raise ModelError(message, hint=f"write {rule} with 'receptor', one of {one}")
        return None
    if not names:
        found = f"{synapse.name}.receptor = '{named}': '{target.name}', {a(model.name)}, sums all input"
        raise ModelError(f"{found}: expected no receptor", hint="leave it out", path=(synapse.name, "receptor"))
    if named not in names:
        raise unknown(f"receptor of '{target.name}', {a(model.name)},", named, names, path=("synapse", "receptor"))
    index, conductance = names.index(named), named in model.conductances
    return Receptor(named, index, conductance, conductance and len(names) == 2 and index == 1)


def receptor_of_current(synapse: Synapse, target: Population, source: str) -> Receptor | None:
    """The receptor that a current is sent to, which filters it; None where it acts on V_m as it is.

    Raises:
        ModelError: the neurons have no such receptor.
    """
    model = target.model
    assert isinstance(model, Neuron)
    named = synapse.receptor if isinstance(synapse, static) else None
    if named is None:
        return None
    message = f"static.receptor = '{named}' of a current from '{source}'"
    if not model.filters:
        told = f"{message}, which goes to no receptor of {a(model.name)}: expected none"
        raise ModelError(told, hint="leave it out", path=("static", "receptor"))
    if named not in model.filters:
        raise unknown(
            f"receptor of '{target.name}', {a(model.name)},", named, list(model.filters), path=("synapse", "receptor")
        )
    return Receptor(named, model.named_receptors().index(named), False, False)


def check_conductance(receptor: Receptor | None, weight: Floats) -> None:
    """Weights onto a conductance that is named are not negative.

    Raises:
        ModelError: one is; it names the first.
    """
    if receptor is None or not receptor.conductance:
        return
    bad = np.flatnonzero(weight < 0.0)
    if bad.size:
        message = (
            f"weight[{bad[0]}] = {weight[bad[0]]:g} onto receptor '{receptor.name}', a conductance, which grows by it: "
            "expected at least 0"
        )
        raise ModelError(message, hint="leave out the sign, or the receptor", path=("weight",), about=("receptor",))
