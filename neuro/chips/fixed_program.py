"""Program in a chip's integers, with a report of rounding errors and of the fill level of input registers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.chips.description import Chip
from neuro.chips.fixed import FixedPopulation, FixedProjection
from neuro.chips.known import arithmetic_of
from neuro.core.tables import aligned
from neuro.program.backend import Problem
from neuro.program.program import Floats, Program

POPULATIONS = ("population", "neurons", "kind", "units per mV", "quantity", "described", "on the chip", "error")
PROJECTIONS = (
    "projection",
    "weights",
    "bits",
    "signs",
    "scale",
    "weight step",
    "delay",
    "become 0",
    "largest error",
    "rms",
)


@dataclass(frozen=True, slots=True, eq=False)
class FixedProgram:
    """A whole program in a chip's integers.

    Attributes:
        chip: the target chip.
        program: the program in floats.
        populations, projections: populations and projections in the order of the program. A projection is None if it
            carries a current or cannot be quantised.
        problems: refusals, and approximations beyond the stated limits.
        notes: tasks of the host, and other remarks.
    """

    chip: Chip
    program: Program
    populations: tuple[FixedPopulation, ...]
    projections: tuple[FixedProjection | None, ...]
    problems: tuple[Problem, ...]
    notes: tuple[str, ...]

    def __str__(self) -> str:
        """Return the report as text."""
        return report(self)

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON."""
        return {
            "chip": self.chip.name,
            "populations": {
                part.name: {
                    "kind": part.kind,
                    "units_per_mV": part.volt,
                    "rounding": {
                        r.quantity: {"unit": r.unit, "wanted": r.exact, "got": r.got, "error": r.error}
                        for r in part.rounding
                    },
                }
                for part in self.populations
            },
            "projections": {
                part.name: {
                    "exponent": part.exponent,
                    "sign_mode": part.sign_mode,
                    "bits": part.bits,
                    "step": float(part.step.max()),
                    "delay": [int(part.delay.min(initial=0)), int(part.delay.max(initial=0))],
                    "saturated": part.rounding.saturated,
                    "zeroed": part.rounding.zeroed,
                    "largest_error": part.rounding.worst,
                    "rms_error": part.rounding.rms,
                }
                for part in self.projections
                if part is not None
            },
            "notes": list(self.notes),
        }


def report(fixed: FixedProgram) -> str:
    """Return the report of quantising a program: a table of populations, a table of projections, and notes."""
    lines = [f"network '{fixed.program.name}' in the integers of {fixed.chip.title}"]
    for head, rows in ((POPULATIONS, _populations(fixed)), (PROJECTIONS, _projections(fixed))):
        if body := list(rows):
            lines += ["", *aligned([head, *body])]
    if fixed.notes:
        lines += ["", "notes", *(f"  - {note}" for note in fixed.notes)]
    return "\n".join(lines)


def _populations(fixed: FixedProgram) -> Iterator[tuple[str, ...]]:
    for part, cells in zip(fixed.program.populations, fixed.populations, strict=True):
        if cells.kind in ("source", "current"):
            continue
        scaled = f"{cells.volt:.6g}" if cells.rounding else "-"
        name_columns = (part.name, f"{part.size:,}", cells.kind, scaled)
        rows = [
            (r.quantity, f"{r.exact:.6g} {r.unit}", f"{r.got:.6g} {r.unit}", _share(r.error, signed=True))
            for r in cells.rounding
        ] or [("-",) * 4]
        for k, row in enumerate(rows):
            yield (*(name_columns if k == 0 else ("",) * 4), *row)


def _projections(fixed: FixedProgram) -> Iterator[tuple[str, ...]]:
    scale_text = arithmetic_of(fixed.chip).scale_text
    for part, wires in zip(fixed.program.projections, fixed.projections, strict=True):
        if wires is None:
            continue
        rounding, described, register = wires.rounding, _range(part.delay), _range(wires.delay)
        yield (
            part.name,
            f"{part.size:,}",
            str(wires.bits),
            wires.sign_mode or "either",
            scale_text(fixed.populations[part.target], wires),
            _range(wires.step),
            described if described == register else f"{described} as {register}",
            _share(rounding.zeroed),
            _share(rounding.worst),
            _share(rounding.rms),
        )


def _range(values: npt.NDArray[Any]) -> str:
    low, high = values.min(), values.max()
    return f"{low:.5g}" if low == high else f"{low:.5g}..{high:.5g}"


def _share(error: float, signed: bool = False) -> str:
    if error == 0.0:
        return "0"
    if abs(error) < 5e-5:
        return "< 0.01%"
    return f"{error:+.2%}" if signed else f"{error:.2%}"


Spikes = Mapping[str, npt.NDArray[np.floating]]


def filled(fixed: FixedProgram, spikes: Spikes) -> dict[str, float]:
    """Return the largest input of each population, over all neurons and steps, as a share of its register's range.

    A share of 1 or more wraps. Weights and delays are those of the present.

    Args:
        fixed: a quantised program.
        spikes: number of spikes of each neuron in each step, shape (recordings, steps, neurons), by population.
            Populations that are left out emit none.

    Returns:
        Shares by population, for populations with incoming spikes; empty on chips whose slots saturate.
    """
    program, arithmetic = fixed.program, arithmetic_of(fixed.chip)
    if arithmetic.receptors == 2:  # slots of such a family saturate
        return {}
    shares = {}
    for target, cells in enumerate(fixed.populations):
        afferent = [k for k, part in enumerate(program.projections) if part.target == target]
        sums = [_sums(fixed, k, wires, spikes) for k in afferent if (wires := fixed.projections[k]) is not None]
        arriving = [words for words in sums if words is not None]
        if arriving:
            shares[cells.name] = arithmetic.filled(cells, np.sum(arriving, axis=0))
    return shares


def _sums(fixed: FixedProgram, index: int, wires: FixedProjection, spikes: Spikes) -> Floats | None:
    """Return the input that a projection adds in each step, shape (recordings, steps, neurons), in words.

    None if its source emits no spikes or the projection has no synapses.
    """
    from scipy.sparse import csr_array

    program = fixed.program
    part = program.projections[index]
    source, target = program.populations[part.source], program.populations[part.target]
    emitted = spikes.get(source.name)
    if emitted is None or not part.size:
        return None
    batch, steps, _ = emitted.shape
    pre, post, indices = program.synapses(index)
    words = np.broadcast_to(wires.words, max(wires.words.size, int(indices.max()) + 1))[indices].astype(np.float64)
    lags = np.broadcast_to(wires.lag, max(wires.lag.size, int(indices.max()) + 1))[indices]
    rows = csr_array(emitted.reshape(batch * steps, -1).astype(np.float64))
    total = np.zeros((batch, steps, target.size))
    for lag in np.unique(lags):
        has_lag = lags == lag
        table = csr_array((words[has_lag], (pre[has_lag], post[has_lag])), shape=(source.size, target.size))
        dense = table.nnz > source.size * target.size // 8
        received = rows @ (table.toarray() if dense else table)
        received = (received if dense else received.toarray()).reshape(batch, steps, -1)
        total[:, lag:] += received[:, : steps - lag]
    return total
