"""Arguments that commands of `neuro tune` share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Tuned = Annotated[Path, typer.Argument(metavar="FOLDER", help="A tuning, as 'neuro tune run' writes it.")]
