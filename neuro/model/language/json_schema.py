"""JSON Schema of the language for editors, generated from the definitions that the loader uses."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import MISSING
from typing import Any

from neuro.core.choice import Choice
from neuro.core.errors import ModelError
from neuro.core.quantities import KINDS, Quantity
from neuro.core.units import UNITS, dimension_of
from neuro.model.equations.definition import WORDS
from neuro.model.equations.rule import WORDS as RULE_WORDS
from neuro.model.language.including import VERSION
from neuro.model.language.loader import TABLES
from neuro.model.network import Network
from neuro.model.neurons import MODELS
from neuro.model.parts import (
    INITIAL,
    RESOLUTION,
    WEIGHT,
    Group,
    Part,
    Population,
    Probe,
    Projection,
    Readout,
    Signal,
    Trials,
    World,
)
from neuro.model.views import AXIS

Schema = dict[str, Any]
_NAME = r"^[\w.-]+$"
_PARAMETER: Schema = {"$ref": "#/$defs/parameter"}


def schema() -> Schema:
    """Return the JSON Schema (draft 2020-12) of a network in YAML."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "neuro network",
        "description": "A spiking network: its populations, projections, signals, groups, trials, probes and world.",
        **_closed(
            {
                "neuro": {"const": VERSION, "description": "version of the language"},
                "name": {
                    "type": "string",
                    "pattern": _NAME,
                    "description": "name of the network",
                    "default": "network",
                },
                "resolution": _quantity(RESOLUTION, Network().resolution),
                "parameters": {
                    "type": "object",
                    "description": "values of $names; neuro.load(path, params={...}) overrides them",
                    "propertyNames": {"pattern": r"^[^\W\d]\w*$"},
                },
                "include": {
                    "type": "array",
                    "items": {"type": "string"},
                    "description": "files in this folder to read before the sections of this file",
                },
                "models": _models(),
                "populations": {"type": "object", "description": _summary(Population)},
                "projections": {"type": "object", "description": _summary(Projection)},
                "signals": _mapping_of_parts(_part(Signal), Signal),
                "groups": _mapping_of_parts({"$ref": "#/$defs/group"}, Group),
                "trials": _words(Trials),
                "probes": _mapping_of_parts(_part(Probe), Probe),
                "readout": _words(Readout),
                "world": _words(World),
            },
        ),
        "if": {"anyOf": [{"required": ["models"]}, {"required": ["include"]}]},
        "then": _networks(own=True),
        "else": _networks(own=False),
        "$defs": {
            "parameter": {
                "type": "string",
                "pattern": r"^\$([^\W\d]\w*|\(.*\))$",
                "description": "a parameter, or arithmetic with numbers and parameters",
            },
            "numbers": {
                "type": "array",
                "items": {"anyOf": [{"type": "number"}, _measured(*UNITS), _PARAMETER, {"$ref": "#/$defs/numbers"}]},
            },
            "file": {
                **_closed({"file": {"type": "string"}, "key": {"type": "string"}}, ["file"]),
                "description": "an array in an HDF5 file (key: the data set) or NPY file in this folder",
            },
            **{kind: _choice(table) for kind, table in TABLES.items()},
            **{f"{kind}.{name}": _words(cls) for kind, table in TABLES.items() for name, cls in table.items()},
        },
    }


def _models() -> Schema:
    """Return the schema of models in equations. The loader checks the expressions themselves."""
    texts = {"type": "object", "additionalProperties": {"type": ["string", "number"]}}
    words: Schema = {word: {} for word in WORDS}
    words |= {"equations": texts, "let": texts, "reset": texts, "initial": texts, "threshold": {"type": "string"}}
    return {
        "type": "object",
        "description": "Models of this network, written as equations.",
        "propertyNames": {"pattern": r"^[A-Za-z]\w*$"},
        "additionalProperties": {"anyOf": [_closed(words, ["equations"]), _closed({word: {} for word in RULE_WORDS})]},
    }


def _networks(own: bool) -> Schema:
    """Return the schemas of populations and projections.

    With `own` the network may define models of its own, so unknown names of models are accepted.
    """
    return {"properties": {f"{cls.word}s": _mapping_of_parts(_part(cls, own), cls) for cls in (Population, Projection)}}


def _part(cls: type[Part], own: bool = False) -> Schema:
    """Return the schema of a part. A population with a table of neurons needs no shape."""
    words = {word: _quantity(q, cls.defaults.get(word, MISSING), own) for word, q in cls.words.items()}
    if cls is not Population:
        return _closed(words, cls.needs)
    return {**_closed(words, ["model"]), "anyOf": [{"required": ["shape"]}, {"required": ["neurons"]}]}


def _by_name() -> Schema:
    """Return the schema of a mapping from names to values or lists of values."""
    value: Schema = {"type": ["string", "number"]}
    values: Schema = {"anyOf": [value, {"type": "array", "items": value}]}
    return {"type": "object", "minProperties": 1, "additionalProperties": values}


def _closed(properties: Schema, required: Iterable[str] = ()) -> Schema:
    """Return the schema of a mapping that accepts no other words."""
    needs = {"required": list(required)} if required else {}
    return {"type": "object", "properties": properties, **needs, "additionalProperties": False}


def _mapping_of_parts(part: Schema, cls: type) -> Schema:
    """Return the schema of a mapping from names to parts."""
    return {
        "type": "object",
        "description": _summary(cls),
        "propertyNames": {"pattern": _NAME},
        "additionalProperties": part,
    }


def _choice(table: Mapping[str, type[Choice]]) -> Schema:
    """Return the schema of a choice: `{name: {parameters}}`, or the name alone if no parameter is required."""
    kind = next(iter(table.values())).kind
    names_only = [{"const": name, "description": _summary(cls)} for name, cls in table.items() if not _required(cls)]
    words = {name: {"$ref": f"#/$defs/{kind}.{name}"} for name in table}
    return {"anyOf": [*names_only, {**_closed(words), "minProperties": 1, "maxProperties": 1}, _PARAMETER]}


def _words(cls: type[Choice]) -> Schema:
    """Return the schema of the parameters of a choice."""
    defaults = cls.defaults()
    quantities = {word: q for word, q in cls.quantities().items() if q.kind != "events"}
    words = {word: _quantity(q, defaults.get(word, MISSING)) for word, q in quantities.items()}
    schema_of_words = {"title": cls.called(), "description": _summary(cls), **_closed(words, _required(cls))}
    return _with_file(schema_of_words, cls.file_of) if cls.file_of else schema_of_words


def _with_file(mapping: Schema, word: str) -> Schema:
    """Return the schema of a mapping in which `file` and `key` may replace a word."""
    properties = {**mapping["properties"], "file": {"type": "string"}, "key": {"type": "string"}}
    alternatives = [{"required": [word]}, {"required": ["file"]}]
    return {
        **mapping,
        "properties": properties,
        "required": [w for w in mapping["required"] if w != word],
        "oneOf": alternatives,
    }


def _required(cls: type[Choice]) -> list[str]:
    defaults = cls.defaults()
    return [word for word in cls.quantities() if word not in defaults]


def _summary(cls: type) -> str:
    return (inspect.getdoc(cls) or "").partition("\n")[0]


def _quantity(q: Quantity, default: Any = MISSING, own: bool = False) -> Schema:
    """Return the schema of the values of a parameter. `own` is explained in `_networks`."""
    accepted = _accepted(q, own)
    out: Schema = {"anyOf": accepted} if len(accepted) > 1 else dict(accepted[0])
    if q.doc:
        out["description"] = f"{q.doc} ({q.unit})" if q.unit else q.doc
    if isinstance(default, float) and math.isinf(default):
        out["description"] += f", {'-' if default < 0 else ''}.inf if not given"
    elif default is not MISSING and default is not None:
        out["default"] = list(default) if isinstance(default, tuple) else default
    return out


def _units(q: Quantity) -> list[Schema]:
    """Return the schema of numbers with a unit, or [] for a quantity without one. `of_value` accepts any unit."""
    if q.of_value or q is WEIGHT or q is INITIAL:
        return [_measured(*UNITS)]
    try:
        dimension = dimension_of(q.unit) if q.unit else None
    except ModelError:
        return []
    same_dimension = [name for name, (_, of) in UNITS.items() if of == dimension]
    return [_measured(*same_dimension, *([] if q.unit in same_dimension else [q.unit]))] if q.unit else []


def _measured(*units: str) -> Schema:
    """Return the schema of a number with a unit.

    The pattern also accepts every unit composed by * / ^, because a pattern cannot check dimensions.
    """
    unit_pattern = "|".join(map(re.escape, units))
    return {"type": "string", "pattern": rf"^[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)? *({unit_pattern}|[^ ]*[*/^].*)$"}


def _accepted(q: Quantity, own: bool) -> list[Schema]:
    names = {">": "exclusiveMinimum", ">=": "minimum", "<": "exclusiveMaximum", "<=": "maximum"}
    bounds: Schema = {names[sign]: bound for sign, bound, _ in q.bounds}
    if q.nonzero:
        bounds["not"] = {"const": 0}
    file, numbers = {"$ref": "#/$defs/file"}, {"$ref": "#/$defs/numbers"}
    integer = {"type": "integer", **bounds}
    of_distance = [_closed({"of_distance": {"$ref": "#/$defs/profile"}}, ["of_distance"])] if q.of_distance else []
    match q.kind:
        case "number":
            more = [numbers, file, {"$ref": "#/$defs/distribution"}] if q.arrays else []
            return [{"type": "number", **bounds}, *_units(q), *more, *of_distance, _PARAMETER]
        case "choice":
            assert q.choice is not None
            number: list[Schema] = [{"type": "number", **bounds}] if bounds else []
            number += [{"type": "number"}, numbers, file] if q.arrays else []
            choices: list[Schema] = [*number, {"$ref": f"#/$defs/{q.choice.kind}"}]
            if not own or q.choice.kind not in ("model", "synapse"):
                return choices
            name = {"not": {"enum": list(TABLES[q.choice.kind])}}
            parameters = {"type": "object", "propertyNames": name, "minProperties": 1, "maxProperties": 1}
            return [*choices, {"type": "string", **name}, parameters]
        case "choices":
            assert q.choice is not None
            choice_reference: Schema = {"$ref": f"#/$defs/{q.choice.kind}"}
            return [{"type": "object", "additionalProperties": choice_reference, "minProperties": 1}]
        case "neurons":
            index: list[Schema] = [
                {"type": "string", "pattern": rf"^\s*({AXIS})\s*(,\s*({AXIS})\s*)*$"},
                {"type": "integer"},
                {"type": "array", "items": {"type": "integer", "minimum": 0}, "minItems": 1},
                {"$ref": "#/$defs/file"},
                {**_by_name(), "not": {"required": ["file"]}},
                _PARAMETER,
            ]
            index_by_name: Schema = {
                "type": "object",
                "propertyNames": {"pattern": _NAME},
                "additionalProperties": {"anyOf": index},
                "minProperties": 1,
                "maxProperties": 1,
            }
            return [{"type": "string"}, index_by_name, *(index[1:3] if q.arrays else [])]
        case "states":
            states = sorted({state.name for model in MODELS.values() for state in model.states if not state.hidden})
            any_state = {"type": "object", "additionalProperties": _quantity(INITIAL)}
            return [any_state if own else _closed({state: _quantity(INITIAL) for state in states})]
        case "delay":
            return [{"type": "number", "exclusiveMinimum": 0}, _measured("us", "ms", "s"), _PARAMETER]
        case "integer":
            return [integer, *({"const": word} for word in q.words), _PARAMETER]
        case "boolean":
            return [{"type": "boolean"}, _PARAMETER]
        case "word":
            return [{"enum": list(q.words)}, _PARAMETER]
        case "shape":
            sizes: list[Schema] = [integer, *({"const": word} for word in q.words), _PARAMETER]
            return [{"type": "array", "items": {"anyOf": sizes}, "minItems": 1}, *sizes]
        case "names":
            return [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]
        case "words":
            return [_by_name()]
        case _ if KINDS[q.kind].is_list:
            return [numbers, file, _PARAMETER]
        case "codes":
            code = {"$ref": "#/$defs/code"}
            return [code, {"type": "array", "items": code, "minItems": 1}]
        case "file":
            return [{"type": "string"}]
        case "part":
            assert q.part is not None
            return [_words(q.part)]
        case _:
            return [{"type": "string"}]
