"""Linear nodes are what torch computes, alone and in a row, as kernels and as matrices."""

from __future__ import annotations

import numpy as np
import pytest

import neuro
from neuro_exchange.nir.graph import Node, compose, map_of, output_shape, sheet

torch = pytest.importorskip("torch", reason="torch is not installed")
nir = pytest.importorskip("nir", reason="nir is not installed")
F = torch.nn.functional
pytestmark = pytest.mark.filterwarnings("ignore:Using padding='same'")


def conv(rng):
    groups = int(rng.choice([1, 2, 4]))
    words = {"stride": tuple(rng.integers(1, 4, 2)), "dilation": tuple(rng.integers(1, 3, 2)), "groups": groups}
    words = {name: tuple(map(int, v)) if isinstance(v, tuple) else v for name, v in words.items()}
    weight = rng.normal(size=(4, 4 // groups, *rng.integers(1, 4, 2)))
    padding = tuple(int(n) for n in rng.integers(0, 3, 2))
    if rng.random() < 0.3:
        padding, words["stride"] = "same", (1, 1)
    node = Node("c", "Conv2d", {"weight": weight, "bias": np.zeros(4), "padding": padding, **words})
    return node, lambda x: F.conv2d(x, torch.from_numpy(weight), padding=padding, **words)


def conv1(rng):
    weight, stride, padding = rng.normal(size=(3, 4, 3)), int(rng.integers(1, 3)), int(rng.integers(0, 3))
    fields = {"weight": weight, "bias": np.zeros(3), "stride": stride, "padding": padding, "dilation": 1, "groups": 1}
    return Node("c", "Conv1d", fields), lambda x: F.conv1d(x, torch.from_numpy(weight), stride=stride, padding=padding)


def pool(rng, kind="SumPool2d"):
    size, stride = (tuple(int(n) for n in rng.integers(1, 4, 2)) for _ in range(2))
    padding = tuple(int(rng.integers(0, k // 2 + 1)) for k in size)
    node = Node("p", kind, {"kernel_size": np.array(size), "stride": np.array(stride), "padding": np.array(padding)})
    factor = float(np.prod(size)) if kind == "SumPool2d" else 1.0
    return node, lambda x: factor * F.avg_pool2d(x, size, stride, padding)


@pytest.mark.parametrize("seed", range(40))
def test_one_node(seed):
    rng = np.random.default_rng(seed)
    make = (conv, conv1, pool, lambda r: pool(r, "AvgPool2d"))[seed % 4]
    node, call = make(rng)
    shape = (4, 11) if make is conv1 else (4, 9, 8)
    x = rng.normal(size=shape)
    expected = call(torch.from_numpy(x)[None])[0].numpy()
    found = map_of(node, shape)
    assert found.target == output_shape(node, shape) == expected.shape
    assert np.allclose(found(x), expected)


@pytest.mark.parametrize("seed", range(20))
def test_several_in_a_row(seed):
    rng = np.random.default_rng(seed)
    square = {"stride": 2, "padding": 0, "kernel_size": 2}
    nodes = [(Node("p", "SumPool2d", square), lambda x: 4.0 * F.avg_pool2d(x, 2)), conv(rng)]
    if seed % 2:
        nodes.reverse()
    x = rng.normal(size=(4, 16, 16))
    shape, maps, y = x.shape, [], torch.from_numpy(x)[None]
    for node, call in nodes:
        maps.append(map_of(node, shape))
        shape, y = maps[-1].target, call(y)
    whole = compose(maps)
    assert np.allclose(whole(x), y[0].numpy())
    assert (whole.kernel is not None) == (seed % 2 == 0)


@pytest.mark.parametrize("seed", range(12))
def test_grids_of_the_language_send_what_the_map_gives(seed):
    """Weights that reach the neurons, as potentials of integrators without leak."""
    rng = np.random.default_rng(seed)
    node, _ = conv(rng)
    shape = (4, 9, 8)
    target = output_shape(node, shape)
    words = {word: value for word, value in node.fields.items() if word not in ("weight", "bias")}
    graph = nir.NIRGraph(
        {
            "input": nir.Input({"input": np.array(shape)}),
            "conv": nir.Conv2d((9, 8), node.fields["weight"], bias=np.zeros(4), **words),
            "neurons": nir.I(r=np.ones(target)),
            "output": nir.Output({"output": np.array(target)}),
        },
        [("input", "conv"), ("conv", "neurons"), ("neurons", "output")],
        type_check=False,
    )
    net = neuro.from_nir(graph, dt=1.0, from_="norse")
    sim = neuro.compile(net)
    sent = rng.random(shape) < 0.3
    sim.inject("input", np.ones(sent.sum()), np.flatnonzero(sent))
    sim.run(3.0)
    assert np.allclose(sim.get("neurons", "V_m"), map_of(node, shape)(sent * 1.0).reshape(-1))
    unequal = node.fields["stride"][0] != node.fields["stride"][1] and 1 not in sheet(target)[1:]
    assert net.projections["input_neurons"].rule.name == ("pairs" if unequal else "grid")
