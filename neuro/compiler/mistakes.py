"""All mistakes of a file: its first, then the first of what is left without it, until nothing is wrong.

So each is told as if it were alone. What may only follow from another is not told:

- a part that is mistaken, or that names a mistaken one, is judged word by word, and no longer as a whole;
- a text that is no YAML, an `include` that fails and a mistaken `resolution` leave little to judge of the rest.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from neuro.compiler.resolve import compile_network
from neuro.core.errors import ModelError, Where
from neuro.core.paths import file_path
from neuro.model.language.loader import build
from neuro.model.language.parameters import resolve
from neuro.model.language.reader import Node, read
from neuro.model.language.sources import SECTIONS, gather
from neuro.program.program import Program

MOST = 1000
"""Mistakes after which no more are looked for."""

Words = tuple[str, ...]
_WORD = re.compile(r"[\w.-]+")


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What is wrong with a file.

    Attributes:
        mistakes: by place; the text of each is what `neuro.load` or `neuro.compile` says where it is the only one.
        program: the network without what is wrong; None where too little is left of it.
        unsure: the places of parts that are not judged as a whole.
    """

    mistakes: list[ModelError]
    program: Program | None
    unsure: set[Where]


def mistakes(path: str | Path, params: Mapping[str, Any] | None, seed: int) -> Findings:
    """Find all mistakes of a network in a YAML file.

    Args:
        path: the file.
        params: values for its `parameters`, as of `neuro.load`.
        seed: as of `neuro.compile`.
    """
    search = _Search(file_path(path, "path"), {} if params is None else dict(params), seed)
    sections = search.sections()
    if sections is not None:
        search.parts(sections)
    return Findings(sorted(search.told, key=search.order), search.program, search.unsure)


class _Places:
    """Where each word of a tree stands, and each value."""

    def __init__(self, *trees: Node) -> None:
        self.words: dict[Where, Words] = {}
        self.values: dict[Where, Words] = {}
        for tree in trees:
            self._walk(tree, ())

    def _walk(self, node: Node, path: Words, listed: bool = False) -> None:
        """Add what a path leads to; what is in a list has the path of the list."""
        self.values.setdefault(node.where, path)
        if isinstance(node.value, dict):
            for word, inner in node.value.items():
                here = path if listed else (*path, word)
                self.words.setdefault(inner.label, here)
                self._walk(inner, here, listed)
        elif isinstance(node.value, list):
            for item in node.value:
                self._walk(item, path, listed=True)

    def of(self, error: ModelError) -> Words:
        """The words that lead to what a mistake is about; none if it is about no word."""
        if error.where is None:
            return ()
        word, value = self.words.get(error.where, ()), self.values.get(error.where, ())
        if not (word or value):
            value = self._around(error.where)
        if not word or not value or len(value) < 2:
            return word or value
        # A mapping that begins on a line of its own begins where its first word does.
        return word if error.message.endswith((f"'{word[-1]}'", f"{word[-1]} has no value")) else value

    def _around(self, where: Where) -> Words:
        """The value within which a place lies, as a character of a formula does."""
        before = [
            at for at in self.values if (at.file, at.line) == (where.file, where.line) and at.column < where.column
        ]
        return self.values[max(before, key=lambda at: at.column)] if before else ()


class _Search:
    """What was told, and what was taken out for it.

    Attributes:
        mended: the words that lead to what was taken out.
        failed: names of the parts that it was taken out of, or was.
        lost: names in parts that were taken out whole.
    """

    def __init__(self, file: Path, params: dict[str, Any], seed: int) -> None:
        self.file, self.params, self.seed = file, params, seed
        self.told: list[ModelError] = []
        self.files: dict[Path, Node] = {}
        self.mended: list[Words] = []
        self.failed: set[str] = set()
        self.lost: set[str] = set()
        self.program: Program | None = None
        self.unsure: set[Where] = set()

    def order(self, error: ModelError) -> tuple[int, int, int]:
        """By file as they are included, then by line."""
        files = [str(file) for file in self.files]
        where = error.where or Where("")
        return (files.index(where.file) if where.file in files else -1, where.line, where.column)

    def sections(self) -> dict[str, Node] | None:
        """The sections with values in place of `$names`; None where too little is left."""
        while len(self.told) < MOST:
            try:
                return resolve(gather(self.file, self.read), self.params, Where(str(self.file)))
            except ModelError as error:
                path = _Places(*self.files.values()).of(error)
                file = error.where.file if error.where else ""
                root = next((root for root in self.files.values() if _has(root, file, path)), None)
                if root is None:
                    self.told.append(error)
                    return None
                self.mend(root, path, error)
                if path[0] in ("neuro", "include") or (len(path) == 1 and path[0] in SECTIONS and not self.failed):
                    return None
        return None

    def read(self, path: Path) -> Node:
        if path not in self.files:
            self.files[path] = read(path)
        return self.files[path]

    def parts(self, sections: dict[str, Node]) -> None:
        """Build and compile, without what is wrong."""
        here = Where(str(self.file))
        root = Node(sections, here, here)
        places = _Places(root)
        while len(self.told) < MOST:
            try:
                net = build(sections)
                if ("resolution",) not in self.mended:
                    self.program = compile_network(net, self.seed)
                    self.unsure = {
                        node.label
                        for section, parts in sections.items()
                        if isinstance(parts.value, dict)
                        for name, node in parts.value.items()
                        if self.follows(root, (section, name))
                    }
                return
            except ModelError as error:
                path = places.of(error)
                if not _has(root, here.file, path):
                    if not self.mended:
                        self.told.append(error)
                    return
                self.mend(root, path, error)

    def mend(self, root: Node, path: Words, error: ModelError) -> None:
        """Tell a mistake unless it may follow from another, and take out what it is about."""
        if not self.follows(root, path):
            self.told.append(error)
        gone = _taken(root, path)
        self.mended.append(path)
        if len(path) == 1 and isinstance(gone.value, dict):
            self.failed |= set(gone.value)
        elif len(path) > 1:
            self.failed.add(path[1])
        if path[0] == "parameters":
            self.params.pop(path[-1], None)
        if len(path) == 2:
            self.lost |= set(_names(gone))
            if path[0] == "populations" and gone.value != _stand_in():
                root.value["populations"].value[path[1]] = Node(_stand_in(), gone.where, gone.label)

    def follows(self, root: Node, path: Words) -> bool:
        """Whether a mistake may only be there since something was taken out."""
        if any(mended[: len(path)] == path for mended in self.mended):
            return True
        names = {*path[2:], *_names(_at(root, path))}
        if names & self.failed:
            return True
        if path == ("trials",) or (path[0] == "parameters" and path[-1] in self.params):
            return bool(self.mended)
        if len(path) == 2 and path[0] == "projections" and any(mended[0] == "trials" for mended in self.mended):
            return True
        return path[0] == "populations" and "auto" in names and path[1] in self.lost


def _stand_in() -> dict[str, Node]:
    """A population for those that name one that is mistaken."""
    nowhere = Where("")
    return {"model": Node("parrot_neuron", nowhere, nowhere), "shape": Node(1, nowhere, nowhere)}


def _has(root: Node, file: str, path: Words) -> bool:
    """Whether a tree is of a file and has what a path leads to."""
    try:
        return bool(path) and root.where.file == file and _at(root, path) is not None
    except (KeyError, TypeError):
        return False


def _at(root: Node, path: Words) -> Node:
    for word in path:
        root = root.value[word]
    return root


def _taken(root: Node, path: Words) -> Node:
    """What a path leads to, taken out."""
    gone: Node = _at(root, path[:-1]).value.pop(path[-1])
    return gone


def _names(node: Node) -> Iterator[str]:
    """All words below a node, in whatever they stand."""
    if isinstance(node.value, dict):
        for word, inner in node.value.items():
            yield from _WORD.findall(word)
            yield from _names(inner)
    elif isinstance(node.value, list):
        for item in node.value:
            yield from _names(item)
    elif isinstance(node.value, str):
        yield node.value
        yield from _WORD.findall(node.value)
