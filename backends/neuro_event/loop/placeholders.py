"""Placeholders for absent input or current: a model's step is compiled without reading them, so they cost nothing."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,arg-type"
from __future__ import annotations

import operator

from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model

from neuro.kernels.numba_internals import AbstractTemplate, infer_global


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
