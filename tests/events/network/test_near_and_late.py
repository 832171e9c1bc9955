"""A recording that is over before it begins, and the nearest names of files and formats."""

import neuro
from neuro.compiler.resolve import compile_network
from neuro.events import Events
from refused import refused as told_of

RECORDING = Events([1000, 3000], [0, 1], [0, 1], [0, 1], (2, 2))


def camera(**words) -> None:
    net = neuro.Network("seen")
    net.population("eyes", "auto", neuro.event_camera(**{"events": RECORDING} | words))
    compile_network(net, 1)


def test_an_offset_beyond_the_recording(messages, tmp_path):
    neuro.events.save(RECORDING, file := tmp_path / "walk.aedat4")
    told = {f"{words}": told_of(camera, **words) for words in ({"offset": 1e6}, {"origin": 3001})}
    told["file"] = told_of(camera, file=str(file), events=None, offset=2.001)
    messages({case: text.partition("population")[2] for case, text in told.items()})
    camera(offset=2)
    camera(origin=3000)


def test_files_and_formats(tmp_path):
    neuro.events.save(Events([1], [0], [0], [0], (2, 2)), tmp_path / "walk.dat")
    near = "hint: did you mean 'walk.dat'?"
    assert told_of(lambda: neuro.events.load(tmp_path / "wlk.dat")).endswith(f"no such file\n  {near}")
    net = neuro.Network("seen")
    net.population("eyes", "auto", neuro.event_camera(file=tmp_path / "wlk.dat"))
    assert told_of(lambda: neuro.compile(net)).endswith(near)
    assert told_of(lambda: neuro.events.load(tmp_path / "other")).endswith("no such file")
    message = told_of(lambda: neuro.events.load(tmp_path / "walk.dat", format="aedat9"))
    assert message.endswith("hint: did you mean 'aedat2' or 'aedat3' or 'aedat4'?")
