"""What pages make of little room, in a browser: tables fit usual widths, and nothing is cut on a narrow page."""

import html as plain
import re

from neuro.core import html

MEASURE = """
const place = document.querySelector('.scroll'), head = document.querySelector('thead')
document.title = [place.scrollWidth <= place.clientWidth, getComputedStyle(head).display].join(' ')
"""
TITLE = "const h = document.querySelector('h2'); document.title = h.scrollWidth <= h.clientWidth"
GATHER = """
const titles = () => [...document.querySelectorAll('iframe')].map(frame => frame.contentDocument.title).join('|')
onload = () => { document.title = titles() }
"""
HEAD = "runs on|>accuracy|>95 % interval|>equal decisions|>equal spikes|>dynamic|>static|>total|>chip time|>first spike"
ROW = ("spinnaker", "89.0%", "86.0% - 91.5%", "100.0%", "481 of 500", "392.5 uJ", "3.6 mJ", "3.992 mJ", "10 ms",
       "18.6 ms")  # fmt: skip
SHORT = ("what", "value"), ("command", "neuro train dense --search " + ",".join(f"step={k}:{k + 1}" for k in range(20)))
PANEL = "<section style='width:150px'><h2>Event camera <span>brighter darker true place</span></h2></section>"


def shown(head, row):
    return html.page("test", "", [html.table(head, [row])], MEASURE)


def test_pages_of_several_widths(chromium, tmp_path):
    """Each in a frame of its width: ten columns fit, or are a list; two stay a table; titles of panels wrap."""
    fits, listed = "true table-header-group", "true none"
    style = html.style_sheets("player.css")
    panel = f"<title>x</title><style>{style}</style>{PANEL}<script>{TITLE}</script>"
    cases = [
        *((width, shown(HEAD.split("|"), ROW), fits) for width in (800, 960, 1120, 1400)),
        (600, shown(HEAD.split("|"), ROW), listed),
        (600, shown(*SHORT), fits),
        (600, panel, "true"),
    ]
    frame = '<iframe width="{}" height="300" srcdoc="{}"></iframe>'
    frames = (frame.format(width, plain.escape(page)) for width, page, _ in cases)
    (tmp_path / "page.html").write_text(f"<title>x</title>{''.join(frames)}<script>{GATHER}</script>", "utf-8")
    dom = chromium("--window-size=1500,900", "--dump-dom", f"file://{tmp_path / 'page.html'}")
    assert re.search("<title>(.*?)</title>", dom)[1].split("|") == [expected for *_, expected in cases]
