"""Loihi 1's compartments in the engine."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from neuro.chips.loihi.arithmetic import KIND, LOIHI, word
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection, Words
from neuro.core.errors import ModelError
from neuro.program.program import Floats, Ints
from neuro_chip import tables as t
from neuro_chip.families.family import ChipFamily
from neuro_chip.families.loihi_step import lif
from neuro_chip.tables import Arrays


def _write(a: Arrays, row: NDArray[np.int64], here: slice, r: Mapping[str, Ints]) -> None:
    a["keep_u"][here] = 4095 - r["du"]
    a["keep_v"][here] = 4096 - r["dv"]
    row[t.LOWEST] = int(r["v_min"][0]) if "v_min" in r else -(2**23) + 1
    a["fall"][here] = r.get("fall", 0)
    a["threshold"][here] = r["vth"] * 64
    a["bias"][here] = r["bias_mant"] << r["bias_exp"]
    a["refractory"][here] = r["refractory"] - 1


def _current(cells: FixedPopulation, name: str, states: Mapping[str, NDArray[np.int32]]) -> Floats:
    """A compartment has one current: what is above 0 is excitatory."""
    kept = np.maximum(states["u"], 0) if name == "I_syn_ex" else np.minimum(states["u"], 0)
    current: Floats = kept / cells.ampere[0]
    return current


def _units(cells: FixedPopulation, name: str, values: Floats) -> Floats:
    units: Floats = values * cells.ampere[name == "I_syn_in"]
    return units


def _bias(cells: FixedPopulation, current: Floats) -> NDArray[np.int32]:
    r = cells.registers
    mantissas = r["bias_mant"] + np.rint(current * cells.drive / 2.0 ** r["bias_exp"]).astype(np.int64)
    if mantissas.min() < -4096 or mantissas.max() > 4095:
        raise ModelError(
            f"population '{cells.name}': a current of {np.abs(current).max():g} pA overflows the bias register",
            hint="describe the dc_generator with its largest amplitude: the scale leaves room for it",
        )
    value: NDArray[np.int32] = (mantissas << r["bias_exp"]).astype(np.int32)
    return value


def _words(wires: FixedProjection, mantissas: Words) -> Words:
    return word(mantissas, wires.exponent, wires.bits, wires.sign_mode == "mixed")


def _way_out(cells: FixedPopulation) -> str:
    return f"scales={{'{cells.name}': {cells.volt / 4:.4g}}} leaves 4 times the room"


FAMILY = ChipFamily(
    arithmetic=LOIHI,
    steps={KIND: lif},
    receptors=1,
    word=np.int16,
    stands_for={
        **{"V_m": "v", "I_syn_ex": "u", "I_syn_in": "u", "tau_m": "dv", "tau_syn_ex": "du", "tau_syn_in": "du"},
        **{"V_th": "vth", "I_e": "bias_mant", "t_ref": "refractory"},
    },
    states={KIND: ("v", "u")},
    write=_write,
    current=_current,
    units=_units,
    bias=_bias,
    words=_words,
    way_out=_way_out,
)
