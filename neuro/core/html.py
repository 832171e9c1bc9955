"""Elements of an HTML page. Values that are not elements are escaped."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from neuro.core.provenance import ATTRIBUTE, provenance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FOLDER = Path(__file__).parent


class Html(str):
    """Text that is HTML or SVG."""

    __slots__ = ()


def page(
    generator: str, title: str, parts: Iterable[object], script: str = "", record: Mapping[str, Any] | None = None
) -> str:
    """Return a self-contained page, without other fonts, scripts or network connections.

    Args:
        generator: command that makes the page, a mark of the file.
        title: title of the window.
        parts: content of the page.
        script: script of the page; its policy lets the browser run no other script.
        record: provenance of the page, see `neuro.core.provenance`; by default the files that this process has read.
    """
    template = Template((_FOLDER / "page.html").read_text("utf-8"))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return template.substitute(
        head=head(generator, title, f"'sha256-{digest}'" if script else "'none'", record),
        style=style_sheets("page.css"),
        body=join(parts),
        script=tag("script", Html(script)) if script else "",
    )


def head(generator: str, title: str, scripts: str = "'unsafe-inline'", record: Mapping[str, Any] | None = None) -> Html:
    """Return the first elements of a page's head.

    Args:
        generator: command that makes the page, a mark of the file.
        title: title of the window.
        scripts: scripts that the browser may run, in the words of its Content-Security-Policy.
        record: provenance of the page, see `neuro.core.provenance`; by default the files that this process has read.
    """
    origin = json.dumps(provenance() if record is None else record, ensure_ascii=False)
    policy = f"default-src 'none'; style-src 'unsafe-inline'; script-src {scripts}; img-src data:"
    return Html(
        f"""<meta charset="utf-8">
<meta name="generator" content="{generator}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="color-scheme" content="light dark">
<link rel="icon" href="data:,">
{tag("title", title)}
<meta name="{ATTRIBUTE}" content="{escape(origin)}">"""
    )


def style_sheets(*names: str) -> str:
    """Return the tokens of all pages (colours, fonts, space), followed by style sheets.

    Args:
        names: file names; "player.css" has panels, buttons and a time slider.
    """
    return "\n".join((_FOLDER / name).read_text("utf-8").strip() for name in ("tokens.css", *names))


def player_script() -> str:
    """Return the script that pages share; it computes round tick marks of an axis."""
    return (_FOLDER / "player.js").read_text("utf-8").strip()


_VOID = ("img", "input")
"""Elements without content."""


def tag(name: str, *parts: object, **attributes: object) -> Html:
    """Return an element.

    Args:
        name: name of the element.
        parts: content: elements, and other values, which are escaped; None is left out.
        attributes: attributes by name; `class_` is "class", "_" is "-", None is left out, floats have at most two
            decimals.
    """
    text = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(_text(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    return Html(f"<{name}{text}>" if name in _VOID else f"<{name}{text}>{join(parts)}</{name}>")


def join(parts: Iterable[object]) -> Html:
    """Join elements and texts."""
    return Html("".join(part if isinstance(part, Html) else escape(_text(part)) for part in parts if part is not None))


def table(columns: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> Html:
    """Return a table. Columns whose name begins with ">" are numbers, aligned to the right.

    On a narrow screen each row is shown as a list of cells with the names of their columns.
    """
    kinds = ["n" if name.startswith(">") else None for name in columns]
    names = [name.lstrip(">") for name in columns]
    head = [tag("th", name, class_=kind, scope="col") for name, kind in zip(names, kinds, strict=True)]
    body = [
        tag("tr", *(tag("td", cell, class_=k, data_is=n) for cell, k, n in zip(row, kinds, names, strict=True)))
        for row in rows
    ]
    title = tag("caption", caption) if caption else None
    return tag("div", tag("table", title, tag("thead", tag("tr", *head)), tag("tbody", *body)), class_="scroll")


def folded(summary: str, *parts: object) -> Html:
    """Return a block of which only the summary is shown until a reader opens it."""
    return tag("details", tag("summary", summary), *parts)


def card(title: str, big: str, below: object) -> Html:
    """Return a card with a large figure and its meaning. Put cards into an element of class "cards"."""
    return tag("section", tag("h3", title), tag("p", big, class_="big"), tag("p", below), class_="card")


def figure(picture: Html, caption: object, title: str = "", class_: str | None = None) -> Html:
    """Return a picture with a caption. The caption is above if there is a title, else below."""
    if title:
        return tag(
            "figure", tag("figcaption", tag("b", title), tag("span", caption)), tag("div", picture), class_=class_
        )
    return tag("figure", picture, tag("figcaption", caption), class_=class_)


def picture(drawing: Figure, label: str) -> Html:
    """Return a Matplotlib figure as an image in its own colours, scaled to fit; see also `figure_svg`.

    Args:
        drawing: the figure.
        label: description for screen readers.
    """
    file = io.BytesIO()
    drawing.savefig(file, format="png", metadata={"Software": "neuro"})
    data = base64.b64encode(file.getvalue()).decode()
    style = f"width:{drawing.get_size_inches()[0] * 96:.0f}px;max-width:100%"
    return tag("figure", tag("img", src=f"data:image/png;base64,{data}", alt=label, style=style))


_COLOURS = {
    "#000000": "ink",
    "#0072b2": "item2",
    "#d55e00": "chip1",
    "#009e73": "item0",
    "#cc79a7": "item3",
    "#e69f00": "item1",
    "#56b4e9": "item6",
}
"""Colours of `neuro.plots`, and the tokens of tokens.css that replace them."""
_SPACE, _LINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}"


def figure_svg(drawing: Figure, label: str) -> Html:
    """Return a Matplotlib figure as SVG, with text as text, in the colours of the page, light or dark.

    Args:
        drawing: the figure. Its attribute `titles` maps the `gid` of an artist to a text for each marker, line or cell
            of the artist. The page shows the text under the pointer.
        label: description for screen readers.
    """
    from matplotlib import rc_context

    file = io.BytesIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "neuro"}):
        drawing.savefig(file, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    root = ElementTree.fromstring(file.getvalue())
    titles = getattr(drawing, "titles", {})
    for part in root.iter():
        part.tag = part.tag.removeprefix(_SPACE)
        part.attrib = {name.removeprefix(_LINK): _shorter(name, value) for name, value in part.attrib.items()}
        part.text, part.tail = (content and (content.strip() or None) for content in (part.text, part.tail))
    for group in root.iter("g"):
        marks = list(group.iter("use")) or list(group.iter("path"))
        for mark, text in zip(marks, titles.get(group.attrib.pop("id", ""), ()), strict=False):
            ElementTree.SubElement(mark, "title").text = text
    content = "".join(ElementTree.tostring(part, encoding="unicode") for part in root if part.tag != "metadata")
    for colour, name in _COLOURS.items():
        content = content.replace(colour, f"var(--{name})")
    width, height = drawing.get_size_inches() * 72
    box = f"0 0 {_text(float(width))} {_text(float(height))}"
    # On a narrow screen the figure scrolls, so that text of 10 points stays readable.
    style = f"max-width:{width * 96 / 72:.0f}px;min-width:{width * 0.75:.0f}px"
    return tag("svg", Html(content), viewBox=box, role="img", aria_label=label, style=style)


def _shorter(name: str, number: str) -> str:
    """Return an attribute of an SVG with two decimals, without superfluous spaces and without the font."""
    if name in ("d", "x", "y", "transform"):
        number = re.sub(r"(\.\d\d)\d+", r"\1", " ".join(number.split()))
        return re.sub(r" (?=[MLCQz-])|(?<=[MLCQ]) ", "", number) if name == "d" else number
    if name == "style":
        number = re.sub(r"font: ([\d.]+px)[^;]*", r"font-size: \1", number)
        return re.sub(r"font-family: [^;]*;? ?|(?<=[:;]) ", "", number)
    return number


def legend(*entries: tuple[str, str]) -> Html:
    """Return a legend: a coloured square and a text for each entry."""
    return tag("p", *(tag("span", tag("i", class_=kind), text) for kind, text in entries), class_="legend")


def svg(width: float, height: float, *parts: object, label: str, class_: str | None = None) -> Html:
    """Return a drawing that is scaled to the available width.

    Args:
        width: width in units of the drawing, which are pixels if there is room.
        height: height in the same units.
        parts: content of the drawing.
        label: description for screen readers.
        class_: class of the element.
    """
    box = f"0 0 {_text(width)} {_text(height)}"
    style = f"max-width:{_text(width)}px"
    return tag("svg", *parts, viewBox=box, role="img", aria_label=label, style=style, class_=class_)


def text(x: float, y: float, words: object, class_: str | None = None, anchor: str | None = None) -> Html:
    """Return a text in a drawing."""
    return tag("text", words, x=x, y=y, class_=class_, text_anchor=anchor)


def line(x1: float, y1: float, x2: float, y2: float, class_: str) -> Html:
    """Return a line in a drawing."""
    return tag("line", x1=x1, y1=y1, x2=x2, y2=y2, class_=class_)


def box(
    x: float, y: float, width: float, height: float, class_: str, title: str = "", opacity: float | None = None
) -> Html:
    """Return a rectangle in a drawing. `title` is shown under the pointer."""
    hover = tag("title", title) if title else None
    return tag("rect", hover, x=x, y=y, width=width, height=height, class_=class_, fill_opacity=opacity)


def _text(value: object) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)
