"""Networks as YAML: reading, writing, and the schema for editors."""

from neuro.language.loader import load

__all__ = ["load"]
