"""Lists of models, backends and the fields of network files: `neuro models`, `neuro backends`, `neuro schema`."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from neuro.core.choice import Choice
    from neuro.core.quantities import Quantity


KINDS = {
    "generators": "Generators",
    "neurons": "Neurons",
    "chip-neurons": "Neurons in a chip's registers",
    "synapses": "Synapses",
    "rules": "Connection rules",
    "profiles": "Functions of distance",
    "masks": "Masks",
    "distributions": "Distributions",
    "codes": "Codes",
    "sources": "Sources of signals",
    "groups": "Groups and trials",
    "encoders": "Encoders of a world",
    "decoders": "Decoders of a world",
    "teachers": "Teachers of a world",
}
"""Titles of the sections of the catalogue, by the name of the kind in `neuro models KIND`."""

Name = Annotated[
    str, typer.Argument(metavar="[NAME]", help="Model to describe, or kind to list: neurons, synapses, rules, ...")
]
Long = Annotated[
    bool, typer.Option("--long", help="Print parameters, units, bounds, equation and source of all models listed.")
]


def models(name: Name = "", long: Long = False) -> None:
    """List the models, synapses, rules and distributions for network files, or describe one in full."""
    from neuro.core.errors import unknown
    from neuro.core.tables import console, table

    sections = catalogue()
    choices: dict[str, list[Any]] = {}
    for section in sections.values():
        for word, choice in section.items():
            choices.setdefault(word, []).append(choice)
    out = console()
    if name and name not in choices.keys() | KINDS.keys():
        raise unknown("model", name, choices.keys() | KINDS.keys())
    if name in KINDS and not long:
        rows = [(word, sentence(choice)) for word, choice in sections[KINDS[name]].items()]
        out.print(table((KINDS[name], "is"), rows))
    elif name in choices:
        for choice in choices[name]:
            describe(choice, out)
    elif long:
        for title in [KINDS[name]] if name else sections:
            out.rule(f"[bold]{title}")
            for choice in sections[title].values():
                describe(choice, out)
    else:
        out.print(table(("kind", "names"), [(kind, ", ".join(sections[title])) for kind, title in KINDS.items()]))
        out.print(
            "neuro models KIND: a line for each model; neuro models NAME: one model; "
            "neuro models --long: all models in full"
        )


def catalogue() -> dict[str, Mapping[str, type[Choice]]]:
    """Return all models for network files: for each title of a section, the classes of its models by name."""
    from neuro.coding.codes import CHOICES
    from neuro.coding.world import DECODERS, ENCODERS, TEACHERS
    from neuro.model.distributions import DISTRIBUTIONS
    from neuro.model.neurons import MODELS, Generator
    from neuro.model.parts import GROUPS, dropout, labels, reward
    from neuro.model.rules import RULES
    from neuro.model.signals import SOURCES
    from neuro.model.space import MASKS, PROFILES
    from neuro.model.synapses import SYNAPSES

    return {
        "Generators": {name: model for name, model in MODELS.items() if issubclass(model, Generator)},
        "Neurons": {n: model for n, model in MODELS.items() if not (model.chip or issubclass(model, Generator))},
        "Neurons in a chip's registers": {name: model for name, model in MODELS.items() if model.chip},
        "Synapses": SYNAPSES,
        "Connection rules": RULES,
        "Functions of distance": PROFILES,
        "Masks": MASKS,
        "Distributions": DISTRIBUTIONS,
        "Codes": CHOICES,
        "Sources of signals": SOURCES,
        "Groups and trials": GROUPS | {part.__name__: part for part in (labels, reward, dropout)},
        "Encoders of a world": ENCODERS,
        "Decoders of a world": DECODERS,
        "Teachers of a world": TEACHERS,
    }


def describe(choice: type[Choice], out: Any) -> None:
    """Print the description, equation, source, parameters and states of a model."""
    from rich.padding import Padding
    from rich.text import Text

    from neuro.core.tables import table

    out.print(Text(choice.__name__, style="bold cyan"))
    for text in filter(None, (body(choice), attribute_line(choice, "equation"), attribute_line(choice, "source"))):
        out.print(Padding(Text(text), (0, 0, 0, 2)))
    defaults = choice.defaults()
    rows = [
        (
            word,
            default_text(defaults[word]) if word in defaults else "required",
            q.unit,
            bounds(q),
            "yes" if q.arrays else "",
            q.doc,
        )
        for word, q in choice.quantities().items()
    ]
    if rows:
        columns = ("parameter", ">default", "unit", "accepts", "array", "meaning")
        out.print(Padding(table(columns, rows), (0, 0, 0, 2)))
    states = [(s.name, s.unit, s.doc) for s in getattr(choice, "states", ()) if not s.hidden]
    if states:
        out.print(Padding(table(("state", "unit", "meaning"), states), (0, 0, 0, 2)))
    out.print()


def body(choice: type[Choice]) -> str:
    """Return the description of a model without the source, as a line for each paragraph."""
    text = inspect.cleandoc(choice.__doc__ or "")
    if getattr(choice, "source", ""):
        text = text.partition("Source:")[0]
    return "\n".join(" ".join(paragraph.split()) for paragraph in text.strip().split("\n\n"))


def sentence(choice: type[Choice]) -> str:
    """Return the first sentence of the description of a model."""
    return re.split(r"(?<=[^.]\.) |\n", body(choice), maxsplit=1)[0].rstrip(".").replace("``", "`")


def attribute_line(choice: type[Choice], name: str) -> str:
    """Return "NAME: VALUE" for an optional text of a class, or "" if the class lacks the text."""
    text = getattr(choice, name, "")
    return f"{name}: {text}" if text else ""


def bounds(q: Quantity) -> str:
    """Return the accepted values of a parameter as text, e.g. "a number > 0, also .inf"."""
    text = q.expected().removesuffix(f" {q.unit}" if q.unit else "")
    return text + (", also .inf" if q.infinite else "")


def default_text(value: object) -> str:
    """Format a default value as in YAML."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}".replace("inf", ".inf")
    if value is None:
        return "-"
    return "[" + ", ".join(map(str, value)) + "]" if isinstance(value, tuple) else str(value)


def backends() -> None:
    """List the simulators and emulated chips that run networks."""
    from neuro.core.tables import console, table
    from neuro.program.backend import installed

    rows = [(name, backend.description) for name, backend in installed().items()]
    console().print(table(("backend", "description"), rows))


def schema() -> None:
    """Print the JSON Schema of network files, for editors that complete YAML."""
    from neuro.model.language.json_schema import schema as build

    typer.echo(json.dumps(build(), indent=2))
