"""Loading of a description in YAML as a `Network`.

Some neurons of a population are named by an index, by ids or by columns:

| neurons | in YAML | on a command line |
| --- | --- | --- |
| whole population | `exc` | `exc` |
| index | `{exc: "0:100"}`, `{grid: "2:4, :"}` | `exc[0:100]`, `grid[2:4, :]` |
| ids | `{exc: [3, 7]}`, or a file | `exc[[3, 7]]` |
| columns of the table of neurons | `{brain: {type: KC, side: left}}` | `brain[type=KC, side=left]` |
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from neuro.coding.codes import CHOICES
from neuro.coding.world import DECODERS, ENCODERS, TEACHERS
from neuro.core.checks import check
from neuro.core.choice import Choice
from neuro.core.errors import ModelError, Where, unknown
from neuro.core.hints import ELSEWHERE
from neuro.core.inputs import file_path, gathering
from neuro.core.quantities import KINDS, Quantity
from neuro.core.system import uncollected
from neuro.core.values import FromFile, shown
from neuro.model.distributions import DISTRIBUTIONS
from neuro.model.language.files import array, of_program, recording, train
from neuro.model.language.including import gather
from neuro.model.language.parameters import resolve
from neuro.model.language.published import refuse_name
from neuro.model.language.reader import Node, about, follow, found_text, mistake, plain, put_at, within, words
from neuro.model.network import Network, check_name
from neuro.model.neurons import MODELS, Model
from neuro.model.parts import AUTO, GROUPS, Part, Population, Probe, Projection, Readout, Signal, Trials, World
from neuro.model.rules import RULES
from neuro.model.signals import SOURCES
from neuro.model.space import MASKS, PROFILES, of_distance
from neuro.model.synapses import SYNAPSES
from neuro.model.views import indices, view

TABLES: dict[str, Mapping[str, type[Choice]]] = {
    "model": MODELS,
    "rule": RULES,
    "synapse": SYNAPSES,
    "group": GROUPS,
    "distribution": DISTRIBUTIONS,
    "profile": PROFILES,
    "mask": MASKS,
    "code": CHOICES,
    "encoder": ENCODERS,
    "decoder": DECODERS,
    "teacher": TEACHERS,
    "source": SOURCES,
}
FILE = ("file", "key")
"""Words of an array in a file."""
C = TypeVar("C", bound=Choice)
_CALL = re.compile(r"(\w+)\s*\((.*)\)")


def choice(node: Node, kind: str, network_classes: Mapping[str, type[Choice]] | None = None) -> Any:
    """Create the object for `name` or `{name: {parameters}}`.

    Args:
        node: the name or the mapping.
        kind: the kind of object, a key of `TABLES`.
        network_classes: classes from the network's own section `models`, by name.
    """
    network_classes = network_classes or {}
    if isinstance(node.value, Choice):
        return node.value
    if isinstance(node.value, str):
        cls = _class_named(node.value, node, kind, network_classes)
        return with_parameters(cls, Node({}, node.where, node.where, node.source))
    if not isinstance(node.value, dict) or len(node.value) != 1:
        raise mistake(
            node, f"{kind}: {found_text(node)}: expected a name, or {{name: {{parameters}}}}", _regroup(node, kind)
        )
    [(name, inner)] = node.value.items()
    cls = _class_named(name, Node(name, inner.label, inner.label, node.source), kind, network_classes)
    if inner.value is None:
        raise mistake(inner, f"{name} has no parameters here", f"write only '{name}'")
    return with_parameters(cls, inner)


def with_parameters(cls: type[C], node: Node) -> C:
    """Create an object of a class from the mapping of its parameters."""
    if isinstance(node.value, cls):
        return node.value
    name, quantities = cls.called(), cls.quantities()
    if not quantities and node.value != {}:
        raise mistake(node, f"{name} has no parameters", f"write only '{name}'")
    if not isinstance(node.value, dict):
        required = [word for word in quantities if word not in cls.defaults()]
        hint = f"write {{{name}: {{{required[0]}: {plain(node)}}}}}" if len(required) == 1 else ""
        raise mistake(node, f"{name}: {found_text(node)}: expected its parameters, {{word: value}}", hint)
    if cls.file_of:
        node = _with_array(cls, node)
    for word in cls.strays.keys() & node.value.keys():
        raise mistake(node.value[word], f"unknown parameter of {name} '{word}'", cls.strays[word])
    parameters = words(node, quantities, name, kind=f"parameter of {name}")
    values = {word: value(quantities[word], inner, f"{name}.{word}") for word, inner in parameters.items()}
    with about(node):
        return cls.from_words(values)


def value(q: Quantity, node: Node, label: str) -> Any:
    """Return the value of a parameter. The parameter's class checks the bounds later.

    Args:
        q: the parameter's quantity.
        node: the node with the value.
        label: full name of the parameter, for messages.
    """
    if q.part is not None:
        return with_parameters(q.part, node)
    if q.kind == "codes":
        return codes(node)
    if q.kind == "file" and isinstance(node.value, str):
        return recording(node, node.value)
    if q.kind == "events":
        return of_program(node, label)
    if isinstance(node.value, dict) and "file" in node.value and q.kind == "train":
        return train(node)
    if q.kind == "choices" and q.choice is not None and isinstance(node.value, dict):
        return {name: choice(inner, q.choice.kind) for name, inner in node.value.items()}
    if q.choice is not None and q.arrays and not (isinstance(node.value, (str, dict)) and "file" not in node.value):
        return array(node) if isinstance(node.value, dict) else plain(node)
    if q.choice is not None and (q.at_least is None or isinstance(node.value, (str, dict))):
        return choice(node, q.choice.kind)
    if q.of_distance and isinstance(node.value, dict) and of_distance.called() in node.value:
        distance_words = words(node, (of_distance.called(),), label)
        return of_distance(choice(distance_words[of_distance.called()], "profile"))
    if isinstance(node.value, dict) and "file" in node.value and (q.arrays or KINDS[q.kind].is_list):
        return array(node)
    if q.arrays and isinstance(node.value, dict):
        _refuse_bare_parameters(node, label)
        return choice(node, "distribution")
    if q.arrays and isinstance(node.value, str) and node.value.partition("(")[0].strip() in DISTRIBUTIONS:
        return choice(node, "distribution")
    return plain(node)


def codes(node: Node) -> tuple[Any, ...]:
    """Return the codes of a node, as a tuple even for a single code."""
    items = node.value if isinstance(node.value, list) else [node]
    return tuple(choice(item, "code") for item in items)


def _with_array(cls: type[Choice], node: Node) -> Node:
    """Return the mapping with the words `file` and `key` replaced by one parameter with the array."""
    parameters = words(node, [*cls.quantities(), *FILE], cls.called(), kind=f"parameter of {cls.called()}")
    file_words = {word: parameters[word] for word in FILE if word in parameters}
    if not file_words:
        return node
    first_word = next(iter(file_words.values()))
    if cls.file_of in parameters:
        message = f"{cls.called()}: found both '{cls.file_of}' and '{next(iter(file_words))}': expected one of them"
        raise mistake(first_word, message)
    if "file" not in parameters:
        raise mistake(first_word, f"{cls.called()}: found 'key' without 'file': expected both")
    other_parameters = {word: value for word, value in parameters.items() if word not in file_words}
    array = Node(file_words, first_word.where, first_word.label, first_word.source)
    return Node({cls.file_of: array, **other_parameters}, node.where, node.label, node.source)


def part(node: Node, accepted: Iterable[str], label: str, needs: Iterable[str]) -> dict[str, Node]:
    """Return the words of a part, see `words`.

    If a parameter of the part's model is given one level too high, the error shows the right place.
    """
    names = list(accepted)
    for word, inner in node.value.items() if isinstance(node.value, dict) else ():
        if word not in names and (correction := _corrected_line(node, word)):
            raise unknown(f"word of {label}", word, names, inner.label).but(hint=f"write {correction}", suggestion="")
    return words(node, names, label, needs)


def _corrected_line(node: Node, word: str) -> str:
    """Return the line with a misplaced parameter in its right place, e.g. `model: {iaf_psc_exp: {tau_m: 5}}`, or ""."""
    for kind, table in TABLES.items():
        choice_node = node.value.get(kind)
        name = choice_node if choice_node is None else choice_node.value
        if isinstance(name, dict):
            name = next(iter(name), None)
        if isinstance(name, str) and name in table and (parameter := _parameter_named(word, table[name])):
            return f"{kind}: {{{name}: {{{parameter}: {shown(plain(node.value[word]))}}}}}"
    return ""


def _parameter_named(word: str, cls: type[Choice]) -> str:
    """Return the name in neuro of a parameter of a class. `word` may be its name in another tool. "" if not found."""
    parameters = cls.quantities()
    return next((name for name in (word, *ELSEWHERE.get(word.lower(), ())) if name in parameters), "")


def _class_named(name: str, node: Node, kind: str, network_classes: Mapping[str, type[Choice]]) -> type[Choice]:
    if name in network_classes:
        return network_classes[name]
    table = TABLES[kind]
    if name in table:
        return table[name]
    error = unknown(kind, name, [*network_classes, *table])
    words = (name,) if error.suggestion else (name, *ELSEWHERE.get(name.lower(), ()))
    kinds = [f"'{w}' is a {other}, not a {kind}" for w in words for other, names in TABLES.items() if w in names]
    hint = kinds[0] if kinds else error.hint
    if hint.endswith(", ..."):
        hint = "'neuro models' lists all models"
    if kind == "distribution" and name in PROFILES:
        hint = f"'{name}' is a profile, write {{of_distance: {{{name}: ...}}}}"
    call = _CALL.fullmatch(name)
    if call and call[1] in table:
        hint = f"write {{{call[1]}: {{{call[2].replace('=', ': ')}}}}}"
        if not call[2].strip():
            hint = f"write only '{call[1]}'"
        elif "=" not in call[2]:
            hint = f"write {{{call[1]}: {{word: value}}}} with the words " + ", ".join(table[call[1]].quantities())
    raise put_at(node, error.but(hint=hint, suggestion=error.suggestion if hint == error.hint else ""))


def _regroup(node: Node, kind: str) -> str:
    """Return a hint for a flat mapping such as `{type: name, tau_m: 5}`: `{name: {tau_m: 5}}`. "" if there is none."""
    if not isinstance(node.value, dict):
        return ""
    table = TABLES[kind]
    matches = [word for word in node.value if word in table]
    matches += [inner.value for inner in node.value.values() if isinstance(inner.value, str) and inner.value in table]
    if len(matches) != 1:
        return ""
    parameters = {
        _parameter_named(word, table[matches[0]]) or word: plain(inner)
        for word, inner in node.value.items()
        if word != matches[0] and inner.value != matches[0]
    }
    return f"write {shown({matches[0]: parameters})}"


def _refuse_bare_parameters(node: Node, label: str) -> None:
    """Raise an error for `{mean: 1, std: 2}`, which lacks the name of the distribution."""
    if any(word in DISTRIBUTIONS for word in node.value):
        return
    candidates = [name for name, cls in DISTRIBUTIONS.items() if set(node.value) <= set(cls.quantities())]
    if candidates and node.value:
        values_text = shown(plain(node))
        raise mistake(
            node,
            f"{label} = {values_text}: expected the name of a distribution",
            f"write {{{candidates[0]}: {values_text}}}",
        )


def load(path: str | Path, params: Mapping[str, Any] | None = None) -> Network:
    """Read a network from a YAML file.

    Args:
        path: the file. Files that it names must be in the same folder or below.
        params: values that replace values in the file's section `parameters`.

    Returns:
        The network, in which all `$names` are replaced by values.

    Raises:
        ModelError: the description has a mistake. The error names the file, line and column, and the expected value.
    """
    file = file_path(path, "path")
    refuse_name(file)
    with gathering() as inputs:
        net = build(resolve(gather(file), {} if params is None else params, Where(str(file))))
    net.inputs = tuple(inputs)
    return net


@uncollected()
def build(sections: Mapping[str, Node], every_mistake: bool = False) -> Network:
    """Build the network that sections without `$names` describe. Errors are the same as those of `load`.

    Args:
        sections: sections of the description.
        every_mistake: whether the error lists all mistakes of the section, in `others`.
    """
    return _Builder(sections, every_mistake).network()


def _reading_order(cls: type[Part]) -> list[tuple[str, Quantity, str]]:
    """Return each word of a part with its quantity and its argument in Python. Words that name neurons come last."""
    order = sorted(cls.words.items(), key=lambda item: item[1].kind == "neurons")
    return [(word, q, cls.ends.get(word, (word,))[0]) for word, q in order]


class _Builder:
    """Builder of a network. The order of the sections is such that each section refers to earlier sections only."""

    def __init__(self, sections: Mapping[str, Node], every_mistake: bool) -> None:
        self.sections, self.every_mistake = sections, every_mistake
        self.net = Network()
        self.models: dict[str, type[Choice]] = {}
        self.synapses: dict[str, type[Choice]] = {}
        self.shared_models: dict[str, Model] = {}

    def network(self) -> Network:
        for word in ("name", "resolution"):
            if word in self.sections:
                node = self.sections[word]
                with about(node):
                    settings = {"name": self.net.name, "resolution": self.net.resolution, word: plain(node)}
                    self.net = Network(settings["name"], resolution=settings["resolution"])
        self.add_parts("models", self.add_model)
        self.add_parts("populations", partial(self.add_part, Population, _reading_order(Population)))
        self.add_parts("projections", partial(self.add_part, Projection, _reading_order(Projection)))
        self.add_parts("signals", partial(self.add_part, Signal, _reading_order(Signal)))
        self.add_parts("groups", self.add_group)
        self.net.trials_section = self.section(Trials)
        self.net.trials_origin = self.sections["trials"].label if "trials" in self.sections else None
        self.add_parts("probes", partial(self.add_part, Probe, _reading_order(Probe)))
        self.net.readout_section = self.section(Readout)
        self.net.world_section = self.section(World)
        self.net.world_origin = self.sections["world"].label if "world" in self.sections else None
        self.net.place = None
        self.check_references()
        return self.net

    def add_parts(self, section: str, add: Callable[[str, Node], None]) -> None:
        if section not in self.sections:
            return
        kind = section.removesuffix("s")
        errors: list[ModelError] = []
        for name, node in self.sections[section].value.items():
            self.net.place = node.label
            check_name(name, kind, node.label)
            try:
                add(name, node)
            except ModelError as error:
                named_error = error.at(None, f"{kind} '{name}'")
                if not self.every_mistake:
                    raise named_error from None
                errors += [named_error, *named_error.others]
        if errors:
            errors[0].others = tuple(errors[1:])
            raise errors[0]

    def add_model(self, name: str, node: Node) -> None:
        from neuro.model.equations import model_from_words

        with about(node):
            model = model_from_words(name, plain(node))
            table = self.models if issubclass(model, Model) else self.synapses
            table[name] = model

    def add_part(self, cls: type[Part], order: Sequence[tuple[str, Quantity, str]], name: str, node: Node) -> None:
        """Add a part to the network. Words that name neurons are read last, so that other errors are reported first."""
        has_table = isinstance(node.value, dict) and "neurons" in node.value
        required = [word for word in cls.needs if not (word == "shape" and has_table)]
        part_words = part(node, cls.words, f"a {cls.word}", required)
        values: dict[str, Any] = {"shape": AUTO} if has_table else {}
        for word, q, argument in order:
            if word in part_words:
                values[argument] = self.value(q, word, part_words[word], values)
        add = self.net.connect if cls is Projection else getattr(self.net, cls.word)
        with about(node):
            add(name=name, **values)

    def value(self, q: Quantity, word: str, node: Node, values_so_far: Mapping[str, Any]) -> Any:
        """Return the value of a word of a part. `values_so_far` has the values of the previous words."""
        if q.kind == "neurons":
            return neurons(node, self.net.populations, word)
        if q.kind == "states":
            model = values_so_far["model"]
            quantities = {state.name: state.quantity() for state in model.states if not state.hidden}
            states = words(node, quantities, word, kind=f"state of {model.name}")
            return {state: value(quantities[state], inner, f"{word}.{state}") for state, inner in states.items()}
        if word == "model":
            return self.model_named(node)
        return choice(node, word, self.synapses) if word == "synapse" else value(q, node, word)

    def model_named(self, node: Node) -> Model:
        """Return the model of a population. Populations with the same model without parameters share one object."""
        name = node.value if isinstance(node.value, str) else ""
        model: Model = self.shared_models[name] if name in self.shared_models else choice(node, "model", self.models)
        if name:
            self.shared_models[name] = model
        return model

    def add_group(self, name: str, node: Node) -> None:
        group = choice(node, "group")
        with about(node):
            self.net.group(name, group)

    def section(self, cls: type[C]) -> C | None:
        if cls.word not in self.sections:
            return None
        with within(cls.word):
            return with_parameters(cls, self.sections[cls.word])

    def check_references(self) -> None:
        """Check names of populations and signals in parameters. Names in parts are checked when the parts are added."""
        for name, group in self.net.groups.items():
            node = follow(self.sections["groups"], (name, group.choice.name))
            self.check_names(group.choice, node, f"group '{name}'")
        for name, projection in self.net.projections.items():
            node = follow(self.sections["projections"], (name, "synapse", projection.synapse.name))
            self.check_names(projection.synapse, node, f"projection '{name}'")
        for name, signal in self.net.signals.items():
            if isinstance(signal.values, Choice):
                node = follow(self.sections["signals"], (name, "values", signal.values.name))
                self.check_names(signal.values, node, f"signal '{name}'")
        for section in (self.net.trials_section, self.net.readout_section):
            if section is not None:
                self.check_names(section, self.sections[section.word], section.word)

        self.check_world()

    def check_world(self) -> None:
        """Check the names of populations and signals in the section `world`."""
        world, net = self.net.world_section, self.net
        if world is None:
            return
        critics = {name: rule.critic for name, rule in (world.reward or {}).items() if hasattr(rule, "critic")}
        references: list[tuple[tuple[str, ...], str, str]]
        references = [(("observe", name), "population", name) for name in world.observe]
        references += [(("act", world.act.name, "of"), "population", name) for name in world.act.of]
        references += [(("reward", name), "signal", name) for name in world.reward or {}]
        references += [
            (("reward", name, world.reward[name].name), "population", rule) for name, rule in critics.items()
        ]
        for path, kind, name in references:
            parts: Mapping[str, Part] = net.signals if kind == "signal" else net.populations
            place = follow(self.sections["world"], path).label
            if name not in parts:
                raise unknown(kind, name, parts, place).at(None, "world")
            if kind == "signal" and net.signals[name].values is not None:
                message = f"world: signal '{name}' has its own values: expected a signal that only the world sets"
                raise ModelError(message, where=place)

    def check_names(self, choice: Choice, node: Node, context: str) -> None:
        for word, name in choice.parameters().items():
            q = choice.quantities()[word]
            if isinstance(name, Choice):
                self.check_names(name, follow(node, (word,)), f"{context}: {word}")
            elif q.kind == "name" and name is not None:
                kind = "signal" if word in ("signal", "gate") else "population"
                parts = self.net.signals if kind == "signal" else self.net.populations
                if name not in parts:
                    error = unknown(kind, name, parts, path=(word,))
                    error.hint = error.hint if parts else f"add it to the section '{kind}s'"
                    with about(node, context):
                        raise error


IDS = Quantity(doc="ids of neurons", kind="ids")


def neurons(node: Node, populations: Mapping[str, Population], role: str) -> Any:
    """Return the name of a population, or a view, for the value of `of`, `from` or `to`.

    Args:
        node: the node with the value.
        populations: the populations of the network.
        role: the word that has the value, for messages.
    """
    if not isinstance(node.value, dict):
        return plain(node)
    if len(node.value) != 1:
        raise mistake(node, f"{role}: {found_text(node)}: expected a name, or {{name: index}}")
    [(name, index)] = node.value.items()
    if name not in populations:
        error = unknown("population", name, populations)
        raise error.at(index.label, role)
    index_value = index.value
    with within(role):
        if isinstance(index_value, bool) or not isinstance(index_value, (str, int, list, dict)):
            expected = 'expected an index such as "0:100", or a list of ids'
            raise mistake(index, f"{name}: {found_text(index)}: {expected}")
        selection = array(index) if isinstance(index_value, dict) and "file" in index_value else plain(index)
        with about(index):
            if isinstance(selection, dict):
                return populations[name].where(**selection)
            ids = check(IDS, selection, name) if isinstance(selection, (list, FromFile)) else selection
            return view(populations[name], indices(ids, name) if isinstance(ids, str) else ids)
