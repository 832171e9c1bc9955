"""Arrays that hold nothing, for steps of neurons without input or current: they are not read, and cost nothing."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,arg-type"
from __future__ import annotations

import operator

from numba import types
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, models, register_model


class Nothing(types.Opaque):
    """An array of any shape of which each item is one known number."""

    def __init__(self, value):
        super().__init__(name=f"Nothing({value})")
        self.value = value


register_model(Nothing)(models.OpaqueModel)


@infer_global(operator.getitem)
class _Item(AbstractTemplate):
    def generic(self, args, kws):
        if len(args) == 2 and isinstance(args[0], Nothing):
            return types.float64(*args)
        return None


@lower_builtin(operator.getitem, Nothing, types.Any)
def _item(context, builder, signature, arguments):
    return context.get_constant(types.float64, signature.args[0].value)


def _nothing(value):
    kind = Nothing(value)

    @intrinsic
    def nothing(typingctx):
        def codegen(context, builder, signature, arguments):
            return context.get_dummy_value()

        return kind(), codegen

    return nothing


no_input = _nothing(-0.0)
"""What arrives where nothing does: added to a state it changes no bit."""

no_current = _nothing(0.0)
