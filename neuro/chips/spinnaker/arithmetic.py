"""SpiNNaker 1 as a family of chips; any table with `arithmetic: spinnaker` computes so."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from neuro.chips.arithmetic import Arithmetic, Option
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection
from neuro.chips.quantising.inputs import Options
from neuro.chips.quantising.losses import refuse_rules
from neuro.chips.quantising.options import is_whole
from neuro.chips.spinnaker import neurons
from neuro.chips.spinnaker.neurons import LARGEST, LARGEST_SHIFT
from neuro.model.neurons import iaf_psc_delta, iaf_psc_exp
from neuro.program.program import Program

_TICK_MS = 1.0


def _two_shifts(value: Any) -> bool:
    shifts = range(LARGEST_SHIFT + 1)
    return isinstance(value, (tuple, list)) and len(value) == 2 and all(is_whole(shift, shifts) for shift in value)


_OPTIONS = (
    Option(
        "shifts",
        "populations",
        _two_shifts,
        f"the shifts of excitatory and inhibitory slots, two whole numbers up to {LARGEST_SHIFT}",
    ),
)


def _shifts(cells: FixedPopulation) -> tuple[int, int] | None:
    r = cells.registers
    return (int(r["exc_shift"][0]), int(r["inh_shift"][0])) if "exc_shift" in r else None


def _kept_options(cells: FixedPopulation, wires: tuple[FixedProjection, ...]) -> Options:
    shifts = _shifts(cells)
    return Options({} if shifts is None else {"shifts": {cells.name: shifts}})


def _told_scale(cells: FixedPopulation, wires: FixedProjection) -> str:
    shifts = _shifts(cells)
    return "-" if shifts is None else "shifts {}, {}".format(*shifts)


def _notes(program: Program) -> Iterator[str]:
    if program.resolution != _TICK_MS:
        yield f"a step of {program.resolution:g} ms takes a tick of {_TICK_MS:g} ms on the machine"


SPINNAKER = Arithmetic(
    name="spinnaker",
    title="SpiNNaker",
    models=(iaf_psc_exp, iaf_psc_delta),
    options=_OPTIONS,
    state_limit=LARGEST,
    register_of_one=neurons.REGISTER_OF_ONE,
    one_bit=False,
    in_rows=True,
    multicast=True,
    population=neurons.population,
    native=neurons.native,
    native_projection=neurons.native_projection,
    relay_projection=neurons.relay_projection,
    give_rules=refuse_rules,
    kept_options=_kept_options,
    filled=None,
    told_scale=_told_scale,
    lossless=lambda wires: "",
    notes=_notes,
)
