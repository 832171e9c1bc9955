"""What a run of neighbouring neurons does, of any model.

Each model has an entry of its own, which the loop calls by its address, once for a run of neurons: so a network
compiles the models that it has, and a new model compiles nothing but itself.
"""

# mypy: ignore-errors
from __future__ import annotations

import operator
from functools import cache

import numpy as np
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model

from neuro.kernels.address import Entry
from neuro.kernels.draws import step_word, uniform
from neuro.kernels.instructions import moved
from neuro.kernels.jit import compiled, inlined, kernel, subkernel
from neuro.kernels.numba_internals import AbstractTemplate, infer_global
from neuro.model.neurons import Neuron, iaf_psc_alpha, iaf_psc_delta, iaf_psc_exp, izhikevich, parrot_neuron
from neuro.model.synapses import Synapse, stdp, stdp_dopa
from neuro_event.loop import tables as t
from neuro_event.loop.tables import ENTRY_TYPE, net_of


# A step takes its input and its current as arrays. Where there is none, an array of zeros would still be read for each
# neuron and step. An opaque type, of which each item is a constant, compiles to a step without the read: memory sets
# the pace of large networks.
class Placeholder(types.Opaque):
    """An array of any shape of which each item is one known number."""

    def __init__(self, value):
        super().__init__(name=f"Placeholder({value})")
        self.value = value


register_model(Placeholder)(models.OpaqueModel)


@infer_global(operator.getitem)
class _Item(AbstractTemplate):
    def generic(self, args, kws):
        if len(args) == 2 and isinstance(args[0], Placeholder):
            return types.float64(*args)
        return None


@lower_builtin(operator.getitem, Placeholder, types.Any)
def _item(context, builder, signature, arguments):
    return context.get_constant(types.float64, signature.args[0].value)


def _placeholder(value):
    kind = Placeholder(value)

    @intrinsic
    def placeholder(typingctx):
        def codegen(context, builder, signature, arguments):
            return context.get_dummy_value()

        return kind(), codegen

    return placeholder


no_input = _placeholder(-0.0)
"""What arrives where nothing does: added to a state it changes no bit."""

no_current = _placeholder(0.0)


_ONE = np.uint64(1)

CATCH_UP, STEP, BARE, QUIET, FIRE = range(5)
"""Operations of an entry; `BARE` steps neurons that have neither input nor current."""


def taking(model, function, arguments):
    """A function of a model, compiled, for these arguments; it may take fewer of them: the first ones."""
    own = getattr(model.arithmetic, function)
    # A model that draws nothing takes no `u`; all are called in one way.
    taken = ", ".join(arguments.split(", ")[: own.__code__.co_argcount])
    scope = {"own": compiled(own)}
    exec(f"def {function}({arguments}):\n    return own({taken})", scope)
    return inlined(scope[function])


def operations(model):
    """What a run of neighbouring neurons of a model does; its functions are in `neuro.model.neurons.base`.

    A model that is not in `NEURONS` may read the current in any way, so of no current it gets an array.
    """
    constants, fire = taking(model, "constants", "p, h, c"), taking(model, "fire", "s, c, i")
    step, quiet = taking(model, "step", "s, c, x, i_0, lo, hi, fired, u"), taking(model, "quiet", "s, c, i_0, lo, hi")
    # Ours take single items of input and current, so a placeholder will do; a third-party step may slice them.
    foreign = model not in NEURONS

    own_catch_up = getattr(model.arithmetic, "catch_up", None)
    if own_catch_up is None:

        @inlined
        def skip(net, p, c, lo, hi, h, n):
            """One step of n h in place of n steps."""
            constants(p, n * h, c)
            step(net.state, c, net.empty_input, net.current, np.uint64(lo), np.uint64(hi), net.fired, net.draws)

    else:
        advance = compiled(own_catch_up)

        @inlined
        def skip(net, p, c, lo, hi, h, n):
            advance(net.state, p, c, net.current, np.uint64(lo), np.uint64(hi), h, n)

    @subkernel
    def catch_up(view, thread, pop, lo, hi, h, n):
        """Advance neurons that slept for n steps of h ms."""
        net = net_of(view)
        row = net.pops[pop]
        # Room of the thread: kernels allocate nothing.
        c = net.scratch[thread]
        if row[t.CONSTANT_STRIDE] == 0:
            skip(net, net.parameters[row[t.CONSTANT]], c, lo, hi, h, n)
        else:
            # Constants differ between neurons: one at a time, with its own row.
            for i in range(lo, hi):
                skip(net, net.parameters[row[t.CONSTANT] + i - row[t.BEGIN]], c, i, i + 1, h, n)

    @inlined
    def step_run(view, pop, lo, hi):
        """Step neurons with their input."""
        net = net_of(view)
        row = net.pops[pop]
        if row[t.CONSTANT_STRIDE] == 0:
            # Unsigned bounds: no index is tested for being one from the end, so loops are vectorised.
            c, begin, end = net.constants[row[t.CONSTANT]], np.uint64(lo), np.uint64(hi)
            # A current that no projection brings is a placeholder or zeros: a step without it reads one array less.
            if row[t.CARRIED] == 1:
                step(net.state, c, net.x, net.current, begin, end, net.fired, net.draws)
            elif foreign:
                step(net.state, c, net.x, moved(net.none, lo), begin, end, net.fired, net.draws)
            else:
                step(net.state, c, net.x, no_current(), begin, end, net.fired, net.draws)
            return
        for i in range(lo, hi):
            c = net.constants[row[t.CONSTANT] + i - row[t.BEGIN]]
            u = np.uint64(i)
            step(net.state, c, net.x, net.current, u, u + _ONE, net.fired, net.draws)

    if model.collects:

        @subkernel
        def step_bare(view, pop, lo, hi):
            net = net_of(view)
            row = net.pops[pop]
            none = no_input(), no_current()
            if row[t.CONSTANT_STRIDE] == 0:
                c = net.constants[row[t.CONSTANT]]
                step(net.state, c, none[0], none[1], np.uint64(lo), np.uint64(hi), net.fired, net.draws)
                return
            for i in range(lo, hi):
                c = net.constants[row[t.CONSTANT] + i - row[t.BEGIN]]
                u = np.uint64(i)
                step(net.state, c, none[0], none[1], u, u + _ONE, net.fired, net.draws)

    else:

        @subkernel
        def step_bare(view, pop, lo, hi):
            pass

    @subkernel
    def is_quiet(view, pop, lo, hi):
        """Whether none of the neurons can fire before its next input."""
        net = net_of(view)
        row = net.pops[pop]
        if row[t.CONSTANT_STRIDE] == 0:
            return quiet(net.state, net.constants[row[t.CONSTANT]], net.current, lo, hi)
        for i in range(lo, hi):
            c = net.constants[row[t.CONSTANT] + i - row[t.BEGIN]]
            if not quiet(net.state, c, net.current, i, i + 1):
                return False
        return True

    @subkernel
    def fire_one(view, pop, i):
        """What a spike does to its neuron."""
        net = net_of(view)
        row = net.pops[pop]
        c = net.constants[row[t.CONSTANT] + (i - row[t.BEGIN]) * row[t.CONSTANT_STRIDE]]
        fire(net.state, c, i)

    return catch_up, step_run, step_bare, is_quiet, fire_one


@subkernel
def draw(view, pop, lo, hi, step):
    """Draw the numbers of neurons for a step."""
    net = net_of(view)
    base = step_word(net.keys[pop], step)
    for i in range(lo, hi):
        net.draws[i] = uniform(base, net.order[i])


@cache
def entry(model):
    """All operations of one model. Its arguments are those of `neuro_event.loop.tables.call_entry`."""
    catch_up, step_run, step_bare, is_quiet, fire_one = operations(model)
    draws, linear, foreign = model.draws, model.linear, model not in NEURONS

    @kernel
    def run(view, pop, operation, lo, hi, thread, step, h):
        if linear and operation == CATCH_UP:  # of others nothing changes while they sleep; `step`: how many they slept
            catch_up(view, thread, pop, lo, hi, h, step)
        elif operation == STEP:
            if draws:
                draw(view, pop, lo, hi, step)
            if foreign:  # ours write it for each neuron; to set it where it is reached is enough
                net_of(view).fired[lo:hi] = 0
            step_run(view, pop, lo, hi)
        elif operation == BARE:
            step_bare(view, pop, lo, hi)
        elif operation == FIRE:
            fire_one(view, pop, lo)
        elif operation == QUIET:
            return 1 if is_quiet(view, pop, lo, hi) else 0
        return 0

    return Entry(run, ENTRY_TYPE, model)


@cache
def generator_entry(model):
    """What a third-party generator emits in a step."""
    emit = compiled(model.arithmetic.emit)

    @kernel
    def run(view, pop, operation, lo, hi, thread, step, h):
        net = net_of(view)
        row = net.pops[pop]
        base = step_word(net.keys[pop], step)
        out, u = net.x[0], net.x[1]
        for i in range(lo, hi):
            out[i] = 0.0
            u[i] = uniform(base, i - row[t.BEGIN])
        if row[t.CONSTANT_STRIDE] == 0:
            emit(net.state, net.constants[row[t.CONSTANT]], u, step, lo, hi, out)
        else:
            for i in range(lo, hi):
                emit(net.state, net.constants[row[t.CONSTANT] + i - row[t.BEGIN]], u, step, i, i + 1, out)
        for i in range(lo, hi):
            net.fired[i] = out[i] >= 1.0
        return 0

    return Entry(run, ENTRY_TYPE, model)


NEURONS: tuple[type[Neuron], ...] = (parrot_neuron, iaf_psc_delta, iaf_psc_exp, iaf_psc_alpha, izhikevich)
"""Their steps take items of the input and of the current only, and write for each neuron whether it fired."""

RULES: tuple[type[Synapse], ...] = (stdp, stdp_dopa)
"""Their traces are K+ and K-, see `lazy_stdp`; those of all others are kept as `lazy_rules` has them."""
