from pathlib import Path

import pytest
from matplotlib.image import imread


@pytest.fixture
def ran(neuro, network):
    neuro("run", network, "--backend", "reference", "--for", "20")
    return "out.h5"


def test_the_command(neuro, ran):
    answer = neuro("plot", "out.h5", "--out", "pictures")
    assert answer.out.split() == [f"pictures/out-{name}.png" for name in ("raster", "rates", "traces")]
    for name in answer.out.split():
        picture = imread(name)
        assert picture.shape[1] == 1500
        assert picture[..., :3].std() > 0.01
    assert neuro("plot", "out.h5").out.split()[0] == "out-raster.png"
    assert not list(Path().rglob("*.part"))


BEGIN = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}


@pytest.mark.parametrize("form", BEGIN)
def test_other_formats(neuro, ran, form):
    words = ("plot", ran, "--format", form, "--of", "one", "--window", 5, 10, "--bin", 2)
    names = [f"out-{name}.{form}" for name in ("raster", "rates", "traces")]
    assert neuro(*words).out.split() == names
    assert all(Path(name).read_bytes().startswith(BEGIN[form]) for name in names)
    assert neuro(*words).status == 0, "its own pictures are replaced"
    Path(names[0]).write_bytes(BEGIN[form] + b" of somebody else")
    answer = neuro(*words)
    assert answer.err == f"error: {names[0]}: exists and is not a picture of neuro: expected a new name\n"


def test_a_drawing_that_was_edited_stays(neuro, ran):
    words = ("plot", ran, "--format", "svg")
    neuro(*words)
    drawing = Path("out-raster.svg")
    drawing.write_text(drawing.read_text().replace("neuron", "cell"))
    assert neuro(*words).status == 2


def test_only_what_was_asked_for(neuro, ran):
    answer = neuro("plot", ran, "--population", "exc", "--population", "one")
    assert answer.out.split() == ["out-raster.png", "out-rates.png", "out-traces.png"]
    answer = neuro("plot", ran, "--of", "noise")
    assert (answer.status, answer.err) == (
        2,
        "error: spikes of 'noise' were not kept\n  hint: 'neuro run --record noise' keeps them\n",
    )
    answer = neuro("plot", ran, "--of", "ecx")
    assert (answer.status, answer.err) == (2, "error: unknown population 'ecx'\n  hint: did you mean 'exc'?\n")
    answer = neuro("plot", ran, "--window", 10, 5)
    expected = "error: window = [10, 5]: expected (begin, end) in ms with 0 <= begin < end\n"
    assert (answer.status, answer.err) == (2, expected)


def test_what_is_no_folder(neuro, network):
    neuro("run", network, "--backend", "reference", "--for", "2")
    for name in ("/dev/full", network):
        answer = neuro("plot", "out.h5", "--out", name)
        expected = f"error: {name}: is no folder: expected the name of a folder, or a new name\n"
        assert (answer.status, answer.out, answer.err) == (2, "", expected)
