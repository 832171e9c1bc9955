"""What pages make of little room, in a browser: tables fit usual widths, and nothing is cut on a narrow page."""

import re

import pytest

from neuro.core import html

MEASURE = """
const place = document.querySelector('.scroll'), head = document.querySelector('thead')
document.title = [place.scrollWidth <= place.clientWidth, getComputedStyle(head).display].join(' ')
"""
HEAD = ("runs on", ">accuracy", ">95 % interval", ">equal decisions", ">equal spikes", ">dynamic", ">static", ">total",
        ">chip time", ">first spike")  # fmt: skip
ROW = (
    "spinnaker",
    "89.0%",
    "86.0% - 91.5%",
    "100.0%",
    "481 of 500",
    "392.5 uJ",
    "3.6 mJ",
    "3.992 mJ",
    "10 ms",
    "18.6 ms",
)
SHORT = ("what", "value"), ("command", "neuro train dense --search " + ",".join(f"step={k}:{k + 1}" for k in range(20)))


@pytest.fixture
def shown(chromium, tmp_path):
    """Whether all of a table is seen in a window of some width, and how its head is displayed."""

    def of(head, row, width):
        file = tmp_path / "page.html"
        file.write_text(html.page("test", "", [html.table(head, [row])], MEASURE), "utf-8")
        dom = chromium(f"--window-size={width},900", "--dump-dom", f"file://{file}")
        return re.search("<title>(.*?)</title>", dom)[1].split()

    return of


@pytest.mark.parametrize("width", [800, 960, 1120, 1400])
def test_ten_columns_fit(shown, width):
    assert shown(HEAD, ROW, width) == ["true", "table-header-group"]


def test_many_columns_are_a_list_where_there_is_little_room(shown):
    assert shown(HEAD, ROW, 600) == ["true", "none"]


def test_two_columns_stay_a_table(shown):
    assert shown(*SHORT, 600) == ["true", "table-header-group"]


def test_titles_of_panels_wrap(chromium, tmp_path):
    measure = "const h = document.querySelector('h2'); document.title = h.scrollWidth <= h.clientWidth"
    panel = "<section style='width:150px'><h2>Event camera <span>brighter darker true place</span></h2></section>"
    page = f"<title>x</title><style>{html.player_style()}</style>{panel}<script>{measure}</script>"
    (tmp_path / "page.html").write_text(page, "utf-8")
    assert "<title>true</title>" in chromium("--dump-dom", f"file://{tmp_path / 'page.html'}")
