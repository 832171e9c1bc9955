"""What can be named in a network, and what runs it: `neuro models`, `neuro backends`, `neuro schema`."""

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
"""The title of each section of the catalogue, by the word that lists it."""

Name = Annotated[
    str, typer.Argument(metavar="[NAME]", help="Describe this one, or list a kind: neurons, synapses, rules, ...")
]
Long = Annotated[bool, typer.Option("--long", help="Describe all: parameters, units, bounds, equation, source.")]


def models(name: Name = "", long: Long = False) -> None:
    """List the names of all models, synapses, rules and distributions, or a kind, a line each; describe one, or all."""
    from neuro.core.errors import unknown
    from neuro.core.tables import console, table

    sections = catalogue()
    known: dict[str, list[Any]] = {}
    for section in sections.values():
        for word, choice in section.items():
            known.setdefault(word, []).append(choice)
    out = console()
    if name and name not in known.keys() | KINDS.keys():
        raise unknown("model", name, known.keys() | KINDS.keys())
    if name in KINDS and not long:
        rows = [(word, sentence(choice)) for word, choice in sections[KINDS[name]].items()]
        out.print(table((KINDS[name], "is"), rows))
    elif name in known:
        for choice in known[name]:
            describe(choice, out)
    elif long:
        for title in [KINDS[name]] if name else sections:
            out.rule(f"[bold]{title}")
            for choice in sections[title].values():
                describe(choice, out)
    else:
        out.print(table(("kind", "names"), [(kind, ", ".join(sections[title])) for kind, title in KINDS.items()]))
        out.print(
            "neuro models KIND lists a kind, a line each; neuro models NAME describes one, neuro models --long all"
        )


def catalogue() -> dict[str, Mapping[str, type[Choice]]]:
    """Everything that can be named in a network, by section."""
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
    """Print one of them."""
    from rich.padding import Padding
    from rich.text import Text

    from neuro.core.tables import table

    out.print(Text(choice.__name__, style="bold cyan"))
    for text in filter(None, (body(choice), said(choice, "equation"), said(choice, "source"))):
        out.print(Padding(Text(text), (0, 0, 0, 2)))
    defaults = choice.defaults()
    rows = [
        (
            word,
            shown(defaults[word]) if word in defaults else "required",
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
    """The description without its source, which is shown apart; paragraphs on lines of their own."""
    text = inspect.cleandoc(choice.__doc__ or "")
    if getattr(choice, "source", ""):
        text = text.partition("Source:")[0]
    return "\n".join(" ".join(paragraph.split()) for paragraph in text.strip().split("\n\n"))


def sentence(choice: type[Choice]) -> str:
    """The first sentence of the description."""
    return re.split(r"(?<=[^.]\.) |\n", body(choice), maxsplit=1)[0].rstrip(".").replace("``", "`")


def said(choice: type[Choice], what: str) -> str:
    """The line of a class attribute that some kinds have."""
    text = getattr(choice, what, "")
    return f"{what}: {text}" if text else ""


def bounds(q: Quantity) -> str:
    """What is accepted, e.g. "a number > 0, also .inf"."""
    text = q.expected().removesuffix(f" {q.unit}" if q.unit else "")
    return text + (", also .inf" if q.infinite else "")


def shown(value: object) -> str:
    """A default as YAML says it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}".replace("inf", ".inf")
    if value is None:
        return "-"
    return "[" + ", ".join(map(str, value)) + "]" if isinstance(value, tuple) else str(value)


def backends() -> None:
    """List what networks can run on."""
    from neuro.core.tables import console, table
    from neuro.program.backend import installed

    rows = [(name, backend.description) for name, backend in installed().items()]
    console().print(table(("backend", "what it is"), rows))


def schema() -> None:
    """Print the JSON Schema of network files, for editors that complete YAML."""
    from neuro.model.language.json_schema import schema as build

    typer.echo(json.dumps(build(), indent=2))
