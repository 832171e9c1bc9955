"""Maps of chips: tiles and cores, coloured by how full they are."""

from __future__ import annotations

import math

from neuro.chips.description import Chip, Mesh
from neuro.chips.placing.mesh import mesh_of
from neuro.chips.placing.placement import Core, Placement
from neuro.core import html
from neuro.core.html import Html, tag

CORE, TILE_GAP, CHIP_GAP = 24.0, 7.0, 26.0
_HEAD = 20.0
MOST_CHIPS, MOST_ROWS = 48, 200
CORE_COLUMNS = (">chip", ">tile", ">core", "holds", ">neurons", ">bytes", ">fullest")
LIMITS = {
    "neurons_per_core": "neurons",
    "synapse_bytes_per_core": "synaptic memory",
    "axons_in_per_core": "axons in",
    "axons_out_per_core": "axons out",
}


def chip_map(placement: Placement, chip: Chip) -> Html:
    """All chips in use, as they lie; pointing at a core tells what it holds."""
    mesh = mesh_of(chip, len(placement.cores))
    numbers = sorted({core.chip for core in placement.cores})[:MOST_CHIPS]
    cores = [core for core in placement.cores if core.chip in numbers]
    side = math.ceil(math.sqrt(mesh.cores_per_tile))
    width, height = _tile(side) * mesh.columns + TILE_GAP, _tile(_rows(mesh, side)) * mesh.rows + TILE_GAP
    corner = {core.chip: (core.column // mesh.columns, core.row // mesh.rows) for core in cores}
    parts: list[object] = []
    for number, (column, row) in sorted(corner.items()):
        x, y = column * (width + CHIP_GAP), row * (height + CHIP_GAP + _HEAD)
        parts.append(html.text(x + 2, y + 13, f"chip {number}", "tick"))
        parts.append(_chip(mesh, side, x, y + _HEAD, width, height))
    parts += [_core(placement, mesh, side, core, width, height) for core in cores]
    across = (1 + max((column for column, _ in corner.values()), default=0)) * (width + CHIP_GAP) - CHIP_GAP
    down = (1 + max((row for _, row in corner.values()), default=0)) * (height + CHIP_GAP + _HEAD) - CHIP_GAP
    label = f"map of {placement.chips_used} chips of {chip.title}"
    drawing = html.svg(across + 2, down + 2, *parts, label=label, class_="map")
    return html.join([html.figure(html.join([_scale(), drawing]), _caption(placement, chip, mesh)), _list(placement)])


def _list(placement: Placement) -> Html:
    """The cores as a table, for paper and for those who cannot point."""
    rows = [
        (*_place(core), held(placement, core), f"{core.neurons:,}", f"{core.synapse_bytes:,}", _full(core))
        for core in placement.cores[:MOST_ROWS]
    ]
    rest = len(placement.cores) - len(rows)
    told = tag("p", f"and {rest:,} more") if rest else None
    return tag("details", tag("summary", "Cores"), html.table(CORE_COLUMNS, rows), told)


def _place(core: Core) -> tuple[str, str, str]:
    return f"{core.chip}", f"{core.column},{core.row}", f"{core.slot}"


def _full(core: Core) -> str:
    name, share = max(core.load.items(), key=lambda pair: pair[1], default=("", 0.0))
    return f"{share:.0%} {LIMITS.get(name, name)}" if name else "-"


def _tile(cores: int) -> float:
    return cores * CORE + TILE_GAP


def _rows(mesh: Mesh, side: int) -> int:
    return math.ceil(mesh.cores_per_tile / side)


def _chip(mesh: Mesh, side: int, x: float, y: float, width: float, height: float) -> Html:
    """The outline of a chip and its empty cores."""
    cells = [
        _spot(mesh, side, column, row, slot)
        for row in range(mesh.rows)
        for column in range(mesh.columns)
        for slot in range(mesh.cores_per_tile)
    ]
    n = CORE - 2
    path = "".join(f"M{x + left:.0f} {y + top:.0f}h{n:.0f}v{n:.0f}h-{n:.0f}z" for left, top in cells)
    outline = tag("rect", x=x + 1, y=y + 1, width=width, height=height, rx=4, class_="chip")
    return html.join([outline, tag("path", d=path, class_="empty")])


def _spot(mesh: Mesh, side: int, column: int, row: int, slot: int) -> tuple[float, float]:
    """Where a core lies on its chip."""
    left = TILE_GAP + column * _tile(side) + (slot % side) * CORE
    return left + 1, TILE_GAP + row * _tile(_rows(mesh, side)) + (slot // side) * CORE + 1


def _core(placement: Placement, mesh: Mesh, side: int, core: Core, width: float, height: float) -> Html:
    left, top = _spot(mesh, side, core.column % mesh.columns, core.row % mesh.rows, core.slot)
    x = core.column // mesh.columns * (width + CHIP_GAP) + left
    y = core.row // mesh.rows * (height + CHIP_GAP + _HEAD) + _HEAD + top
    load = max(core.load.values(), default=0.0)
    kind = "core over" if load > 1.0 else "core"
    return html.box(x, y, CORE - 2, CORE - 2, kind, title(placement, core), 0.18 + 0.82 * min(load, 1.0))


def held(placement: Placement, core: Core) -> str:
    """The populations on a core, and which of their neurons."""
    return ", ".join(f"{placement.populations[p]}[{first}:{last}]" for p, first, last in core.parts)


def title(placement: Placement, core: Core) -> str:
    """What a core holds, and how full it is."""
    loads = ", ".join(f"{LIMITS.get(name, name)} {share:.0%}" for name, share in core.load.items())
    place = "chip {}, tile {}, core {}".format(*_place(core))
    size = f"{core.neurons:,} neuron{'s' * (core.neurons != 1)}, {core.synapse_bytes:,} bytes of synapses"
    return f"{place}\n{held(placement, core)}\n{size}\n{loads}"


def _scale() -> Html:
    steps = (html.box(i * 15.0, 0, 14, 10, "core", "", 0.18 + 0.82 * i / 7) for i in range(8))
    drawing = html.svg(120, 10, *steps, label="from empty to full")
    words = ("empty", drawing, "full, by the limit that is closest")
    return tag("p", *(part if isinstance(part, Html) else tag("span", part) for part in words), class_="scale")


def _caption(placement: Placement, chip: Chip, mesh: Mesh) -> str:
    fullest = max(placement.cores, key=lambda core: max(core.load.values(), default=0.0), default=None)
    most = mesh.columns * mesh.rows * mesh.cores_per_tile
    told = [
        f"{len(placement.cores):,} of {most * placement.chips_used:,} cores on {placement.chips_used:,} "
        f"chip{'s' * (placement.chips_used != 1)} of {chip.title}",
        f"{placement.synapse_bytes:,} bytes of synapses",
        f"{placement.total_hops:,} hops if every source spikes once",
    ]
    if fullest is not None and fullest.load:
        name, share = max(fullest.load.items(), key=lambda pair: pair[1])
        told.append(f"the fullest core uses {share:.0%} of its {LIMITS.get(name, name)}")
    if placement.chips_used > MOST_CHIPS:
        told.append(f"{MOST_CHIPS} chips are drawn")
    return "; ".join(told) + ". Pointing at a core tells what it holds."
