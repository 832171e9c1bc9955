"""Loihi 2's neurons in the engine."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from neuro.chips.loihi2 import LOIHI2, words_of
from neuro.program.program import Ints
from neuro_chip import tables as t
from neuro_chip.families import loihi, loihi2_step
from neuro_chip.families.family import ChipFamily
from neuro_chip.tables import Arrays

_COLUMNS = {
    "reset_interval": t.INTERVAL,
    "reset_offset": t.OFFSET,
    "state_exp": t.STATE_EXP,
    "relu": t.RELU,
    "cum_error": t.CUMULATIVE,
}
"""Registers that all neurons of a population share, and their columns in the table of populations."""


def _write(a: Arrays, row: NDArray[np.int64], here: slice, r: Mapping[str, Ints]) -> None:
    for name, column in _COLUMNS.items():
        row[column] = int(r[name][0]) if name in r else 0
    row[t.INPUT_EXP] = sum(int(r[name][0]) for name in ("spike_exp", "state_exp", "exp") if name in r)
    if "du" in r:
        a["keep_u"][here] = 4095 - r["du"]
        a["keep_v"][here] = 4096 - r["dv"]
        a["threshold"][here] = r["vth_hi" if "vth_hi" in r else "vth"] * 64
        a["v_rest"][here] = r["vth_lo"] * 64 if "vth_lo" in r else 0
        a["bias"][here] = r["bias_mant"] << r["bias_exp"]
        return
    if "cos_decay" in r:
        a["keep_u"][here], a["keep_v"][here] = r["cos_decay"], r["sin_decay"]
        a["threshold"][here] = r["vth"]
        return
    for name, array in (("vth", "threshold"), ("bias", "bias")):
        a[array][here] = r.get(name, 0)


_SIGMA = ("sigma", "act", "residue", "error", "payload")
FAMILY = ChipFamily(
    arithmetic=LOIHI2,
    steps={
        "loihi2_lif": loihi2_step.lif,
        "loihi2_ternary_lif": loihi2_step.ternary_lif,
        "loihi2_rf": loihi2_step.rf,
        "loihi2_rf_iz": loihi2_step.rf_iz,
        "sigma_delta": loihi2_step.sigma_delta,
        "delta_encoder": loihi2_step.delta_encoder,
        "sigma_decoder": loihi2_step.sigma_decoder,
        "graded_vector": loihi2_step.graded_vector,
        "graded_product": loihi2_step.product,
    },
    receptors=1,
    word=np.int32,
    stands_for=loihi.FAMILY.stands_for,
    states={
        "loihi2_lif": ("v", "u"),
        "loihi2_ternary_lif": ("v", "u"),
        "loihi2_rf": ("real", "imag"),
        "loihi2_rf_iz": ("real", "imag"),
        "sigma_delta": _SIGMA,
        "delta_encoder": _SIGMA[1:],
        "sigma_decoder": ("sigma", "payload"),
        "graded_vector": ("payload",),
        "graded_product": ("payload",),
    },
    write=_write,
    current=loihi.FAMILY.current,
    units=loihi.FAMILY.units,
    bias=loihi.FAMILY.bias,
    words=words_of,
    way_out=loihi.FAMILY.way_out,
)
