"""What pages, tables and pictures label is what they show."""

import re
from types import SimpleNamespace

import numpy as np

from neuro.compare.cells import where
from neuro.compare.differences import Divergence
from neuro.core import html
from neuro.pages import bills
from neuro.plots._canvas import COLOURS, Picture
from neuro_drone.report import columns_of
from neuro_train.telling import curves


def test_a_spike_of_the_first_run_alone_is_missing_in_the_other():
    assert where(Divergence(1.5, 3, True)) == "1.5 ms, neuron 3: missing"
    assert where(Divergence(1.5, 3, False)) == "1.5 ms, neuron 3: extra"


def test_static_joules_are_those_of_their_clock():
    bill = SimpleNamespace(dynamic_j=1.0, static_j=2.0, real_time=SimpleNamespace(static_j=3.0))
    assert bills._energies(bill) == {"dynamic": 1.0, "static": 2.0, "waiting": 3.0}


def test_marks_of_a_figure_in_a_page_say_what_they_are():
    figure = Picture(figsize=(3.0, 2.0))
    axis = figure.subplots()
    axis.plot([1.0, 2.0], [3.0, 4.0], "o-", color=COLOURS[0], gid="line")
    axis.set_xlabel("a < b")
    figure.titles["line"] = ["the first", "the second"]
    drawn = str(html.figure_svg(figure, "two points"))
    assert re.findall(r"<use[^>]*><title>([^<]*)</title></use>", drawn) == ["the first", "the second"]
    assert ">a &lt; b</text>" in drawn
    assert "var(--ink)" in drawn
    assert COLOURS[0].lower() not in drawn
    assert not re.search(r"#ffffff|DejaVu|\bid=\"(figure|axes|line)", drawn)


def test_the_curve_of_right_decisions_is_in_percent():
    noted = {"loss": np.array([2.0, 1.0]), "right": np.array([0.5, 0.75]), "joules": np.zeros(2)}
    drawn = curves(noted)
    assert drawn["right, %"].axes[0].lines[0].get_ydata().tolist() == [50.0, 75.0]
    assert drawn["loss"].axes[0].lines[0].get_ydata().tolist() == [2.0, 1.0]


def test_signed_errors_of_the_drone_have_signs():
    means = {"learning_on": None, "error_px": 1.0, "absolute": [2.0, 3.0], "signed": [-2.0, 0.5]}
    sums = {"laps": 1, "starts": 2}
    row = SimpleNamespace(text="static", steps=0)
    summary = SimpleNamespace(row=row, each=[0], sd=None, mean=means.__getitem__, total=sums.__getitem__)
    columns, [cells] = columns_of([summary])
    shown = dict(zip(columns, cells, strict=True))
    assert (shown[">absolute"], shown[">signed"]) == ("2.00, 3.00", "-2.00, +0.50")
