"""Grids by channel, of the same size, and over several threads; groups in which a spike resets its rivals."""

import numpy as np
import pytest

import neuro
from neuro.chips import chip, quantise
from neuro.compiler import compile_network
from refused import error_of

PLAIN = {"E_L": 0.0, "V_reset": 0.0}


def sheet_onto(maps, rule, weight=1.0, shape=(2, 5, 7), resolution=1.0):
    net = neuro.Network("sheets", resolution=resolution)
    net.population("sheet", shape, neuro.poisson_generator(rate=60.0))
    net.population("maps", (maps, "auto", "auto"), neuro.iaf_psc_delta(**PLAIN, V_th=4.0))
    net.connect("sheet", "maps", rule, weight=weight, name="kernels")
    return net


def spelt_out(program):
    """(source, target, weight) of every synapse of the first projection."""
    source, target, slot = program.synapses(0)
    weight = np.broadcast_to(program.projections[0].weight, program.projections[0].size)
    return {(int(i), int(j)): float(weight[k]) for i, j, k in zip(source, target, slot, strict=True)}


@pytest.mark.parametrize("height", [5, 8, 34])
@pytest.mark.parametrize(("kernel", "stride"), [(1, 1), (4, 1), (7, 1), (4, 4), (3, 2), (2, 5)])
def test_same_keeps_the_size_and_spreads_the_border(height, kernel, stride):
    """As by TensorFlow: ceil(n / stride) places, and of the border that they need the odd line at the end."""
    rule = neuro.grid(kernel=(kernel, 1), stride=stride, padding="same")
    program, rows = compile_network(sheet_onto(1, rule, shape=(height, 1)), 0), -(-height // stride)
    border = max((rows - 1) * stride + kernel - height, 0)
    assert program.populations[1].shape == (1, rows, 1)
    first = np.arange(rows) * stride - border // 2
    expected = {(y, r) for r in range(rows) for y in range(first[r], first[r] + kernel) if 0 <= y < height}
    assert set(spelt_out(program)) == expected


def test_by_channel_a_map_sees_one_channel():
    kernels = np.arange(1.0, 37.0).reshape(4, 1, 3, 3)
    program = compile_network(sheet_onto(4, neuro.grid(kernel=(3, 3), depthwise=True), kernels), 0)
    found = spelt_out(program)
    expected = {
        ((m // 2 * 5 + r + i) * 7 + c + j, (m * 3 + r) * 5 + c): kernels[m, 0, i, j]
        for m in range(4) for r in range(3) for c in range(5) for i in range(3) for j in range(3)
    }  # fmt: skip
    assert found == expected
    sim = neuro.compile(sheet_onto(4, neuro.grid(kernel=(3, 3), depthwise=True), kernels[:, 0]))
    np.testing.assert_array_equal(sim.weights("kernels"), kernels)


@pytest.mark.parametrize("depthwise", [False, True])
@pytest.mark.parametrize("shape", [(2, 30, 30), (2, 60, 11)])
def test_threads_do_not_matter_to_a_large_grid(shape, depthwise):
    """More neurons than one thread takes as a whole; also where a spike marks only the blocks that it reaches."""
    rule = neuro.grid(kernel=(5, 5), padding="same", depthwise=depthwise)
    net = sheet_onto(4, rule, neuro.normal(mean=1.0, std=0.5), shape)
    one, two = (neuro.compile(net, "event", seed=1, threads=threads) for threads in (1, 2))
    for sim in (one, two):
        sim.run(60.0)
    assert one.spikes("maps")[0].size > 100
    for a, b in zip(one.spikes("maps"), two.spikes("maps"), strict=True):
        np.testing.assert_array_equal(a, b)


def test_padding_is_a_number_or_same():
    error = error_of(neuro.grid, kernel=(3, 3), padding="sane")
    assert error.message == "grid.padding = 'sane': expected a whole number >= 0 or same"
    assert error.hint == "did you mean 'same'?"


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize("backend", ["reference", "event", "loihi", "spinnaker"])
def test_a_spike_resets_its_rivals_and_holds_them(backend):
    """Columns are rivals: of 0, 2, 4 in ms 2 the largest fires; 1, 3, 5 have no spike and go on."""
    net = neuro.Network("rivals", resolution=1.0)
    trains = [[1.0, 5.0, 7.0], [1.0], [1.0, 5.0, 7.0], [], [1.0, 7.0], [7.0]]
    net.population("input", 6, neuro.spike_generator(spike_times=trains))
    model = neuro.iaf_psc_delta(**PLAIN, tau_m=float("inf"), V_th=4.0, t_ref=4.0)
    net.population("cells", (3, 2), model)
    net.connect("input", "cells", neuro.one_to_one(), weight=np.array([5.0, 3.0, 7.0, 3.0, 2.0, 3.0]))
    net.group("first", neuro.lateral_reset(of="cells", axis=0))
    sim = neuro.compile(net, backend)
    sim.run(3.0)
    np.testing.assert_allclose(sim.get("cells", "V_m"), [0.0, 3.0, 0.0, 0.0, 0.0, 0.0])
    sim.run(7.0)
    times, ids = sim.spikes("cells")
    assert [(t, i) for t, i in zip(times.tolist(), ids.tolist(), strict=True)] == [(2.0, 2), (8.0, 2)]
    np.testing.assert_allclose(sim.get("cells", "V_m"), [0.0, 3.0, 0.0, 0.0, 0.0, 3.0])


def test_a_chip_says_that_the_host_resets():
    net = neuro.Network("rivals", resolution=1.0)
    net.population("cells", (3, 2), neuro.iaf_psc_delta(**PLAIN, V_th=4.0))
    net.group("first", neuro.lateral_reset(of="cells"))
    expected = "the host decides group 'first' from the voltages of the step; the chip has no lateral reset"
    assert expected in quantise(compile_network(net, 0), chip("loihi")).notes


@pytest.mark.parametrize("backend", ["event", "reference"])
def test_a_sheet_is_silenced_as_a_whole(backend):
    net = sheet_onto(2, neuro.grid(kernel=(3, 3)), weight=2.0)
    net.population("out", 3, neuro.iaf_psc_delta(**PLAIN, V_th=4.0))
    net.connect("maps", "out", neuro.all_to_all(), weight=1.0)
    sim = neuro.compile(net, backend=backend, seed=1)
    sim.run(100.0)
    fired = sim.counts().populations["maps"].spikes
    assert fired > 0
    with pytest.raises(neuro.ModelError, match=r"'kernels' has one kernel for all neurons: expected all neurons"):
        sim.silence(net.populations["sheet"][0, 0, 0])
    sim.silence("sheet")
    sim.silence("maps")
    assert not sim.weights("kernels").any()
    sim.run(10.0)
    fired = sim.counts().populations["maps"].spikes
    sim.run(100.0)
    assert sim.counts().populations["maps"].spikes == fired
    assert not sim.weights("maps_out")[2].any()


def test_a_kernel_of_one_number_is_square():
    assert neuro.grid(kernel=5) == neuro.grid(kernel=(5, 5))
