"""Models as equations: a neuron or a rule as text, with no code run, compiled like any model."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from neuro.core.errors import ModelError, here
from neuro.model.equations.definition import WORDS, check_name, mapping
from neuro.model.equations.neuron import EquationNeuron, neuron
from neuro.model.equations.parameters import NAME
from neuro.model.equations.rule import WORDS as RULE_WORDS, EquationSynapse, is_rule, rule
from neuro.model.neurons import MODELS
from neuro.model.synapses import SYNAPSES

__all__ = ["EquationNeuron", "EquationSynapse", "equations", "model_from_words"]

_CLASSES: dict[str, type[EquationNeuron] | type[EquationSynapse]] = {}
"""Each model by its words: the same words give the same class."""


def equations(name: str, **words: Any) -> Any:
    """Make a model from equations; its instances are models as any other, e.g. `adex(C_m=200.0)`.

    Args:
        name: of the model.
        words: its words, as in the section `models` of a network file: `equations`, `let`, `receptors`, `threshold`,
            `reset`, `refractory`, `parameters`, `initial`, `integrator`, `doc`, `source`; of a rule of spike pairs
            `traces`, `states`, `on_pre`, `on_post`, `on_signal`, `initial`, `parameters`, `doc`, `source`. One that
            is None is as left out.

    Returns:
        The class of the model; the same words give the same class.

    Raises:
        ModelError: the first mistake, with its column where it is in an expression; of names and units all mistakes.
    """
    try:
        return model_from_words(name, {word: value for word, value in words.items() if value is not None})
    except ModelError as error:
        raise error.at(here(), f"model '{name}'") from None


def model_from_words(name: str, words: Mapping[str, Any]) -> type[EquationNeuron] | type[EquationSynapse]:
    """The class of a model, by the words that define it.

    Raises:
        ModelError: the first mistake in the words; its path leads there.
    """
    if isinstance(words, Mapping) and is_rule(words):
        mapping(words, RULE_WORDS, "a rule")
    elif isinstance(words, Mapping) and "equations" in words:
        mapping(words, WORDS, "a model")
    else:
        mapping(words, tuple(dict.fromkeys((*WORDS, *RULE_WORDS))), "a model")
    try:
        check_name(name)
    except ModelError:
        raise ModelError(f"name '{name}': {NAME}") from None
    if name in MODELS or name in SYNAPSES:
        raise ModelError(f"'{name}' is a model of its own already: expected another name")
    key = json.dumps([name, words], default=repr)
    if key not in _CLASSES:
        _CLASSES[key] = rule(name, words) if is_rule(words) else neuron(name, words)
    return _CLASSES[key]
