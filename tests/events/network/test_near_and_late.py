"""A recording that is over before it begins, and the nearest names of files and formats."""

import pytest

import neuro
from neuro import ModelError
from neuro.compiler.resolve import compile_network
from neuro.events import Events
from refused import refused as told

RECORDING = Events([1000, 3000], [0, 1], [0, 1], [0, 1], (2, 2))


def camera(**words) -> None:
    net = neuro.Network("seen")
    net.population("eyes", "auto", neuro.event_camera(events=RECORDING, **words))
    compile_network(net, 1)


def test_an_offset_beyond_the_recording():
    with pytest.raises(ModelError) as caught:
        camera(offset=1e6)
    assert str(caught.value).partition(": ")[2] == (
        "population 'eyes': event_camera.offset = 1000000 ms: the recording has no event after that"
    )
    with pytest.raises(ModelError, match=r"event_camera.origin = 3001 us: the recording has no event after that"):
        camera(origin=3001)
    camera(offset=2)
    camera(origin=3000)


def test_an_offset_beyond_a_file(tmp_path):
    file = tmp_path / "walk.aedat4"
    neuro.events.save(RECORDING, file)
    net = neuro.Network("seen")
    net.population("eyes", "auto", neuro.event_camera(file=str(file), offset=2.001))
    with pytest.raises(ModelError, match=r"event_camera.offset = 2.001 ms: the recording has no event after that"):
        compile_network(net, 1)


def test_files_and_formats(tmp_path):
    neuro.events.save(Events([1], [0], [0], [0], (2, 2)), tmp_path / "walk.dat")
    near = "hint: did you mean 'walk.dat'?"
    assert told(lambda: neuro.events.load(tmp_path / "wlk.dat")).endswith(f"no such file\n  {near}")
    net = neuro.Network("seen")
    net.population("eyes", "auto", neuro.event_camera(file=tmp_path / "wlk.dat"))
    assert told(lambda: neuro.compile(net)).endswith(near)
    assert told(lambda: neuro.events.load(tmp_path / "other")).endswith("no such file")
    message = told(lambda: neuro.events.load(tmp_path / "walk.dat", format="aedat9"))
    assert message.endswith("hint: did you mean 'aedat2' or 'aedat3' or 'aedat4'?")
