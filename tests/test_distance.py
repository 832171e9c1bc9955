"""Connections, weights and delays of distance: pairs, distributions, NEST, mistakes, and what is saved."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.stats import chi2

import neuro
from beside import beside, evaluated
from neuro.compiler import compile_network
from neuro.compiler.pairs import Geometry, space_of
from neuro.model.parts import Population
from neuro.model.space import PROFILES, Profile
from neuro.program.program import Projection
from refused import refused

LINE = {"shape": 200, "extent": [2.0]}
SHEET = {"shape": [12, 15], "extent": [1.2, 1.5]}
BLOCK = {"shape": [4, 5, 3], "extent": [4.0, 5.0, 3.0]}
FREE = {"shape": 90, "positions": np.random.default_rng(3).uniform(-1.0, 1.0, (90, 2))}


def population(words: dict, name: str = "a") -> Population:
    said = {**words}
    return neuro.Network("n").population(name, said.pop("shape"), neuro.iaf_psc_exp(), **said)


def compiled(rule, source: dict, target: dict | None = None, seed: int = 1, **words) -> Projection:
    """From one population to another, or to itself."""
    net = neuro.Network("near")
    for name, said in (("a", source), ("b", target or source)):
        rest = {**said}
        net.population(name, rest.pop("shape"), neuro.iaf_psc_exp(), **rest)
    net.connect("a", "b" if target else "a", rule, name="p", **words)
    return compile_network(net, seed).projections[0]


def pairs_of(part: Projection) -> tuple[np.ndarray, np.ndarray]:
    return np.repeat(np.arange(len(part.row_ends) - 1), np.diff(part.row_ends)), part.targets.astype(np.int64)


def all_distances(source: dict, target: dict) -> np.ndarray:
    """To the nearest of all images, as it is written in books."""
    one, other = (space_of(population(words), shape_of(words)) for words in (source, target))
    shifts = itertools.product(*((-p, 0.0, p) if p else (0.0,) for p in one.periods))
    images = [np.linalg.norm(other.places[None] - one.places[:, None] + shift, axis=2) for shift in shifts]
    return np.min(images, axis=0)


def shape_of(words: dict) -> tuple[int, ...]:
    shape = words["shape"]
    return (shape,) if isinstance(shape, int) else tuple(shape)


def test_places_follow_from_the_shape():
    sheet = space_of(population({"shape": [2, 3]}), (2, 3)).places
    assert sheet.tolist() == [[-0.5, -1], [-0.5, 0], [-0.5, 1], [0.5, -1], [0.5, 0], [0.5, 1]]
    line = space_of(population({"shape": 4, "extent": [2.0]}), (4,)).places
    assert line.tolist() == [[-0.75], [-0.25], [0.25], [0.75]]


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("words", [LINE, SHEET, BLOCK, {**FREE, "extent": [2.0, 2.5]}])
def test_all_neighbours_within_a_radius_and_no_others(words: dict, periodic: bool):
    words = {**words, "periodic": periodic}
    far = all_distances(words, words)
    for radius in (0.3, 1.0):
        expected = np.argwhere(far <= radius * (1 + 1e-9))
        for rule in (
            neuro.distance_dependent(p=neuro.box(radius=radius)),
            neuro.distance_dependent(mask=neuro.circular(radius=radius)),
            neuro.distance_dependent(p=neuro.box(radius=radius, c=0.0), mask=neuro.circular(radius=9.0)),
        ):
            assert np.array_equal(np.stack(pairs_of(compiled(rule, words)), axis=1), expected)


def test_a_rectangle_lies_around_the_source():
    mask = neuro.rectangular(lower_left=[0.0, -0.2], upper_right=[0.1, 0.3])
    pre, post = pairs_of(compiled(neuro.distance_dependent(mask=mask), SHEET))
    inner = 5 * 15 + 7
    found = [divmod(int(n) - inner + 7, 15) for n in post[pre == inner]]
    assert sorted((row, column - 7) for row, column in found) == [(r, c) for r in (0, 1) for c in range(-2, 4)]


@settings(max_examples=25)
@given(st.integers(0, 99), st.floats(0.05, 1.0), st.booleans(), st.booleans())
def test_neither_autapses_nor_pairs_twice_nor_beyond_the_mask(seed, radius, periodic, autapses):
    words = {**SHEET, "periodic": periodic}
    rule = neuro.distance_dependent(
        p=neuro.exponential(beta=0.3), mask=neuro.circular(radius=radius), autapses=autapses
    )
    pre, post = pairs_of(compiled(rule, words, seed=seed))
    assert np.all(np.diff(pre * 180 + post) > 0)
    assert autapses or not np.any(pre == post)
    space = space_of(population(words), (12, 15))
    far = Geometry(space, space).distance(pre, post)
    assert far.max(initial=0.0) <= radius * (1 + 1e-9)
    assert np.array_equal(far, Geometry(space, space).distance(post, pre))


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("profile", evaluated(__file__, "PROFILED", globals()), ids=repr)
def test_the_share_at_each_distance_is_the_profile(profile: Profile, periodic: bool):
    words = {**SHEET, "periodic": periodic}
    far, drawn = all_distances(words, words), np.zeros((180, 180))
    for seed in range(5):
        drawn[pairs_of(compiled(neuro.distance_dependent(p=profile), words, seed=seed))] += 1
    p = profile.at(far)
    places = np.digitize(far, np.quantile(far, np.linspace(0.05, 0.95, 19)))
    found, expected, variance = (np.bincount(places.ravel(), v.ravel()) for v in (drawn, 5 * p, 5 * p * (1 - p)))
    assert chi2.sf(((found - expected) ** 2 / variance).sum(), found.size) > 1e-3


def test_a_draw_belongs_to_its_pair():
    whole = compiled(neuro.distance_dependent(p=neuro.gaussian(std=0.5)), SHEET)
    masked = compiled(neuro.distance_dependent(p=neuro.gaussian(std=0.5), mask=neuro.circular(radius=0.45)), SHEET)
    space = space_of(population(SHEET), (12, 15))
    pre, post = pairs_of(whole)
    near = Geometry(space, space).distance(pre, post) <= 0.45 * (1 + 1e-9)
    assert np.array_equal(np.stack(pairs_of(masked)), np.stack((pre[near], post[near])))


@pytest.mark.parametrize("rule", evaluated(__file__, "RULED", globals()), ids=lambda rule: rule.name)
def test_weights_and_delays_of_distance(rule):
    delay = neuro.of_distance(neuro.linear(c=0.62, a=3.0))
    part = compiled(rule, SHEET, weight=neuro.of_distance(neuro.gaussian(std=0.5, a=-40.0)), delay=delay)
    if part.layout == "csr":
        pre, post = pairs_of(part)
    else:
        pre, post = (np.arange(180),) * 2 if part.layout == "one_to_one" else np.divmod(np.arange(180 * 180), 180)
    far = all_distances(SHEET, SHEET)[pre, post]
    assert np.allclose(part.weight, -40.0 * np.exp(-(far**2) / 0.5), rtol=1e-12, atol=0.0)
    assert np.array_equal(part.delay, np.rint((0.62 + 3.0 * far) / 0.1))
    assert part.delay.dtype == np.int32


def test_neurons_of_a_view_lie_where_they_are():
    net = neuro.Network("views")
    cells = net.population("cells", [12, 15], neuro.iaf_psc_exp(), extent=[1.2, 1.5])
    rule = neuro.distance_dependent(mask=neuro.circular(radius=0.35), autapses=False)
    net.connect(cells[[40, 7, 39, 100]], cells[2:9, 3:], rule, delay=neuro.of_distance(neuro.linear(a=9.0)), name="p")
    part = compile_network(net, 1).projections[0]
    far = all_distances(SHEET, SHEET)
    near = [(i, j) for i in (7, 39, 40, 100) for j in cells[2:9, 3:].ids if i != j and far[i, j] < 0.351]
    pre, post = pairs_of(part)
    assert list(zip(pre, post, strict=True)) == near
    assert np.array_equal(part.delay, np.rint(90.0 * far[pre, post]))


def test_delays_of_distance_are_at_least_one_step():
    part = compiled(neuro.all_to_all(), SHEET, delay=neuro.of_distance(neuro.linear(a=1.0)))
    assert part.delay.min() == 1


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("mask", [{"circular": {"radius": 0.31}}, {"circular": {"radius": 0.27}}])
def test_nest_makes_the_same_pairs(own_nest, mask: dict, periodic: bool):
    places = space_of(population(SHEET), (12, 15)).places.tolist()
    layer = own_nest.Create(
        "iaf_psc_exp", positions=own_nest.spatial.free(places, extent=[1.2, 1.5], edge_wrap=periodic)
    )
    delay = 0.5 + 2.0 * own_nest.spatial.distance
    own_nest.Connect(layer, layer, {"rule": "pairwise_bernoulli", "p": 1.0, "mask": mask}, {"delay": delay})
    made = own_nest.GetConnections()
    theirs = sorted(zip(made.source, made.target, made.delay, strict=True))
    rule = neuro.distance_dependent(mask=neuro.circular(**mask["circular"]))
    part = compiled(rule, {**SHEET, "periodic": periodic}, delay=neuro.of_distance(neuro.linear(c=0.5, a=2.0)))
    pre, post = pairs_of(part)
    assert list(zip((pre + 1).tolist(), (post + 1).tolist(), strict=True)) == [row[:2] for row in theirs]
    assert np.abs(part.delay * 0.1 - [row[2] for row in theirs]).max() < 0.051


def test_a_profile_of_ones_own(registries):
    @neuro.register
    class ring(Profile):
        """1 at whole distances."""

        def at(self, distance):
            return (np.abs(distance - np.rint(distance)) < 1e-9).astype(float)

    assert PROFILES["ring"] is ring
    part = compiled(neuro.distance_dependent(p=ring()), {"shape": [5, 5]})
    far = all_distances({"shape": [5, 5]}, {"shape": [5, 5]})
    assert np.array_equal(np.stack(pairs_of(part), axis=1), np.argwhere(np.abs(far - np.rint(far)) < 1e-9))


YAML, TWO = beside(__file__, "YAML", "TWO")


def test_what_is_said_is_saved(tmp_path):
    (tmp_path / "net.yaml").write_text(YAML)
    net = neuro.load(tmp_path / "net.yaml")
    rule = neuro.distance_dependent(p=neuro.gaussian(std=0.5), mask=neuro.circular(radius=2.0), autapses=False)
    assert net.projections["a_a"].rule == rule
    assert net.projections["a_a"].weight == neuro.of_distance(neuro.linear(a=-2.0))
    net.save(tmp_path / "saved.yaml")
    again = neuro.load(tmp_path / "saved.yaml")
    assert again == net
    again.save(tmp_path / "again.yaml")
    assert (tmp_path / "again.yaml").read_text() == (tmp_path / "saved.yaml").read_text()
    assert np.array_equal(again.populations["b"].positions, [[0.0, 1.0], [2.0, 0.5]])


PLACED = {"shape": 2, "positions": [[0.0, 1.0], [2.0, 0.5]]}
ANY = neuro.distance_dependent(p=0.5)


def test_mistakes(messages):
    messages.calls(globals())


def load(word: str, text: str) -> None:
    """A description with one word said so."""
    whole = TWO
    for name, value in ({"WORDS": "", "RULE": "all_to_all", "WEIGHT": "1.0"} | {word: text}).items():
        whole = whole.replace(name, value)
    Path("net.yaml").write_text(whole)
    neuro.load("net.yaml")


def test_mistakes_in_yaml(tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)
    messages.calls(globals())


def test_a_kernel_has_no_distance():
    net = neuro.Network("grids")
    net.population("a", (4, 4), neuro.poisson_generator())
    net.population("b", (2, "auto", "auto"), neuro.iaf_psc_exp())
    net.connect("a", "b", neuro.grid(kernel=(2, 2)), weight=neuro.of_distance(neuro.linear()))
    assert "a shared kernel has none: expected numbers or a distribution" in refused(compile_network, net, 1)


def test_a_gaussian_has_its_peak_at_its_mean():
    profile = neuro.gaussian(std=0.1, mean=0.5, a=0.6, c=0.1)
    assert profile.at(np.array([0.5, 0.6, 0.0])) == pytest.approx([0.7, 0.1 + 0.6 * np.exp(-0.5), 0.1], abs=1e-5)
