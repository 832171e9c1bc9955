"""Networks as YAML: reading, writing, and the schema for editors."""

from neuro.language.loader import load
from neuro.language.schema import schema
from neuro.language.writer import save

__all__ = ["load", "save", "schema"]
