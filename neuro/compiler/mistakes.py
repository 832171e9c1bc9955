"""Collect every error in a file: remove a part with an error and check the rest again, until no error is left.

Each error then reads like the only error in the file. If other parts need the part, a stand-in replaces it. The
search runs twice, with different stand-ins. Only errors with the same text in both searches are reported, since
other errors depend on a stand-in. Some removed parts also cause errors elsewhere; `may_follow` finds these errors.
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
from neuro.model.language.parameters import as_node, resolve
from neuro.model.language.reader import Node, read
from neuro.model.neurons import MODELS, Neuron, spike_generator
from neuro.program.program import Program

MOST = 1000
"""Number of errors after which the search ends."""
_ENDS = (("from",), ("to",), ("of",), ("record",))
_OF_SENSOR = ("file", "events", "stream", "sensor", "format", "polarity", "crop", "scale", "event_camera")
_OF_ARRAY = {"file", "key"}
_OF_DECISIONS = ("labels", "dropout", "reset")
_WORDS = ("unknown word of", "unknown parameter of", "unknown state of")
_DEPENDS_ON = {"count of synapses": ("from", "to", "rule"), "neurons at an end": ("from", "to")}
_NAMES = tuple(f"unknown {kind}" for kind in ("population", "parameter", "model", "signal", "synapse", "projection"))


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """The errors of a file.

    Attributes:
        mistakes: the errors sorted by place, with the text that `neuro.load` or `neuro.compile` would raise for each.
        program: the network without the erroneous parts; None if too little is left.
        unsure: the places of parts that cannot be judged as a whole.
    """

    mistakes: list[ModelError]
    program: Program | None
    unsure: set[Where]


@uncollected()
def mistakes(path: str | Path, params: Mapping[str, Any] | None, seed: int, backend_draws: bool = False) -> Findings:
    """Find all errors of a network in a YAML file.

    Args:
        path: the file.
        params: values for its `parameters`, as for `neuro.load`.
        seed: as for `neuro.compile`.
        backend_draws: as for `compile_network`.
    """
    file, values = file_path(path, "path"), {} if params is None else dict(params)
    first_search = _Search(file, dict(values), seed, 0, backend_draws)
    first_search.run()
    errors = {_identity(error): error for error in first_search.reported}
    if first_search.changed:
        # The second search uses other stand-ins. Errors with another text, or absent, come from a stand-in: drop them.
        second_search = _Search(file, dict(values), seed, 1, backend_draws)
        second_search.run()
        second_identities = {_identity(error) for error in second_search.reported}
        errors = {identity: error for identity, error in errors.items() if identity in second_identities}
    return Findings(sorted(errors.values(), key=first_search.sort_key), first_search.program, first_search.unsure)


def _identity(error: ModelError) -> str:
    """Return the text of an error. The amount of free memory is left out, because it differs between searches."""
    return f"{error.where}: {NO_ROOM}" if error.kind == NO_ROOM else str(error)


class _Search:
    """A search for all errors: the errors reported so far, and the changes to the description.

    Attributes:
        changed: the paths that were removed or have a stand-in.
        failed: names of parts that were removed or changed their kind.
        touched: names of all parts with a change.
        possible_grid_ends: names in removed projections that may have been grids.
        replaced_ends: paths of ends with a stand-in for invalid neurons of a known population.
        resolved: whether all `$names` are replaced by values.
        may_lack_parts: whether a section that may contain parts could not be read.
    """

    def __init__(self, file: Path, params: dict[str, Any], seed: int, turn: int, backend_draws: bool) -> None:
        self.file, self.params, self.seed, self.turn, self.backend_draws = file, params, seed, turn, backend_draws
        self.reported: list[ModelError] = []
        self.files: dict[Path, Node] = {}
        self.changed: list[Words] = []
        self.failed: set[str] = set()
        self.touched: set[str] = set()
        self.possible_grid_ends: set[str] = set()
        self.replaced_ends: set[Words] = set()
        self.may_lack_parts = self.resolved = False
        self.program: Program | None = None
        self.unsure: set[Where] = set()

    def sort_key(self, error: ModelError) -> tuple[int, int, int]:
        """Return the key for sorting: files in the order in which they are included, then lines."""
        files = [str(file) for file in self.files]
        where = error.where or Where("")
        return (files.index(where.file) if where.file in files else -1, where.line, where.column)

    def run(self) -> None:
        sections = self.load_sections()
        if sections is not None:
            self.resolved = True
            self.failed -= {path[1] for path in self.changed if path[0] == "parameters" and len(path) == 2}
            self.compile_parts(sections)

    def load_sections(self) -> dict[str, Node] | None:
        """Return the sections with values in place of `$names`; None if too little is left."""
        while len(self.changed) < MOST:
            try:
                return resolve(gather(self.file, self.read), self.params, Where(str(self.file)))
            except ModelError as error:
                path = WordPlaces(*self.files.values()).of(error)
                file = error.where.file if error.where else ""
                root = next((r for r in self.files.values() if r.where.file == file and has(r, path[:1])), None)
                if root is None:
                    if not (self.may_lack_parts and error.kind in _NAMES):
                        self.report(error)
                    if file in ("", str(self.file)):
                        return None
                    # An unreadable included file counts as empty; it might have defined any part.
                    self.files[Path(file)], self.may_lack_parts = Node({}, Where(file), Where(file)), True
                    continue
                if not self.may_follow(root, path, error):
                    self.report(error)
                self.remove(root, path, error)
        return None

    def read(self, path: Path) -> Node:
        if path not in self.files:
            self.files[path] = read(path, repeated_words=self.reported)
        return self.files[path]

    def compile_parts(self, sections: dict[str, Node]) -> None:
        """Build and compile the network, without the parts that have errors."""
        file_start = Where(str(self.file))
        root = Node(sections, file_start, file_start)
        paths_by_place: WordPlaces | None = None
        while len(self.changed) < MOST:
            net = None
            try:
                net = build(sections, every_mistake=True)
                self.program = compile_network(net, self.seed, backend_draws=self.backend_draws)
                uncertain = self.failed | self.touched
                self.unsure = {
                    node.label
                    for parts in sections.values()
                    if uncertain and isinstance(parts.value, dict)
                    for name, node in parts.value.items()
                    if {name, *names(node)} & uncertain
                }
                return
            except ModelError as error:
                paths_by_place = paths_by_place or WordPlaces(root)
                path = paths_by_place.of(error)
                if net is not None and path and has(root, path):
                    path = subject(root, path, error)
                if not has(root, path[:1]):
                    if not self.changed:
                        self.report(error)
                    return
                other_errors = [(paths_by_place.of(other), other) for other in error.others[: MOST - len(self.changed)]]
                # `others` has further errors of the same check. All errors are judged before a part is removed.
                for other_path, listed_error in [(path, error), *other_errors]:
                    if not self.may_follow(root, other_path, listed_error, compiled=net is not None):
                        self.report(listed_error)
                self.remove(root, path, error)
                for other_path, listed_error in other_errors:
                    if has(root, other_path):
                        self.remove(root, other_path, listed_error)

    def report(self, error: ModelError) -> None:
        self.reported.append(error.but(others=()))

    def remove(self, root: Node, path: Words, error: ModelError) -> None:
        """Remove or replace the part with an error."""
        population = chosen_from(root.value, path)
        if population and path not in self.changed:
            index_node = node_at(root, path[:3])
            node_at(root, path[:2]).value[path[2]] = as_node(some_neurons(population, self.turn), index_node)
            self.replaced_ends.add(path)
            self.record_change(root, path, None, replaced=True)
            return
        while len(path) > 1 and (self.changed.count(path) > (len(path) == 2) or not has(root, path[:-1])):
            path = path[:-1]
        if len(path) > 2 and path[-1] in _OF_ARRAY and set(node_at(root, path[:-1]).value) == _OF_ARRAY:
            path = path[:-1]  # `file` or `key` alone would be read as the name of a distribution
        mapping = node_at(root, path[:-1]).value
        removed = mapping.pop(path[-1], None) if isinstance(mapping, dict) else None
        replacement = None
        if path not in self.changed:
            replacement = stand_in(root.value, path, removed, error, self.turn)
        renamed = self.renamed(path, error)
        if renamed and removed is not None and renamed not in mapping:
            mapping[renamed] = removed
        elif replacement is not None and isinstance(mapping, dict):
            mapping[path[-1]] = as_node(replacement, removed or node_at(root, path[:-1]))
        self.record_change(root, path, removed, bool(renamed) or replacement is not None)
        if len(path) > 1 and error.kind in _WORDS and isinstance(mapping, dict):
            self.rename((*path[:-1], error.suggestion), root, removed)

    def renamed(self, path: Words, error: ModelError) -> str:
        """Return the likely intended name of an unknown section or group, or ""."""
        if len(path) == 1:
            return error.suggestion if error.suggestion in SECTIONS else ""
        return error.suggestion or "winner_take_all" if error.kind == "unknown group" else ""

    def rename(self, path: Words, root: Node, removed: Node | None) -> None:
        """Add a stand-in for the suggested word in place of an unknown word."""
        mapping = node_at(root, path[:-1]).value
        if not path[-1] or path[-1] in mapping or removed is None:
            return
        replacement = stand_in(root.value, path, None, ModelError(""), self.turn)
        if replacement is not None:
            mapping[path[-1]] = as_node(replacement, removed)
        self.record_change(root, path, None, replacement is not None)

    def record_change(self, root: Node, path: Words, removed: Node | None, replaced: bool) -> None:
        """Record a change of the description."""
        self.changed.append(path)
        if path[0] == "parameters":
            self.params.pop(path[-1], None)
        if len(path) == 1:
            self.may_lack_parts |= path[0] in ("include", *GATHERED)
            if not replaced and removed is not None and isinstance(removed.value, dict):
                self.failed |= set(removed.value)
            return
        self.touched.add(path[1])
        if path[0] == "parameters" or (len(path) == 2 and not replaced) or path[2:] == ("synapse",):
            self.failed.add(path[1])
        if path[0] == "projections" and (len(path) == 2 or path[2] in ("from", "to", "rule")):
            self.possible_grid_ends |= set(names(removed)) if removed is not None else set()
            self.possible_grid_ends |= set(names(node_at(root, path[:2]))) if has(root, path[:2]) else set()

    def may_follow(self, root: Node, path: Words, error: ModelError, compiled: bool = False) -> bool:
        """Return whether an error may be a consequence of an earlier change."""
        # "unknown X of" reports a word inside a part, "unknown X" the part itself.
        names_a_part = error.kind.startswith("unknown") and not error.kind.endswith(" of") and error.found == path[-1]
        if path in self.changed or (not names_a_part and any(change[: len(path)] == path for change in self.changed)):
            return True
        if self.may_lack_parts and error.kind in _NAMES:
            return True
        longest = next(path[:n] for n in range(len(path), 0, -1) if has(root, path[:n]))
        words = set(() if names_a_part else names(node_at(root, longest))) | set(path[2:] if self.resolved else ())
        if words & self.failed or self.depends_on_kind(root, path, error):
            return True
        if path[0] == "parameters" and path[-1] in self.params:
            return bool(self.changed)
        if path[0] == "populations" and "auto" in words and path[1:] and path[1] in self.possible_grid_ends:
            return True
        return (compiled or path[0] == "models") and self.depends_on_change(path, error)

    def depends_on_kind(self, root: Node, path: Words, error: ModelError) -> bool:
        """Return whether an error is a consequence of a part of unknown kind."""
        changes = self.changes_in(path)
        ends = {change[0] for change in changes}
        if error.missing and any(change[-1] == error.missing for change in changes):
            return True
        if path[0] == "projections":
            return path[2:3] in (("weight",), ("synapse",)) and error.kind == "unit" and bool(ends & {"from", "to"})
        if path[0] == "populations":
            return path[2:3] == ("shape",) and any(change[-1] in _OF_SENSOR for change in changes)
        if path[0] != "probes":
            return False
        projection_path = (*path[:2], "of")
        if (error.kind == "synapses" or error.kind in _DEPENDS_ON) and has(root, projection_path):
            return self.is_unsure(str(node_at(root, projection_path).value), error.kind)
        return error.kind == "no projection" and "of" in ends

    def is_unsure(self, projection: str, kind: str) -> bool:
        """Return whether the kind, the number or the end neurons of a projection's synapses are unknown."""
        changes = self.changes_in(("projections", projection))
        if kind in _DEPENDS_ON:
            return any(change[0] in _DEPENDS_ON[kind] for change in changes)
        return projection in self.failed or any(change[0] == "synapse" and len(change) <= 2 for change in changes)

    def changes_in(self, path: Words) -> list[Words]:
        """Return the changed paths within a part, except those that leave the population known."""
        return [
            change[2:]
            for change in self.changed
            if change[:2] == path[:2] and len(change) > 2 and change not in self.replaced_ends
        ]

    def depends_on_change(self, path: Words, error: ModelError) -> bool:
        """Return whether an error of the compiler depends on a change in its part, or on the deciding population."""
        changes = self.changes_in(path)
        if {change[-1] for change in changes if change not in _ENDS} & {*error.path, *error.about, error.found}:
            return True
        if path[0] == "trials":
            return bool(self.changed) if len(path) == 1 else path[1] in _OF_DECISIONS and self.is_undecided()
        if path[0] == "projections":
            if path[2:3] == ("weight",) and any(change == ("synapse",) or change[-1] == "Wmin" for change in changes):
                return True
            if error.kind == "trials" and (self.is_undecided() or ("trials",) in self.changed or self.may_lack_parts):
                return True
        if path[2:3] == ("synapses",):
            return ("of",) in changes
        return error.kind != "resolution" and any(change[:1] in _ENDS for change in changes)

    def is_undecided(self) -> bool:
        """Return whether the population that decides a trial is unknown."""
        return any(
            (change[0] == "groups" and (len(change) < 4 or change[-1] == "of"))
            or (change[:2] in (("trials", "labels"), ("trials", "dropout")) and change[2:] in ((), ("of",)))
            for change in self.changed
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
"""Words whose value is a population, with the classes of models that the population may have."""
_SETTINGS = ("trials", "readout")
"""Sections without named parts."""


def stand_in(sections: Mapping[str, Node], path: Words, removed: Node | None, error: ModelError, turn: int) -> Any:
    """Return a plain value in place of an erroneous value; None to remove the value.

    Args:
        sections: sections of the description.
        path: the path of the value.
        removed: the erroneous value, if any.
        error: its error.
        turn: 0 or 1, the first or the second stand-in.
    """
    if path in (("parameters",), ("populations",)):
        return None
    if path[0] == "parameters":
        return turn + 1
    if path[0] == "populations" and path[2:] in ((), ("model",)):
        model = "spike_generator" if _trial_input(sections) == path[1] else _MODEL[turn]
        return model if path[2:] else {"model": model, "shape": _SHAPE[turn]}
    if path[0] == "probes" and path[2:] == ("record",):
        return error.suggestion or next((word for word in error.expected if word not in ALONE), None)
    key = (path[0], *path[2:]) if path[0] not in _SETTINGS else path
    if key in _REPLACED:
        return _REPLACED[key][turn]
    if path[-1] in _PARTS and (len(path) == 3 or path[0] in ("groups", *_SETTINGS)):
        populations = sections["populations"].value if "populations" in sections else {}
        if not isinstance(populations, dict):
            return None
        matches = [name for name, node in populations.items() if issubclass(_model(node), _PARTS[path[-1]] or object)]
        return error.suggestion if error.suggestion in populations else next(iter([*matches, *populations]), None)
    return _valid_number(path[-2], path[-1], turn) if len(path) > 3 else None


def chosen_from(sections: Mapping[str, Node], path: Words) -> str:
    """Return the population of a path to an index of neurons; "" for other paths."""
    populations = sections["populations"].value if "populations" in sections else {}
    is_index = len(path) == 4 and path[2] in ("from", "to", "of", "pre", "post") and path[3] in populations
    return path[3] if is_index else ""


def some_neurons(population: str, turn: int) -> Any:
    """Return all neurons of a population, or a single one, so that errors about the number of neurons differ."""
    return population if turn == 0 else {population: 0}


def _trial_input(sections: Mapping[str, Node]) -> Any:
    """Return the name of the population to which trials present their input."""
    trials = sections["trials"].value if "trials" in sections else None
    return trials["input"].value if isinstance(trials, dict) and "input" in trials else None


def _valid_number(name: str, word: str, turn: int) -> Any:
    """Return a valid number for a parameter without a default."""
    cls = next((table[name] for table in TABLES.values() if name in table), None)
    if cls is None or word not in cls.quantities() or word in cls.defaults():
        return None
    quantity = cls.quantities()[word]
    if quantity.kind == "shape":
        return [turn + 1, turn + 1]
    low = next((bound for bound in (quantity.at_least, quantity.above) if bound is not None), 0.0)
    high = next((bound for bound in (quantity.at_most, quantity.below) if bound is not None), low + 4.0)
    number = low + (high - low) * (turn + 1) / 4.0
    return int(number) if quantity.kind == "integer" or quantity.whole else number


def _model(node: Node) -> type[Any]:
    """Return the class of a population's model; `object` if unknown."""
    model = node.value.get("model") if isinstance(node.value, dict) else None
    name = model and (next(iter(model.value), "") if isinstance(model.value, dict) else model.value)
    return MODELS[name] if isinstance(name, str) and name in MODELS else object


Words: TypeAlias = tuple[str, ...]

_WORD = re.compile(r"[\w.-]+")
_DEFAULTED = ("weight", "delay", "record")
"""Words of parts that can cause an error even if the file lacks them."""


class WordPlaces:
    """Paths of the words and values of a tree, by their place in the file."""

    def __init__(self, *trees: Node) -> None:
        self.by_label: dict[Where, Words] = {}
        self.by_value: dict[Where, Words] = {}
        for tree in trees:
            self._walk(tree, ())

    def _walk(self, node: Node, path: Words, in_list: bool = False) -> None:
        """Add the paths below a node; items of a list have the path of the list."""
        self.by_value.setdefault(node.where, path)
        if isinstance(node.value, dict):
            for word, inner in node.value.items():
                inner_path = path if in_list else (*path, word)
                self.by_label.setdefault(inner.label, inner_path)
                self._walk(inner, inner_path, in_list)
        elif isinstance(node.value, list):
            for item in node.value:
                self._walk(item, path, in_list=True)

    def of(self, error: ModelError) -> Words:
        """Return the path of the word that causes an error; empty if no word does."""
        path = self._path_at(error)
        return (*path, error.missing) if path and error.missing else path

    def _path_at(self, error: ModelError) -> Words:
        if error.where is None:
            return ()
        word, value = self.by_label.get(error.where, ()), self.by_value.get(error.where, ())
        if not (word or value):
            earlier_places = [
                place
                for place in self.by_value
                if (place.file, place.line) == (error.where.file, error.where.line)
                and place.column < error.where.column
            ]
            value = self.by_value[max(earlier_places, key=lambda place: place.column)] if earlier_places else ()
        if not word or not value or len(value) < 2:
            return word or value
        # A mapping on a separate line has the place of the first word.
        return word if error.found == word[-1] else value


def subject(root: Node, part: Words, error: ModelError) -> Words:
    """Return the path of the word that causes a compiler error in a part, or of the whole part.

    Args:
        root: the tree.
        part: the path of the part.
        error: its path begins with a word of the part, or with a choice in the part, such as a model.
    """
    if not error.path:
        return part
    first_word, *rest = error.path
    match = next((path for name, path in _words_below(node_at(root, part), part) if name == first_word), None)
    if match is None:
        return (*part, first_word) if first_word in _DEFAULTED else part
    for word in rest:
        inner = node_at(root, match).value
        if not isinstance(inner, dict):
            break
        # A missing word has its default, so another word of the file causes the error.
        match = next(((*match, name) for name in (word, *error.about) if name in inner), match)
    return match


def _words_below(node: Node, path: Words) -> Iterator[tuple[str, Words]]:
    """Yield all words and textual values below a node with their paths, the nearest first."""
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
    """Return whether a tree has a path."""
    try:
        return bool(path) and node_at(root, path) is not None
    except (KeyError, TypeError):
        return False


def node_at(root: Node, path: Words) -> Node:
    """Return the node at a path."""
    for word in path:
        root = root.value[word]
    return root


def names(node: Node) -> Iterator[str]:
    """Yield all words below a node, at any depth."""
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
