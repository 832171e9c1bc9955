"""Docstrings on the site: they are plain text with code in backticks, and every public name is described once."""

from __future__ import annotations

import re
from functools import cache
from importlib import import_module
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import roles
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.nodes import make_refnode

from neuro.model.language.loader import TABLES

HOMES = (
    "neuro",
    *(f"neuro.{name}" for name in ("chips", "coding", "compare", "events", "live", "plots", "realtime", "results")),
    *(f"neuro.events.{name}" for name in ("filters", "representations", "segmentation")),
    "neuro.extend",
    "neuro.apps",
)
"""Modules that share names: each name is described by the first that has it."""
MODELS = Path(__file__).parents[1] / "reference" / "models"
"""The pages of the parts of networks, with all their parameters."""

_CODE = re.compile(r"(``[^`]*``|`[^`]*`)")
_SPECIAL = re.compile(r"([*|\\]|_(?!\w))")
_NAME = re.compile(r"`[\w.]+`")
_FENCE = re.compile(r"^( *)```(\w*)$")


def to_rst(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Blocks of code become blocks of reStructuredText; what means nothing special in plain text does so there, too."""
    text, fence = [], None
    for number, line in enumerate(lines):
        if mark := _FENCE.match(line):
            fence = None if fence is not None else mark[1]
            text += ["", f"{mark[1]}.. code-block:: {mark[2] or 'text'}", ""] if fence is not None else [""]
        elif fence is not None:
            text.append("   " + line if line else "")
        elif _begins_code(lines[number:]):
            text.append(line + ":")
        else:
            text.append(line if line.startswith("    ") and _inside_code(lines[:number]) else escaped(line))
    lines[:] = text


def _begins_code(lines: list[str]) -> bool:
    """Whether a sentence ends with a colon, and an indented block follows after a blank line."""
    return len(lines) > 2 and lines[0].endswith(":") and not lines[1] and lines[2].startswith("    ")


def _inside_code(before: list[str]) -> bool:
    """Whether the last line that is not indented begins an indented block of code."""
    last = max((k for k, line in enumerate(before) if line and not line.startswith(" ")), default=0)
    return _begins_code(before[last:])


def escaped(line: str) -> str:
    """A line outside of blocks of code."""
    text = _CODE.split(line)
    if any("`" in part for part in text[::2]):  # code that goes on in the next line
        return line
    return "".join(
        _SPECIAL.sub(r"\\\1", part) if k % 2 == 0 else part if _NAME.fullmatch(part) else f"``{part.strip('` ')}``"
        for k, part in enumerate(text)
    )


@cache
def parts() -> dict[str, type]:
    """Neurons, synapses, rules and so on, by name."""
    return {name: part for table in TABLES.values() for name, part in table.items()}


@cache
def home(name: str) -> str:
    """The module whose page describes a name, "" for none of those that share names."""
    return next((module for module in HOMES if name in import_module(module).__all__), "")


def described_elsewhere(app: Sphinx, what: str, name: str, obj: object, skip: bool, options: object) -> bool | None:
    """Leave out parts, which have a page of their own, and names that an earlier module describes."""
    module = app.env.current_document.autodoc_module
    if what == "module" and module in HOMES:
        return True if parts().get(name) is obj or home(name) != module else None
    return None


@cache
def page_of() -> dict[str, str]:
    """The page that describes each part, by the part's name."""
    pages = {page: re.findall(r"^### (\w+)$", page.read_text("utf-8"), re.M) for page in sorted(MODELS.glob("*.md"))}
    return {name: f"reference/models/{page.stem}" for page, names in pages.items() for name in names}


def to_models(app: Sphinx, env: BuildEnvironment, node: pending_xref, text: nodes.Node) -> nodes.Node | None:
    """Link the name of a part to its heading on a page of models."""
    name = node["reftarget"].removeprefix("neuro.")
    if node.get("refdomain") != "py" or name not in parts():
        return None
    return make_refnode(app.builder, node["refdoc"], page_of()[name], name.replace("_", "-"), text, name)


def setup(app: Sphinx) -> dict[str, object]:
    """Called by Sphinx."""
    before_napoleon = 400
    roles.register_generic_role("mpltype", nodes.literal)  # in docstrings that pictures inherit from Matplotlib
    app.connect("autodoc-process-docstring", to_rst, priority=before_napoleon)
    app.connect("autodoc-skip-member", described_elsewhere, priority=before_napoleon)
    app.connect("missing-reference", to_models)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
