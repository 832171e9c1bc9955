"""A description in YAML to a `Network`.

Neurons of a population are its name, `{exc: "0:100"}`, `{grid: "2:4, :"}`, ids in a list or a file, or, by columns of
its table of neurons, `{brain: {type: KC, side: left}}`. On a command line the same index stands behind the name:
`exc[0:100]`, `grid[2:4, :]`, ids as `exc[[3, 7]]`, columns as `brain[type=KC, side=left]`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from neuro.core.checks import check
from neuro.core.choice import Choice
from neuro.core.errors import ModelError, Where, unknown
from neuro.core.inputs import gathering
from neuro.core.memory import uncollected
from neuro.core.paths import file_path
from neuro.core.quantities import Quantity
from neuro.core.values import FromFile
from neuro.model.equations import made
from neuro.model.language.choices import choice, part, value, with_parameters
from neuro.model.language.files import array, refuse_name
from neuro.model.language.nodes import about, follow, found, mistake, plain, put_at, within, words
from neuro.model.language.parameters import resolve
from neuro.model.language.reader import Node
from neuro.model.language.sources import gather
from neuro.model.network import Network, check_name
from neuro.model.neurons import Model
from neuro.model.parts import AUTO, CHOSEN, DELAY, EXTENT, POSITIONS, WEIGHT, Population, Readout, Trials
from neuro.model.synapses import static
from neuro.model.views import indices, view
from neuro.model.wiring.neurons import neuron_table

VALUES = {"weight": WEIGHT, "delay": DELAY}
PLACES = {"positions": POSITIONS, "extent": EXTENT}
OF_POPULATIONS = ("model", "shape", "initial", *PLACES, "periodic", "neurons")


def load(path: str | Path, params: Mapping[str, Any] | None = None) -> Network:
    """Read a network from a YAML file.

    Args:
        path: the file; files that it names are looked for in its folder only.
        params: values for the file's `parameters`, in place of those it gives.

    Returns:
        The network, with values in place of all `$names`.

    Raises:
        ModelError: with the file, line and column of the first mistake, and what was expected.
    """
    file = file_path(path, "path")
    refuse_name(file)
    with gathering() as read:
        net = build(resolve(gather(file), {} if params is None else params, Where(str(file))))
    net.inputs = tuple(read)
    return net


@uncollected()
def build(sections: Mapping[str, Node], together: bool = False) -> Network:
    """The network that sections without `$names` describe; the same errors as of `load`.

    Args:
        sections: of the description.
        together: whether the first mistake is raised with those of other parts in its section.
    """
    return _Builder(sections, together).network()


class _Builder:
    """Adds the parts of each section to a network, in the order in which they refer to each other."""

    def __init__(self, sections: Mapping[str, Node], together: bool) -> None:
        self.sections, self.together = sections, together
        self.net = Network()
        self.models: dict[str, type[Choice]] = {}
        self.synapses: dict[str, type[Choice]] = {}
        self.named: dict[str, Model] = {}

    def network(self) -> Network:
        for word in ("name", "resolution"):
            if word in self.sections:
                node = self.sections[word]
                with about(node):
                    settings = {"name": self.net.name, "resolution": self.net.resolution, word: plain(node)}
                    self.net = Network(settings["name"], resolution=settings["resolution"])
        self.each("models", self.model)
        self.each("populations", self.population)
        self.each("projections", self.projection)
        self.each("signals", self.signal)
        self.each("groups", self.group)
        if "trials" in self.sections:
            self.trials(self.sections["trials"])
        self.each("probes", self.probe)
        if "readout" in self.sections:
            with within("readout"):
                self.net.readout_section = with_parameters(Readout, self.sections["readout"])
        self.net.place = None
        self.references()
        return self.net

    def each(self, section: str, add: Callable[[str, Node], None]) -> None:
        if section not in self.sections:
            return
        word = section.removesuffix("s")
        wrong: list[ModelError] = []
        for name, node in self.sections[section].value.items():
            self.net.place = node.label
            check_name(name, word, node.label)
            try:
                add(name, node)
            except ModelError as error:
                named = error.at(None, f"{word} '{name}'")
                if not self.together:
                    raise named from None
                wrong += [named, *named.others]
        if wrong:
            wrong[0].others = tuple(wrong[1:])
            raise wrong[0]

    def model(self, name: str, node: Node) -> None:
        with about(node):
            model = made(name, plain(node))
            of = self.models if issubclass(model, Model) else self.synapses
            of[name] = model

    def population(self, name: str, node: Node) -> None:
        listed = isinstance(node.value, dict) and "neurons" in node.value
        said = part(node, OF_POPULATIONS, "a population", ("model",) if listed else ("model", "shape"))
        model = self.by_name(said["model"])
        initial = {}
        if "initial" in said:
            quantities = {state.name: state.quantity() for state in model.states if not state.hidden}
            states = words(said["initial"], quantities, "initial", kind=f"state of {model.name}")
            initial = {word: value(quantities[word], inner, f"initial.{word}") for word, inner in states.items()}
        places = {word: value(q, said[word], word) for word, q in PLACES.items() if word in said}
        if "periodic" in said:
            places["periodic"] = plain(said["periodic"])
        if listed:
            places["neurons"] = with_parameters(neuron_table, said["neurons"])
        shape = plain(said["shape"]) if "shape" in said else AUTO
        with about(node):
            self.net.population(name, shape, model, initial=initial, **places)

    def by_name(self, node: Node) -> Model:
        """The model of a population; one that is said by its name alone is made once."""
        name = node.value if isinstance(node.value, str) else ""
        model: Model = self.named[name] if name in self.named else choice(node, "model", self.models)
        if name:
            self.named[name] = model
        return model

    def projection(self, name: str, node: Node) -> None:
        known = ("from", "to", "rule", "weight", "delay", "synapse")
        said = part(node, known, "a projection", ("from", "to", "rule"))
        rule = choice(said["rule"], "rule")
        synapse = choice(said["synapse"], "synapse", self.synapses) if "synapse" in said else static()
        values = {word: value(q, said[word], word) for word, q in VALUES.items() if word in said}
        ends = [neurons(said[word], self.net.populations, word) for word in ("from", "to")]
        with about(node):
            self.net.connect(ends[0], ends[1], rule, synapse, name=name, **values)

    def signal(self, name: str, node: Node) -> None:
        said = words(node, ("to",), "a signal", needs=("to",))
        with about(node):
            self.net.signal(name, to=plain(said["to"]))

    def group(self, name: str, node: Node) -> None:
        group = choice(node, "group")
        with about(node):
            self.net.group(name, group)

    def trials(self, node: Node) -> None:
        with within("trials"):
            self.net.trials_section = with_parameters(Trials, node)
        self.net.trials_origin = node.label

    def probe(self, name: str, node: Node) -> None:
        known = ("of", "record", "every", "at", "mean", "synapses", "pre", "post")
        said = words(node, known, "a probe", needs=("of",))
        rest = {word: plain(said[word]) for word in known[1:5] if word in said}
        rest |= {word: neurons(said[word], self.net.populations, word) for word in known[6:] if word in said}
        if "synapses" in said:
            rest["synapses"] = value(CHOSEN, said["synapses"], "synapses")
        of = neurons(said["of"], self.net.populations, "of")
        with about(node):
            self.net.probe(name, of, **rest)

    def references(self) -> None:
        """Check the names that choices hold; those of the parts are checked as the parts are added."""
        for name, group in self.net.groups.items():
            node = follow(self.sections["groups"], (name, group.choice.name))
            self.names(group.choice, node, f"group '{name}'")
        for name, projection in self.net.projections.items():
            node = follow(self.sections["projections"], (name, "synapse", projection.synapse.name))
            self.names(projection.synapse, node, f"projection '{name}'")
        if self.net.trials_section is not None:
            self.names(self.net.trials_section, self.sections["trials"], "trials")
        if self.net.readout_section is not None:
            self.names(self.net.readout_section, self.sections["readout"], "readout")

    def names(self, choice: Choice, node: Node, context: str) -> None:
        for word, name in choice.parameters().items():
            q = choice.quantities()[word]
            if isinstance(name, Choice):
                self.names(name, follow(node, (word,)), f"{context}: {word}")
            elif q.kind == "name" and name is not None:
                kind = "signal" if word in ("signal", "gate") else "population"
                known = self.net.signals if kind == "signal" else self.net.populations
                if name not in known:
                    error = unknown(kind, name, known, path=(word,))
                    error.hint = error.hint if known else f"add it to the section '{kind}s'"
                    with about(node, context):
                        raise error


IDS = Quantity(doc="ids of neurons", kind="ids")


def neurons(node: Node, populations: Mapping[str, Population], role: str) -> Any:
    """What `of`, `from` or `to` stands for: what is said if it is the name of a population, or a view of it.

    Args:
        node: what is said.
        populations: those of the network.
        role: the word before it, for messages.
    """
    if not isinstance(node.value, dict):
        return plain(node)
    if len(node.value) != 1:
        raise mistake(node, f"{role}: {found(node)}: expected a name, or {{name: index}}")
    [(name, index)] = node.value.items()
    if name not in populations:
        error = unknown("population", name, populations)
        raise error.at(index.label, role)
    with within(role):
        if isinstance(index.value, dict) and "file" not in index.value:
            with about(index):
                return populations[name].where(**plain(index))
        chosen = _index(index, populations[name])
        with about(index):
            ids = isinstance(chosen, (list, FromFile))
            return view(populations[name], check(IDS, chosen, name) if ids else chosen)


def _index(node: Node, population: Population) -> Any:
    """The index that is written, or ids that are not yet checked."""
    if isinstance(node.value, str):
        return _axes(node, population)
    if isinstance(node.value, dict):
        return array(node)
    if isinstance(node.value, (int, list)) and not isinstance(node.value, bool):
        return plain(node)
    raise mistake(node, f'{population.name}: {found(node)}: expected an index such as "0:100", or a list of ids')


def _axes(node: Node, population: Population) -> tuple[int | slice, ...]:
    try:
        return indices(node.value, population.name)
    except ModelError as error:
        raise put_at(node, error) from None
