"""Models in equations: the text of a neuron or a learning rule is compiled like other models.

No user code is run.
"""

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
"""Classes of models by their words. Equal words give the same class."""


def equations(name: str, **words: Any) -> Any:
    """Create a model class from equations. Use the class like other model classes, e.g. `adex(C_m=200.0)`.

    Args:
        name: name of the model.
        words: words of the section `models` of a network file. For a neuron: `equations`, `let`, `receptors`,
            `threshold`, `reset`, `refractory`, `parameters`, `initial`, `integrator`, `doc`, `source`. For a rule of
            spike pairs: `traces`, `states`, `on_pre`, `on_post`, `on_signal`, `initial`, `parameters`, `doc`,
            `source`. The value None is the same as a missing word.

    Returns:
        The class of the model. The same words give the same class.

    Raises:
        ModelError: the first mistake, with the column for a mistake in an expression. Mistakes in names and units are
            all reported.
    """
    try:
        return model_from_words(name, {word: value for word, value in words.items() if value is not None})
    except ModelError as error:
        raise error.at(here(), f"model '{name}'") from None


def model_from_words(name: str, words: Mapping[str, Any]) -> type[EquationNeuron] | type[EquationSynapse]:
    """Return the model class defined by words.

    Raises:
        ModelError: the first mistake in the words. The path of the error leads to the word.
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
        raise ModelError(f"'{name}' is the name of another model: expected another name")
    key = json.dumps([name, words], default=repr)
    if key not in _CLASSES:
        _CLASSES[key] = rule(name, words) if is_rule(words) else neuron(name, words)
    return _CLASSES[key]
