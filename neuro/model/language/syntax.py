"""Messages for syntax errors of YAML, in the terms of a description."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import yaml

from neuro.core.errors import ModelError, Where


def syntax_error(error: yaml.MarkedYAMLError, lines: Sequence[str], file: str) -> ModelError:
    """Translate an error of the YAML parser."""
    mark = error.problem_mark or error.context_mark
    if mark is None:
        return ModelError(f"not YAML: {error.problem}", where=Where(file))
    where = _place(mark, file)
    line = lines[mark.line] if mark.line < len(lines) else ""
    text = (re.match(r"\w+|.?", line[mark.column :]) or "")[0]
    problem = str(error.problem)
    if text == "\t" or "tab character" in problem:
        return ModelError("found a tab: expected spaces", where=where, hint="YAML is indented by spaces only")
    if "cannot start any token" in problem:
        return ModelError(
            f"found '{text}': expected a value", where=where, hint="put text with this character in quotes"
        )
    if "mapping values are not allowed" in problem:
        message = "found ':' without a word before it"
        hint = "is a ':' missing on the line above, or the indentation different?"
        return ModelError(message, where=where, hint=hint)
    if "could not find expected ':'" in problem:
        return ModelError("expected ':' after the word on the line above", where=where)
    if "expected ',' or" in problem:
        closing = "]" if "']'" in problem else "}"
        start = _place(error.context_mark, file) if error.context_mark else where
        return ModelError(f"expected ',' or '{closing}' in the list or mapping that begins at {start}", where=where)
    if "expected key" in problem or "<block end>" in problem or "'-' indicator" in problem:
        return ModelError(
            f"found {repr(text) if text else 'the end of the line'}: expected a word or the end of the part",
            where=where,
            hint="do the words of a part begin in the same column, and do brackets match?",
        )
    if "end of stream" in problem:
        begin = _place(error.context_mark, file) if error.context_mark else where
        return ModelError("found the end of the file inside quotes", where=begin)
    return ModelError(f"not YAML: {problem}", where=where)


def _place(mark: Any, file: str) -> Where:
    return Where(file, mark.line + 1, mark.column + 1)
