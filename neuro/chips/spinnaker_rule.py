"""Learning rules in the form of SpiNNaker's released programs: constants in s16.15 and tables in s4.11.

Source: sPyNNaker 7.4.1, its plastic synapses.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Any

import numpy as np

from neuro.core.errors import ModelError
from neuro.model.synapses import (
    Synapse,
    spinnaker_learning,
    stdp,
    stdp_dopa,
    stdp_nn_restr,
    stdp_nn_symm,
    stdp_triplet,
    vogels_sprekeler,
)
from neuro.model.synapses.spinnaker_programs import (
    ADDITIVE as ADDITIVE,
    MULTIPLICATIVE as MULTIPLICATIVE,
    TIMINGS as TIMINGS,
)
from neuro.program.program import Ints

PROGRAMS = {
    ("pair", ADDITIVE, False): "mad_pair_additive",
    ("pair", MULTIPLICATIVE, False): "mad_pair_multiplicative",
    ("nearest", ADDITIVE, False): "mad_nearest_pair_additive",
    ("nearest", MULTIPLICATIVE, False): "mad_nearest_pair_multiplicative",
    ("triplet", ADDITIVE, False): "mad_pfister_triplet_additive",
    ("vogels", ADDITIVE, False): "mad_vogels_2011_additive",
    ("recurrent", MULTIPLICATIVE, False): "mad_recurrent_dual_fsm_multiplicative",
    ("pair", ADDITIVE, True): "izhikevich_neuromodulation_pair_additive",
    ("pair", MULTIPLICATIVE, True): "izhikevich_neuromodulation_pair_multiplicative",
    ("vogels", ADDITIVE, True): "izhikevich_neuromodulation_vogels_2011_additive",
}
"""The released programs, by timing, weight dependence and whether dopamine modulates learning."""

TIMING_OF: dict[type[Synapse], str] = {
    stdp: "pair",
    stdp_nn_restr: "nearest",
    stdp_nn_symm: "nearest",
    stdp_triplet: "triplet",
    vogels_sprekeler: "vogels",
    stdp_dopa: "pair",
}
"""Timing of the program of each rule. A `spinnaker_learning` has a parameter for it."""
KNOWN = (*TIMING_OF, spinnaker_learning)
"""The synapse models that a program can run."""


def program_of(synapse: Synapse) -> tuple[str, bool]:
    """Return the timing of the program that runs a rule of `KNOWN`, and whether the program is neuromodulated."""
    if isinstance(synapse, spinnaker_learning):
        return synapse.timing, synapse.taught
    timing = next(timing for rule, timing in TIMING_OF.items() if isinstance(synapse, rule))
    return timing, isinstance(synapse, stdp_dopa)


SIGNAL_SPIKES = "spikes of sources for signals"
"""Name, in counts, of the spikes that carry a signal to the machine."""

ONE = 2048
"""1.0 in s4.11."""
PARTS = 32768
"""1.0 in s16.15."""
LONGEST_TABLE = 65534

(
    TIMING,
    OF_WEIGHT,
    TAUGHT,
    LOW,
    HIGH,
    UP,
    DOWN,
    UP_TRIPLET,
    DOWN_TRIPLET,
    ALPHA,
    FEWEST,
    MOST,
    GAIN,
    TAUGHT_LOW,
    TAUGHT_HIGH,
    CONSTANTS,
) = range(16)
"""Columns of constants: index in `TIMINGS`; whether the dependence is multiplicative; whether dopamine modulates it;
bounds and steps of the rule in s16.15; Vogels' alpha in s4.11; ends of the accumulator; with dopamine K and weight
bounds."""

PLUS, MINUS, X, Y, C, D, TABLES = range(7)
"""Tables: decay of the traces of rows and of post neurons, of the slow traces of triplets, of eligibility and dopamine.
The first two tables of the recurrent rule have the lengths of windows of rows and of post spikes instead."""

INDEX_SHIFTS = (0, 0, 2, 2, 4, 2)
"""Right shift, in bits, from a time difference to the index of each table."""

WINDOWS = 2048
"""Entries of a table of windows."""


_MECHANISM = ("constants", "table", "places")


@dataclass(frozen=True, slots=True, eq=False)
class SpinnakerRule:
    """A rule in the form of a released program.

    Attributes:
        program: name of the released program.
        constants: int64, columns as above.
        table: all tables concatenated, int64.
        places: begin of each table in `table`, its length and its index shift, shape (TABLES, 3).
        shift: shift of the slots of its receptor; a unit of a word is 2^(shift - 15).
        slots: slots of a neuron for future ticks. A delay of `slots` ticks is stored as 0 and never delivered.
        inhibits: whether the words of the rule, which are magnitudes, are subtracted.
        concentrations: dopamine per spike of each source in s4.11. There is one source, a dopamine population; or the
            sources carry a signal, with separate sources for reward, for punishment, and for each neuron.
        eligibility: eligibility in the unit of the language per unit of its word.
    """

    program: str
    constants: Ints
    table: Ints
    places: Ints
    shift: int = 0
    slots: int = 16
    inhibits: bool = False
    concentrations: tuple[int, ...] = ()
    eligibility: float = 1.0

    def is_as(self, other_rule: SpinnakerRule) -> bool:
        """Return whether another rule has equal program, constants and tables, so that both can share histories."""
        return self.concentrations == other_rule.concentrations and all(
            np.array_equal(getattr(self, name), getattr(other_rule, name)) for name in _MECHANISM
        )


def fixed_point(value: float) -> int:
    """Return a number in s16.15, rounded from its shortest decimal form, ties to even."""
    return int((Decimal(repr(float(value))) * PARTS).to_integral_value(ROUND_HALF_EVEN))


def table_length(tau: float, dt: float, shift: int) -> int:
    """Return the number of entries in the table of a time constant, see `table_of`."""
    return int(2 * math.ceil(math.log(ONE) / (dt / tau) / 2**shift / 2))


def table_of(tau: float, dt: float, shift: int) -> Ints:
    """Return the share that remains after 0, 1, ... blocks of 2^shift ticks, in s4.11; 0 beyond the end.

    Args:
        tau: time constant in ms.
        dt: length of a tick in ms.
        shift: log2 of the ticks in a block.

    Raises:
        ModelError: the table has more than 65534 entries.
    """
    length = table_length(tau, dt, shift)
    if length > LONGEST_TABLE:
        longest = LONGEST_TABLE * 2**shift * dt / math.log(ONE)
        raise ModelError(f"a time constant of {tau:g} ms: expected at most {longest:.6g} ms, {LONGEST_TABLE} entries")
    table: Ints = np.floor(ONE * np.exp(-dt / tau * np.arange(length) * 2**shift)).astype(np.int64)
    return table


def windows_of(mean: float) -> Ints:
    """Return equally likely lengths of windows in ticks, exponentially distributed with a mean in ticks."""
    lengths: Ints = np.floor(-mean * np.log(1.0 - np.arange(WINDOWS) / WINDOWS)).astype(np.int64)
    return lengths


def rule_of(
    timing: str,
    dependence: str,
    numbers: Mapping[str, Any],
    *,
    dt: float,
    neuromodulation: Mapping[str, float] | None = None,
) -> SpinnakerRule:
    """Return a rule in the form of a released program.

    Args:
        timing: name in `TIMINGS`.
        dependence: "additive" or "multiplicative".
        numbers: parameters by PyNN's names, weights in the unit of the machine (nA or mV): w_min, w_max, A_plus,
            A_minus; tau_plus and tau_minus; for triplets tau_x, tau_y, A3_plus and A3_minus; for Vogels tau and alpha;
            for the recurrent rule accumulator_depression and accumulator_potentiation, mean_pre_window and
            mean_post_window in ms.
        dt: length of a tick in ms.
        neuromodulation: values of tau_c, tau_d, w_min and w_max, if dopamine modulates learning.

    Raises:
        ModelError: no such program was released, or a table would be too long.
    """
    program = PROGRAMS.get((timing, dependence, neuromodulation is not None))
    if program is None:
        taught = " with neuromodulation" if neuromodulation is not None else ""
        raise ModelError(
            f"{timing}, {dependence}{taught}: no such SpiNNaker program was released",
            hint=f"released programs: {', '.join(PROGRAMS.values())}",
        )
    scale = float(numbers["w_max"]) if timing == "triplet" else 1.0
    c: Ints = np.zeros(CONSTANTS, dtype=np.int64)
    c[TIMING], c[OF_WEIGHT] = TIMINGS.index(timing), dependence == MULTIPLICATIVE
    c[LOW], c[HIGH] = fixed_point(numbers["w_min"]), fixed_point(numbers["w_max"])
    amplitudes = {UP: "A_plus", DOWN: "A_minus", UP_TRIPLET: "A3_plus", DOWN_TRIPLET: "A3_minus"}
    for column, name in amplitudes.items():
        c[column] = fixed_point(numbers.get(name, 0.0) * scale)
    taus: dict[int, float] = {}
    tables: dict[int, Ints] = {}
    if timing == "vogels":
        c[ALPHA] = round(float(numbers["alpha"]) * ONE)
        taus = dict.fromkeys((PLUS, MINUS), numbers["tau"])
    elif timing == "recurrent":
        c[FEWEST] = numbers["accumulator_depression"] + 1
        c[MOST] = numbers["accumulator_potentiation"] - 1
        tables = {
            PLUS: windows_of(numbers["mean_pre_window"] / dt),
            MINUS: windows_of(numbers["mean_post_window"] / dt),
        }
    else:
        taus = {PLUS: numbers["tau_plus"], MINUS: numbers["tau_minus"]}
        taus |= {X: numbers["tau_x"], Y: numbers["tau_y"]} if timing == "triplet" else {}
    if neuromodulation is not None:
        tau_c, tau_d = neuromodulation["tau_c"], neuromodulation["tau_d"]
        c[TAUGHT], c[GAIN] = 1, fixed_point(1.0 / -(1.0 / tau_c + 1.0 / tau_d))
        c[TAUGHT_LOW], c[TAUGHT_HIGH] = (fixed_point(neuromodulation[name]) for name in ("w_min", "w_max"))
        taus |= {C: tau_c, D: tau_d}
    tables |= {k: table_of(tau, dt, INDEX_SHIFTS[k]) for k, tau in taus.items()}
    places: Ints = np.zeros((TABLES, 3), dtype=np.int64)
    position = 0
    for k, table in tables.items():
        places[k] = position, table.size, INDEX_SHIFTS[k]
        position += table.size
    return SpinnakerRule(program, c, np.concatenate(list(tables.values())), places)
