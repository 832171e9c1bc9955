"""Networks from NIR that are written as NIR again: delays, convolutions, pools, and files that the package opens."""

from __future__ import annotations

import json

import numpy as np
import pytest

import neuro

nir = pytest.importorskip("nir", reason="nir is not installed")
pytestmark = pytest.mark.filterwarnings("ignore:Using padding='same'")
STEPS = 40
BACK = nir.Linear(0.3 * np.eye(2))


def lif(*shape: int, tau=0.01, threshold=0.05):
    one = np.ones(shape)
    return nir.LIF(tau=tau * one, r=one, v_leak=0.0 * one, v_threshold=threshold * one, v_reset=0.0 * one)


def delay(steps, *shape: int):
    return nir.Delay(np.broadcast_to(np.asarray(steps) * 1e-3, shape).copy())


def graph(edges: str, type_check: bool = False, **nodes):
    """A graph from edges such as "input>a a>out"; Output nodes by their names."""
    return nir.NIRGraph(nodes, [tuple(edge.split(">")) for edge in edges.split()], type_check=type_check)


def ends(*shape: int):
    return nir.Input({"input": np.array(shape)}), nir.Output({"output": np.array(shape)})


def fed(net, chance=0.2, seed=0):
    """The spike times of all populations of neurons, for random input."""
    sim = neuro.compile(net, seed=1)
    rng = np.random.default_rng(seed)
    for name, part in sorted(net.populations.items()):
        if part.model.name == "spike_generator":
            steps, ids = np.nonzero(rng.random((STEPS, part.ids.size)) < chance)
            sim.inject(name, (steps + 1) * net.resolution, ids)
    sim.run(round(net.resolution * (STEPS + 40), 9))
    neurons = [name for name, part in net.populations.items() if part.model.name in ("iaf_psc_delta", "cuba_lif")]
    probed = {net.probes[probe].of for probe in net.probes if net.probes[probe].record == "spikes"}
    return {name: [each.tolist() for each in sim.spikes(name)] for name in neurons if name in probed}


def with_probes(net):
    """The network, with probes of the spikes of all its neurons."""
    for name, part in net.populations.items():
        if part.model.name in ("iaf_psc_delta", "cuba_lif") and name not in {net.probes[p].of for p in net.probes}:
            net.probe(f"{name}_spikes", name)
    return net


def round_trip(source, tmp_path, type_check=True):
    """The network of a graph, the graph that is written for it, and the network of the file."""
    net = with_probes(neuro.from_nir(source, dt=1.0, from_="nir"))
    written = neuro.to_nir(net)
    nir.write(tmp_path / "net.nir", written)
    nir.read(tmp_path / "net.nir", type_check=type_check)
    return net, written, with_probes(neuro.from_nir(tmp_path / "net.nir", dt=1.0))


def delays_of(written):
    return {name: node.delay.tolist() for name, node in written.nodes.items() if isinstance(node, nir.Delay)}


def test_a_delay_before_one_of_two(tmp_path):
    source, output = ends(1)
    two = graph("input>d d>a input>b a>oa b>ob", input=source, d=delay(5, 1), a=lif(1), b=lif(1), oa=output, ob=output)
    net, written, again = round_trip(two, tmp_path)
    for each in (net, again):
        sim = neuro.compile(each)
        sim.inject("input", [1.0], [0])
        sim.run(20.0)
        assert sim.spikes("a")[0] - sim.spikes("b")[0] == [5.0]
    assert delays_of(written) == {"input_a.delay": [0.005]}


@pytest.mark.parametrize("tool", ["norse", "snntorch", "sinabs", "spikingjelly"])
@pytest.mark.parametrize("place", ["from an input", "between layers", "in one of two ways", "in a loop"])
def test_tools_without_delays_refuse_them_by_name(tool, place):
    net = neuro.Network("net", resolution=1.0)
    words = {"tau_m": np.inf, "C_m": 1.0, "t_ref": 0.0, "E_L": 0.0, "V_reset": 0.0, "V_th": 1.0}
    if tool == "sinabs":
        words |= {"reset_by_subtraction": True, "max_spikes": 255, "V_min": -1.0}
    net.population("input", 1, neuro.spike_generator())
    for name in ("a", "b"):
        net.population(name, 1, neuro.iaf_psc_delta(**words))
    late = {"from an input": "input_a", "between layers": "a_b", "in one of two ways": "input_b", "in a loop": "a_a"}[
        place
    ]
    ways = [
        ("input", "a"),
        ("a", "b"),
        *([("input", "b")] if "ways" in place else [("a", "a")] if "loop" in place else []),
    ]
    for source, target in ways:
        name = f"{source}_{target}"
        one = 2.0 if name == "input_b" else 1.0  # as late as by way of a
        net.connect(source, target, neuro.all_to_all(), weight=1.0, delay=one + 3.0 * (name == late))
    with pytest.raises(neuro.ModelError) as error:
        neuro.to_nir(net, for_=tool)
    expected = f"node '{late}' (static): its delay exceeds one step per layer by 3 steps: {tool} has no Delay"
    assert expected in str(error.value)
    assert delays_of(neuro.to_nir(net)) == {f"{late}.delay": [0.003]} if tool != "sinabs" else True


def two_layers():
    source, output = ends(2)
    weights = nir.Linear(np.array([[0.9, 0.4], [0.2, 0.8]]))
    return {"input": source, "w": weights, "a": lif(2), "v": nir.Linear(weights.weight.T), "b": lif(2), "out": output}


@pytest.mark.parametrize(
    ("edges", "more", "expected"),
    [
        ("input>d d>w w>a a>v v>b b>out", {"d": delay(3, 2)}, {"input_a.delay": [0.003] * 2}),
        ("input>d d>w w>a a>v v>b b>out", {"d": delay([1, 4], 2)}, {"input_a.delay": [0.001, 0.004]}),
        ("input>d d>w w>a a>v v>b b>out", {"d": delay([0, 4], 2)}, {"input_a.delay": [0.0, 0.004]}),
        ("input>w w>d d>a a>v v>b b>out", {"d": delay(3, 2)}, {"input_a.delay": [0.003] * 2}),
        ("input>w w>a a>d d>v v>b b>out", {"d": delay([2, 3], 2)}, {"a_b.delay": [0.002, 0.003]}),
        ("input>w w>a a>v v>b b>d d>out", {"d": delay([2, 3], 2)}, {"b_out.delay": [0.002, 0.003]}),
        ("input>w w>a a>v v>b b>out input>d d>b", {"d": delay(3, 2)}, {"input_b.delay": [0.003] * 2}),
        ("input>w w>a a>d d>v v>b b>out input>b", {"d": delay(1, 2)}, {"a_b.delay": [0.001] * 2}),
        ("input>w w>a a>v v>b b>out a>d d>e e>a", {"d": delay(2, 2), "e": BACK}, {"a_a.delay": [0.002] * 2}),
        ("input>w w>a a>v v>b b>out b>d d>e e>a", {"d": delay(2, 2), "e": BACK}, {"b_a.delay": [0.002] * 2}),
        (
            "input>f f>w w>a a>v v>b b>out b>d d>e e>a",
            {"f": delay(2, 2), "d": delay(3, 2), "e": BACK},
            {"input_a.delay": [0.002] * 2, "b_a.delay": [0.003] * 2},
        ),
        (
            "input>d d>e e>w w>a a>v v>b b>out",
            {"d": delay([1, 2], 2), "e": delay(2, 2)},
            {"input_a.delay": [0.003, 0.004]},
        ),
    ],
)
def test_delays_in_all_places(edges, more, expected, tmp_path):
    net, written, again = round_trip(graph(edges, **two_layers(), **more), tmp_path)
    assert net.verdicts.exact
    assert {name: pytest.approx(steps) for name, steps in expected.items()} == delays_of(written)
    spikes = fed(net)
    assert all(len(times) > 5 for times, _ in spikes.values())
    assert fed(again) == spikes
    assert json.loads(written.metadata["neuro_verdicts"])["exact"]


def test_delays_behind_weights_that_differ_from_neuron_to_neuron(tmp_path):
    net, _, again = round_trip(graph("input>w w>d d>a a>v v>b b>out", **two_layers(), d=delay([1, 4], 2)), tmp_path)
    sim = neuro.compile(net)
    sim.inject("input", [1.0, 1.0], [0, 1])
    sim.run(20.0)
    assert [each.tolist() for each in sim.spikes("a")] == [[3.0, 6.0], [0, 1]]
    assert fed(again) == fed(net)


def late(edges, **nodes):
    """The network of a graph in which delays are."""
    return neuro.from_nir(graph(edges, **two_layers() | nodes), dt=1.0, from_="nir")


def test_delays_that_cannot_be_are_refused(messages):
    messages.calls(globals())
    longer = graph("input>d d>w w>a a>v v>b b>out", **two_layers(), d=nir.Delay(np.full(2, 100.0, np.float32) * 1e-3))
    assert neuro.check_nir(longer, dt=0.1, from_="nir").exact


def test_layers_that_wait_for_others_have_no_delay():
    """Skipped layers and constant currents take steps here that are none in a tool."""
    nodes = two_layers() | {"w": nir.Affine(np.eye(2), np.full(2, 0.1)), "s": nir.Linear(np.eye(2))}
    skipped = graph("input>w w>a a>v v>b b>out input>s s>b", **nodes)
    assert not delays_of(neuro.to_nir(neuro.from_nir(skipped, dt=1.0, from_="nir")))
    assert json.loads(
        neuro.to_nir(neuro.from_nir(skipped, dt=1.0, from_="norse"), for_="norse").metadata["neuro_verdicts"]
    )["exact"]


def conv(rng, shape, one_row=False):
    """A random convolution, all of whose numbers differ between rows and columns, and the shape that it gives."""
    groups = int(rng.choice([1, shape[0]]))
    maps = groups * int(rng.integers(1, 3))
    sides = shape[1:]
    kernel = tuple(int(rng.integers(1, min(n, 3) + 1)) for n in sides)
    dilation = tuple(int(rng.integers(1, 3)) if 2 * (k - 1) < n else 1 for k, n in zip(kernel, sides, strict=True))
    stride = (int(rng.integers(1, 3)),) * len(sides)
    padding = tuple(int(rng.integers(0, 2)) for _ in sides)
    reach = [d * (k - 1) + 1 for d, k in zip(dilation, kernel, strict=True)]
    places = [(n + 2 * p - r) // s + 1 for n, p, r, s in zip(sides, padding, reach, stride, strict=True)]
    weight = rng.normal(0.6, 0.5, (maps, shape[0] // groups, *kernel))
    bias = rng.normal(0.0, 0.2, maps) * int(rng.choice([0, 1]))
    if len(sides) == 1:
        return nir.Conv1d(sides[0], weight, stride[0], padding[0], dilation[0], groups, bias), (maps, *places)
    return nir.Conv2d(sides, weight, stride, padding, dilation, groups, bias), (maps, *places)


def pool(rng, shape):
    size = tuple(int(rng.integers(1, min(n, 3) + 1)) for n in shape[1:])
    stride = int(rng.integers(1, 3))
    padding = tuple(int(rng.integers(0, k // 2 + 1)) for k in size)
    places = [(n + 2 * p - k) // stride + 1 for n, p, k in zip(shape[1:], padding, size, strict=True)]
    kind = nir.SumPool2d if rng.random() < 0.5 else nir.AvgPool2d
    return kind(np.array(size), np.array([stride, stride]), np.array(padding)), (shape[0], *places)


def random_sheets(seed):
    """Two layers behind convolutions, pools and delays, then a dense one, some with recurrent weights."""
    rng = np.random.default_rng(seed)
    sides = [int(n) for n in rng.integers(3, 7, 1 if seed % 4 == 3 else 2)]
    shape = (int(rng.integers(1, 4)), *sides)
    nodes, edges, last = {"input": nir.Input({"input": np.array(shape)})}, [], "input"

    def add(name, node):
        nonlocal last
        nodes[name] = node
        edges.append((last, name))
        last = name

    for layer in range(2):
        if rng.random() < 0.4:
            add(f"delay{layer}", delay(rng.integers(0, 4, shape if rng.random() < 0.5 else ()), *shape))
        makers = [conv] if len(shape) == 2 else [conv, conv, pool]
        for k in range(int(rng.integers(1, 3))):
            node, shape = makers[int(rng.integers(len(makers)))](rng, shape)
            add(f"{type(node).__name__.lower()}{layer}{k}", node)
        add(f"cells{layer}", lif(*shape, tau=float(rng.uniform(0.003, 0.02)), threshold=float(rng.uniform(0.03, 0.1))))
    add("flatten", nir.Flatten({"input": np.array(shape)}, 0, -1))
    size = int(np.prod(shape))
    add("dense", nir.Linear(rng.normal(0.5, 0.5, (3, size))))
    add("cells2", lif(3))
    if rng.random() < 0.5:
        nodes["back"] = nir.Linear(rng.normal(0.0, 0.3, (3, 3)))
        edges += [("cells2", "back"), ("back", "cells2")]
    add("out", nir.Output({"output": np.array([3])}))
    return nir.NIRGraph(nodes, edges, type_check=False)


@pytest.mark.parametrize("seed", [*range(16), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(16, 100))])
def test_random_sheets_are_written_and_opened_by_the_package(seed, tmp_path):
    """The spikes are the same when it comes back, and the verdict says which files need type_check=False."""
    net = with_probes(neuro.from_nir(random_sheets(seed), dt=1.0, from_="nir"))
    written = neuro.to_nir(net)
    verdicts = written.metadata["neuro_verdicts"]
    assert json.loads(verdicts)["exact"]
    file = tmp_path / "net.nir"
    nir.write(file, written)
    if "type_check=False" in verdicts:
        with pytest.raises(ValueError, match="type mismatch"):
            nir.read(file)
    nir.read(file, type_check="type_check=False" not in verdicts)
    spikes = fed(net, chance=0.5)
    assert any(times for times, _ in spikes.values())
    assert fed(with_probes(neuro.from_nir(file, dt=1.0)), chance=0.5) == spikes


def test_a_threshold_that_is_just_reached_is_written_as_it_is(tmp_path):
    """Two spikes of 0.05 reach 0.1, which in single precision would be above it."""
    source, output = ends(1)
    cell = nir.IF(r=np.ones(1), v_threshold=np.array([0.1]), v_reset=np.zeros(1))
    weights = nir.Linear(np.array([[50.0]]))
    net, _, again = round_trip(graph("input>w w>a a>out", input=source, w=weights, a=cell, out=output), tmp_path)
    for each in (net, again):
        sim = neuro.compile(each)
        sim.inject("input", [1.0, 2.0], [0, 0])
        sim.run(10.0)
        assert sim.spikes("a")[0].tolist() == [3.0]


def test_one_row_is_a_conv1d_and_sums_are_pools(tmp_path):
    source, _ = ends(2, 9)
    one = nir.Conv1d(9, np.random.default_rng(0).uniform(0, 1, (4, 2, 3)), 2, 1, 1, 1, np.zeros(4))
    nodes = {"input": source, "conv": one, "a": lif(4, 5), "out": nir.Output({"output": np.array([4, 5])})}
    net, written, again = round_trip(graph("input>conv conv>a a>out", **nodes), tmp_path)
    assert isinstance(written.nodes["input_a"], nir.Conv1d)
    assert fed(net) == fed(again)
    pools = nir.AvgPool2d(np.array([2, 1]), np.array([2, 2]), np.array([1, 0]))
    nodes = {"input": nir.Input({"input": np.array([2, 4, 5])}), "pool": pools, "a": lif(2, 3, 3)}
    nodes["out"] = nir.Output({"output": np.array([2, 3, 3])})
    net, written, again = round_trip(graph("input>pool pool>a a>out", **nodes), tmp_path)
    assert [type(node).__name__ for node in written.nodes.values()] == ["Input", "LIF", "SumPool2d", "Scale", "Output"]
    assert fed(net) == fed(again)


@pytest.mark.parametrize(("kernel", "groups"), [((1, 3), 1), ((3, 2), 1), ((3, 3), 3)])
@pytest.mark.parametrize("tool", [None, "norse", "snntorch", "sinabs"])
def test_a_convolution_that_the_package_misreads_names_the_way_in(kernel, groups, tool, tmp_path):
    net = neuro.Network("net", resolution=1.0)
    net.population("input", (3, 6, 7), neuro.spike_generator())
    words = {"tau_m": np.inf, "C_m": 1.0, "t_ref": 0.0, "E_L": 0.0, "V_reset": 0.0, "V_th": 1.0}
    words |= {"reset_by_subtraction": True, "max_spikes": 255, "V_min": -1.0} if tool == "sinabs" else {}
    rule = neuro.grid(kernel=kernel, depthwise=groups > 1)
    net.population("cells", (3, "auto", "auto"), neuro.iaf_psc_delta(**words))
    weight = np.random.default_rng(0).normal(0.5, 0.5, (3, 3 // groups, *kernel))
    net.connect("input", "cells", rule, weight=weight, delay=1.0)
    written = neuro.to_nir(net, for_=tool)
    verdicts = {each["node"]: each["how"] for each in json.loads(written.metadata["neuro_verdicts"])["nodes"]}
    assert verdicts["input_cells"].endswith("nir.read opens the graph with type_check=False only")
    nir.write(tmp_path / "net.nir", written)
    with pytest.raises(ValueError, match="Type inference error"):
        nir.read(tmp_path / "net.nir")
    nir.read(tmp_path / "net.nir", type_check=False)
    again = neuro.from_nir(tmp_path / "net.nir", dt=1.0)
    assert fed(with_probes(again)) == fed(with_probes(net))


@pytest.mark.parametrize("part", ["scale of weights", "constant current"])
def test_what_differs_within_a_map_is_no_convolution(part):
    net = neuro.Network("net", resolution=1.0)
    net.population("input", (1, 2, 2), neuro.spike_generator())
    tau = [5.0, 6.0, 7.0, 8.0] if "scale" in part else 5.0
    net.population(
        "cells", (1, 2, 2), neuro.iaf_psc_delta(tau_m=tau, C_m=1.0, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0)
    )
    net.connect("input", "cells", neuro.grid(kernel=(1, 1)), weight=np.ones((1, 1, 1, 1)), delay=1.0)
    if "current" in part:
        net.population("dc", 1, neuro.dc_generator(amplitude=1.0))
        net.connect("dc", "cells", neuro.pairs([0], [2]), weight=1.0, delay=1.0)
    tool = "norse" if "scale" in part else None
    with pytest.raises(
        neuro.ModelError, match=rf"the {part} differs within a map of 'cells'\n  hint: give a map equal"
    ):
        neuro.to_nir(net, for_=tool)


def test_a_sheet_of_two_axes_is_one_channel(tmp_path):
    net = neuro.Network("net", resolution=1.0)
    net.population("input", (5, 6), neuro.spike_generator())
    net.population("cells", (2, 4, 5), neuro.iaf_psc_delta(C_m=1.0, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0))
    weight = np.random.default_rng(0).normal(0.5, 0.5, (2, 1, 2, 2))
    net.connect("input", "cells", neuro.grid(kernel=(2, 2)), weight=weight, delay=1.0)
    nir.write(tmp_path / "net.nir", neuro.to_nir(net))
    nir.read(tmp_path / "net.nir")
    again = neuro.from_nir(tmp_path / "net.nir", dt=1.0)
    assert fed(with_probes(again)) == fed(with_probes(net))


@pytest.mark.parametrize(
    ("kind", "tools"), [("SumPool2d", (None, "norse", "snntorch", "spikingjelly")), ("AvgPool2d", (None, "snntorch"))]
)
def test_pools_before_integrators_are_written_as_pools(kind, tools, tmp_path):
    pool = getattr(nir, kind)(np.array([2, 3]), np.array([2, 2]), np.array([0, 0]))
    nodes = {"input": nir.Input({"input": np.array([2, 4, 5])}), "pool": pool, "a": lif(2, 2, 2)}
    nodes["a"] = nir.IF(r=np.full((2, 2, 2), 1e3), v_threshold=np.ones((2, 2, 2)))
    nodes["out"] = nir.Output({"output": np.array([2, 2, 2])})
    net = with_probes(neuro.from_nir(graph("input>pool pool>a a>out", **nodes), dt=1.0, from_="nir"))
    for tool in tools:
        written = neuro.to_nir(net, for_=tool)
        assert type(written.nodes["input_a"]).__name__ == kind
        assert "input_a.scale" not in written.nodes
        nir.write(tmp_path / "net.nir", written)
        nir.read(tmp_path / "net.nir", type_check=True)


@pytest.mark.parametrize("tool", ["nir", "norse"])
def test_cuba_lif_has_the_difference_equation_of_the_tool_also_after_silence(tool):
    """Bursts with 150 silent steps between them, beside NumPy."""
    rng = np.random.default_rng(4)
    words = {
        "tau_syn": [0.004, 0.03],
        "tau_mem": [0.02, 0.006],
        "r": [1.5, 0.7],
        "v_leak": [0.0, 0.1],
        "w_in": [2.0, 0.8],
    }
    words = {word: np.array(values) for word, values in words.items()} | {"v_threshold": np.array([0.2, 0.3])}
    counts = np.where((np.arange(400) % 160 < 10)[:, None], rng.random((400, 2)) < 0.6, False)
    weights = np.array([[3.0, 1.5], [2.0, 2.5]])
    cell = nir.CubaLIF(**words, v_reset=np.zeros(2))
    net = neuro.from_nir(nir.NIRGraph.from_list(ends(2)[0], nir.Linear(weights), cell), dt=1.0, from_=tool)
    assert net.verdicts.exact
    keep, i_keep = (np.exp(-0.001 / words[word]) for word in ("tau_mem", "tau_syn"))
    if tool == "norse":
        keep, i_keep = (1.0 - 0.001 / words[word] for word in ("tau_mem", "tau_syn"))
    i, v, expected = np.zeros(2), words["v_leak"].copy(), []
    for step, x in enumerate(counts):
        i = i_keep * i + (1.0 - i_keep) * words["w_in"] * (weights @ x)
        drive = words["r"] * i if tool == "nir" else words["r"] * (i + words["v_leak"])
        v = words["v_leak"] + keep * (v - words["v_leak"]) + (1.0 - keep) * drive
        fires = v > words["v_threshold"] if tool == "norse" else v >= words["v_threshold"]
        v[fires] = 0.0
        expected += [(step + 1, neuron) for neuron in np.flatnonzero(fires)]
    depth = int(net.verdicts["cubalif"].how.rpartition("; ")[2].split()[0])
    sim = neuro.compile(net, backend="reference")
    steps, ids = np.nonzero(counts)
    sim.inject("input", steps + 1.0, ids)
    sim.run(410.0)
    times, ids = sim.spikes("cubalif")
    found = sorted(zip((times - depth).tolist(), ids.tolist(), strict=True))
    assert len(expected) > 20
    assert found == [each for each in sorted(expected) if each[0] <= 410 - depth]


def test_a_bias_before_a_delay_is_not_exact():
    nodes = two_layers() | {"w": nir.Affine(np.eye(2), np.full(2, 0.1)), "d": delay(3, 2)}
    before = neuro.check_nir(graph("input>w w>d d>a a>v v>b b>out", **nodes), dt=1.0, from_="nir")
    assert [each.node for each in before if each.verdict != "exact"] == ["d"]
    assert "the bias of 'w' acts from the first step here" in before["d"].how
    assert neuro.check_nir(graph("input>d d>w w>a a>v v>b b>out", **nodes), dt=1.0, from_="nir").exact
