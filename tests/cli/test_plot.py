import shutil
from pathlib import Path

import pytest
import yaml
from matplotlib.image import imread

from small_networks import NETWORK

VIEWS = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))["views"]


def test_mistakes(neuro, ran, messages):
    for view in (*VIEWS, "noise", "ecx"):
        messages({f"--of {view}": neuro("plot", ran, "--of", view).err})
    for words in ("--between 10 5", "--between 0 3s", "--between 0 soon", "--out /dev/full", "--out net.yaml"):
        messages({words: neuro("plot", ran, *words.split()).err})
    assert sorted(path.name for path in Path().iterdir()) == ["net.yaml", "out.h5"]


def test_parts_of_results(neuro, ran):
    """A view is written as in YAML, in brackets behind the name; of traces its neurons are drawn alone."""
    names = [f"out-{name}.png" for name in ("raster", "rates", "traces")]
    assert neuro("plot", ran, "--of", "exc", "--of", "one").out.split() == names
    assert neuro("plot", ran, "--between", "0.005 s", "10 ms", "--bin", "1 ms").status == 0
    for view in (" exc [ 1, 0:4:2 ] ", "exc[[3, 1]]"):
        answer = neuro("plot", ran, "--of", view, "--out", "views")
        assert answer.out.split() == [f"views/{name}" for name in names], answer.err


@pytest.fixture(scope="module")
def file(status_of, tmp_path_factory):
    """The results of a run."""
    folder = tmp_path_factory.mktemp("ran")
    (folder / "net.yaml").write_text(NETWORK)
    words = ("--backend", "reference", "--for", "20", "--out", folder / "out.h5")
    assert status_of("run", folder / "net.yaml", *words) == 0
    return folder / "out.h5"


@pytest.fixture
def ran(file, network):
    shutil.copy(file, "out.h5")
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


BEGIN = {"pdf": b"%PDF", "svg": b"<?xml"}


@pytest.mark.parametrize("form", BEGIN)
def test_other_formats(neuro, ran, form):
    words = ("plot", ran, "--format", form, "--of", "one", "--between", 5, 10, "--bin", 2)
    names = [f"out-{name}.{form}" for name in ("raster", "rates", "traces")]
    assert neuro(*words).out.split() == names
    assert all(Path(name).read_bytes().startswith(BEGIN[form]) for name in names)
    assert neuro(*words).status == 0, "its own pictures are replaced"
    Path(names[0]).write_bytes(BEGIN[form] + b" of another program")
    answer = neuro(*words)
    assert answer.err == f"error: {names[0]}: exists and is not a picture of neuro: expected a new name\n"
