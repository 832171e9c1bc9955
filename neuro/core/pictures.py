"""Figures as PNG, PDF or SVG files, with a mark of this package."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from neuro.core.errors import ModelError
from neuro.core.outputs import Kind, check_output, marked, output

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PICTURE = "a picture of neuro"
# For PNG the complete chunk of text: the length 14, then kind, keyword and text.
_PICTURES: dict[str, tuple[Kind, dict[str, str | None]]] = {
    ".png": (marked(_PICTURE, "\0\0\0\x0etEXtSoftware\0neuro"), {"Software": "neuro"}),
    ".pdf": (marked(_PICTURE, "/Creator (neuro)", anywhere=True), {"Creator": "neuro"}),
    ".svg": (marked(_PICTURE, "<dc:title>neuro</dc:title>"), {"Creator": "neuro", "Date": None}),
}


def write_picture(path: Path, figure: Figure) -> None:
    """Write a figure as PNG, PDF or SVG, by the ending of the name. See `output` for errors."""
    ending = path.suffix if path.suffix in _PICTURES else ".png"
    kind, metadata = _PICTURES[ending]
    with output(path, kind) as part:
        figure.savefig(part, format=ending[1:], metadata=metadata)


def check_picture(path: Path) -> None:
    """Raise an error if a picture cannot be written, or if its name has an unknown ending. See `check_output`."""
    if path.suffix not in _PICTURES:
        raise ModelError(f"{path}: expected a name ending in {', '.join(_PICTURES)}")
    check_output(path, _PICTURES[path.suffix][0])
