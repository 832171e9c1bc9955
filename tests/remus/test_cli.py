import json
import shutil
import subprocess
import sys

import pytest
from matplotlib.image import imread

from bar_recordings import write_bars
from neuro.events import Events, recordings, save
from neuro_recognise import Recogniser, fit
from neuro_recognise.energy import bills
from neuro_recognise.method import Progress
from neuro_recognise.methods import method_of
from neuro_recognise.telling.report import LearningBar, try_out
from neuro_remus import demo
from refused import mistakes_of


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Recordings of bars; the last of them is empty."""
    folder = write_bars(tmp_path_factory.mktemp("bars"))
    save(Events([], [], [], [], (34, 34)), folder / "Test" / "lying" / "23.bin", replace=True)
    return folder


@pytest.fixture
def neuro(answer, monkeypatch, tmp_path):
    """Run `neuro ...`; return exit status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / "cache")

    return answer


SMALL = ("--set", "theta=40", "--set", "per_class=2", "--set", "epochs=3")


@pytest.fixture(scope="module")
def trained(folder, tmp_path_factory):
    """A recogniser that learnt the bars."""
    method = method_of("remus", values={"theta": 40, "per_class": 2, "epochs": 3})
    out = tmp_path_factory.mktemp("trained") / "model.h5"
    fit(recordings(folder, part="Train"), method, out=out, cache=out.parent / "cache")
    return out


@pytest.fixture
def model(trained, tmp_path):
    return shutil.copy(trained, tmp_path / "model.h5")


@pytest.mark.filterwarnings("ignore:backend")
def test_pages_and_lines_of_the_demonstration(trained, folder, tmp_path, capsys, monkeypatch):
    made, unseen = Recogniser.load(trained), recordings(folder, part="Test")
    tried = try_out(made, unseen)
    demo.write_page(tmp_path / "index.html", made, {"remus": (tried, bills(tried, ["loihi", "cpu"]))})
    text = (tmp_path / "index.html").read_text("utf-8")
    assert f'<h3>right, remus</h3><p class="big">{tried.own.accuracy:.1%}</p>' in text
    assert text.count("<img ") == 3  # what it looks for, the curve, what it takes for what
    assert text.index(">loihi</td>") < text.index("not in the bill: the camera")
    assert "neuro new my-classifier --template classifier" in text
    monkeypatch.setattr("neuro.core.progress.EVERY_S", 0.0)
    with LearningBar() as bar:
        for done in range(4):
            bar.show(Progress("epoch 1 of 2", done, 3, 0.5))
    assert capsys.readouterr().err.splitlines().count("epoch 1 of 2: 50.0% right") == 1


def test_train_test_show(neuro, folder, tmp_path):
    code, out, err = neuro("recognise", "train", "remus", "--data", folder, *SMALL)
    assert (code, err.count("% right"), out) == (0, 3, "model.h5: remus for 2 classes, learnt from 16 recordings\n")
    code, out, _ = neuro("recognise", "test", "model.h5", "--data", folder, "--json", "--out", "pictures")
    figures = json.loads(out.partition("\n")[2])
    assert (code, figures["n"], figures["classes"], figures["method"]) == (0, 8, ["lying", "upright"], "remus")
    assert figures["accuracy"] == figures["votes"]["potentials"]["accuracy"] == 7 / 8
    assert (figures["silent"], figures["confusion"]) == (1, [[3, 0, 1], [0, 4, 0]])
    assert set(figures["votes"]) == {"majority", "potentials"}
    assert figures["interval"][0] < 7 / 8 < figures["interval"][1]
    code, out, _ = neuro("recognise", "test", "model.h5", "--data", folder)
    assert (code, "87.5%" in out) == (0, True)
    code, out, _ = neuro("recognise", "show", "model.h5", "--out", "pictures")
    assert (code, " layer.theta " in out, " 40.0 " in out) == (0, True, True)
    for name, least in (("prototypes", (300, 400)), ("learning", (300, 600)), ("confusion", (300, 300))):
        image = imread(tmp_path / "pictures" / f"{name}.png")
        assert all(side >= limit for side, limit in zip(image.shape, least, strict=False))
        assert 0.01 < (image[..., :3].min(axis=2) < 0.9).mean() < 0.9
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cache", "model.h5", "pictures"]


def test_energy(neuro, folder, model):
    code, out, err = neuro("recognise", "energy", "model.h5", "--data", folder)
    assert (code, err, "of 8 right" in out) == (0, "", True)
    assert all(f"\n {target} " in out for target in ("loihi", "spinnaker", "spinnaker2", "truenorth", "cpu", "gpu"))
    words = ("--chips", "truenorth,cpu", "--json")
    code, out, _ = neuro("recognise", "energy", "model.h5", "--data", folder, *words)
    told = json.loads(out)
    assert (code, [bill["target"] for bill in told["bills"]]) == (0, ["truenorth", "cpu"])
    tested = json.loads(neuro("recognise", "test", "model.h5", "--data", folder, "--json")[1])
    assert (told["accuracy"], told["recordings"]) == (tested["accuracy"], 8)


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
def test_train_test_and_energy_on_other_backends(neuro, folder):
    assert neuro("recognise", "train", "remus", "--data", folder, "--backend", "loihi", *SMALL)[0] == 0
    figures = json.loads(neuro("recognise", "test", "model.h5", "--data", folder, "--backend", "loihi", "--json")[1])
    assert figures["accuracy"] == 7 / 8
    told = json.loads(neuro("recognise", "energy", "model.h5", "--data", folder, "--backend", "spinnaker", "--json")[1])
    assert (told["backend"], told["accuracy"]) == ("spinnaker", 7 / 8)
    settings = "--set theta=40 --set per_class=1 --set epochs=1"
    more = f"--backend reference {settings} --preset adapted --out a.h5".split()
    assert neuro("recognise", "train", "remus", "--data", folder / "Test", *more)[0] == 0


def test_mistakes(neuro, folder, model, tmp_path, messages):
    (tmp_path / "other" / "round").mkdir(parents=True)
    (tmp_path / "other" / "round" / "1.bin").write_bytes((folder / "Train" / "lying" / "1.bin").read_bytes())
    (tmp_path / "bare.yaml").write_text("limits:\n  cores_per_chip: {value: 128, source: me}\n")
    messages(mistakes_of(neuro, messages.cases, folder=folder))


def test_demo_of_given_recordings(neuro, folder, tmp_path):
    for _ in range(2):
        code, out, _ = neuro("remus", "demo", "--data", folder, "--out", "demo")
        assert code == 0
        assert "learning from 16 recordings of 2 classes" in out
        assert "testing on 8 unseen recordings" in out
        assert "\n gpu " in out.partition("demo/energy.json\n")[2].partition("energy per recording; ")[2]
    assert json.loads((tmp_path / "demo" / "energy.json").read_text())["recordings"] == 8
    from neuro_remus.demo import halves

    learning, unseen = halves(folder / "Train", 0)
    assert (len(learning), len(unseen)) == (12, 4)
    assert not {item.name for item in learning} & {item.name for item in unseen}
    assert sorted(item.label for item in unseen) == [0, 0, 1, 1]


def test_help_is_light():
    code = "import sys, neuro_remus.cli; sys.exit(bool({'numba', 'h5py', 'matplotlib', 'numpy'} & sys.modules.keys()))"
    subprocess.run([sys.executable, "-c", code], check=True)
