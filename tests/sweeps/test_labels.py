"""Pictures of sweeps and tunings label what they show."""

import re
from types import SimpleNamespace

import numpy as np

from neuro.core import html
from neuro_sweeps import pictures


def test_values_of_a_map_lie_beside_their_axes():
    axes = [[1, 2, 3], [10, 20]]
    grid = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]])
    data = SimpleNamespace(grid=lambda: grid, axis=axes.__getitem__, names=["a", "b"], metric="m", mean_of="")
    figure = pictures._map(data, "", 4.6)
    assert np.array_equal(figure.axes[0].collections[0].get_array(), grid)
    drawn = str(html.figure_svg(figure, "a map"))
    ticks = {told: float(y) for y, told in re.findall(r'<text[^>]* y="([\d.]+)"[^>]*>(\d+)</text>', drawn)}
    corners = r'<path d="M[\d.]+ ([\d.]+)L[\d. ]+L[\d.]+ ([\d.]+)L[^>]*>'
    cells = re.findall(corners + r"<title>a = \d, b = (\d+): [\d.]+</title>", drawn)
    assert len(cells) == grid.size
    for bottom, top, told in cells:
        assert float(top) < ticks[told] < float(bottom)


def test_bars_of_importance_stand_at_their_names(monkeypatch):
    shares = {"first": 0.1, "second": 0.7, "third": 0.2}
    monkeypatch.setattr(pictures, "importance", lambda table, name: shares)
    plan = SimpleNamespace(objectives={"loss": "minimise"}, names=tuple(shares))
    (axis,) = pictures._importance(SimpleNamespace(plan=plan, name="search"), "", 7.0).axes
    names = [label.get_text() for label in axis.get_yticklabels()]
    lengths = {names[round(bar.get_y() + bar.get_height() / 2)]: bar.get_width() for bar in axis.patches}
    assert lengths == shares
