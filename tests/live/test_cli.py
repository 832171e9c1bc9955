"""`neuro live --page`, and a page on a loop."""

import json
import os
import re
import subprocess
import sys
import threading
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest

import neuro
from neuro.events import Events
from neuro.realtime import Loop
from running_page import Running

pytestmark = pytest.mark.usefixtures("frozen_heap")
NETWORK = """
neuro: 1
name: small
resolution: 1.0
populations:
  camera: {model: event_camera, shape: [2, 3, 4]}
  cells: {model: {iaf_psc_exp: {I_e: 600.0}}, shape: 3}
"""


@pytest.fixture
def network(tmp_path, websockets):
    path = tmp_path / "small.yaml"
    path.write_text(NETWORK)
    return path


def test_a_page_keeps_the_time(answer, network):
    found = answer("live", network, "--page", "--no-browser", "--for", 100, "--speed", "inf")
    assert found.status == 0, found.err
    assert re.fullmatch(r"page: http://127\.0\.0\.1:\d+/[\w-]{32}/\n", found.out)


BROWSER = """#!{python}
import json, os, re, stat, sys, urllib.parse, urllib.request
file = urllib.parse.unquote(urllib.parse.urlsplit(sys.argv[1]).path)
url = re.search('url=(http://[^"]+)', open(file).read())[1]
modes = [stat.S_IMODE(os.stat(name).st_mode) for name in (file, os.path.dirname(file))]
served = urllib.request.urlopen(url).read().decode()
json.dump({{"words": sys.argv[1:], "modes": modes, "url": url, "served": served}}, open({out!r}, "w"))
"""


def test_the_token_is_not_among_the_words_of_the_browser(network, tmp_path):
    browser, out = tmp_path / "browser", tmp_path / "out.json"
    browser.write_text(BROWSER.format(python=sys.executable, out=str(out)))
    browser.chmod(0o700)
    code = "from neuro.cli import main; main()"
    command = [sys.executable, "-c", code, "live", str(network), "--page", "--for", "100", "--speed", "inf"]
    environment = os.environ | {"BROWSER": str(browser)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    seen = json.loads(out.read_text())
    assert done.stdout == f"page: {seen['url']}\n"
    token = urlsplit(seen["url"]).path.strip("/")
    assert len(token) == 32
    assert token not in " ".join(seen["words"])
    assert seen["modes"] == [0o600, 0o700]
    assert "page.js" in seen["served"]
    file = Path(unquote(urlsplit(seen["words"][0]).path))
    assert not file.exists()
    assert not file.parent.exists()


def test_a_page_beside_a_loop(answer, network, tmp_path):
    found = answer("live", network, "--page", "--no-browser", "--for", 20, "--out", tmp_path / "day.h5")
    assert found.status == 0, found.err
    assert found.out.startswith("page: ")
    assert "event to action" in found.out


def test_a_stream_is_shown_without_a_network(answer, websockets):
    stream = ("udp://127.0.0.1:0", "--from", "spif", "--sensor", "34x34", "--page", "--no-browser")
    found = answer("events", "listen", *stream, "--for", 95.5)
    assert found.status == 0, found.err
    assert re.fullmatch(r"page: http://\S+\nudp://127\.0\.0\.1:\d+: 0 events in 0 datagrams, \d\.\d s\n", found.out)
    refused = answer("events", "listen", *stream, "--until-silent", 100)
    assert "--page: expected neither OUT nor --until-silent" in refused.err


def test_what_does_not_go_together_is_refused(messages, answer, network):
    found = {case: answer("live", network, *case.split()) for case in messages.cases}
    assert all(each.status for each in found.values())
    messages({case: " ".join(each.err.replace("│", " ").split()) for case, each in found.items()})


class Burst:
    """An input that gives some events at every look."""

    sensor_size = (4, 3)

    def __init__(self):
        self.now = 0

    def take(self):
        self.now += 1000
        return Events([self.now], [1], [2], [1], (4, 3))


def test_a_page_on_a_loop_shows_spikes_pictures_and_figures(network):
    sim = neuro.compile(neuro.load(network))
    with neuro.live.Page(sim, figures=lambda: {"ticks missed": "0"}) as page:
        loop = Loop(sim, tick=1.0, inputs={"camera": Burst()}, watch=page.tick)
        thread = threading.Thread(target=loop.run, args=(20_000.0,))
        thread.start()
        running = Running.__new__(Running)
        running.look(page)
        with running.client() as client:
            heads = [client.frame() for _ in range(20)]
            kept = client.until(lambda kept: "figures" in kept)
        loop.stop()
        thread.join()
    assert kept["figures"]["figures"] == {"ticks missed": "0"}
    assert not kept["about"]["paced"]
    assert "unknown command" in page.commands.answer({"do": "pause"})[0]["error"]
    spikes = sum(count for head, _ in heads for _, count in head["spikes"])
    rate = sum(head["rates"][1] * (head["time"] - head["began"]) * 1e-3 * 3 for head, _ in heads)
    assert spikes == pytest.approx(rate, abs=0.5)
    assert spikes > 0
    pictures = [np.frombuffer(body[-24:], "u1").reshape(2, 3, 4).astype(int) for _, body in heads]
    assert sum(picture[1, 2, 1] for picture in pictures) == sum(picture.sum() for picture in pictures) > 0
