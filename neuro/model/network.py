"""A network under construction: it gathers parts, and knows no backend, no array layout and no steps."""

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
from neuro.model.views import Laid, View, named, view
from neuro.model.wiring.neurons import neuron_table

P = TypeVar("P", bound=Part)


class Network(Description):
    """A network under construction.

    Args:
        name: its name, used in messages and files.
        resolution: length of a step in ms.

    Attributes:
        place: where the next part comes from; None means the caller's line.
        inputs: the files that it was read from; none of one that was made in Python.
        latest: the part that was added last.
        verdicts: what became of each node of a network that came from another tool; None of any other.
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
        """Add neurons of one model.

        Args:
            name: a new name.
            shape: number of neurons, or sizes of the axes (`"auto"` where a grid decides).
            model: e.g. `neuro.iaf_psc_exp(tau_m=10.0)`.
            initial: states at time 0: a number, an array or a distribution by the state's name.
            positions: where neurons lie: coordinates, shape (n, 1 to 3); by the shape if not given, centred at 0.
            extent: length of each axis, in the unit of positions; without it neighbours are one unit apart.
            periodic: whether what leaves at one edge comes in at the other.
            neurons: the table that lists its neurons; its rows are the shape if that is `"auto"`.

        Returns:
            The part, to be passed to `connect` and others.
        """
        what = f"population '{name}'"
        if neurons is not None:
            self._expect(neurons, neuron_table, what, "a table such as neuro.neuron_table('neurons.csv', id='id')")
        sizes = self._checked(Population, "shape", shape, what)
        if neurons is not None and sizes == (AUTO,):
            with self._in_place(what):
                sizes = (neurons.neurons.size,)
        self._expect(model, Model, what, "a model such as neuro.iaf_psc_exp()")
        self._expect({} if initial is None else initial, Mapping, what, "states by name such as {'V_m': -60.0}")
        states = {s.name: s.quantity() for s in model.states if not s.hidden} if initial else {}
        start = {}
        for state, value in (initial or {}).items():
            path = ("initial", str(state))
            with self._in_place(what):
                if state not in states:
                    raise unknown(f"state of {model.name}", state, states, path=path)
                start[state] = check(states[state], value, f"{what}: initial.{state}", path)
        places = {"positions": positions, "extent": extent, "periodic": periodic}
        checked = {word: self._checked(Population, word, value, what) for word, value in places.items()}
        part = Population(name, sizes, model, start, self._where(), **checked, neurons=neurons)
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
            target: likewise.
            rule: e.g. `neuro.all_to_all()`; of views it sees their shapes, and counts their neurons from 0.
            synapse: e.g. `neuro.stdp(Wmax=3.0)`; static if not given.
            weight: a number, an array (one per synapse, see docs), a distribution, or `neuro.of_distance(...)`.
            delay: the same, in ms.
            name: a new name; `source_target` if not given.
        """
        source, target = self._written(source, "connect: from"), self._written(target, "connect: to")
        label = name if name is not None else f"{_called(source)}_{_called(target)}"
        what = f"projection '{label}'"
        (pre, source_view), (post, target_view) = self._neurons(source, what, "from"), self._neurons(target, what, "to")
        self._expect(rule, Rule, what, "a rule such as neuro.all_to_all()")
        chosen = static() if synapse is None else synapse
        self._expect(chosen, Synapse, what, "a synapse such as neuro.static()")
        # A current has no unit of weight; else a number with a unit is taken in that of the target's model.
        current = self.populations[pre].model.role == "current"
        unit = "" if current else getattr(self.populations[post].model, "weight_unit", "")
        weights = replace(WEIGHT, taken_in=unit)
        try:
            chosen = chosen.in_unit(weights, what)
        except ModelError as error:
            raise error.but(where=error.where or self._where(), path=("synapse", *error.path)) from None
        part = Projection(
            label,
            pre,
            post,
            rule,
            chosen,
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
        """Add the neurons of a wiring diagram as one population, and its edges as a projection onto itself.

        Args:
            name: of the population; the projection is called `name_name`.
            neurons: the table of neurons, or its file.
            edges: the list of edges, or its file.
            model: of all neurons.
            synapse: of all edges; static if not given.
            weight: of one synapse: the factor on the weights of the file, see `neuro.from_file`.
            delay: in ms, likewise.
            initial: states at time 0.
            drive: the weight of a spike of `sim.activate`: adds the population `name_drive`, a `poisson_generator` of
                rate 0 for each neuron.

        Returns:
            The population; `where` chooses its neurons by columns of the table.
        """
        table = neuron_table(neurons) if isinstance(neurons, (str, Path)) else neurons
        rule = from_file(edges) if isinstance(edges, (str, Path)) else edges
        self._expect(rule, from_file, f"wiring '{name}': edges", "edges such as neuro.from_file('edges.csv')")
        brain = self.population(name, AUTO, model, initial=initial, neurons=table)
        self.connect(brain, brain, rule, synapse, weight=weight, delay=delay)
        if drive is not None:
            source = self.population(f"{name}_drive", brain.shape, poisson_generator(rate=0.0))
            self.connect(source, brain, one_to_one(), weight=drive, delay=self.resolution)
        return brain

    @naming_words
    def signal(self, name: str, *, to: Population | str, values: Any = None) -> Signal:
        """Add a signal: one value per neuron of `to`.

        Args:
            name: a new name.
            to: the population.
            values: a number, one for each neuron, or what gives them, as `neuro.computed("count(left)", every=50.0)`;
                if not given, a program sets them by `sim.signal`.
        """
        what = f"signal '{check_name(name, 'signal', self._where())}'"
        target = self._name_of(to, what, "to")
        return self._add(
            self.signals, Signal(name, target, self._where(), self._checked(Signal, "values", values, what))
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
            of: a population of this network, a view of one, a projection, or its name.
            record: of a population "spikes", "rate" (spikes of a neuron in a second, the mean of a bin), or one or
                several of its states; of a projection "weight" or other states of its synapses.
            every: interval in ms, each step if not given; of a rate the length of its bins.
            at: "pre_spikes" records the synapses of a neuron that fires, as its spike leaves and is sent with.
            mean: whether to record the mean over neurons or synapses instead of each.
            synapses: of a projection, which ones, in the order of its weights; all if not given.
            pre: of a projection only the synapses from these neurons: a population, a view of it, or ids.
            post: likewise those onto these neurons.
        """
        what = f"probe '{check_name(name, 'probe', self._where())}'"
        states = self._checked(Probe, "record", record, what)
        if not states or len(set(states)) < len(states):
            message = f"{what}: record = {shown(record)}: expected one or several names, each once"
            raise ModelError(message, where=self._where(), path=("record",))
        population, view = self._recorded(of, what)
        part = Probe(
            name,
            population,
            record if isinstance(record, str) else states,
            self._checked(Probe, "every", every, what),
            self._where(),
            view,
            self._checked(Probe, "at", at, what),
            self._checked(Probe, "mean", mean, what),
            self._checked(Probe, "synapses", synapses, what),
            self._side(pre, population, what, "pre"),
            self._side(post, population, what, "post"),
        )
        return self._add(self.probes, part)

    def trials(self, **words: Any) -> Trials:
        """Say how trials go; the words are those of `neuro.Trials`."""
        if self.trials_section is not None:
            raise ModelError("trials: said twice", where=self._where())
        with self._in_place("trials"):
            self.trials_section = self.latest = section = Trials.from_words(words)
        self.trials_origin = self._where()
        return section

    def readout(self, **words: Any) -> Readout:
        """Say how the network is asked about recordings, in place of what was said; the words are those of `Readout`.

        Backends do not see it: `neuro.predict` does.
        """
        with self._in_place("readout"):
            section = Readout.from_words(words)
            for word in ("input", "output"):
                if (name := getattr(section, word)) not in self.populations:
                    raise unknown("population", name, self.populations, path=(word,))
        self.readout_section = section
        return section

    def world(self, **words: Any) -> World:
        """Say which world it acts in, in place of what was said; the words are those of `neuro.World`.

        Backends do not see it: `neuro.closed_loop` does.
        """
        with self._in_place("world"):
            section = World.from_words(words)
        self.world_section, self.world_origin = section, self._where()
        return section

    def save(self, path: str | Path) -> None:
        """Write YAML that loads to an equal network; large arrays go to an HDF5 file beside it."""
        from neuro.model.language.writer import save

        save(self, path)

    def frozen(self) -> Network:
        """The same network with the weights that it has, static synapses and no signals: nothing learns."""
        from neuro.model.frozen import frozen

        return frozen(self)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Network):
            return NotImplemented
        skip = ("trials_origin", "world_origin", "place", "inputs", "latest", "verdicts")
        mine, theirs = vars(self), vars(other)
        return all(same(mine[k], theirs[k]) for k in mine if k not in skip)

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
        """Give an error raised inside the place of the next part, and begin its message with `context`."""
        try:
            yield
        except ModelError as error:
            raise error.at(self._where(), context) from None

    def _checked(self, part: type[Part], word: str, value: Any, what: str, q: Quantity | None = None) -> Any:
        """Check the value of a word of a part; `q` stands for what the word may be where that is known better."""
        try:  # a context manager would take a second for 200,000 parts
            return check(q or part.words[word], value, f"{what}: {word}", (word,))
        except ModelError as error:
            raise error.at(self._where()) from None

    def _written(self, of: Any, what: str) -> Any:
        """Return the view that a text or a mapping means; a name of a population stays a name."""
        if not isinstance(of, Mapping) and not (isinstance(of, str) and "[" in of):
            return of
        with self._in_place(what):
            neurons = named(of, self.populations)
            if isinstance(neurons, Mapping):
                raise ModelError(f"{what}: found {shown(dict(neurons))}: expected a name, or {{name: index}}")
        return neurons

    def _neurons(self, of: Population | View | str, what: str, role: str) -> tuple[str, View | None]:
        """The name of a population, and the view if only some of its neurons are meant."""
        of = self._written(of, f"{what}: {role}")
        if isinstance(of, View):
            return self._name_of(of.population, what, role), of
        return self._name_of(of, what, role), None

    def _name_of(self, population: Laid | str, what: str, role: str) -> str:
        name = population.name if isinstance(population, Population) else population
        if not isinstance(name, str):
            raise ModelError(f"{what}: {role} = {shown(name)}: expected a name", where=self._where(), path=(role,))
        if name not in self.populations:
            raise unknown("population", name, self.populations, path=(role,)).at(self._where(), what)
        if isinstance(population, Population) and population is not self.populations[name]:
            message = f"{what}: {role}: population '{name}' is a part of another network: expected one of '{self.name}'"
            raise ModelError(message, where=self._where(), hint=f"'{name}' names the one here", path=(role,))
        return name

    def _recorded(self, of: Population | View | Projection | str, what: str) -> tuple[str, View | None]:
        """The name of a population or a projection, and the view if only some of its neurons are meant."""
        if isinstance(of, Projection) and self.projections.get(of.name) is not of:
            message = f"{what}: of: projection '{of.name}' is a part of another network: expected one of '{self.name}'"
            raise ModelError(message, where=self._where(), path=("of",))
        name = of.name if isinstance(of, Projection) else of
        if isinstance(name, str) and name in self.projections and name not in self.populations:
            return name, None
        assert not isinstance(of, Projection)
        written = self._written(of, f"{what}: of")
        if isinstance(written, str) and written not in self.populations:
            known = [*self.populations, *self.projections]
            raise unknown("population", written, known, path=("of",)).at(self._where(), what)
        return self._neurons(written, what, "of")

    def _side(self, given: Side, of: str, what: str, word: str) -> View | None:
        """The neurons at one end of a projection, None for all."""
        if given is None:
            return None
        if of in self.populations:
            message = f"{what}: {word} is for projections: '{of}' is a population"
            raise ModelError(message, where=self._where(), path=(word,), kind="no projection")
        end = getattr(self.projections[of], {"pre": "source", "post": "target"}[word])
        if isinstance(given, (Population, View, str, Mapping)):
            population, chosen = self._neurons(given, what, word)
            if population != end:
                found = repr(given) if chosen is not None else f"'{population}'"
                message = f"{what}: {word} = {found}: expected neurons of '{end}', as '{of}' has there"
                raise ModelError(message, where=self._where(), path=(word,), kind="neurons at an end")
            return chosen
        ids = [given] if is_number(given) else given
        with self._in_place(f"{what}: {word}"):
            return view(self.populations[end], ids if isinstance(ids, list) else np.asarray(ids))

    def _expect(self, value: object, kind: type | tuple[type, ...], what: str, expected: str) -> None:
        if isinstance(value, type) and issubclass(value, kind):
            message, hint = f"{value.__name__} is a class", f"write {value.__name__}()"
        elif not isinstance(value, kind):
            message, hint = f"found {shown(value)}", ""
        else:
            return
        raise ModelError(f"{what}: {message}: expected {expected}", where=self._where(), hint=hint)


def _called(end: Any) -> str:
    population = end.population if isinstance(end, View) else end
    return population.name if isinstance(population, Population) else str(population)


def check_name(name: Any, what: str, where: Where | None) -> str:
    """Return the name of a network or a part if it can be one."""
    if not isinstance(name, str) or not name or not (name.isalnum() or all(c.isalnum() or c in "_-." for c in name)):
        raise ModelError(f"{what} name {shown(name)}: expected letters, digits, '_', '-' or '.'", where=where)
    return name
