"""The page in a browser: its script draws and zooms, and nothing is told on the console."""

import numpy as np
import pytest
from matplotlib.image import imread

import neuro
from neuro.pages.report import page
from neuro.run.collect import collect


@pytest.fixture
def picture(chromium, tmp_path):
    """A page as a browser of some width draws it."""

    def of(where, width):
        chromium(f"--window-size={width},1000", f"--screenshot={tmp_path / 'page.png'}", where)
        return imread(tmp_path / "page.png")[..., :3]

    return of


def blue(pixels):
    """Where spikes are drawn."""
    return (pixels[..., 2] - pixels[..., 0] > 0.2) & (pixels[..., 0] < 0.5)


def test_it_draws_and_zooms(tmp_path, picture):
    net = neuro.Network("three", resolution=1.0)
    net.population("cells", 30, neuro.spike_generator(spike_times=[[100.0, 300.0, 301.0]] * 30))
    sim = neuro.compile(net)
    sim.run(400.0)
    (tmp_path / "page.html").write_text(page(collect(sim, net), "run.h5"), "utf-8")
    where = f"file://{tmp_path / 'page.html'}"
    whole, part = picture(where, 900), picture(f"{where}#299-302", 900)
    columns = [np.flatnonzero(blue(pixels[:680]).sum(axis=0) > 20) for pixels in (whole, part)]
    assert [1 + int((np.diff(found) > 3).sum()) for found in columns] == [2, 2]
    assert columns[0].max() - columns[0].min() > 300  # 100 and 300 ms of 400
    assert 200 < columns[1].max() - columns[1].min() < 320  # 300 and 301 ms of 3
    narrow = picture(where, 420)
    assert blue(narrow)[:, 380:].sum() == 0
    assert blue(narrow).sum() > 60


def test_curves_follow(tmp_path, picture):
    """A part of the run is shown by traces, too, also of a network that is silent."""
    net = neuro.Network("step", resolution=1.0)
    cells = net.population("cells", 1, neuro.iaf_psc_exp(V_th=100.0))
    drive = net.population("drive", 1, neuro.step_current_generator(amplitude_times=[150.0], amplitude_values=[400.0]))
    net.connect(drive, cells, neuro.one_to_one())
    net.probe("v", cells, "V_m", every=1.0)
    sim = neuro.compile(net)
    sim.run(400.0)
    (tmp_path / "page.html").write_text(page(collect(sim, net), "run.h5"), "utf-8")
    where = f"file://{tmp_path / 'page.html'}"
    rises = [np.ptp(curve(picture(f"{where}{part}", 900))) for part in ("", "#0-140", "#140-400")]
    assert rises[1] < 6 < 50 < min(rises[0], rises[2])
    assert rises[0] == pytest.approx(rises[2], abs=6)


def curve(pixels):
    """The height of the line of a trace in each of its columns, but those below its name."""
    pixels = pixels[720:850, 90:300]
    teal = (pixels[..., 1] - pixels[..., 0] > 0.25) & (pixels[..., 2] - pixels[..., 0] > 0.25)
    rows, columns = np.nonzero(teal)
    long = [rows[columns == column].mean() for column in np.unique(columns)]
    return np.array(long)
