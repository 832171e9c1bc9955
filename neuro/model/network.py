"""The class `Network`: a collection of parts, independent of backends, array layouts and steps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from neuro.core.checks import check, is_number
from neuro.core.errors import ModelError, Where, here, naming_words, unknown
from neuro.core.hints import near
from neuro.core.quantities import Quantity
from neuro.core.values import same, shown
from neuro.model.neurons import Model, poisson_generator
from neuro.model.parts import (
    AUTO,
    RESOLUTION,
    WEIGHT,
    Competition,
    Description,
    Group,
    Part,
    Population,
    Probe,
    Projection,
    Readout,
    Side,
    Signal,
    Trials,
    World,
)
from neuro.model.rules import Rule, from_file, one_to_one
from neuro.model.synapses import Synapse, static
from neuro.model.views import HasShape, View, view, view_of_index
from neuro.model.wiring.neurons import neuron_table

P = TypeVar("P", bound=Part)


class Network(Description):
    """A network under construction.

    Args:
        name: the name in messages and files.
        resolution: length of a step in ms.

    Attributes:
        place: the origin (file and line) of the next part. If it is None, the origin is the line of the caller.
        inputs: files of the network; empty for a network built in Python.
        latest: the part that was added last.
        verdicts: result of the conversion of each node, for a network imported from another tool; else None.
    """

    inputs: tuple[str, ...] = ()
    verdicts: Any = None

    @naming_words
    def __init__(self, name: str = "network", *, resolution: float = 0.1) -> None:
        self.name = check_name(name, "network", here())
        self.place: Where | None = None
        with self._in_place():
            self.resolution: float = check(RESOLUTION, resolution, "resolution")
        self.populations, self.projections = {}, {}
        self.signals, self.groups, self.probes = {}, {}, {}
        self.trials_section, self.readout_section, self.world_section = None, None, None
        self.trials_origin: Where | None = None
        self.world_origin: Where | None = None
        self.latest: Part | Trials | None = None

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            hint = "" if name.startswith("_") else near(name, dir(type(self)))
            raise AttributeError(f"'Network' object has no attribute '{name}'{hint and f': {hint}'}")

    @naming_words
    def population(
        self,
        name: str,
        shape: int | Iterable[int | str],
        model: Model,
        *,
        initial: Mapping[str, Any] | None = None,
        positions: Any = None,
        extent: Any = None,
        periodic: bool = False,
        neurons: neuron_table | None = None,
    ) -> Population:
        """Add a population of neurons of one model.

        Args:
            name: a new name.
            shape: number of neurons, or sizes of the axes; `"auto"` if a grid decides.
            model: e.g. `neuro.iaf_psc_exp(tau_m=10.0)`.
            initial: states at time 0, by name: a number, an array or a distribution.
            positions: coordinates, shape (n, 1 to 3). By default positions follow from the shape and are centred at 0.
            extent: length of each axis, in the unit of positions. By default neighbours are one unit apart.
            periodic: whether opposite edges touch (periodic boundary conditions).
            neurons: table of the neurons. With the shape `"auto"` there is one neuron per row.

        Returns:
            The population, an argument of `connect`, `signal` and `probe`.
        """
        label = f"population '{name}'"
        if neurons is not None:
            self._expect(neurons, neuron_table, label, "a table such as neuro.neuron_table('neurons.csv', id='id')")
        sizes = self._checked(Population, "shape", shape, label)
        if neurons is not None and sizes == (AUTO,):
            with self._in_place(label):
                sizes = (neurons.neurons.size,)
        self._expect(model, Model, label, "a model such as neuro.iaf_psc_exp()")
        if initial is not None:
            self._expect(initial, Mapping, label, "states by name such as {'V_m': -60.0}")
        states = {s.name: s.quantity() for s in model.states if not s.hidden} if initial else {}
        initial_values = {}
        for state, value in (initial or {}).items():
            path = ("initial", str(state))
            with self._in_place(label):
                if state not in states:
                    raise unknown(f"state of {model.name}", state, states, path=path)
                initial_values[state] = check(states[state], value, f"{label}: initial.{state}", path)
        words = {"positions": positions, "extent": extent, "periodic": periodic}
        checked_words = {  # the default of each word, which needs no check, is that of the part
            word: self._checked(Population, word, value, label)
            for word, value in words.items()
            if value is not getattr(Population, word)
        }
        part = Population(name, sizes, model, initial_values, self._where(), **checked_words, neurons=neurons)
        return self._add(self.populations, part)

    @naming_words
    def connect(
        self,
        source: Population | View | str,
        target: Population | View | str,
        rule: Rule,
        synapse: Synapse | None = None,
        *,
        weight: Any = 1.0,
        delay: Any = 1.0,
        name: str | None = None,
    ) -> Projection:
        """Connect two populations, or some of their neurons.

        Args:
            source: a population of this network, its name, or a view of it such as `exc[:100]`.
            target: a population of this network, its name, or a view of it.
            rule: e.g. `neuro.all_to_all()`. Between views, the rule uses their shapes and counts neurons from 0.
            synapse: e.g. `neuro.stdp(Wmax=3.0)`. The default is static.
            weight: a number, an array (one per synapse, see docs), a distribution, or `neuro.of_distance(...)`.
            delay: in ms, of the same kinds as `weight`.
            name: a new name. The default is `source_target`.
        """
        source, target = self._view_or_name(source, "connect: from"), self._view_or_name(target, "connect: to")
        label = name if name is not None else f"{_population_name(source)}_{_population_name(target)}"
        what = f"projection '{label}'"
        (pre, source_view), (post, target_view) = self._neurons(source, what, "from"), self._neurons(target, what, "to")
        self._expect(rule, Rule, what, "a rule such as neuro.all_to_all()")
        model = static() if synapse is None else synapse
        self._expect(model, Synapse, what, "a synapse such as neuro.static()")
        # The weight of a current has no unit. Other weights are converted to the unit of the target's model.
        is_current = self.populations[pre].model.role == "current"
        unit = "" if is_current else getattr(self.populations[post].model, "weight_unit", "")
        weights = replace(WEIGHT, taken_in=unit)
        try:
            model = model.in_unit(weights, what)
        except ModelError as error:
            raise error.but(where=error.where or self._where(), path=("synapse", *error.path)) from None
        part = Projection(
            label,
            pre,
            post,
            rule,
            model,
            self._checked(Projection, "weight", weight, what, weights),
            self._checked(Projection, "delay", delay, what),
            self._where(),
            source_view,
            target_view,
            (self.populations[pre], self.populations[post]),
        )
        return self._add(self.projections, part)

    def wiring(
        self,
        name: str = "brain",
        *,
        neurons: neuron_table | str | Path,
        edges: from_file | str | Path,
        model: Model,
        synapse: Synapse | None = None,
        weight: Any = 1.0,
        delay: Any = 1.0,
        initial: Mapping[str, Any] | None = None,
        drive: Any = None,
    ) -> Population:
        """Add a wiring diagram: a population of the neurons, and a projection of the edges.

        Args:
            name: name of the population. The projection is called `name_name`.
            neurons: the table of neurons, or its file.
            edges: the list of edges, or its file.
            model: the model of all neurons.
            synapse: the synapse model of all edges. The default is static.
            weight: factor on the weights in the file, see `neuro.from_file`.
            delay: factor on the delays in the file, in ms.
            initial: states at time 0.
            drive: weight of the spikes that `sim.activate` sends. With it, the population `name_drive` is added, which
                has one `poisson_generator` of rate 0 per neuron.

        Returns:
            The population. Its method `where` chooses neurons by columns of the table.
        """
        table = neuron_table(neurons) if isinstance(neurons, (str, Path)) else neurons
        rule = from_file(edges) if isinstance(edges, (str, Path)) else edges
        self._expect(rule, from_file, f"wiring '{name}': edges", "edges such as neuro.from_file('edges.csv')")
        population = self.population(name, AUTO, model, initial=initial, neurons=table)
        self.connect(population, population, rule, synapse, weight=weight, delay=delay)
        if drive is not None:
            source = self.population(f"{name}_drive", population.shape, poisson_generator(rate=0.0))
            self.connect(source, population, one_to_one(), weight=drive, delay=self.resolution)
        return population

    @naming_words
    def signal(self, name: str, *, to: Population | str, values: Any = None) -> Signal:
        """Add a signal, which has one value per neuron of `to`.

        Args:
            name: a new name.
            to: the population that receives the signal.
            values: a number, an array with a number per neuron, or a source such as
                `neuro.computed("count(left)", every=50.0)`. Without `values`, a program sets the signal by
                `sim.signal`.
        """
        label = f"signal '{check_name(name, 'signal', self._where())}'"
        target = self._name_of(to, label, "to")
        return self._add(
            self.signals, Signal(name, target, self._where(), self._checked(Signal, "values", values, label))
        )

    def group(self, name: str, choice: Competition) -> Group:
        """Add a group, e.g. `net.group("choice", neuro.winner_take_all(of="s2"))`."""
        self._expect(choice, Competition, f"group '{name}'", "a group such as neuro.winner_take_all(of='out')")
        return self._add(self.groups, Group(name, choice, self._where()))

    @naming_words
    def probe(
        self,
        name: str,
        of: Population | View | Projection | str,
        record: str | Iterable[str] = "spikes",
        *,
        every: float | None = None,
        at: str | None = None,
        mean: bool = False,
        synapses: Any = None,
        pre: Side = None,
        post: Side = None,
    ) -> Probe:
        """Record a population or a projection while the network runs.

        Args:
            name: a new name.
            of: a population or projection of this network, its name, or a view of a population.
            record: recorded quantity. For a population "spikes", "rate" (mean rate per neuron and bin, in Hz), or one
                or several of its states; for a projection "weight" or other states of its synapses.
            every: sampling interval in ms, or the length of the bins of a rate. The default is each step.
            at: "pre_spikes" records the synapses of a neuron that fires, with the values that its spike carries.
            mean: whether to record the mean over neurons or synapses instead of each value.
            synapses: for a projection, indices of the recorded synapses, in the order of its weights. By default all
                synapses are recorded.
            pre: for a projection, record only synapses from these neurons: a population, a view of it, or ids.
            post: for a projection, record only synapses onto these neurons.
        """
        label = f"probe '{check_name(name, 'probe', self._where())}'"
        states = self._checked(Probe, "record", record, label)
        if not states or len(set(states)) < len(states):
            message = f"{label}: record = {shown(record)}: expected one or several names, each once"
            raise ModelError(message, where=self._where(), path=("record",))
        population, view = self._probed(of, label)
        part = Probe(
            name,
            population,
            record if isinstance(record, str) else states,
            self._checked(Probe, "every", every, label),
            self._where(),
            view,
            self._checked(Probe, "at", at, label),
            self._checked(Probe, "mean", mean, label),
            self._checked(Probe, "synapses", synapses, label),
            self._side(pre, population, label, "pre"),
            self._side(post, population, label, "post"),
        )
        return self._add(self.probes, part)

    def trials(self, **words: Any) -> Trials:
        """Define the trials. The keywords are the fields of `neuro.Trials`."""
        if self.trials_section is not None:
            raise ModelError("trials: defined twice: expected one definition", where=self._where())
        with self._in_place("trials"):
            self.trials_section = self.latest = section = Trials.from_words(words)
        self.trials_origin = self._where()
        return section

    def readout(self, **words: Any) -> Readout:
        """Define how recordings are shown and classified, in place of an earlier definition.

        The keywords are the fields of `Readout`. `neuro.predict` uses the section; backends ignore it.
        """
        with self._in_place("readout"):
            section = Readout.from_words(words)
            for word in ("input", "output"):
                if (name := getattr(section, word)) not in self.populations:
                    raise unknown("population", name, self.populations, path=(word,))
        self.readout_section = section
        return section

    def world(self, **words: Any) -> World:
        """Define the environment of the network, in place of an earlier definition.

        The keywords are the fields of `neuro.World`. `neuro.closed_loop` uses the section; backends ignore it.
        """
        with self._in_place("world"):
            section = World.from_words(words)
        self.world_section, self.world_origin = section, self._where()
        return section

    def save(self, path: str | Path) -> None:
        """Write the network as YAML. `neuro.load` reads an equal network. Large arrays go to an HDF5 file beside it."""
        from neuro.model.language.writer import save

        save(self, path)

    def frozen(self) -> Network:
        """Return a copy without learning: with the same weights, static synapses, and no signals."""
        from neuro.model.frozen import frozen

        return frozen(self)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Network):
            return NotImplemented
        not_compared = ("trials_origin", "world_origin", "place", "inputs", "latest", "verdicts")
        own_parts, other_parts = vars(self), vars(other)
        return all(same(own_parts[k], other_parts[k]) for k in own_parts if k not in not_compared)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return (
            f"Network({self.name!r}, {len(self.populations)} populations, {len(self.projections)} projections, "
            f"resolution={self.resolution:g})"
        )

    def __str__(self) -> str:
        from neuro.core.tables import as_text
        from neuro.model.words import heading, tables

        return as_text(heading(self), tables(self))

    def _repr_html_(self) -> str:
        from neuro.core.tables import as_html
        from neuro.model.words import heading, tables

        return as_html(heading(self), tables(self))

    def _add(self, table: dict[str, P], part: P) -> P:
        check_name(part.name, part.word, self._where())
        if part.name in table:
            raise ModelError(f"{part.word} '{part.name}' is defined twice", where=self._where(), path=(part.name,))
        table[part.name] = self.latest = part
        return part

    def _where(self) -> Where | None:
        return self.place or here()

    @contextmanager
    def _in_place(self, context: str = "") -> Iterator[None]:
        """Add the origin of the next part, and the prefix `context`, to errors raised in the block."""
        try:
            yield
        except ModelError as error:
            raise error.at(self._where(), context) from None

    def _checked(self, part: type[Part], word: str, value: Any, label: str, quantity: Quantity | None = None) -> Any:
        """Check the value of a word of a part. `quantity` replaces the quantity of the word in `part.words`."""
        try:  # a context manager here would cost a second for 200,000 parts
            return check(quantity or part.words[word], value, f"{label}: {word}", (word,))
        except ModelError as error:
            raise error.at(self._where()) from None

    def _view_or_name(self, of: Any, label: str) -> Any:
        """Convert a text such as `exc[:100]`, or a mapping, to a view. Names and parts are returned unchanged."""
        if not isinstance(of, Mapping) and not (isinstance(of, str) and "[" in of):
            return of
        with self._in_place(label):
            neurons = view_of_index(of, self.populations)
            if isinstance(neurons, Mapping):
                raise ModelError(f"{label}: found {shown(dict(neurons))}: expected a name, or {{name: index}}")
        return neurons

    def _neurons(self, of: Population | View | str, label: str, role: str) -> tuple[str, View | None]:
        """Return the name of a population, and a view if only some of the neurons are chosen."""
        of = self._view_or_name(of, f"{label}: {role}")
        if isinstance(of, View):
            return self._name_of(of.population, label, role), of
        return self._name_of(of, label, role), None

    def _name_of(self, population: HasShape | str, what: str, role: str) -> str:
        name = population.name if isinstance(population, Population) else population
        if not isinstance(name, str):
            raise ModelError(f"{what}: {role} = {shown(name)}: expected a name", where=self._where(), path=(role,))
        if name not in self.populations:
            raise unknown("population", name, self.populations, path=(role,)).at(self._where(), what)
        if isinstance(population, Population) and population is not self.populations[name]:
            message = f"{what}: {role}: population '{name}' is a part of another network: expected one of '{self.name}'"
            raise ModelError(message, where=self._where(), hint=f"pass the name '{name}'", path=(role,))
        return name

    def _probed(self, of: Population | View | Projection | str, label: str) -> tuple[str, View | None]:
        """Return the name of a population or projection, and a view if only some neurons of a population are chosen."""
        if isinstance(of, Projection) and self.projections.get(of.name) is not of:
            message = f"{label}: of: projection '{of.name}' is a part of another network: expected one of '{self.name}'"
            raise ModelError(message, where=self._where(), path=("of",))
        name = of.name if isinstance(of, Projection) else of
        if isinstance(name, str) and name in self.projections and name not in self.populations:
            return name, None
        assert not isinstance(of, Projection)
        neurons = self._view_or_name(of, f"{label}: of")
        if isinstance(neurons, str) and neurons not in self.populations:
            names = [*self.populations, *self.projections]
            raise unknown("population", neurons, names, path=("of",)).at(self._where(), label)
        return self._neurons(neurons, label, "of")

    def _side(self, side: Side, of: str, label: str, word: str) -> View | None:
        """Return the view of the neurons at one end of a projection, or None for all."""
        if side is None:
            return None
        if of in self.populations:
            message = f"{label}: {word} is for projections: '{of}' is a population"
            raise ModelError(message, where=self._where(), path=(word,), kind="no projection")
        end = getattr(self.projections[of], {"pre": "source", "post": "target"}[word])
        if isinstance(side, (Population, View, str, Mapping)):
            population, neurons = self._neurons(side, label, word)
            if population != end:
                value = repr(side) if neurons is not None else f"'{population}'"
                message = f"{label}: {word} = {value}: expected neurons of '{end}', an end of '{of}'"
                raise ModelError(message, where=self._where(), path=(word,), kind="neurons at an end")
            return neurons
        ids = [side] if is_number(side) else side
        with self._in_place(f"{label}: {word}"):
            return view(self.populations[end], ids if isinstance(ids, list) else np.asarray(ids))

    def _expect(self, value: object, kind: type | tuple[type, ...], label: str, expected: str) -> None:
        if isinstance(value, type) and issubclass(value, kind):
            message, hint = f"{value.__name__} is a class", f"write {value.__name__}()"
        elif not isinstance(value, kind):
            message, hint = f"found {shown(value)}", ""
        else:
            return
        raise ModelError(f"{label}: {message}: expected {expected}", where=self._where(), hint=hint)


def _population_name(end: Any) -> str:
    population = end.population if isinstance(end, View) else end
    return population.name if isinstance(population, Population) else str(population)


def check_name(name: Any, noun: str, where: Where | None) -> str:
    """Return the name of a network or a part if it is valid.

    Raises:
        ModelError: the name is empty or contains other characters than letters, digits, '_', '-' and '.'.
    """
    if not isinstance(name, str) or not name or not (name.isalnum() or all(c.isalnum() or c in "_-." for c in name)):
        raise ModelError(f"{noun} name {shown(name)}: expected letters, digits, '_', '-' or '.'", where=where)
    return name
