import shutil
from pathlib import Path

import pytest
from matplotlib.image import imread

from small_networks import NETWORK


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


def test_only_what_was_asked_for(neuro, ran):
    answer = neuro("plot", ran, "--of", "exc", "--of", "one")
    assert answer.out.split() == ["out-raster.png", "out-rates.png", "out-traces.png"]
    answer = neuro("plot", ran, "--of", "noise")
    assert (answer.status, answer.err) == (
        2,
        "error: spikes of 'noise' were not kept\n  hint: 'neuro run --record noise' keeps them\n",
    )
    answer = neuro("plot", ran, "--of", "ecx")
    assert (answer.status, answer.err) == (2, "error: unknown population 'ecx'\n  hint: did you mean 'exc'?\n")
    answer = neuro("plot", ran, "--between", 10, 5)
    expected = "error: window = [10, 5]: expected (begin, end) in ms with 0 <= begin < end\n"
    assert (answer.status, answer.err) == (2, expected)


def test_times_with_units(neuro, ran):
    assert neuro("plot", ran, "--between", "0.005 s", "10 ms", "--bin", "1 ms").status == 0
    answer = neuro("plot", ran, "--between", "0 ms", "3 s")
    assert answer.err == "error: window = [0, 3000]: the run ends at 20 ms: expected an end <= 20 ms\n"
    answer = neuro("plot", ran, "--between", "0", "soon")
    assert answer.err == "error: --between: found 'soon': expected a time in ms\n"


def test_some_neurons(neuro, ran):
    """A view is written as in YAML, in brackets behind the name; of traces its neurons are drawn alone."""
    for view in (" exc [ 1, 0:4:2 ] ", "exc[[3, 1]]"):
        answer = neuro("plot", ran, "--of", view, "--out", "views")
        assert answer.out.split() == [f"views/out-{name}.png" for name in ("raster", "rates", "traces")], answer.err


@pytest.mark.parametrize(
    ("view", "expected"),
    [
        ("ecx[:2]", "unknown population 'ecx'\n  hint: did you mean 'exc'?"),
        ("exc[:999]", "exc[:999]: axis 0: found 999: expected -2 to 2"),
        (
            "exc[a]",
            'exc: found \'a\': expected a number or begin:end:step for each axis\n  hint: write "0:100" or "2:4, :"',
        ),
        ("exc[:2", "found 'exc[:2': expected ']' at its end\n  hint: write 'exc[0:100]'"),
        ("exc[[1, x]]", "exc: found '[1, x]': expected a list of ids such as [3, 7]"),
        ("exc[0, 1, 2]", "exc[0, 1, 2]: found 3 indices: expected at most 2, one for each axis"),
        ("exc[2:2]", "exc[2:2]: axis 0 chooses no neuron: expected at least one"),
        ("exc[[1, 1]]", "exc[[1, 1]] chooses neuron 1 more than once: expected each once"),
    ],
)
def test_views_that_are_none(neuro, ran, view, expected):
    answer = neuro("plot", ran, "--of", view)
    assert (answer.status, answer.err) == (2, f"error: {expected}\n")


def test_what_is_no_folder(neuro, ran):
    for name in ("/dev/full", "net.yaml"):
        answer = neuro("plot", "out.h5", "--out", name)
        expected = f"error: {name}: is no folder: expected the name of a folder, or a new name\n"
        assert (answer.status, answer.out, answer.err) == (2, "", expected)
