"""The conversion of a quantised program to the arrays of the compiled loop."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.fixed import FixedPopulation, FixedProjection
from neuro.chips.fixed_program import FixedProgram
from neuro.chips.inputs import has_two_inputs, longest_lag
from neuro.chips.known import arithmetic_of
from neuro.core import keyed_random
from neuro.core.clock import NEVER
from neuro.kernels.jit import subkernel
from neuro.model.parts import lateral_reset, local_winners, winner_take_all
from neuro.program.program import Program
from neuro_chip import deliver, loihi2_step, loihi_step, spinnaker_step, tables as t
from neuro_chip.tables import Arrays

FAMILIES = {"loihi": loihi_step, "loihi2": loihi2_step, "spinnaker": spinnaker_step}
"""Module with the integer steps of each family, by the name of its arithmetic. A new family adds a module here."""

STEPS = {kind: step for family in FAMILIES.values() for kind, step in family.STEPS.items()}
"""The integer step of each kind of population (`FixedPopulation.kind`).

step(net, pop, row, step) updates the neurons of a population and sets `fired` for those that reach the threshold.
"""

NUMBERS = {kind: t.STEPPED + place for place, kind in enumerate(STEPS)}
"""The number of each kind in column `KIND` of the table of populations."""


def _dispatch(numbered):
    """Return a function (net, pop, row, step) that runs the step with the number in a population's row.

    The last step has no comparison: it runs for every other number.
    """
    (number, update), *other_pairs = numbered
    if not other_pairs:
        return update
    # A chain of comparisons, because a kernel can hold no table of functions. There are few kinds, and each population
    # passes the chain once per step.
    update_others = _dispatch(other_pairs)

    @subkernel
    def update_by_kind(net, pop, row, step):
        if row[t.KIND] == number:
            update(net, pop, row, step)
        else:
            update_others(net, pop, row, step)

    return update_by_kind


update = _dispatch([(NUMBERS[kind], step) for kind, step in STEPS.items()])

KINDS = {"current": t.CURRENT, "relay": t.RELAY, **NUMBERS}
LAYOUTS = {"one_to_one": t.ONE_TO_ONE, "dense": t.DENSE, "csr": t.CSR, "grid": t.GRID}
STATES = {
    **{"v": "v", "u": "u", "g_exc": "u", "g_inh": "g_inh"},
    **{"real": "v", "imag": "u", "sigma": "v", "act": "u", "residue": "g_inh", "error": "hold", "payload": "payload"},
}
"""Arrays of the loop with the state registers, by the registers' names."""

SPARE_SPIKES = 1 << 20
"""Number of spikes that the record can hold before it is emptied, in addition to the spikes of one step."""


def arrays_of(fixed: FixedProgram) -> Arrays:
    """Return all arrays that the loop reads and writes, by the names of `net`."""
    program = fixed.program
    a: Arrays = {}
    _populations(a, fixed)
    _projections(a, fixed)
    total = int(a["pops"][-1, t.END])
    n_pops = len(program.populations)
    for name in ("v", "u", "g_inh", "hold", "keep_u", "keep_v", "threshold", "bias", "v_reset", "fall", "refractory"):
        a[name] = np.zeros(total, dtype=np.int32)
    for name in ("v_rest", "r_m"):
        a[name] = np.zeros(total, dtype=np.int32)
    for name in ("exc_decay", "exc_init", "inh_decay", "inh_init"):
        a[name] = np.zeros(total, dtype=np.int64)
    a["still"], a["resting"] = np.zeros((4, total), dtype=np.int32), np.zeros(n_pops, dtype=np.uint8)
    a["payload"] = np.zeros(total, dtype=np.int32)
    a["fired"], a["muted"] = np.zeros(total, dtype=np.uint8), np.zeros(total, dtype=np.uint8)
    a["first"] = np.full(total, NEVER, dtype=np.int64)
    a["events"], a["spikes"] = np.zeros(total, dtype=np.int64), np.zeros(total, dtype=np.int64)
    a["active"] = np.zeros(n_pops, dtype=np.int64)
    a["native"] = np.zeros((n_pops, t.NATIVE_COLUMNS), dtype=np.int64)
    a["potential"] = np.zeros(total, dtype=np.int32)
    a["set_out"] = np.zeros(len(program.projections), dtype=np.int64)
    a["emitted"], a["emitted_times"] = np.zeros(total, dtype=np.int64), np.zeros(total, dtype=np.int64)
    a["keys"] = _keys(program, "poisson", [p.name for p in program.populations])
    a["group_keys"] = _keys(program, "tie", [g.name for g in program.groups])
    a["mean"], a["nothing"] = np.zeros(total), np.ones(total)
    capacity = total + min(SPARE_SPIKES, 64 * total + 1024)
    for name in ("rec_steps", "rec_ids", "rec_counts"):
        a[name] = np.zeros(capacity, dtype=np.int64)
    a["clock"] = np.zeros(t.CLOCK_COLUMNS, dtype=np.int64)
    a["clock"][t.STOP_GROUP] = t.NONE
    a["stop"] = np.zeros(1, dtype=np.int64)
    _groups(a, program)
    for k, part in enumerate(fixed.populations):
        write_registers(a, fixed, k, part)
    return a


def _groups(a: Arrays, program: Program) -> None:
    """Add the tables of groups: the rule of competition of each, and arrays for winners."""
    n, shapes = len(program.groups), [program.populations[group.population].shape for group in program.groups]
    has_several = any(group.choice.several for group in program.groups)
    a["groups"] = np.zeros((n, t.GROUP_COLUMNS), dtype=np.int64)
    a["groups"][:, t.WINNER] = t.NONE
    a["local"] = np.full((n, 5), t.NONE, dtype=np.int64)
    a["standing"] = np.zeros((n, 2), dtype=np.int64)
    a["map_wins"] = np.zeros((n, max((shape[0] for shape in shapes), default=0)), dtype=np.int64)
    a["won"] = np.zeros((a["v"].size if has_several else 0, 2), dtype=np.int64)
    for k, (group, shape) in enumerate(zip(program.groups, shapes, strict=True)):
        a["pops"][group.population, t.GROUP] = k
        a["groups"][k, t.POPULATION] = group.population
        match group.choice:
            case winner_take_all(first_to_fire=once):
                a["groups"][k, t.FIRST_TO_FIRE] = once
            case lateral_reset(axis=axis):
                a["groups"][k, [t.RIVALS, t.APART]] = shape[axis], math.prod(shape[axis + 1 :])
            case local_winners(radius=radius, per_map=per_map):
                a["local"][k] = radius, per_map or 0, *shape
                a["standing"][k, t.OPEN] = math.prod(shape)


def _keys(program: Program, purpose: str, names: list[str]) -> NDArray[np.uint64]:
    return np.array([keyed_random.key(program.seed, purpose, name) for name in names], dtype=np.uint64)


def slots_of(fixed: FixedProgram, target: int) -> int:
    """Return the number of slots of a population's ring: a power of two above the longest lag of its input."""
    lags = [
        int(longest_lag(fixed.program, index).max(initial=1))
        for index, (wires, part) in enumerate(zip(fixed.projections, fixed.program.projections, strict=True))
        if wires is not None and part.target == target
    ]
    return 1 << (max(lags, default=1)).bit_length()


def _extra_steps(fixed: FixedProgram, target: int) -> int:
    """Return the steps by which input acts later than its delay: 1 for `iaf_psc_exp`, else 0."""
    return max(
        (
            int((wires.lag - part.delay).max(initial=0))
            for wires, part in zip(fixed.projections, fixed.program.projections, strict=True)
            if wires is not None and part.target == target
        ),
        default=0,
    )


def _populations(a: Arrays, fixed: FixedProgram) -> None:
    program = fixed.program
    pops = np.zeros((len(program.populations), t.POPULATION_COLUMNS), dtype=np.int64)
    arithmetic = arithmetic_of(fixed.chip)
    at = ring = arrived = 0
    planes: list[tuple[int, int, int, int]] = []
    for k, (part, cells) in enumerate(zip(program.populations, fixed.populations, strict=True)):
        generator = t.POISSON if part.kind == "poisson" else t.LISTED
        kind = KINDS.get(cells.kind, generator)
        pops[k, [t.KIND, t.BEGIN, t.END]] = kind, at, at + part.size
        pops[k, [t.RECORD, t.GROUP, t.START, t.STOP]] = part.records, t.NONE, part.start, part.stop
        pops[k, [t.BINARY, t.RECEPTORS]] = arithmetic.one_bit, arithmetic.receptors if kind >= t.STEPPED else 1
        pops[k, t.GRADED] = part.model.graded or getattr(part.model, "resets_in_step", False)
        at += part.size
        if kind >= t.RELAY:
            slots = slots_of(fixed, k)
            pops[k, [t.RING, t.SLOTS, t.ARRIVED, t.LATE]] = ring, slots, arrived, _extra_steps(fixed, k)
            # A relay needs one ring, but has two, so that snapshots of earlier versions fit.
            ring += slots * part.size * (2 if kind == t.RELAY else arithmetic.receptors)
            arrived += slots
            pops[k, t.PLANES] = len(planes)
            second_input = [(0, 0, 1)] if _has_second_input(fixed, k) else []
            own_planes = [wires for wires in _with_planes(fixed, k) for _ in _plane_lags(wires)]
            for plane in (*second_input, *((wires.shift, wires.wraps, wires.receptor) for wires in own_planes)):
                planes.append((ring, *plane))
                ring += slots * part.size
            pops[k, t.PLANES_END] = len(planes)
    a["pops"], a["planes"] = pops, np.array(planes, dtype=np.int64).reshape(-1, t.PLANE_COLUMNS)
    a["ring"], a["arrived"] = np.zeros(ring + at, dtype=np.int32), np.zeros(ring + at, dtype=np.uint8)
    a["arrived_all"], a["came"] = np.zeros(arrived, dtype=np.uint8), np.zeros(arrived, dtype=np.uint8)


def _with_planes(fixed: FixedProgram, target: int) -> list[FixedProjection]:
    """Return the projections onto a population whose sums are shifted or wrapped before other sums are added."""
    projections = zip(fixed.projections, fixed.program.projections, strict=True)
    incoming = [wires for wires, part in projections if wires is not None and part.target == target]
    return [wires for wires in incoming if wires.sums_apart]


def _has_second_input(fixed: FixedProgram, target: int) -> bool:
    """Return whether a population has a second input, which uses the first plane."""
    return arithmetic_of(fixed.chip).receptors == 1 and has_two_inputs(fixed.program.populations[target].model)


def _plane_lags(wires: FixedProjection) -> range:
    """Return the lags of a projection, each of which has its own plane: only spikes of one step share a sum."""
    lags = wires.lag if wires.lag.size else np.ones(1, dtype=np.int32)
    return range(int(lags.min()), int(lags.max()) + 1)


def _projections(a: Arrays, fixed: FixedProgram) -> None:
    program = fixed.program
    table = np.zeros((len(program.projections), t.PROJECTION_COLUMNS), dtype=np.int64)
    kind = arithmetic_of(fixed.chip).word
    lists: dict[str, list[NDArray[Any]]] = {name: [] for name in ("words", "lags", "rows", "targets")}
    kinds = {"words": kind, "lags": np.int32, "rows": np.int64, "targets": np.int32}
    at = dict.fromkeys(lists, 0)
    for q, (part, wires) in enumerate(zip(program.projections, fixed.projections, strict=True)):
        table[q, [t.SOURCE, t.TARGET]] = part.source, part.target
        if wires is None:
            continue
        part_words = wires.words if not part.synapse.learns else np.broadcast_to(wires.words, part.size)
        layout, row_ends, targets = _layout(program, q, wires.lag.size > 1)
        if (layout == t.CSR and part_words.size > 1) or part.synapse.learns:
            part_words = np.broadcast_to(part_words, part.size)
        table[q, t.LAYOUT] = layout
        table[q, [t.WORD, t.WORD_STRIDE]] = at["words"], part_words.size > 1 or part.size == 1
        table[q, [t.LAG, t.LAG_STRIDE]] = at["lags"], wires.lag.size > 1
        table[q, [t.ROW, t.SYNAPSE]] = at["rows"], at["targets"]
        table[q, [t.POSITIVE, t.NEGATIVE]] = bool(np.any(part_words > 0)), bool(np.any(part_words < 0))
        arrays: dict[str, NDArray[Any]] = {"words": part_words, "lags": wires.lag, "rows": row_ends, "targets": targets}
        for name, array in arrays.items():
            lists[name].append(array)
            at[name] += array.size
        if (g := part.grid) is not None:
            row = table[q]
            row[[t.CHANNEL_HEIGHT, t.CHANNEL_WIDTH]] = g.height, g.width
            row[[t.ROWS, t.COLUMNS]] = g.rows, g.columns
            row[[t.DEPTH, t.KERNEL_HEIGHT, t.KERNEL_WIDTH]] = g.kernels[1:]
            row[[t.STRIDE, t.TOP, t.LEFT, t.REACH, t.MAPS]] = g.stride, g.top, g.left, g.reach, g.maps
        if wires.sums_apart:
            target, with_planes = a["pops"][part.target], _with_planes(fixed, part.target)
            plane = (
                target[t.PLANES]
                + _has_second_input(fixed, part.target)
                + sum(len(_plane_lags(plane_wires)) for plane_wires in with_planes[: with_planes.index(wires)])
            )
            table[q, t.PLANE] = a["planes"][plane, t.PLANE_RING] - target[t.RING]
            table[q, t.PLANE_STRIDE] = target[t.SLOTS] * (target[t.END] - target[t.BEGIN])
            table[q, t.FIRST_LAG] = _plane_lags(wires)[0]
    a["projections"] = table
    a |= {name: _joined(parts, kinds[name]) for name, parts in lists.items()}
    if any(part.grid is not None for part in program.projections):
        deliver.lay_out(a, program)
    else:
        table[:, t.GATHER] = t.NONE
        a["kernels"], a["gathered"] = np.zeros(0, dtype=kind), np.zeros(0, dtype=np.int32)
        a["marked"] = np.zeros(0, dtype=np.uint8)
    spiking = [q for q, wires in enumerate(fixed.projections) if wires is not None]
    projections_of = [[q for q in spiking if table[q, t.SOURCE] == k] for k in range(len(program.populations))]
    a["out"] = np.array([q for group in projections_of for q in group], dtype=np.int64)
    a["out_ends"] = np.concatenate(([0], np.cumsum([len(group) for group in projections_of]))).astype(np.int64)


def _joined(parts: list[NDArray[Any]], kind: Any) -> NDArray[Any]:
    """Concatenate and convert arrays in one pass, because there can be hundreds of millions of synapses."""
    joined = np.zeros(sum(part.size for part in parts), dtype=kind)
    at = 0
    for part in parts:
        joined[at : at + part.size] = part
        at += part.size
    return joined


_NO_IDS = np.zeros(0, dtype=np.int32)
_NO_ROWS = np.zeros(0, dtype=np.int64)


def _layout(program: Program, q: int, own_lags: bool) -> tuple[int, NDArray[np.int64], NDArray[np.int32]]:
    """Return layout, row ends and targets of a projection; dense rows with a lag per synapse become CSR."""
    part = program.projections[q]
    if part.layout == "csr":
        return t.CSR, part.row_ends, part.targets
    if part.layout == "dense" and own_lags:
        n_source, n_target = program.populations[part.source].size, program.populations[part.target].size
        targets = np.tile(np.arange(n_target, dtype=np.int32), n_source)
        return t.CSR, np.arange(n_source + 1, dtype=np.int64) * n_target, targets
    return LAYOUTS[part.layout], _NO_ROWS, _NO_IDS


def write_registers(a: Arrays, fixed: FixedProgram, k: int, part: FixedPopulation) -> None:
    """Write the registers of a population to the arrays of the loop."""
    row = a["pops"][k]
    if row[t.KIND] >= t.STEPPED:
        FAMILIES[fixed.chip.arithmetic].write(a, row, slice(row[t.BEGIN], row[t.END]), part.registers)


def write_states(a: Arrays, k: int, part: FixedPopulation) -> None:
    """Write the initial state registers of a population to the arrays of the loop."""
    neurons = slice(a["pops"][k, t.BEGIN], a["pops"][k, t.END])
    for name, array in STATES.items():
        if name in part.initial:
            a[array][neurons] = part.initial[name]
