"""Convolutions whose rows and columns differ in all: kernel, stride, padding, dilation, groups, and channels."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import correlate2d

import neuro
from neuro.model.rules import out_size, synapses_of

STRIDES, PADDINGS, DILATIONS = [(1, 2), (2, 1), (3, 2)], [(0, 1), (2, 0), (1, 3)], [(1, 2), (2, 1), (3, 2)]
KERNELS = [(2, 3), (3, 1), (1, 2)]


def convolved(x, kernel, stride, padding, dilation, groups):
    """A convolution by scipy: the kernel with zeros between its entries, laid on the sheet with its border."""
    maps, depth, height, width = kernel.shape
    wide = np.zeros((maps, depth, dilation[0] * (height - 1) + 1, dilation[1] * (width - 1) + 1))
    wide[:, :, :: dilation[0], :: dilation[1]] = kernel
    bordered = np.pad(x, ((0, 0), (padding[0],) * 2, (padding[1],) * 2))
    out = [
        sum(correlate2d(bordered[m // (maps // groups) * depth + k], wide[m, k], "valid") for k in range(depth))
        for m in range(maps)
    ]
    return np.array(out)[:, :: stride[0], :: stride[1]]


def drawn(seed):
    """A generator, a kernel and the words of a convolution of 4 channels, all unequal along rows and columns."""
    rng = np.random.default_rng(seed)
    words = {
        "stride": STRIDES[seed % 3],
        "padding": PADDINGS[seed // 3 % 3],
        "dilation": DILATIONS[(seed + seed // 3) % 3],
    }
    groups = (1, 2, 4)[seed // 9 % 3]
    maps = groups * (1 if groups == 4 else 3)
    kernel = rng.normal(size=(maps, 4 // groups, *KERNELS[(seed // 2) % 3]))
    return rng, kernel, words | {"groups": groups}


def delivered(net, source, target, x, backend):
    """What integrators without leak hold after a step with the spikes of a sheet, which carry multiplicities."""
    sim = neuro.compile(net, backend=backend)
    ids = np.repeat(np.arange(x.size), x.reshape(-1))
    sim.inject(source, np.ones(ids.size), ids)
    sim.run(3.0)
    return sim.get(target, "V_m")


def two_sheets(shape, target):
    net = neuro.Network("sheets", resolution=1.0)
    net.population("sheet", shape, neuro.spike_generator())
    integrator = neuro.iaf_psc_delta(tau_m=np.inf, C_m=1.0, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1e9)
    net.population("maps", target, integrator)
    return net


@pytest.mark.parametrize("seed", range(27))
def test_synapses_are_those_of_a_convolution(seed):
    rng, kernel, words = drawn(seed)
    x = rng.integers(0, 3, (4, 9, 11))
    expected = convolved(x, kernel, **words)
    sizes = kernel.shape[2:], words["stride"], words["padding"], words["dilation"]
    assert (len(kernel), *out_size((9, 11), *sizes)) == expected.shape
    pre, post, weight = synapses_of(x.shape, kernel, *sizes[1:], words["groups"])
    sums = np.zeros(expected.size)
    np.add.at(sums, post, weight * x.reshape(-1)[pre])
    assert np.allclose(sums, expected.reshape(-1))
    assert np.unique(post * x.size + pre).size == pre.size


@pytest.mark.parametrize("seed", range(27))
def test_torch_convolves_so(seed):
    torch = pytest.importorskip("torch", reason="torch is not installed")
    rng, kernel, words = drawn(seed)
    x = rng.normal(size=(4, 9, 11))
    expected = torch.nn.functional.conv2d(torch.from_numpy(x)[None], torch.from_numpy(kernel), **words)[0].numpy()
    assert np.allclose(convolved(x, kernel, **words), expected)


@pytest.mark.parametrize("backend", ["reference", "event"])
@pytest.mark.parametrize("seed", [1, 5, 12, 16, 20, 24])
def test_backends_deliver_a_convolution_of_pairs(seed, backend):
    rng, kernel, words = drawn(seed)
    x = rng.integers(0, 3, (4, 9, 11))
    expected = convolved(x, kernel, **words)
    net = two_sheets(x.shape, expected.shape)
    pre, post, weight = synapses_of(
        x.shape, kernel, words["stride"], words["padding"], words["dilation"], words["groups"]
    )
    net.connect("sheet", "maps", neuro.pairs(pre, post), weight=weight, delay=1.0)
    assert np.allclose(delivered(net, "sheet", "maps", x, backend), expected.reshape(-1))


@pytest.mark.parametrize("backend", ["reference", "event"])
@pytest.mark.parametrize("depthwise", [False, True])
@pytest.mark.parametrize(
    ("kernel", "stride", "padding"), [((2, 3), 2, (0, 1)), ((3, 1), 1, (2, 0)), ((1, 4), 3, (1, 3))]
)
def test_backends_deliver_a_grid(kernel, stride, padding, depthwise, backend):
    rng = np.random.default_rng(stride)
    x = rng.integers(0, 3, (3, 7, 10))
    weight = rng.normal(size=(6, 1 if depthwise else 3, *kernel))
    expected = convolved(x, weight, (stride, stride), padding, (1, 1), 3 if depthwise else 1)
    net = two_sheets(x.shape, expected.shape)
    rule = neuro.grid(kernel=kernel, stride=stride, padding=padding[0], column_padding=padding[1], depthwise=depthwise)
    net.connect("sheet", "maps", rule, weight=weight, delay=1.0)
    assert np.allclose(delivered(net, "sheet", "maps", x, backend), expected.reshape(-1))


@pytest.mark.parametrize("backend", ["reference", "event"])
@pytest.mark.parametrize("share", [1.0, 1 / 6])
def test_backends_deliver_sums_and_means_of_places(share, backend):
    x = np.random.default_rng(0).integers(0, 3, (2, 6, 9))
    expected = convolved(x, np.full((2, 1, 2, 3), share), (2, 2), (0, 1), (1, 1), 2)
    places = np.pad(x, ((0, 0), (0, 0), (1, 1)))
    by_hand = [[places[:, 2 * r : 2 * r + 2, 2 * c : 2 * c + 3].sum((1, 2)) for c in range(5)] for r in range(3)]
    assert np.allclose(expected, share * np.moveaxis(by_hand, 2, 0))
    net = two_sheets(x.shape, expected.shape)
    rule = neuro.grid(kernel=(2, 3), stride=2, padding=0, column_padding=1, depthwise=True)
    net.connect("sheet", "maps", rule, weight=np.full((2, 1, 2, 3), share), delay=1.0)
    assert np.allclose(delivered(net, "sheet", "maps", x, backend), expected.reshape(-1))
