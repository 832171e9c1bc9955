"""Networks as YAML: reading, writing, and the schema for editors.

Apps read their own files in the same grammar: `read` gives nodes that know their place, `words` the known words of a
mapping, `plain` a value, and `mistake` and `about` put errors where they belong.
"""

from neuro.model.language.loader import load
from neuro.model.language.reader import Node, about, mistake, plain, read, words
from neuro.model.language.schema import schema
from neuro.model.language.writer import save

__all__ = ["Node", "about", "load", "mistake", "plain", "read", "save", "schema", "words"]
