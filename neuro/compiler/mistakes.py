"""All mistakes of a file: its first, then the first of what is left without it, until nothing is wrong.

So each is reported as if it were alone. What is mistaken is left out, or something stands in for it where the rest
cannot do without. All is done twice, with different stand-ins: only errors with the same text both times are reported,
since others depend on a stand-in. Of what is left out some is known to decide more than itself (`follows`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from neuro.compiler.memory import NO_ROOM
from neuro.compiler.resolve import compile_network
from neuro.compiler.stand_ins import (
    WordPlaces,
    Words,
    as_node,
    at,
    chosen_from,
    has,
    names,
    some_neurons,
    stand_in,
    subject,
)
from neuro.core.errors import ModelError, Where
from neuro.core.memory import uncollected
from neuro.core.paths import file_path
from neuro.model.language.loader import build
from neuro.model.language.parameters import resolve
from neuro.model.language.reader import Node, read
from neuro.model.language.sources import GATHERED, SECTIONS, gather
from neuro.program.program import Program

MOST = 1000
"""Mistakes after which no more are looked for."""
_ENDS = (("from",), ("to",), ("of",), ("record",))
_OF_SENSOR = ("file", "events", "stream", "sensor", "format", "polarity", "crop", "scale", "event_camera")
_OF_ARRAY = {"file", "key"}
_OF_DECISIONS = ("labels", "dropout", "reset")
_WORDS = ("unknown word of", "unknown parameter of", "unknown state of")
_HANGS_ON = {"count of synapses": ("from", "to", "rule"), "neurons at an end": ("from", "to")}
_NAMES = tuple(f"unknown {kind}" for kind in ("population", "parameter", "model", "signal", "synapse", "projection"))


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


@uncollected()
def mistakes(path: str | Path, params: Mapping[str, Any] | None, seed: int, backend_draws: bool = False) -> Findings:
    """Find all mistakes of a network in a YAML file.

    Args:
        path: the file.
        params: values for its `parameters`, as of `neuro.load`.
        seed: as of `neuro.compile`.
        backend_draws: as of `compile_network`.
    """
    file, said = file_path(path, "path"), {} if params is None else dict(params)
    first = _Search(file, dict(said), seed, 0, backend_draws)
    first.run()
    found = {_identity(error): error for error in first.told}
    if first.mended:
        # Once more with other stand-ins: a mistake that only a stand-in caused is reported in other words, or not at
        # all, and is dropped.
        second = _Search(file, dict(said), seed, 1, backend_draws)
        second.run()
        again = {_identity(error) for error in second.told}
        found = {identity: error for identity, error in found.items() if identity in again}
    return Findings(sorted(found.values(), key=first.order), first.program, first.unsure)


def _identity(error: ModelError) -> str:
    """The text of an error; without the free memory of the moment, which two searches do not share."""
    return f"{error.where}: {NO_ROOM}" if error.kind == NO_ROOM else str(error)


class _Search:
    """What was reported, and what was replaced for it.

    Attributes:
        mended: the words that lead to what was left out or has a stand-in.
        failed: names of parts that are no longer there, or no longer what they were.
        touched: names of all parts in which something was mended.
        lost: names in projections that may have been grids.
        whole: the words of ends whose population is known, in place of neurons of it that are not there.
        resolved: whether values stand in place of all `$names`.
        partial: whether parts that are named may be in what could not be read.
    """

    def __init__(self, file: Path, params: dict[str, Any], seed: int, turn: int, backend_draws: bool) -> None:
        self.file, self.params, self.seed, self.turn, self.backend_draws = file, params, seed, turn, backend_draws
        self.told: list[ModelError] = []
        self.files: dict[Path, Node] = {}
        self.mended: list[Words] = []
        self.failed: set[str] = set()
        self.touched: set[str] = set()
        self.lost: set[str] = set()
        self.whole: set[Words] = set()
        self.partial = self.resolved = False
        self.program: Program | None = None
        self.unsure: set[Where] = set()

    def order(self, error: ModelError) -> tuple[int, int, int]:
        """By file as they are included, then by line."""
        files = [str(file) for file in self.files]
        where = error.where or Where("")
        return (files.index(where.file) if where.file in files else -1, where.line, where.column)

    def run(self) -> None:
        sections = self.sections()
        if sections is not None:
            self.resolved = True
            self.failed -= {path[1] for path in self.mended if path[0] == "parameters" and len(path) == 2}
            self.parts(sections)

    def sections(self) -> dict[str, Node] | None:
        """The sections with values in place of `$names`; None where too little is left."""
        while len(self.mended) < MOST:
            try:
                return resolve(gather(self.file, self.read), self.params, Where(str(self.file)))
            except ModelError as error:
                path = WordPlaces(*self.files.values()).of(error)
                file = error.where.file if error.where else ""
                root = next((r for r in self.files.values() if r.where.file == file and has(r, path[:1])), None)
                if root is None:
                    self.tell(error)
                    return None
                if not self.follows(root, path, error):
                    self.tell(error)
                self.leave_out(root, path, error)
        return None

    def read(self, path: Path) -> Node:
        if path not in self.files:
            self.files[path] = read(path, twice=self.told)
        return self.files[path]

    def parts(self, sections: dict[str, Node]) -> None:
        """Build and compile, without what is wrong."""
        here = Where(str(self.file))
        root = Node(sections, here, here)
        places: WordPlaces | None = None
        while len(self.mended) < MOST:
            net = None
            try:
                net = build(sections, together=True)
                self.program = compile_network(net, self.seed, backend_draws=self.backend_draws)
                doubted = self.failed | self.touched
                self.unsure = {
                    node.label
                    for parts in sections.values()
                    if doubted and isinstance(parts.value, dict)
                    for name, node in parts.value.items()
                    if {name, *names(node)} & doubted
                }
                return
            except ModelError as error:
                places = places or WordPlaces(root)
                path = places.of(error)
                if net is not None and path and has(root, path):
                    path = subject(root, path, error)
                if not has(root, path[:1]):
                    if not self.mended:
                        self.tell(error)
                    return
                others = [(places.of(other), other) for other in error.others[: MOST - len(self.mended)]]
                # A check that found several reports them together, in `others`; each is judged as if it were alone.
                for where, one in [(path, error), *others]:  # before anything is left out for one of them
                    if not self.follows(root, where, one, compiled=net is not None):
                        self.tell(one)
                self.leave_out(root, path, error)
                for where, one in others:
                    if has(root, where):
                        self.leave_out(root, where, one)

    def tell(self, error: ModelError) -> None:
        self.told.append(error.but(others=()))

    def leave_out(self, root: Node, path: Words, error: ModelError) -> None:
        """Leave out or replace what a mistake is about."""
        population = chosen_from(root.value, path)
        if population and path not in self.mended:
            place = at(root, path[:3])
            at(root, path[:2]).value[path[2]] = as_node(some_neurons(population, self.turn), place)
            self.whole.add(path)
            self.note(root, path, None, replaced=True)
            return
        while len(path) > 1 and (self.mended.count(path) > (len(path) == 2) or not has(root, path[:-1])):
            path = path[:-1]
        if len(path) > 2 and path[-1] in _OF_ARRAY and set(at(root, path[:-1]).value) == _OF_ARRAY:
            path = path[:-1]  # the other word by itself would be read as the name of a distribution
        within = at(root, path[:-1]).value
        gone = within.pop(path[-1], None) if isinstance(within, dict) else None
        instead = None
        if path not in self.mended:
            instead = stand_in(root.value, path, gone, error, self.turn)
        renamed = self.renamed(path, error)
        if renamed and gone is not None and renamed not in within:
            within[renamed] = gone
        elif instead is not None and isinstance(within, dict):
            within[path[-1]] = as_node(instead, gone or at(root, path[:-1]))
        self.note(root, path, gone, bool(renamed) or instead is not None)
        if len(path) > 1 and error.kind in _WORDS and isinstance(within, dict):
            self.rename((*path[:-1], error.suggestion), root, gone)

    def renamed(self, path: Words, error: ModelError) -> str:
        """The section or the group that is meant, if its words can be judged without knowing which."""
        if len(path) == 1:
            return error.suggestion if error.suggestion in SECTIONS else ""
        return error.suggestion or "winner_take_all" if error.kind == "unknown group" else ""

    def rename(self, path: Words, root: Node, gone: Node | None) -> None:
        """Let something stand in for the word that an unknown one most likely is."""
        within = at(root, path[:-1]).value
        if not path[-1] or path[-1] in within or gone is None:
            return
        instead = stand_in(root.value, path, None, ModelError(""), self.turn)
        if instead is not None:
            within[path[-1]] = as_node(instead, gone)
        self.note(root, path, None, instead is not None)

    def note(self, root: Node, path: Words, gone: Node | None, replaced: bool) -> None:
        """Remember what is no longer there."""
        self.mended.append(path)
        if path[0] == "parameters":
            self.params.pop(path[-1], None)
        if len(path) == 1:
            self.partial |= path[0] in ("include", *GATHERED)
            if not replaced and gone is not None and isinstance(gone.value, dict):
                self.failed |= set(gone.value)
            return
        self.touched.add(path[1])
        if path[0] == "parameters" or (len(path) == 2 and not replaced) or path[2:] == ("synapse",):
            self.failed.add(path[1])
        if path[0] == "projections" and (len(path) == 2 or path[2] in ("from", "to", "rule")):
            self.lost |= set(names(gone)) if gone is not None else set()
            self.lost |= set(names(at(root, path[:2]))) if has(root, path[:2]) else set()

    def follows(self, root: Node, path: Words, error: ModelError, compiled: bool = False) -> bool:
        """Whether a mistake may only be there since something was mended."""
        # "unknown X of" is about a word inside a part, "unknown X" about a part itself.
        names_a_part = error.kind.startswith("unknown") and not error.kind.endswith(" of") and error.found == path[-1]
        if path in self.mended or (not names_a_part and any(mended[: len(path)] == path for mended in self.mended)):
            return True
        if self.partial and error.kind in _NAMES:
            return True
        there = next(path[:n] for n in range(len(path), 0, -1) if has(root, path[:n]))
        named = set(() if names_a_part else names(at(root, there))) | set(path[2:] if self.resolved else ())
        if named & self.failed or self.depends(root, path, error):
            return True
        if path[0] == "parameters" and path[-1] in self.params:
            return bool(self.mended)
        if path[0] == "populations" and "auto" in named and path[1:] and path[1] in self.lost:
            return True
        return (compiled or path[0] == "models") and self.hangs(path, error)

    def depends(self, root: Node, path: Words, error: ModelError) -> bool:
        """Whether a mistake only follows from a part of unknown kind."""
        beside = self.beside(path)
        ends = {words[0] for words in beside}
        if error.missing and any(words[-1] == error.missing for words in beside):
            return True
        if path[0] == "projections":
            return path[2:3] in (("weight",), ("synapse",)) and error.kind == "unit" and bool(ends & {"from", "to"})
        if path[0] == "populations":
            return path[2:3] == ("shape",) and any(words[-1] in _OF_SENSOR for words in beside)
        if path[0] != "probes":
            return False
        of = (*path[:2], "of")
        if (error.kind == "synapses" or error.kind in _HANGS_ON) and has(root, of):
            return self.is_unsure(str(at(root, of).value), error.kind)
        return error.kind == "no projection" and "of" in ends

    def is_unsure(self, projection: str, what: str) -> bool:
        """Whether it is not known what its synapses are, how many, or whose neurons are at its ends."""
        beside = self.beside(("projections", projection))
        if what in _HANGS_ON:
            return any(words[0] in _HANGS_ON[what] for words in beside)
        return projection in self.failed or any(words[0] == "synapse" and len(words) <= 2 for words in beside)

    def beside(self, path: Words) -> list[Words]:
        """The words within a part that lead to what was mended, but those that leave the population known."""
        return [
            words[2:] for words in self.mended if words[:2] == path[:2] and len(words) > 2 and words not in self.whole
        ]

    def hangs(self, path: Words, error: ModelError) -> bool:
        """Whether what the compiler tells of a part depends on what was mended in it, or on who decides."""
        beside = self.beside(path)
        if {words[-1] for words in beside if words not in _ENDS} & {*error.path, *error.about, error.found}:
            return True
        if path[0] == "trials":
            return bool(self.mended) if len(path) == 1 else path[1] in _OF_DECISIONS and self.undecided()
        if path[0] == "projections":
            if path[2:3] == ("weight",) and any(words == ("synapse",) or words[-1] == "Wmin" for words in beside):
                return True
            if error.kind == "trials" and (self.undecided() or ("trials",) in self.mended or self.partial):
                return True
        if path[2:3] == ("synapses",):
            return ("of",) in beside
        return error.kind != "resolution" and any(words[:1] in _ENDS for words in beside)

    def undecided(self) -> bool:
        """Whether it is not known which population decides a trial."""
        return any(
            (mended[0] == "groups" and (len(mended) < 4 or mended[-1] == "of"))
            or (mended[:2] in (("trials", "labels"), ("trials", "dropout")) and mended[2:] in ((), ("of",)))
            for mended in self.mended
        )
