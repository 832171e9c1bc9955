"""The five ways through the code in docs/explanation/programs.md: each station exists, and is passed in order."""

import ast
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest

import neuro
from neuro.cli.mistakes import mistake
from neuro.compiler.mistakes import mistakes
from neuro.events import Events, load, save
from neuro.results import read
from neuro_recognise.recogniser import fit

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "explanation" / "programs.md").read_text("utf-8").partition("## Five ways")[2]
WAYS = {
    title: re.findall(r"^\d\. `([\w/.]+)` `([\w.]+)`", text, re.M)
    for title, text in re.findall(r"^\*\*([\w ]+)\*\*,(.*?)(?=^\*\*|\Z)", PAGE, re.M | re.S)
}
NETWORK = """\
name: way
resolution: 1 ms
populations:
  input: {shape: 2, model: {spike_generator: {spike_times: [[1, 5], [2]]}}}
  cells: {shape: 3, model: iaf_psc_delta}
projections:
  wires: {from: input, to: cells, rule: all_to_all, weight: 20 mV, delay: 1 ms}
"""


@contextmanager
def called(stations: list[tuple[str, str]]) -> Iterator[list[tuple[str, str]]]:
    """The calls of some functions in the block, each a file of this project and a name, in their order."""
    calls: list[tuple[str, str]] = []

    def note(frame: FrameType, event: str, argument: object) -> None:
        code = frame.f_code
        place = code.co_filename.removeprefix(f"{ROOT}/"), code.co_qualname
        if event == "call" and place in stations:
            calls.append(place)

    sys.setprofile(note)
    try:
        yield calls
    finally:
        sys.setprofile(None)


def network(folder: Path, text: str = NETWORK) -> Path:
    file = folder / "way.yaml"
    file.write_text(text)
    return file


def a_weight(folder: Path) -> None:
    sim = neuro.compile(neuro.load(network(folder)), backend="event")
    assert sim.weights("wires")[2].tolist() == [20.0] * 6


def a_spike(folder: Path) -> None:
    sim = neuro.compile(neuro.load(network(folder)), backend="event")
    with sim.record_to(folder / "way.h5"):
        sim.run(10.0)
    assert read(folder / "way.h5").spikes("input")[0].tolist() == [1.0, 2.0, 5.0]


def a_mistake(folder: Path) -> None:
    found = mistakes(network(folder, NETWORK.replace("20 mV", "20 Hz")), {}, 0).mistakes
    assert "way.yaml:7:61: projection 'wires': weight = 20 Hz: expected a voltage in mV" in mistake(found[0])


def an_event_file(folder: Path) -> None:
    for label, x in (("left", 3), ("right", 12)):
        (folder / label).mkdir()
        for k in range(3):
            t = [1000 * each + 100 * k for each in range(20)]
            save(
                Events(
                    t, [x + each % 3 for each in range(20)], [5 + each % 4 for each in range(20)], [1] * 20, (16, 16)
                ),
                folder / label / f"{k}.dat",
            )
    recogniser = fit(neuro.events.recordings(folder), "hots")
    assert recogniser.predict(load(folder / "left" / "0.dat")).tolist() == [0]


def a_joule(folder: Path) -> None:
    sim = neuro.compile(neuro.load(network(folder)), backend="loihi")
    sim.run(10.0)
    assert sim.energy("loihi").cells()


@pytest.mark.parametrize(
    ("way", "go"),
    [
        ("A weight", a_weight),
        ("A spike", a_spike),
        ("A mistake", a_mistake),
        ("An event file", an_event_file),
        ("A joule", a_joule),
    ],
)
def test_a_way_passes_its_stations_in_order(way: str, go: Callable[[Path], None], tmp_path: Path):
    stations = WAYS[way]
    assert 3 <= len(stations) <= 6
    for file, name in stations:
        defined = ast.parse((ROOT / file).read_text("utf-8"))
        for part in name.split("."):
            defined = next(each for each in defined.body if getattr(each, "name", "") == part)
    with called(stations) as calls:
        go(tmp_path)
    later = iter(calls)  # `in` goes on behind the call that it found
    assert [each for each in stations if each not in later] == []
