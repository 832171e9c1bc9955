"""Pages, pictures and figures of a recording."""

import base64
import io
import json
import re
from functools import partial

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from neuro.events import Events, save
from neuro.events.info import info
from neuro.events.pictures import gif, view


@pytest.fixture
def moving():
    """A bar that moves to the right in 60 ms: ON in front, OFF behind."""
    t, y = np.repeat(np.arange(60) * 1000, 20), np.tile(np.arange(10), 120)
    side = np.tile(np.repeat([0, 1], 10), 60)
    return Events(t + 7, np.clip(t // 2000 + 5 * side, 0, 39), y, side, (40, 10))


def data_of(path):
    text = path.read_text("utf-8")
    data = json.loads(re.search(r'id="data">(.*?)</script>', text)[1])
    kinds = {"t": "<u4", "x": "<u2", "y": "<u2", "p": "u1"}
    return data, {key: np.frombuffer(base64.b64decode(data[key]), kind) for key, kind in kinds.items()}, text


def test_the_page_holds_all_events(moving, tmp_path):
    assert view(moving, tmp_path / "v.html", title="a <b> & c") == 1
    data, columns, text = data_of(tmp_path / "v.html")
    assert np.array_equal(columns["t"] * data["unit"] + int(data["start"]), moving.t)
    assert all(np.array_equal(columns[key], getattr(moving, key)) for key in "xyp")
    assert (data["width"], data["height"], data["step"], sum(data["bars"])) == (40, 10, 1, len(moving))
    assert "<h1>a &lt;b&gt; &amp; c</h1>" in text
    assert "1,200 events, 40×10 px, 0.059 s</p>" in text
    assert "http" not in text.replace("http-equiv", "")


@pytest.mark.parametrize("cut", [1, 7, 100, 1200])
def test_of_many_events_an_even_choice_is_shown_and_told(moving, tmp_path, cut):
    parts = [moving[k : k + cut] for k in range(0, len(moving), cut)]
    assert view(parts, tmp_path / "v.html", title="many", most=200) == 8
    _, columns, text = data_of(tmp_path / "v.html")
    assert np.array_equal(columns["x"], moving.x[::8])
    assert "1 of every 8 events is shown (150)" in text


def test_a_recording_of_days_has_times_that_fit(tmp_path):
    view(Events([0, 3 * 10**11], [0, 1], [0, 1], [0, 1], (2, 2)), tmp_path / "v.html", title="days")
    data, columns, _ = data_of(tmp_path / "v.html")
    assert abs(int(columns["t"][1]) * data["unit"] - 3 * 10**11) < data["unit"]


def test_what_is_refused(messages, moving, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    empty, wide = Events([], [], [], [], (2, 2)), Events([0], [9000], [9000], [1], (9001, 9001))
    monkeypatch.setattr("neuro.events.pictures.MOST_FRAMES", 50)
    messages.calls(globals() | locals())
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def chromium(chromium):
    return partial(chromium, "--window-size=900,900")


STEPS = """
<script>
const seen = [get("now").textContent, get("shown").textContent];
slider.value = 10000; slider.oninput(); draw();
seen.push(get("now").textContent, get("shown").textContent);
get("window").value = 0; get("window").oninput(); draw();
seen.push(get("span").textContent, get("shown").textContent);
get("play").onclick(); seen.push(get("play").textContent, String(now));
get("play").onclick(); seen.push(get("play").textContent);
const row = pen.getImageData(0, 0, W, 1).data, drawn = [];
for (let k = 0; k < W; k++) if (row[4 * k] !== row[0]) drawn.push(k);
seen.push(drawn.join());
document.title = seen.join("|");
</script></body>"""


def test_a_browser_draws_it_moves_in_time_and_plays(moving, tmp_path, chromium):
    page = tmp_path / "v.html"
    view(moving, page, title="bar")
    page.write_text(page.read_text("utf-8").replace("</body>", STEPS), "utf-8")
    title = re.search("<title>(.*?)</title>", chromium("--dump-dom", f"file://{page}"))[1]
    assert title.split("|") == [
        "5.9 ms of 59.0 ms", "120 events", "59.0 ms of 59.0 ms", "120 events", "1.0 ms", "40 events", "Pause", "0",
        "Play", "29,34",
    ]  # fmt: skip


def test_it_looks_as_the_events_do(moving, tmp_path, chromium):
    view(moving, tmp_path / "v.html", title="bar")
    light = "--blink-settings=preferredColorScheme=1"
    chromium(light, f"--screenshot={tmp_path / 'v.png'}", f"file://{tmp_path / 'v.html'}")
    pixels = imread(tmp_path / "v.png")[..., :3]
    blue = (pixels[..., 2] - pixels[..., 0] > 0.4).nonzero()
    red = (pixels[..., 0] - pixels[..., 2] > 0.4).nonzero()
    assert min(len(blue[0]), len(red[0])) > 500
    assert np.median(blue[1]) > np.median(red[1]) + 50  # ON runs before OFF


def test_a_gif_shows_each_window(moving, tmp_path):
    made = gif([moving[:100], moving[100:]], tmp_path / "g.gif", window_us=20_000, fps=10)
    assert (made.frames, made.fps, made.size) == (3, 10.0, (240, 60))
    with Image.open(tmp_path / "g.gif") as picture:
        assert (picture.n_frames, picture.info["duration"], picture.info["loop"]) == (3, 100, 0)
        for k in range(3):
            picture.seek(k)
            shown = np.asarray(picture.convert("RGB"))[3::6, 3::6]
            part, expected = moving.between(7 + 20_000 * k, 7 + 20_000 * (k + 1)), np.full((10, 40, 3), 255)
            for x, y, p in zip(part.x, part.y, part.p, strict=True):
                expected[y, x] = (0, 0x72, 0xB2) if p else (0xD5, 0x5E, 0)
            assert np.array_equal(shown, expected)


def test_pauses_of_a_gif_are_told(moving, tmp_path):
    assert gif(moving, tmp_path / "g.gif", fps=30, scale=2).fps == pytest.approx(100 / 3)
    assert gif(moving, tmp_path / "h.gif", scale=2, colours=("red", "#00ff00", "black")).size == (80, 20)
    with Image.open(tmp_path / "h.gif") as picture:
        assert {colour for _, colour in picture.convert("RGB").getcolors()} == {(0, 0, 0), (255, 0, 0), (0, 255, 0)}


def test_a_short_recording_gives_a_second(moving, tmp_path):
    made = gif([moving[:100], moving[100:]], tmp_path / "g.gif", scale=1)
    assert (made.frames, made.window_us) == (25, 2361)
    long = Events(moving.t * 17, moving.x, moving.y, moving.p, (40, 10))
    assert gif(long, tmp_path / "g.gif", scale=1).window_us == 40_000


def test_of_many_events_no_more_are_held(moving, tmp_path, monkeypatch):
    monkeypatch.setattr("neuro.events.pictures.LONGEST_LOOK_AHEAD", 150)
    parts = [moving[k : k + 100] for k in range(0, len(moving), 100)]
    made = gif(parts, tmp_path / "g.gif", scale=1)
    assert (made.frames, made.window_us) == (2, 40_000)
    with Image.open(tmp_path / "g.gif") as picture:
        assert picture.n_frames == 2


def test_still_frames_are_left_out(tmp_path):
    blinks = Events(np.arange(2000) * 1000, np.full(2000, 3), np.zeros(2000, int), np.arange(2000) // 1000, (8, 8))
    made = gif(blinks, tmp_path / "g.gif", window_us=1000, scale=1, fps=0.1)
    assert (made.frames, made.left_out) == (50, 1950)
    with Image.open(tmp_path / "g.gif") as picture:
        assert (picture.n_frames, picture.info["duration"]) == (2, 250_000)


@pytest.mark.parametrize("name", ["x.h5", "x.csv", "x.dat"])
def test_info_counts(moving, tmp_path, name, monkeypatch):
    monkeypatch.setattr("neuro.events.info.BLOCK", 1000)
    late = Events(
        np.append(moving.t, 500_000), np.append(moving.x, 3), np.append(moving.y, 9), np.append(moving.p, 0), (40, 10)
    )
    save(late, tmp_path / name)
    found = info(tmp_path / name)
    assert (found.events, found.on, found.sensor_size) == (1201, 600, (40, 10))
    assert (found.start_us, found.stop_us, found.duration_us) == (7, 500_000, 499_993)
    assert (found.rate_hz, found.peak_hz) == (pytest.approx(1201 / 0.499993), 20_000)
    assert found.gaps == [(59_007, 440_993), (7, 1000), (1007, 1000)]
    assert found.active_pixels == len(set(zip(late.x.tolist(), late.y.tolist(), strict=True)))
    assert (found.hot_pixels, found.damage, found.as_dict()["on_share"]) == (0, [], 600 / 1201)


def test_info_reads_once_what_can_be_read_once(moving, tmp_path):
    save(moving, tmp_path / "x.csv")
    text = (tmp_path / "x.csv").read_bytes().split(b"\n", 1)[1]  # without the sensor
    with io.BytesIO(text) as pipe:
        found = info(pipe, name="pipe")
    assert (found.path, found.bytes, found.sensor_size, found.sensor_told) == ("pipe", None, (35, 10), False)
    (tmp_path / "y.csv").write_bytes(text)
    same = info(tmp_path / "y.csv")
    assert (found.events, found.active_pixels, found.gaps) == (same.events, same.active_pixels, same.gaps)
    assert found.active_pixels == len(set(zip(moving.x.tolist(), moving.y.tolist(), strict=True)))


def test_gaps_beyond_63_bits(tmp_path):
    save(Events([-(2**63), 0, 2**63 - 1], [0] * 3, [0] * 3, [0] * 3, (2, 2)), tmp_path / "x.csv")
    assert info(tmp_path / "x.csv").gaps == [(-(2**63), 2**63), (0, 2**63 - 1)]


def test_info_names_hot_pixels_and_damage(tmp_path):
    n = 500
    hot = Events(np.arange(n) * 100, np.full(n, 6), np.full(n, 2), np.zeros(n, int), (34, 34))
    save(hot, tmp_path / "x.bin")
    (tmp_path / "x.bin").write_bytes((tmp_path / "x.bin").read_bytes() + b"ab")
    found = info(tmp_path / "x.bin")
    assert (found.hot, found.hot_pixels, found.sensor_told) == ([(6, 2, 500)], 1, False)
    assert found.damage == ["byte 2500: 2 bytes left over after 500 events of 5 bytes; the events before it were read"]
    (tmp_path / "e.bin").write_bytes(b"")
    empty = info(tmp_path / "e.bin")
    assert (empty.events, empty.rate_hz, empty.duration_us, empty.as_dict()["on_share"]) == (0, None, 0, None)
