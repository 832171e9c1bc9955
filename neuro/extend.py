"""Public API for extensions: neurons, generators, synapses, rules, distributions, formats, filters and chips.

from neuro.extend import Neuron, State, quantity, register

Names in this module are stable, even if the code behind them moves.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import public_names

if TYPE_CHECKING:
    from neuro.chips import spinnaker_rule as spinnaker_rule
    from neuro.chips.description import Chip as Chip, Figure as Figure, Mesh as Mesh
    from neuro.core.errors import ModelError as ModelError
    from neuro.core.quantities import Value as Value, quantity as quantity
    from neuro.core.registry import register as register
    from neuro.kernels.jit import allocating as allocating, kernel as kernel, subkernel as subkernel
    from neuro.model.distributions import Distribution as Distribution
    from neuro.model.neurons.base import Generator as Generator, Neuron as Neuron, State as State
    from neuro.model.neurons.integrators import (
        advance as advance,
        fehlberg as fehlberg,
        finite_exp as finite_exp,
        is_still as is_still,
        rows as rows,
        runge_kutta as runge_kutta,
        step_adaptively as step_adaptively,
        step_evenly as step_evenly,
        step_whole as step_whole,
    )
    from neuro.model.neurons.propagators import (
        from_alpha as from_alpha,
        from_constant as from_constant,
        from_exponential as from_exponential,
        leak as leak,
    )
    from neuro.model.rules import Rule as Rule, out_size as out_size, synapses_of as synapses_of
    from neuro.model.signals import Source as Source
    from neuro.model.space import Profile as Profile
    from neuro.model.synapses import loihi_rule as loihi_rule
    from neuro.model.synapses.base import (
        K_MINUS as K_MINUS,
        K_PLUS as K_PLUS,
        DelayRule as DelayRule,
        Growth as Growth,
        Lesson as Lesson,
        Modulated as Modulated,
        Synapse as Synapse,
        Trace as Trace,
        TrialEnd as TrialEnd,
    )
    from neuro.model.synapses.loihi_registers import LoihiEngine as LoihiEngine
    from neuro.model.synapses.moves import MoveRule as MoveRule
    from neuro.program.backend import (
        Backend as Backend,
        Engine as Engine,
        EngineCounts as EngineCounts,
        Outcome as Outcome,
        Problem as Problem,
        Spikes as Spikes,
        Trial as Trial,
    )
    from neuro.program.program import (
        Floats as Floats,
        Grid as Grid,
        Ints as Ints,
        Population as Population,
        Program as Program,
        Projection as Projection,
        Signal as Signal,
        Stretch as Stretch,
        Trials as Trials,
    )
    from neuro_events._events import Events as Events
    from neuro_events.filters import Filter as Filter, Sieve as Sieve
    from neuro_events.formats import (
        Damage as Damage,
        Format as Format,
        Piece as Piece,
        Reader as Reader,
        Seeker as Seeker,
        Unsavable as Unsavable,
        in_order as in_order,
        refuse as refuse,
    )


if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = public_names(__name__, __file__)
