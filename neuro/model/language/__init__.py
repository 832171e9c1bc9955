"""Networks as YAML: reading, writing, and the JSON Schema for editors.

Apps read their own files in the same grammar. `read` returns nodes with their positions in the file, `words` the
accepted words of a mapping, and `plain` the value of a node. `mistake` and `about` add positions to errors.
"""

from typing import TYPE_CHECKING

from neuro.core.lazy import public_names

if TYPE_CHECKING:
    from neuro.model.language.json_schema import schema as schema
    from neuro.model.language.loader import load as load
    from neuro.model.language.reader import (
        Node as Node,
        about as about,
        mistake as mistake,
        plain as plain,
        read as read,
        words as words,
    )
    from neuro.model.language.writer import save as save

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = public_names(__name__, __file__)
