"""Arguments that commands of `neuro sweep` share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Runs = Annotated[Path, typer.Argument(metavar="FOLDER", help="A sweep, as 'neuro sweep run' writes it.")]
