"""Reading and setting of parameters, states and weights while a network runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from neuro.core.checks import check
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import Quantity, word_of
from neuro.core.values import shown
from neuro.model.parts import Population, Projection as Described, Side
from neuro.model.synapses import Synapse
from neuro.model.views import View
from neuro.program.backend import Registers, SettableSynapses, unreadable
from neuro.program.program import Floats, Ints, Projection, synapse_states
from neuro.program.synapse_pairs import Ends, places_of_pairs, refuse_some_of_a_grid
from neuro.run import settable
from neuro.run.handles import Neurons, Run
from neuro.run.inputs import driver, outgoing
from neuro.run.settable import Chosen
from neuro.run.watch import check_weights


class NeuronValues:
    """Reading and setting of neurons.

    Args:
        run: the network in execution.
    """

    def __init__(self, run: Run) -> None:
        self._program, self._engine, self._clock = run.program, run.engine, run.clock

    def set(self, neurons: Neurons, values: Mapping[str, Any]) -> None:
        """Change parameters or states by name: a number for all neurons, or a number for each.

        Raises:
            ModelError: a name is unknown, a value is out of bounds, or several values conflict.
        """
        self._engine.set(neurons.index, self.checked(neurons, values))

    def checked(self, neurons: Neurons, values: Mapping[str, Any]) -> dict[str, Floats]:
        """Return the values that `set` would pass to the engine, after all checks."""
        seed = self._program.seed
        new = {word: settable.new_values(neurons, word, value, self._engine, seed) for word, value in values.items()}
        settable.check_together(self._program, neurons.index, new, self._engine, self._clock)
        return new

    def get(self, neurons: Neurons, name: str) -> Any:
        """Return a state or parameter, one value per neuron.

        Raises:
            ModelError: the population has no such state or parameter.
        """
        part, word = neurons.part, word_of(name) if isinstance(name, str) else ""
        if word not in part.parameters and word not in settable.states(part):
            names = [*settable.states(part), *part.parameters]
            raise unknown("parameter or state", name, names).at(None, f"population '{part.name}'")
        return self._engine.get(neurons.index, word, neurons.ids)

    def states(self, neurons: Neurons) -> list[str]:
        """Return the names of the states that the backend can read, in the order of the model."""
        hidden = unreadable(self._engine)
        return [word for word in settable.states(neurons.part) if word not in hidden]


class SynapseValues:
    """Reading and setting of synapses. Methods take the index of a projection.

    Args:
        run: the network in execution.
    """

    def __init__(self, run: Run) -> None:
        self._program, self._engine, self._clock, self._rules = run.program, run.engine, run.clock, run.rules
        self._handles = run.handles

    def ends(self, index: int) -> tuple[Ints, Ints]:
        """Return source and target of every synapse, in the order of the weights."""
        return self._handles.ends(index)

    def chosen(self, index: int, of: Any, pre: Side, post: Side, *, at_least_one: bool = False) -> Chosen | None:
        """Choose synapses by pairs of neurons, or by source and target neurons. Return None if no argument chooses.

        Args:
            index: index of the projection.
            of: pairs (source, target), rows of ids; the result has the order of the pairs.
            pre: a population, a view of it or ids.
            post: a population, a view of it or ids.
            at_least_one: whether at least one synapse must be chosen.

        Returns:
            A mask over all synapses; for pairs the indices of the synapses.

        Raises:
            ModelError: no synapse is chosen although `at_least_one` is true, a pair has no synapse, neurons belong to
                other populations, or the synapses of a grid share weights.
        """
        part = self._program.projections[index]
        arguments = {word: value for word, value in (("of", of), ("pre", pre), ("post", post)) if value is not None}
        if not arguments:
            return None
        if part.grid is not None:
            refuse_some_of_a_grid(part.name, next(iter(arguments)))
        if of is None:
            return self._between(part, index, pre, post, at_least_one)
        if len(arguments) > 1:
            raise ModelError(f"found both 'of' and '{[*arguments][1]}': expected pairs, or the neurons at either end")
        source, target = (self._program.populations[end] for end in (part.source, part.target))
        ends = Ends(part.name, (source.name, target.name), (source.size, target.size), *self.ends(index))
        return places_of_pairs(ends, of)

    def _between(
        self, part: Projection, index: int, pre: Side, post: Side, at_least_one: bool
    ) -> NDArray[np.bool_] | None:
        mask: NDArray[np.bool_] | None = None
        selections = []
        sides = (("pre", "from", pre, part.source), ("post", "to", post, part.target))
        for (word, preposition, side, population), ids in zip(sides, self.ends(index), strict=True):
            if side is None:
                continue
            neurons = self._handles.neurons_or_ids(side, population, word)
            if neurons.index != population:
                expected = self._program.populations[population].name
                raise ModelError(f"{word} = {neurons.text}: expected neurons of '{expected}', an end of '{part.name}'")
            selections.append(f"{preposition} {neurons.text}")
            if neurons.ids is not None:
                is_selected = neurons.mask()[ids]
                mask = is_selected if mask is None else mask & is_selected
        if at_least_one and mask is not None and not mask.any():
            message = f"none of the {part.size:,} synapses of '{part.name}' goes {' '.join(selections)}"
            raise ModelError(f"{message}: expected at least one")
        return mask

    def weights(self, index: int) -> Floats:
        """Return the weights of all synapses.

        Raises:
            ModelError: a weight is NaN or infinite.
        """
        part, weight = self._program.projections[index], self._engine.get_synapses(index, "weight")
        return check_weights(part.name, part.synapse.name, weight) if part.synapse.learns else weight

    def read(self, index: int, name: str) -> Floats:
        """Return a state, the weight, the delay in ms or a parameter of the model, for all synapses.

        Raises:
            ModelError: the synapses have no such state.
        """
        part = self._program.projections[index]
        names = synapse_states(part)
        if name == "weight":
            return self.weights(index)
        if name == "delay" and not part.synapse.delays:
            delay = self._clock.array_ms(self._program.delays(index).astype(np.int64))
            return np.broadcast_to(delay, part.size).copy()
        rule, word = self._rules[index], word_of(name) if isinstance(name, str) else ""
        if word in rule.numbers() and word not in names:
            return np.full(part.size, rule.parameters()[word], dtype=np.float64)
        if not isinstance(name, str) or name not in names:
            raise unknown("state of synapses", name, [*names, "delay"]).at(None, f"projection '{part.name}'")
        return self._engine.get_synapses(index, name)

    def set(self, index: int, values: Mapping[str, Any], chosen: Chosen | None) -> None:
        """Change weights, or parameters of the synapse model, by name.

        Args:
            index: index of the projection.
            values: either `weight` alone, or only states (of a rule that learns by moves), or only parameters.
            chosen: the synapses to change, None for all.

        Raises:
            ModelError: there is no such parameter, or the rule or the receptor does not accept a value.
        """
        if [*values] == ["weight"]:
            self.set_weights(index, values["weight"], chosen)
            return
        part, rule = self._program.projections[index], self._rules[index]
        if part.synapse.learns == "moves" and {*values} <= {state.name for state in part.synapse.states}:
            self._set_states(index, values, chosen)
            return
        quantities = part.synapse.quantities()
        shared = [word for word in values if word != "weight" and not (word in quantities and quantities[word].arrays)]
        if "weight" in values or (shared and chosen is not None):
            word = next((word for word in [*shared, *values] if word != "weight"), "")
            reason = "is one for all synapses" if word in shared else "is set without weights"
            message = f"{part.synapse.name}.{word} of '{part.name}' {reason}"
            raise ModelError(f"{message}: expected 'weight' alone" + " with of, pre or post" * (chosen is not None))
        rule = self.checked_rule(index, values, chosen)
        self._engine.set_rule(index, rule.vector())
        self._rules[index] = rule

    def checked_rule(self, index: int, values: Mapping[str, Any], chosen: Chosen | None = None) -> Synapse:
        """Return the synapse model that `set` would pass to the engine, after all checks."""
        part = self._program.projections[index]
        rule = settable.new_rule(part, self._rules[index], values, chosen)
        settable.check_rule(part, rule, self._engine.get_synapses(index, "weight"))
        return rule

    def _set_states(self, index: int, values: Mapping[str, Any], chosen: Chosen | None) -> None:
        """Replace states of all synapses, or of the chosen ones."""
        part, engine = self._program.projections[index], self._engine
        assert isinstance(engine, SettableSynapses)
        units = {state.name: state.quantity() for state in part.synapse.states}
        size = part.size if chosen is None else np.arange(part.size)[chosen].size
        new = {word: check(units[word], value, f"{part.synapse.name}.{word}") for word, value in values.items()}
        for word, value in new.items():
            if np.ndim(value) and np.shape(value) != (size,):
                actual = f"shape {list(np.shape(value))}"
                raise ModelError(f"{word} of '{part.name}': {actual}: expected {size} values, or one value")
        for word, value in new.items():
            all_values = np.broadcast_to(value, part.size) if chosen is None else engine.get_synapses(index, word)
            if chosen is not None:
                all_values[chosen] = value
            engine.set_synapses(index, word, np.ascontiguousarray(all_values, dtype=np.float64))

    def set_weights(self, index: int, weights: Any, chosen: Chosen | None) -> None:
        """Replace the weights of all synapses, or of the chosen ones, by a number or a number for each.

        Raises:
            ModelError: the rule or the receptor does not accept the weights.
        """
        new, mask = self.checked_weights(index, weights, chosen), None
        if chosen is not None:
            mask = np.zeros(self._program.projections[index].size, dtype=np.bool_)
            mask[chosen] = True
        self._engine.set_weights(index, new, mask)

    def checked_weights(self, index: int, weights: Any, chosen: Chosen | None = None) -> Floats:
        """Return the weights that `set_weights` would pass to the engine, after all checks."""
        present = None if chosen is None else (self.weights(index), chosen)
        part, unit = self._program.projections[index], self.weight_unit(index)
        return settable.new_weights(part, self._rules[index], weights, present, unit)

    def weight_unit(self, index: int) -> str:
        """Return the unit of the weights of a projection, "" for none."""
        part = self._program.projections[index]
        target = self._program.populations[part.target].model
        return "" if part.carries == "current" else getattr(target, "weight_unit", "")

    def rows(self, index: int, chosen: Chosen | None, delays: bool) -> Any:
        """Return (pre, post, weight), or with `delays` (pre, post, weight, delay).

        For a grid return the kernels, and with `delays` (kernels, delay).
        """
        grid, weight = self._program.projections[index].grid, self.weights(index)
        delay = (self.read(index, "delay"),) if delays else ()
        if grid is not None:
            return (weight.reshape(grid.kernels), float(delay[0][0])) if delay else weight.reshape(grid.kernels)
        rows = (*self.ends(index), weight, *delay)
        return rows if chosen is None else tuple(row[chosen] for row in rows)

    def check(self) -> None:
        """Refuse weights that are NaN, for rules that change them."""
        for index, part in enumerate(self._program.projections):
            if part.synapse.learns:
                self.weights(index)


_FLAG = Quantity(kind="boolean")


class Values:
    """Reading and setting of values of a population, a view or a projection.

    Args:
        run: the network in execution.

    Attributes:
        cells: reads and sets neurons.
        synapses: reads and sets synapses.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self.cells, self.synapses = NeuronValues(run), SynapseValues(run)

    def set(
        self,
        part: Population | View | Described | str,
        values: Any,
        keywords: Mapping[str, Any],
        of: Any,
        pre: Side,
        post: Side,
    ) -> None:
        """Change values by name; see `Simulation.set`."""
        by_name = {} if values is None else values
        if not isinstance(by_name, Mapping) or not all(isinstance(word, str) for word in by_name):
            raise ModelError(f"set: found {shown(values)}: expected values by name", hint="sim.set(cells, V_m=-60.0)")
        new = {word_of(word): value for word, value in {**by_name, **keywords}.items()}
        neurons = self._run.handles.neurons_or_projection(part)
        if not new:
            raise ModelError("set: found no value: expected values by name", hint="sim.set(cells, V_m=-60.0)")
        if isinstance(neurons, int):
            self.synapses.set(neurons, new, self.synapses.chosen(neurons, of, pre, post, at_least_one=True))
        else:
            _refuse_ends(neurons, of, pre, post)
            self.cells.set(neurons, new)

    def get(
        self, part: Population | View | Described | str, what: Any, raw: Any, of: Any, pre: Side, post: Side
    ) -> Any:
        """Return a state or parameter, or several by name; see `Simulation.get`."""
        if isinstance(raw, str) and raw.isidentifier():
            hint = f"sim.get(part, [{what!r}, {raw!r}]) returns both"
            raise ModelError(f"get: found {shown(what)} and {shown(raw)}: expected one name, or a list", hint=hint)
        if isinstance(what, list):
            return {word: self.get(part, word, raw, of, pre, post) for word in what}
        registers = self._run.engine if check(_FLAG, raw, "raw") else None
        if registers is not None and not isinstance(registers, Registers):
            raise ModelError(f"raw = True: expected False, because backend '{self._run.backend}' has no registers")
        neurons = self._run.handles.neurons_or_projection(part)
        if isinstance(neurons, int):
            chosen = self.synapses.chosen(neurons, of, pre, post)
            values = registers.synapse_registers(neurons, what) if registers else self.synapses.read(neurons, what)
            return values if chosen is None else values[chosen]
        _refuse_ends(neurons, of, pre, post)
        if registers is None:
            return self.cells.get(neurons, what)
        all_values = registers.registers(neurons.index, word_of(what))
        return all_values if neurons.ids is None else all_values[neurons.ids]

    def weights(self, index: int, of: Any, pre: Side, post: Side, delays: Any) -> Any:
        """Return the weights of a projection; see `Simulation.weights`."""
        chosen = self.synapses.chosen(index, of, pre, post)
        return self.synapses.rows(index, chosen, check(_FLAG, delays, "delays"))

    def silence(self, of: Population | View | str) -> None:
        """Set the weights of all synapses from some neurons to 0; see `Simulation.silence`."""
        neurons = self._run.handles.neurons(of)
        pre = None if neurons.mask().all() else of
        for index in outgoing(self._run.program, neurons):
            self.synapses.set_weights(index, 0.0, self.synapses.chosen(index, None, pre, None))

    def activate(self, neurons: Neurons, rate: ArrayLike) -> None:
        """Set the rate of the generators that drive some neurons; see `Simulation.activate`."""
        self.cells.set(driver(self._run.program, neurons), {"rate": rate})


def _refuse_ends(neurons: Neurons, of: object, pre: object, post: object) -> None:
    if of is not None or pre is not None or post is not None:
        hint = f"sim.set({of!r}, ...)" if isinstance(of, View) else ""
        raise ModelError(f"of, pre and post choose synapses: found {neurons.text}: expected a projection", hint=hint)
