"""What happens to a synapse between spikes, as text: its states decay, and the weight moves under the signal.

The rate of the weight is a sum of products of what decays exponentially, so its integral is exact.
"""

from __future__ import annotations

from neuro.core.grammar import Expression, Name, Tree
from neuro.model.equations.algebra import culprit, names, polynomial
from neuro.model.equations.dimensions import text_of
from neuro.model.equations.pairs import DECAY_OF_SIGNAL, SIGNAL, WEIGHT, Pairs
from neuro.model.equations.writing import Constants, local, written

DEGREE = 4
"""How many states, and the signal where it decays, a product of the rate may have."""


def advance_lines(pairs: Pairs, constants: Constants) -> list[str]:
    """The body of `advance`."""
    rows = {name: k for k, name in enumerate((WEIGHT, *pairs.states))}
    lines = [f"passed = (end - begin) * {constants.place_of('h')}"]
    used = set() if pairs.drift is None else {WEIGHT, *names(pairs.drift.tree)}
    decaying = [name for name, tau in pairs.states.items() if tau]
    lines += [f"{local(name)} = y[{rows[name]}, e]" for name in rows if name in used or name in decaying]
    if pairs.drift is not None:
        lines.append(f"{local(WEIGHT)} += {_moved(pairs, pairs.drift, constants)}")
        lines.append(f"y[0, e] = {_bounded(pairs, constants)}")
    for name in decaying:
        tau = constants.place(Name(pairs.states[name], 0))
        lines.append(f"y[{rows[name]}, e] = {local(name)} * of_exp(divided(-passed, {tau}))")
    return lines


def _moved(pairs: Pairs, drift: Expression, constants: Constants) -> str:
    """By how much the weight changes."""
    taus = {name: tau for name, tau in pairs.states.items() if tau}
    if DECAY_OF_SIGNAL in pairs.parameters:
        taus[SIGNAL] = DECAY_OF_SIGNAL

    def fits(tree: Tree) -> bool:
        return WEIGHT not in names(tree) and polynomial(tree, taus, DEGREE) is not None

    found = polynomial(drift.tree, taus, DEGREE)
    if found is None or not fits(drift.tree):
        odd = culprit(drift.tree, fits)
        summed = f"a sum of products of at most {DEGREE} of {', '.join(taus) or 'the states'}"
        message = f"a rate without {WEIGHT}" if WEIGHT in names(odd) else f"{summed}, whose decay is integrated exactly"
        hint = "Wmin and Wmax keep the weight within bounds" if WEIGHT in names(odd) else ""
        raise drift.mistake(odd.at, f"found '{text_of(odd)}': expected {message}", hint)
    variables = {**{name: local(name) for name in pairs.states}, SIGNAL: SIGNAL}
    leaf = constants.leaf(variables)
    terms = []
    for product, factor in found.items():
        lasts = _lasting([constants.of_parameters(Name(taus[name], 0)) for name in product], constants)
        terms.append(" * ".join([f"({written(factor, leaf)})", *(variables[name] for name in product), lasts]))
    return " + ".join(terms)


def _lasting(taus: list[str], constants: Constants) -> str:
    """The integral of a product of decays, by their time constants, over what has passed."""
    if not taus:
        return "passed"
    tau = constants.place_of(
        taus[0] if len(taus) == 1 else f"1.0 / ({' + '.join(f'divided(1.0, {tau})' for tau in taus)})"
    )
    return f"{tau} * -of_expm1(divided(-passed, {tau}))"


def _bounded(pairs: Pairs, constants: Constants) -> str:
    """The weight within Wmin, or 0, and Wmax; Wmax below 0 is the smallest."""
    if "Wmax" not in pairs.parameters:
        return local(WEIGHT)
    ends = f"{local('Wmin') if 'Wmin' in pairs.parameters else '0.0'}, {local('Wmax')}"
    low, high = constants.place_of(f"min({ends})"), constants.place_of(f"max({ends})")
    return f"min(max({local(WEIGHT)}, {low}), {high})"
