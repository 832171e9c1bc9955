"""The page in a browser: it draws, it asks the network for nothing, and it says nothing on the console."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from neuro.compare.report import page


@pytest.fixture
def report(three, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(page(three), "utf-8")
    return file


INTRUDERS = Path(__file__).with_name("intruders.html").read_text("utf-8")


def test_the_browser_parses_all_of_it_and_asks_for_nothing(browser, report, tmp_path):
    """The page's own policy lets the browser load nothing, and it says so where something tries to, as it does here."""
    text = report.read_text("utf-8")
    (tmp_path / "bad.html").write_text(text.replace("</main>", f"{INTRUDERS}</main>"), "utf-8")
    dom, console = browser("--dump-dom", f"file://{tmp_path / 'bad.html'}")
    assert dom.count("<svg") == text.count("<svg") > 4
    assert "Written by neuro" in dom
    assert all("Content Security Policy" in line for line in console)
    assert all([line for line in console if what in line] for what in ("x.png", "x.woff2", "script"))


@pytest.mark.parametrize(("scheme", "dark"), [(1, False), (0, True)])
def test_it_is_drawn_light_and_dark(chromium, report, tmp_path, scheme, dark):
    picture, look = tmp_path / "page.png", f"--blink-settings=preferredColorScheme={scheme}"
    chromium(look, "--window-size=1200,2600", f"--screenshot={picture}", f"file://{report}")
    pixels = imread(picture)[..., :3]
    paper = pixels[5, 5]
    assert (paper.mean() < 0.2) == dark
    drawn = np.abs(pixels - paper).max(axis=2) > 0.15
    assert 0.01 < drawn.mean() < 0.5
    hues = pixels.max(axis=2) - pixels.min(axis=2) > 0.3
    assert hues.sum() > 500  # spikes that differ have a colour
