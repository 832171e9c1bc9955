"""Compiled operations of a model on a range of neighbouring neurons.

Each model has an entry. The loop calls it by address, once for a range of neurons. So a network only compiles the
models of the network, and a new model only compiles the code of the model.
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


# A step gets the input and the current as arrays. An array of zeros would be read for each neuron and step, although
# there is no input. With an opaque type whose items are a constant, the compiled step has no such read. This matters in
# large networks, whose speed is limited by memory bandwidth.
class Placeholder(types.Opaque):
    """The type of an array of any shape whose items all have one constant value."""

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
"""The input of neurons without input: -0.0, which changes no bit when it is added to a state."""

no_current = _placeholder(0.0)


_ONE = np.uint64(1)

CATCH_UP, STEP, BARE, QUIET, FIRE = range(5)
"""Operations of an entry. `BARE` steps neurons without input and current."""


def with_arguments(model, function, arguments):
    """Return a compiled function of a model that takes these arguments. The model may define fewer: the first of them.

    Example: for "s, c, x, i_0, lo, hi, fired, u" a model without draws may define step(s, c, x, i_0, lo, hi, fired).
    """
    model_function = getattr(model.arithmetic, function)
    # A model without draws has no argument `u`, but all models are called in the same way.
    used = ", ".join(arguments.split(", ")[: model_function.__code__.co_argcount])
    scope = {"model_function": compiled(model_function)}
    exec(f"def {function}({arguments}):\n    return model_function({used})", scope)
    return inlined(scope[function])


def operations(model):
    """Compile the operations of a model on a range of neurons from its functions, see `neuro.model.neurons.base`.

    A model that is not in `NEURONS` may read the current in any way, so it always gets an array.
    """
    constants, fire = with_arguments(model, "constants", "p, h, c"), with_arguments(model, "fire", "s, c, i")
    step, quiet = (
        with_arguments(model, "step", "s, c, x, i_0, lo, hi, fired, u"),
        with_arguments(model, "quiet", "s, c, i_0, lo, hi"),
    )
    # The models in `NEURONS` only read single items of input and current, so a placeholder is enough. A third-party
    # step may slice them.
    foreign = model not in NEURONS

    own_catch_up = getattr(model.arithmetic, "catch_up", None)
    if own_catch_up is None:

        @inlined
        def skip(net, p, c, lo, hi, h, n):
            """Make one step of n h instead of n steps."""
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
        # Kernels allocate no memory, so each thread has a buffer for constants.
        c = net.scratch[thread]
        if row[t.CONSTANT_STRIDE] == 0:
            skip(net, net.parameters[row[t.CONSTANT]], c, lo, hi, h, n)
        else:
            # Constants differ between neurons, so each neuron is stepped with its own row.
            for i in range(lo, hi):
                skip(net, net.parameters[row[t.CONSTANT] + i - row[t.BEGIN]], c, i, i + 1, h, n)

    @inlined
    def step_run(view, pop, lo, hi):
        """Step neurons with their input."""
        net = net_of(view)
        row = net.pops[pop]
        if row[t.CONSTANT_STRIDE] == 0:
            # Unsigned indices need no test for a negative value, so loops are vectorised.
            c, begin, end = net.constants[row[t.CONSTANT]], np.uint64(lo), np.uint64(hi)
            # If no projection carries a current, the current is a placeholder, so a step reads one array less.
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
        """Return whether none of the neurons can fire before its next input."""
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
        """Apply the effect of a spike on its neuron."""
        net = net_of(view)
        row = net.pops[pop]
        c = net.constants[row[t.CONSTANT] + (i - row[t.BEGIN]) * row[t.CONSTANT_STRIDE]]
        fire(net.state, c, i)

    return catch_up, step_run, step_bare, is_quiet, fire_one


@subkernel
def draw(view, pop, lo, hi, step):
    """Draw the random numbers of neurons for a step."""
    net = net_of(view)
    base = step_word(net.keys[pop], step)
    for i in range(lo, hi):
        net.draws[i] = uniform(base, net.order[i])


@cache
def entry(model):
    """Return all operations of a model as a single function, with the arguments of `tables.call_entry`."""
    catch_up, step_run, step_bare, is_quiet, fire_one = operations(model)
    draws, linear, foreign = model.draws, model.linear, model not in NEURONS

    @kernel
    def run(view, pop, operation, lo, hi, thread, step, h):
        if linear and operation == CATCH_UP:  # other models do not change asleep; `step` is the number of steps
            catch_up(view, thread, pop, lo, hi, h, step)
        elif operation == STEP:
            if draws:
                draw(view, pop, lo, hi, step)
            if foreign:  # a third-party model may write `fired` only of neurons that fire
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
    """Return the compiled step of a third-party generator."""
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
"""Models whose step only reads single items of input and current, and writes `fired` of every neuron."""

RULES: tuple[type[Synapse], ...] = (stdp, stdp_dopa)
"""Rules whose traces are K+ and K-, see `lazy_stdp`. The traces of all other rules are stored as in `lazy_rules`."""
