"""All mistakes of a file: its first, then the first of what is left without it, until nothing is wrong.

So each is reported as if it were alone. What is mistaken is left out, or something stands in for it where the rest
cannot do without. All is done twice, with different stand-ins: only errors with the same text both times are reported,
since others depend on a stand-in. Of what is left out some is known to decide more than itself (`follows`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from neuro.compiler.memory import NO_ROOM
from neuro.compiler.probes import ALONE
from neuro.compiler.resolve import compile_network
from neuro.core.errors import ModelError, Where
from neuro.core.inputs import file_path
from neuro.core.system import uncollected
from neuro.model.language.including import GATHERED, SECTIONS, gather
from neuro.model.language.loader import TABLES, build
from neuro.model.language.parameters import resolve
from neuro.model.language.reader import Node, read
from neuro.model.neurons import MODELS, Neuron, spike_generator
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


_MODEL = ("iaf_psc_delta", "iaf_psc_exp")
_SHAPE = (1, 2)
_RULE = ({"fixed_total_number": {"n": 1}}, {"pairs": {"pre": [0, 0], "post": [0, 0]}})
_REPLACED: Mapping[Words, tuple[Any, Any]] = {
    ("resolution",): (0.1, 0.05),
    ("populations", "shape"): _SHAPE,
    ("projections", "rule"): _RULE,
    ("projections", "weight"): (0.0, 0.0),
    ("trials", "duration"): (10.0, 20.0),
}
_PARTS = {"from": (), "to": (Neuron,), "of": (), "input": (spike_generator,), "output": ()}
"""Words that name a population, and of which model it is."""
_SETTINGS = ("trials", "readout")
"""Sections that are no parts by name."""


def stand_in(sections: Mapping[str, Node], path: Words, gone: Node | None, error: ModelError, turn: int) -> Any:
    """A plain value that stands in for what is mistaken; None if it is left out.

    Args:
        sections: of the description.
        path: the words that lead to it.
        gone: what stood there, if anything did.
        error: what was wrong with it.
        turn: 0 or 1, the first or the second stand-in.
    """
    if path in (("parameters",), ("populations",)):
        return None
    if path[0] == "parameters":
        return turn + 1
    if path[0] == "populations" and path[2:] in ((), ("model",)):
        model = "spike_generator" if _shown(sections) == path[1] else _MODEL[turn]
        return model if path[2:] else {"model": model, "shape": _SHAPE[turn]}
    if path[0] == "probes" and path[2:] == ("record",):
        return error.suggestion or next((word for word in error.expected if word not in ALONE), None)
    place = (path[0], *path[2:]) if path[0] not in _SETTINGS else path
    if place in _REPLACED:
        return _REPLACED[place][turn]
    if path[-1] in _PARTS and (len(path) == 3 or path[0] in ("groups", *_SETTINGS)):
        there = sections["populations"].value if "populations" in sections else {}
        if not isinstance(there, dict):
            return None
        fitting = [name for name, node in there.items() if issubclass(_model(node), _PARTS[path[-1]] or object)]
        return error.suggestion if error.suggestion in there else next(iter([*fitting, *there]), None)
    return _needed(path[-2], path[-1], turn) if len(path) > 3 else None


def chosen_from(sections: Mapping[str, Node], path: Words) -> str:
    """The population of which a path leads to an index; "" if it leads elsewhere."""
    populations = sections["populations"].value if "populations" in sections else {}
    known = len(path) == 4 and path[2] in ("from", "to", "of", "pre", "post") and path[3] in populations
    return path[3] if known else ""


def some_neurons(population: str, turn: int) -> Any:
    """All neurons of a population, or one of it: what depends on how many are chosen differs."""
    return population if turn == 0 else {population: 0}


def _shown(sections: Mapping[str, Node]) -> Any:
    """The name of the population that trials show their input to."""
    trials = sections["trials"].value if "trials" in sections else None
    return trials["input"].value if isinstance(trials, dict) and "input" in trials else None


def _needed(name: str, word: str, turn: int) -> Any:
    """A number that a parameter can be which has no default."""
    cls = next((table[name] for table in TABLES.values() if name in table), None)
    if cls is None or word not in cls.quantities() or word in cls.defaults():
        return None
    q = cls.quantities()[word]
    if q.kind == "shape":
        return [turn + 1, turn + 1]
    low = next((bound for bound in (q.at_least, q.above) if bound is not None), 0.0)
    high = next((bound for bound in (q.at_most, q.below) if bound is not None), low + 4.0)
    number = low + (high - low) * (turn + 1) / 4.0
    return int(number) if q.kind == "integer" or q.whole else number


def _model(node: Node) -> type[Any]:
    """The class of a population's model, as far as its node states it."""
    said = node.value.get("model") if isinstance(node.value, dict) else None
    name = said and (next(iter(said.value), "") if isinstance(said.value, dict) else said.value)
    return MODELS[name] if isinstance(name, str) and name in MODELS else object


def as_node(value: Any, at: Node) -> Node:
    """A plain value as if it stood at the place of another."""
    if isinstance(value, dict):
        value = {word: as_node(inner, at) for word, inner in value.items()}
    elif isinstance(value, list):
        value = [as_node(inner, at) for inner in value]
    return Node(value, at.where, at.label)


Words: TypeAlias = tuple[str, ...]

_WORD = re.compile(r"[\w.-]+")
_DEFAULTED = ("weight", "delay", "record")
"""Words of parts that a mistake may be about where they are not said."""


class WordPlaces:
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
        path = self._at(error)
        return (*path, error.missing) if path and error.missing else path

    def _at(self, error: ModelError) -> Words:
        if error.where is None:
            return ()
        word, value = self.words.get(error.where, ()), self.values.get(error.where, ())
        if not (word or value):
            before = [
                at
                for at in self.values
                if (at.file, at.line) == (error.where.file, error.where.line) and at.column < error.where.column
            ]
            value = self.values[max(before, key=lambda at: at.column)] if before else ()
        if not word or not value or len(value) < 2:
            return word or value
        # A mapping that begins on a line of its own begins where its first word does.
        return word if error.found == word[-1] else value


def subject(root: Node, part: Words, error: ModelError) -> Words:
    """The words that an error of the compiler for a part is about, as far as they are said; else the whole part.

    Args:
        root: what the words lead into.
        part: the words that lead to the part.
        error: its path begins with a word of the part, or with a choice somewhere in it, as a model.
    """
    if not error.path:
        return part
    first, *rest = error.path
    head = next((path for name, path in _words_below(at(root, part), part) if name == first), None)
    if head is None:
        return (*part, first) if first in _DEFAULTED else part
    for word in rest:
        inner = at(root, head).value
        if not isinstance(inner, dict):
            break
        # What is not said has its default, and another word that it depends on is said.
        head = next(((*head, name) for name in (word, *error.about) if name in inner), head)
    return head


def _words_below(node: Node, path: Words) -> Iterator[tuple[str, Words]]:
    """All words below a node with the paths to them, and those that stand for a value, the nearest first."""
    level = [(node, path)]
    while level:
        below = []
        for node, path in level:
            if isinstance(node.value, str):
                yield node.value, path
            elif isinstance(node.value, dict):
                yield from ((word, (*path, word)) for word in node.value)
                below += [(inner, (*path, word)) for word, inner in node.value.items()]
        level = below


def has(root: Node, path: Words) -> bool:
    """Whether a tree has what a path leads to."""
    try:
        return bool(path) and at(root, path) is not None
    except (KeyError, TypeError):
        return False


def at(root: Node, path: Words) -> Node:
    """What a path leads to."""
    for word in path:
        root = root.value[word]
    return root


def names(node: Node) -> Iterator[str]:
    """All words below a node, in whatever they stand."""
    if isinstance(node.value, dict):
        for word, inner in node.value.items():
            yield from _WORD.findall(word)
            yield from names(inner)
    elif isinstance(node.value, list):
        for item in node.value:
            yield from names(item)
    elif isinstance(node.value, str):
        yield node.value
        yield from _WORD.findall(node.value)
