"""Equations as MathML, which browsers draw themselves: no script and no network are needed."""

from __future__ import annotations

from contextlib import suppress

from docstrings import MODELS
from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from equations import typeset
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator


def inline(page: HTML5Translator, node: nodes.math) -> None:
    """Write an equation within a line."""
    page.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def block(page: HTML5Translator, node: nodes.math_block) -> None:
    """Write an equation that stands alone, which scrolls where it is wider than the page."""
    page.body.append(f'<div class="math-block">{tex2mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def of_models(app: Sphinx, doctree: nodes.document) -> None:
    """Typeset the equations of the page of models; one that can't be read stays as it is."""
    for node in list(doctree.findall(nodes.literal)) if app.env.docname == MODELS else ():
        if node.parent.astext().startswith("equation:"):
            with suppress(ValueError):
                node.replace_self(nodes.raw("", typeset(node.astext()), format="html"))


def setup(app: Sphinx) -> dict[str, object]:
    """Called by Sphinx."""
    app.connect("doctree-read", of_models)
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
