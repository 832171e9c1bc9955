"""`neuro schema`."""

from __future__ import annotations

import json

import typer


def schema() -> None:
    """Print the JSON Schema of network files, for editors that complete YAML."""
    from neuro.model.language.schema import schema as build

    typer.echo(json.dumps(build(), indent=2))
