"""Points of a sweep."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings, strategies as st

from neuro_sweeps.space import space_of
from refused import refused


def points(*args, **words):
    return space_of(*args, **words).points()


def test_a_grid_has_all_pairs_in_order():
    assert points({"a": [1, 2], "b": ["x", "y"]}, seeds=2) == [
        ({"a": a, "b": b}, seed) for a in (1, 2) for b in ("x", "y") for seed in (0, 1)
    ]


def test_ranges():
    values = [point["w"] for point, _ in points({"w": {"from": 1, "to": 100, "number": 3, "scale": "log"}})]
    assert values == pytest.approx([1.0, 10.0, 100.0])
    assert (values[0], values[-1]) == (1.0, 100.0)
    assert [p["n"] for p, _ in points({"n": {"from": 1, "to": 3, "number": 5, "whole": True}})] == [1, 2, 3]
    assert [p["n"] for p, _ in points({"n": np.arange(3)})] == [0, 1, 2]
    assert [p["n"] for p, _ in points({"n": range(2)})] == [0, 1]


@settings(max_examples=30)
@given(
    st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6)), min_size=1, max_size=4),
    st.integers(1, 40),
    st.integers(0, 5),
    st.sampled_from(["random", "latin_hypercube"]),
)
def test_what_is_drawn_lies_in_its_range_and_is_the_same_again(ranges, runs, draw, sampling):
    space = {f"p{k}": {"from": low, "to": low + wide} for k, (low, wide) in enumerate(ranges) if low < low + wide}
    if not space:
        return
    found = points(space, sampling=sampling, runs=runs, draw=draw)
    assert len(found) == runs
    assert found == points(space, sampling=sampling, runs=runs, draw=draw)
    for point, seed in found:
        assert seed is None
        for name, said in space.items():
            assert said["from"] <= point[name] <= said["to"]


def test_a_latin_hypercube_has_one_point_in_each_stretch():
    found = points({"a": {"from": 0, "to": 1}, "b": {"from": 0, "to": 1}}, sampling="latin_hypercube", runs=16)
    for name in "ab":
        assert sorted(math.floor(point[name] * 16) for point, _ in found) == list(range(16))


def test_choices_are_drawn_evenly():
    found = points({"a": ["x", "y"], "b": {"from": 1, "to": 6, "whole": True}}, sampling="latin_hypercube", runs=100)
    assert sum(point["a"] == "x" for point, _ in found) == 50
    assert {point["b"] for point, _ in found} == {1, 2, 3, 4, 5, 6}


MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))["space"]


def test_mistakes(messages):
    messages({f"{space} {words}": refused(space_of, space, **words) for space, words in MISTAKES})
