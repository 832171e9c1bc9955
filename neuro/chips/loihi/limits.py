"""What a compartment of Loihi cannot be or do: each limit told with what is needed and the way out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from neuro.chips.loihi.scale import BIAS_LARGEST, Described, receives
from neuro.chips.loihi.words import DECAY_STEPS, REFRACTORY_LIMIT, U_LIMIT, V_LIMIT, VTH_LIMIT
from neuro.chips.quantising.inputs import Inputs, refused, too_long, too_short, value_at
from neuro.program.backend import Problem
from neuro.program.program import Population

GENTLE = 1e-6


def lacking(inputs: Inputs) -> list[Problem]:
    """All that a compartment lacks of a population, whatever its scale."""
    return [*_times(inputs), *_potentials(inputs), *_input(inputs)]


def _times(inputs: Inputs) -> Iterator[Problem]:
    """Time constants that 12-bit decays cannot hold, and refractory periods beyond their register."""
    part, h = inputs.part, inputs.program.resolution
    limit = -h / np.log1p(-1.0 / DECAY_STEPS)
    flows = dict(zip(("tau_syn_ex", "tau_syn_in"), receives(inputs), strict=True))
    for name in ("tau_m", "tau_syn_ex", "tau_syn_in"):
        if name in part.parameters and flows.get(name, True):
            yield from too_short(part, name, h)
            yield from too_long(part, name, h, limit, "a 12-bit decay", name == "tau_m")
    at = int(np.argmax(part.parameters["t_ref"]))
    steps = round(value_at(part, "t_ref", at) / h)
    if steps + 1 > REFRACTORY_LIMIT:
        yield refused(
            part.origin,
            f"population '{part.name}': t_ref = {value_at(part, 't_ref', at):g} ms",
            f"it is {steps} steps, and the refractory register holds at most {REFRACTORY_LIMIT - 1}",
            f"use at most {(REFRACTORY_LIMIT - 1) * h:g} ms, or a coarser resolution",
        )


def _potentials(inputs: Inputs) -> Iterator[Problem]:
    """Potentials that a compartment cannot tell apart, or has not."""
    part, p = inputs.part, inputs.part.parameters
    told = f"population '{part.name}'"
    off = np.flatnonzero(np.broadcast_to(p["V_reset"] != p["E_L"], part.size))
    if off.size:
        v_reset, e_l = value_at(part, "V_reset", off[0]), value_at(part, "E_L", off[0])
        yield refused(
            part.origin,
            f"{told}: V_reset = {v_reset:g} mV",
            f"a spike sets the voltage register to 0, which is E_L = {e_l:g} mV",
            f"set V_reset to {e_l:g}, or run on spinnaker",
        )
    below = np.flatnonzero(np.broadcast_to(p["V_th"] <= p["E_L"], part.size))
    if below.size:
        v_th, e_l = value_at(part, "V_th", below[0]), value_at(part, "E_L", below[0])
        yield refused(
            part.origin,
            f"{told}: V_th = {v_th:g} mV",
            f"the threshold register is unsigned, so V_th must be above E_L = {e_l:g} mV",
            "raise V_th or lower E_L, or run on spinnaker",
        )
    if "V_min" in p and np.isfinite(p["V_min"]).any():
        what = f"{told}: V_min = {p['V_min'].max():g} mV"
        yield refused(part.origin, what, "a compartment has no lowest potential", "leave V_min out")


def _input(inputs: Inputs) -> Iterator[Problem]:
    """Input that a compartment does not keep apart, or not keep."""
    part, p = inputs.part, inputs.part.parameters
    told = f"population '{part.name}'"
    if p.get("refractory_input", np.zeros(1)).any():
        what = f"{told}: refractory_input"
        yield refused(part.origin, what, "a compartment loses input while it is refractory", "leave it out")
    if "tau_syn_ex" not in p or not all(receives(inputs)):
        return
    apart = np.flatnonzero(np.broadcast_to(p["tau_syn_ex"] != p["tau_syn_in"], part.size))
    if apart.size:
        ex, inh = value_at(part, "tau_syn_ex", apart[0]), value_at(part, "tau_syn_in", apart[0])
        yield refused(
            part.origin,
            f"{told}: tau_syn_ex = {ex:g} ms and tau_syn_in = {inh:g} ms",
            "a compartment has one current and so one synaptic time constant",
            "use one time constant for both, or run on spinnaker",
        )


def overflows(part: Population, d: Described, volt: float) -> Iterator[Problem]:
    """Registers that a scale overflows: one set by hand, or one kept while parameters change."""
    for what, largest, limit, name in (
        ("V_th - E_L", float(d.distance.max()) / 64.0, VTH_LIMIT, "the 17-bit threshold register"),
        ("the constant current", float(d.drive.max()), BIAS_LARGEST, "the bias register, 4095 x 2^7,"),
        ("V_m at step 0", float(np.abs(d.start).max()), V_LIMIT, "the 24-bit voltage register"),
        ("I_syn at step 0", float(np.abs(d.current).max()), U_LIMIT - 1, "the 24-bit current register"),
    ):
        need = volt * largest
        if need > limit * (1.0 + GENTLE):
            yield refused(
                part.origin,
                f"population '{part.name}': {what} needs {need:.6g} at {volt:.6g} units per mV",
                f"{name} holds at most {limit}",
                f"set its scale to at most {volt * limit / need:.6g}",
            )
