"""Loihi 1 as a family of chips; any table with `arithmetic: loihi` computes so."""

from __future__ import annotations

import numpy as np

from neuro.chips.arithmetic import Arithmetic, Option
from neuro.chips.loihi import neurons, words
from neuro.chips.loihi.learning import give_rules
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection
from neuro.chips.quantising.inputs import Options
from neuro.chips.quantising.options import is_positive, is_whole
from neuro.model.neurons import iaf_psc_delta, iaf_psc_exp
from neuro.program.program import Floats

_OPTIONS = (
    Option("scales", "populations", is_positive, "units per mV, a number > 0"),
    Option(
        "exponents",
        "projections",
        lambda value: is_whole(value, words.WEIGHT_EXPONENTS),
        "a weight exponent, a whole number from -8 to 7",
    ),
    Option("signals", "projections", is_positive, "the largest dopamine that the signal sets in 1/ms, a number > 0"),
)


def _kept_options(cells: FixedPopulation, wires: tuple[FixedProjection, ...]) -> Options:
    return Options({"scales": {cells.name: cells.volt}, "exponents": {part.name: part.exponent for part in wires}})


def _told_scale(cells: FixedPopulation, wires: FixedProjection) -> str:
    return f"exponent {wires.exponent}"


def _filled(cells: FixedPopulation, arriving: Floats) -> float:
    """Of the 22 bits of a step's input, or of the 24 of u, which also keeps what came before."""
    if "du" not in cells.registers:
        return 0.0
    keep = (4095 - cells.registers["du"]) / 4096
    u, most = np.zeros(arriving[:, 0].shape), 64.0 * float(np.abs(arriving).max(initial=0.0)) / words.INPUT_LIMIT
    for step in range(arriving.shape[1]):
        u = keep * u + 64.0 * arriving[:, step]
        most = max(most, float(np.abs(u).max(initial=0.0)) / words.U_LIMIT)
    return most


LOIHI = Arithmetic(
    name="loihi",
    title="Loihi",
    models=(iaf_psc_exp, iaf_psc_delta),
    options=_OPTIONS,
    state_limit=words.V_LIMIT,
    register_of_one=words.REGISTER_OF_ONE,
    one_bit=True,
    in_rows=False,
    multicast=False,
    population=neurons.population,
    native=words.native,
    native_projection=words.native_projection,
    relay_projection=words.relay_projection,
    give_rules=give_rules,
    kept_options=_kept_options,
    filled=_filled,
    told_scale=_told_scale,
    lossless=words.lossless,
    notes=lambda program: iter(()),
)
