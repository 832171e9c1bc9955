"""Events of a program: in any form, given at once or fed while it runs."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from event_tests import refusal
from neuro.events import Events
from neuro.program.listed import _with_multiplicity
from seen import network, same_run

PARTS = {
    "array": lambda walk: walk.records(),
    "parts": lambda walk: iter([walk[:10], walk[10:10], walk[10:]]),
    "function": lambda walk: lambda: iter([walk]),
}
FORMS = PARTS | {"list of events": list, "iterator of events": iter}


@pytest.mark.parametrize("form", PARTS)
def test_events_in_any_form(walk, form):
    sims = [neuro.compile(network(neuro.event_camera(events=e), (2, 9, 12))) for e in (walk, PARTS[form](walk))]
    for sim in sims:
        sim.run(70.0)
    same_run(*sims)


@pytest.mark.parametrize("form", FORMS)
def test_events_in_any_form_are_fed(walk, form):
    few = walk[:300]
    sims = [neuro.compile(network(neuro.event_camera(origin=int(few.t[0])), (2, 9, 12))) for _ in range(2)]
    for sim, events in zip(sims, (few, FORMS[form](few)), strict=True):
        sim.feed("camera", events)
        sim.run(10.0)
    same_run(*sims)
    assert sims[0].spikes("camera")[0].size == 300


def test_an_iterator_is_asked_when_its_events_are_due(messages, walk):
    asked = []

    def parts():
        for k in range(0, len(walk), 500):
            asked.append(int(walk.t[k] - walk.t[0]))
            yield walk[k : k + 500]

    sim = neuro.compile(network(neuro.event_camera(events=parts()), (2, 9, 12)))
    assert asked == []
    sim.run(10.0)
    assert asked[-2] <= 10_000
    assert len(asked) < 4
    messages({"reset": refusal(sim.reset)})
    sim.run(60.0)
    assert sim.spikes("camera")[0].size == len(walk)


def test_feeding_while_it_runs(messages, walk):
    origin = int(walk.t[0])
    fed = neuro.compile(network(neuro.event_camera(origin=origin), (2, 9, 12)))
    for begin in range(0, 70_000, 10_000):
        fed.feed("camera", walk.between(origin + begin, origin + begin + 10_000))
        fed.run(10.0)
    played = neuro.compile(network(neuro.event_camera(events=walk)))
    played.run(70.0)
    same_run(fed, played)
    early = Events([origin - 1], [0], [0], [1], (12, 9))
    wrong = {"late": ("camera", walk[-1:]), "early": ("camera", early), "cells": ("cells", walk)}
    messages({case: refusal(fed.feed, *given) for case, given in wrong.items()})


def test_what_cannot_be_fed(messages):
    sim = neuro.compile(network(neuro.event_camera(), (2, 9, 12)))
    messages.calls(globals() | locals())


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000), n=st.integers(20, 300), polarity=st.sampled_from(["split", "merge", "on", "off"]),
    scale=st.integers(1, 3), crop=st.booleans(), offset=st.sampled_from([0.0, 3.0]), start=st.sampled_from([0.0, 2.0]),
    stop=st.sampled_from([9.0, np.inf]), resolution=st.sampled_from([0.1, 0.3, 1.0, 1.0 / 3.0])
)  # fmt: skip
def test_events_fall_where_the_formula_says(seed, n, polarity, scale, crop, offset, start, stop, resolution):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 15_000, n)) + 3000
    x, y, p = rng.integers(0, 12, n), rng.integers(0, 9, n), rng.integers(0, 2, n)
    columns, rows = ((3, 9), (1, 8)) if crop else ((0, 12), (0, 9))
    words = {"crop": {"x": list(columns), "y": list(rows)}} if crop else {}
    start, stop = (round(ms / resolution) * resolution if ms < np.inf else ms for ms in (start, stop))
    model = neuro.event_camera(
        polarity=polarity, scale=scale, offset=offset, start=start, stop=stop, origin=0,
        events=Events(t, x, y, p, (12, 9)), **words
    )  # fmt: skip
    net = neuro.Network("formula", resolution=resolution)
    net.population("camera", "auto", model)
    camera = neuro.compile(net, "reference").program.populations[0]
    height, width = camera.shape[-2:]
    numerator, denominator = Fraction(resolution).limit_denominator(10**6).as_integer_ratio()
    expected = []
    for when, column, row, side in zip(t.tolist(), x.tolist(), y.tolist(), p.tolist(), strict=True):
        since = when - round(1000 * offset)
        step = round(start / resolution) + since * denominator // (1000 * numerator) + 1
        seen = columns[0] <= column < columns[1] and rows[0] <= row < rows[1] and polarity != ("on", "off")[side == 1]
        if seen and since >= 0 and step * resolution <= stop + 1e-9:
            neuron = (row - rows[0]) // scale * width + (column - columns[0]) // scale
            expected.append((step, neuron + side * height * width * (polarity == "split")))
    found = [
        (s, k) for part in camera.stream.after(0) for s, k in zip(part.steps.tolist(), part.ids.tolist(), strict=True)
    ]
    assert found == expected


@settings(max_examples=40, deadline=None)
@given(spikes=st.lists(st.tuples(st.integers(1, 2**40), st.integers(0, 50)), max_size=60), near=st.booleans())
def test_spikes_of_one_neuron_and_step_become_one_with_a_multiplicity(spikes, near):
    rows = np.array([(step % 7 if near else step, neuron) for step, neuron in spikes], dtype=np.int64).reshape(-1, 2)
    pairs, counts = np.unique(rows, axis=0, return_counts=True)
    assert np.array_equal(_with_multiplicity(rows[:, 0], rows[:, 1]), np.column_stack([pairs, counts]))
