"""SpiNNaker 1's neurons in the engine."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection, Words
from neuro.chips.spinnaker import DELTA, LARGEST, LARGEST_SHIFT, LIF, SPINNAKER
from neuro.core.errors import ModelError
from neuro.program.program import Floats, Ints
from neuro_chip import tables as t
from neuro_chip.families.family import ChipFamily
from neuro_chip.families.spinnaker_step import delta, lif
from neuro_chip.tables import Arrays

_SLOW_DECAYS = ("exc_decay", "exc_init", "inh_decay", "inh_init")


def _write(a: Arrays, row: NDArray[np.int64], here: slice, r: Mapping[str, Ints]) -> None:
    a["keep_v"][here] = r["exp_tc"]
    row[t.LOWEST] = int(r["v_min"][0]) if "v_min" in r else -(2**31) + 1
    a["fall"][here] = r.get("fall", 0)
    a["threshold"][here] = r["v_thresh"]
    a["bias"][here] = r["i_offset"]
    a["refractory"][here] = r["t_refract"]
    a["v_reset"][here], a["v_rest"][here] = r["v_reset"], r["v_rest"]
    row[t.EXC_SHIFT], row[t.INH_SHIFT] = r["exc_shift"][0], r["inh_shift"][0]
    for name in ("r_m", *_SLOW_DECAYS):
        if name in r:
            a[name][here] = r[name]


def _current(cells: FixedPopulation, name: str, states: Mapping[str, NDArray[np.int32]]) -> Floats:
    if name == "I_syn_ex":
        return states["g_exc"] / cells.ampere[0]
    return -states["g_inh"] / cells.ampere[1]


def _units(cells: FixedPopulation, name: str, values: Floats) -> Floats:
    """The inhibitory register holds what is taken away."""
    return values * cells.ampere[0] if name == "I_syn_ex" else -values * cells.ampere[1]


def _bias(cells: FixedPopulation, current: Floats) -> NDArray[np.int32]:
    offset = cells.registers["i_offset"] + np.rint(current * cells.drive).astype(np.int64)
    if np.abs(offset).max() > LARGEST:
        raise ModelError(
            f"population '{cells.name}': a current of {np.abs(current).max():g} pA overflows the offset register",
            hint="lower the amplitude of the dc_generator",
        )
    return offset.astype(np.int32)


def _words(wires: FixedProjection, mantissas: Words) -> Words:
    return mantissas


def _way_out(cells: FixedPopulation) -> str:
    if "exc_shift" not in cells.registers:
        return ""
    shifts = tuple(min(LARGEST_SHIFT, int(cells.registers[f"{word}_shift"][0]) + 2) for word in ("exc", "inh"))
    return f"shifts={{'{cells.name}': {shifts}}} leaves 4 times the room"


FAMILY = ChipFamily(
    arithmetic=SPINNAKER,
    steps={LIF: lif, DELTA: delta},
    receptors=2,
    word=np.int32,
    stands_for={
        **{"V_m": "v", "I_syn_ex": "g_exc", "I_syn_in": "g_inh", "tau_m": "exp_tc", "V_th": "v_thresh"},
        **{"tau_syn_ex": "exc_decay", "tau_syn_in": "inh_decay", "I_e": "i_offset", "t_ref": "t_refract"},
        **{"E_L": "v_rest", "V_reset": "v_reset", "C_m": "r_m"},
    },
    states={LIF: ("v", "g_exc", "g_inh"), DELTA: ("v",)},
    write=_write,
    current=_current,
    units=_units,
    bias=_bias,
    words=_words,
    way_out=_way_out,
)
