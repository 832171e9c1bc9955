"""Placements of random networks beside a slow count, synapse by synapse."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
from hypothesis import given, settings, strategies as st

import neuro
from neuro.chips import place
from neuro.chips.description import Mesh
from neuro.chips.incoming import synapse_bits
from neuro.compiler import compile_network
from neuro.model.neurons import Neuron
from to_place import limited

SMALL = {
    "neurons_per_core": st.sampled_from([None, 1, 3, 8]),
    "populations_per_core": st.sampled_from([None, 1, 2]),
    "synapse_bytes_per_core": st.sampled_from([None, 24, 64, 200]),
    "synapse_bytes_per_chip": st.sampled_from([None, 150, 400]),
    "axons_in_per_core": st.sampled_from([None, 3, 9]),
    "axons_out_per_core": st.sampled_from([None, 4, 20]),
    "cores_per_chip": st.sampled_from([None, 3, 8]),
}


@st.composite
def programs(draw):
    net = neuro.Network("drawn", resolution=1.0)
    models = {
        "g": neuro.spike_generator(),
        "p": neuro.iaf_psc_delta(),
        "q": neuro.iaf_psc_exp(),
        "r": neuro.parrot_neuron(),
    }
    sizes = {name: draw(st.integers(1, 9)) for name in models}
    for name, model in models.items():
        net.population(name, sizes[name], model)
    if draw(st.booleans()):
        net.population("eye", (2, 4, 3), neuro.spike_generator())
        net.population("map", (2, "auto", "auto"), neuro.iaf_psc_delta())
        rule = neuro.grid((2, 2), stride=draw(st.integers(1, 2)), padding=draw(st.integers(0, 1)))
        net.connect("eye", "map", rule, weight=1.0, delay=1.0)
    for number in range(draw(st.integers(0, 4))):
        source, target = draw(st.sampled_from("gpqr")), draw(st.sampled_from("pqr"))
        n = draw(st.integers(1, 12))
        ids = [np.array(draw(st.lists(st.integers(0, sizes[x] - 1), min_size=n, max_size=n))) for x in (source, target)]
        rule = draw(st.sampled_from([neuro.all_to_all(), neuro.pairs(*ids)]))
        delay = float(draw(st.integers(1, 5)))
        synapse = draw(st.sampled_from([neuro.static(), neuro.stdp()]))
        net.connect(source, target, rule, synapse, weight=1.0, delay=delay, name=f"c{number}")
    return compile_network(net, 0)


def synapses_of(program, index):
    """(source, target) of every synapse, one by one."""
    g = program.projections[index].grid
    if g is None:
        return list(zip(*(ids.tolist() for ids in program.connections(index)), strict=True))
    found = []
    for m, r, c, k in np.ndindex(g.maps, g.rows, g.columns, g.channels):
        for i, j in np.ndindex(g.kernel_height, g.kernel_width):
            y, x = r * g.stride + i - g.top, c * g.stride + j - g.left
            if 0 <= y < g.height and 0 <= x < g.width:
                found.append(((k * g.height + y) * g.width + x, (m * g.rows + r) * g.columns + c))
    return found


def bytes_of(program, target, size, counts):
    """Bytes of one core from {(projection, source): synapses}."""
    total = 0
    if target.arithmetic == "spinnaker":
        for index in {index for index, _ in counts}:
            longest = max(n for (i, _), n in counts.items() if i == index)
            synapse = program.projections[index].synapse
            words = longest
            if synapse.learns == "pairs" and not synapse.delays:
                taught, triplets = synapse.name == "stdp_dopa", synapse.name == "stdp_triplet"
                words = math.ceil(((8 if taught or triplets else 6) + (4 if taught else 2) * longest) / 4)
                words += math.ceil(2 * longest / 4)
            total += program.populations[program.projections[index].source].size * (3 + words) * 4
        return total
    index_width = 0 if size == 1 else max(6, math.ceil(math.log2(size)))
    for (index, _), n in counts.items():
        while n:
            block = min(n, 64)
            total += math.ceil((block * (synapse_bits(program, index) + index_width) + 10) / 64) * 8
            n -= block
    return total


MESHES = st.sampled_from([Mesh(2, 2, 2), Mesh(1, 1, 2), Mesh(3, 1, 1)])


@settings(max_examples=60, deadline=None)
@given(
    programs(),
    st.fixed_dictionaries(SMALL),
    st.sampled_from(["loihi", "spinnaker"]),
    st.sampled_from(["connected", "declared"]),
    MESHES,
)
def test_against_a_slow_count(program, limits, arithmetic, order, mesh):
    target = replace(limited(**limits, mesh=mesh), arithmetic=arithmetic)
    placed = place(program, target, order=order)
    refused = {problem.what.split("'")[1] for problem in placed.problems}
    cores, where = placed.cores, placed.core_of

    for p, part in enumerate(program.populations):
        held = sorted((i, c) for c, core in enumerate(cores) for q, a, b in core.parts if q == p for i in range(a, b))
        expected = list(enumerate(where[p])) if isinstance(part.model, Neuron) else []
        assert held == expected, "every neuron is on one core, that of core_of"
    assert len({(core.chip, core.column, core.row, core.slot) for core in cores}) == len(cores), (
        "no place is used twice"
    )

    counts = [Counter() for _ in cores]
    reached = {}
    for index, part in enumerate(program.projections):
        for source, end in synapses_of(program, index):
            core = int(where[part.target][end])
            counts[core][index, source] += 1
            reached.setdefault((part.source, source), {}).setdefault(core, index)
    for c, core in enumerate(cores):
        names = {program.populations[p].name for p, _, _ in core.parts}
        assert core.neurons == sum(b - a for _, a, b in core.parts)
        assert core.synapse_bytes == bytes_of(program, target, core.neurons, counts[c])
        assert core.axons_in == sum(c in to for to in reached.values())
        assert core.axons_out == sum(len(to) for (p, i), to in reached.items() if where[p][i] == c)
        own = {
            "neurons_per_core": core.neurons,
            "populations_per_core": len(names),
            "axons_in_per_core": core.axons_in,
            "axons_out_per_core": core.axons_out,
            "synapse_bytes_per_core": core.synapse_bytes,
        }
        over = [name for name, value in own.items() if limits[name] is not None and value > limits[name]]
        assert not over or (core.neurons == 1 and names <= refused), "no limit is exceeded unless it is told"

    for chip_number in {core.chip for core in cores}:
        here = [core for core in cores if core.chip == chip_number]
        assert len(here) <= min(limits["cores_per_chip"] or 8, mesh.columns * mesh.rows * mesh.cores_per_tile)
        shared = limits["synapse_bytes_per_chip"]
        assert shared is None or sum(core.synapse_bytes for core in here) <= shared or len(here) == 1

    check_hops(program, placed, reached, arithmetic == "spinnaker", mesh)


def check_hops(program, placed, reached, multicast, mesh):
    """Links one by one: along the row first, then along the column."""
    w, h = mesh.columns, mesh.rows
    found = Counter()
    for (p, i), to in reached.items():
        own = placed.core_of[p][i]
        begin = (placed.cores[own].column, placed.cores[own].row) if own >= 0 else (0, 0)
        used = set()
        for core, index in sorted(to.items(), key=lambda item: item[1]):
            end = (placed.cores[core].column, placed.cores[core].row)
            x, y = begin
            found[index, "cores", i] += 1
            found[index, "local", i] += begin == end
            while (x, y) != end:
                step = (x + (1 if end[0] > x else -1), y) if x != end[0] else (x, y + (1 if end[1] > y else -1))
                link = (x, y), step
                if not (multicast and link in used):
                    found[index, "east_west" if step[1] == y else "north_south", i] += 1
                    found[index, "chip", i] += (x // w, y // h) != (step[0] // w, step[1] // h)
                used.add(link)
                x, y = step
    for index, part in enumerate(program.projections):
        for name in ("cores", "local", "east_west", "north_south", "chip"):
            values = getattr(placed.hops(index), name)
            expected = [found[index, name, i] for i in range(program.populations[part.source].size)]
            assert values.dtype == np.int64
            assert values.tolist() == expected, (part.name, name)


@settings(max_examples=15, deadline=None)
@given(programs(), st.integers(1, 4))
def test_connected_is_never_longer(program, most):
    target = limited(mesh=Mesh(3, 2, 1), cores_per_chip=6)
    close, declared = (place(program, target, order=o, neurons_per_core=most) for o in ("connected", "declared"))
    assert (close.chips_used, close.total_hops) <= (declared.chips_used, declared.total_hops)
