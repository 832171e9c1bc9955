"""What users get wrong is told in one message; what is right beside it is done."""

import json
import re

import numpy as np
import pytest

import neuro
from neuro import ModelError
from neuro.events import EventFileError, Events, recordings, save
from neuro_recognise import Recogniser, fit
from neuro_recognise.compare import MethodComparison, compare, contestants
from neuro_recognise.method import METHODS
from neuro_recognise.methods.descriptor import Descriptor
from neuro_recognise.parts.readouts import Readout
from neuro_recognise.recogniser import method_of
from refused import mistakes_of, refusals_of


def test_backends_are_looked_at_before_any_recording_is_read(neuro, folder, learning, monkeypatch, model, messages):
    monkeypatch.setattr(type(learning), "sensor_size", None)
    messages(mistakes_of(neuro, messages.cases, folder=folder))


def test_of_no_recordings_there_are_no_scores(learning, model):
    for made in (Recogniser.load(model), fit(learning, "boe")):
        assert (made.scores([]).shape, made.predict([]).shape) == ((0, 3), (0,))
        assert (made.predict(learning.take([])).shape, made.scores_at(learning[0].load(), []).shape) == ((0,), (0, 3))


def test_recordings_that_are_damaged_empty_or_none(neuro, folder, model, tmp_path):
    good = sorted((folder / "Test" / "lying").glob("*.bin"))[:2]
    (tmp_path / "bad.bin").write_bytes(good[0].read_bytes()[:-2])
    code, out, err = neuro("predict", "m.h5", good[0], "bad.bin", good[1], "nothing.bin", "--json")
    assert (code, [one["recording"] for one in json.loads(out)]) == (1, list(map(str, good)))
    assert re.fullmatch(r"error: bad\.bin: byte \d+: .*\nerror: nothing\.bin: no such file\n", err)
    code, out, err = neuro("predict", "m.h5", "bad.bin")
    assert (code, out, err.count("error: ")) == (2, "", 1)
    save(Events([], [], [], [], (34, 34)), tmp_path / "empty.npz")
    code, out, _ = neuro("predict", "m.h5", "empty.npz", "--json")
    (said,) = json.loads(out)
    assert (code, said["class"], said["decided_ms"], said["scores"]) == (0, None, None, None)


def test_a_recogniser_of_another_training_stays(neuro, folder, model, tmp_path):
    train, before = ("train", "hats", "--data", folder, "--out", "m.h5"), (tmp_path / "m.h5").read_bytes()
    hint = "\n  hint: give another name, or --force (in Python replace=True) to replace it\n"
    for words, told in (
        ((*train, "--seed", "1"), "seed = 0: found 1 now"),
        ((*train, "--set", "cell=9"), "cell = 7: found 9 now"),
        ((*train, "--set", "readout=ridge"), "readout = svm: found ridge now"),
        ((*train, "--part", "Test"), "other recordings"),
        (("train", "boe", *train[2:]), "method = hats: found boe now"),
    ):
        code, out, err = neuro(*words)
        assert (code, out, err) == (2, "", f"error: m.h5: a recogniser that was trained with {told}{hint}")
    assert (neuro(*train)[0], (tmp_path / "m.h5").read_bytes()) == (0, before)
    assert (neuro(*train, "--seed", "1", "--force")[0], neuro(*train, "--seed", "1")[0]) == (0, 0)


READ = [name for name, method in METHODS.items() if "readout" in method.__dataclass_fields__]


@pytest.mark.parametrize(
    ("name", "values"),
    [*((name, {"readout": "ridge"}) for name in READ),
     *(("boe", {"readout": readout}) for readout in Readout.known if readout != "ridge"),
     *(("boe", {"readout.scale": scale}) for scale in ("standard", "length"))],
)  # fmt: skip
def test_readouts_read_every_method_and_bags_of_events_at_any_scale(learning, unseen, name, values, tmp_path_factory):
    cache = tmp_path_factory.getbasetemp() / "read"
    values |= {"A_plus": 0.05} if name == "masquelier_thorpe" else {}
    scores = fit(learning, method_of(name, values=values), cache=cache).scores(unseen)
    full = np.array([len(item.load()) > 0 for item in unseen])
    assert np.isfinite(scores[full]).all()
    assert np.isnan(scores[~full]).all()


def test_a_damaged_recording_stops_a_training_with_its_name(neuro, folder, tmp_path):
    for k, name in enumerate(("a", "b")):
        (tmp_path / "data" / name).mkdir(parents=True)
        for j in range(2):
            good = next((folder / "Train" / ("lying", "upright")[k]).glob(f"*{j}.bin"))
            (tmp_path / "data" / name / f"{j}.bin").write_bytes(good.read_bytes())
    bad = tmp_path / "data" / "b" / "1.bin"
    whole = bad.read_bytes()
    for damaged in (whole[:-2], whole[:-5] + b"\x00", b"\xff" * 4):
        bad.write_bytes(damaged)
        code, out, err = neuro("train", "hats", "--data", "data", "--out", "m.h5")
        assert (code, out) == (2, "")
        assert re.fullmatch(r"error: data/b/1\.bin: byte \d+: .*\n", err), err


@pytest.fixture
def picky():
    """A method that looks at recordings of at least 100 ms alone."""

    class Picky(Descriptor):
        title, source = "picky", "a test"

        def describe(self, events):
            if len(events) and events.t[-1] - events.t[0] < 100_000:
                raise ModelError("found 90 ms: expected at least 100 ms", hint="record longer")
            return np.ones(2)

    neuro.register(Picky)
    yield
    for where in ("_parts", "_registered"):
        getattr(METHODS, where).pop("picky", None)


def compared(data, folder, *names, **more):
    plan = MethodComparison(contestants(names), 2, (0,), more.pop("targets", ()), folder, jobs=1, **more)
    return compare(data, plan, lambda progress: None)


def test_what_a_method_or_chip_refuses_is_a_row_beside_others(picky, learning, tmp_path):
    one, other = compared(learning, tmp_path / "all", "picky", "hats")
    assert re.fullmatch(r".*/Train/lying/1\.bin: found 90 ms: expected at least 100 ms", one.refused)
    assert (one.evaluations, other.refused, other.accuracy) == ((), "", 1.0)
    (one,) = compared(learning, tmp_path / "all", "must", backend="loihi")
    assert one.refused.startswith("backend 'loihi' cannot run this network (1 problem): ")
    assert "must.yaml:40:3: population 'excited': adaptive" in one.refused


def test_a_damaged_recording_stops_a_comparison(tmp_path, folder):
    for name in ("lying", "upright"):
        (tmp_path / name).mkdir()
        for file in sorted((folder / "Train" / name).glob("*.bin"))[:4]:
            (tmp_path / name / file.name).write_bytes(file.read_bytes())
    bad = tmp_path / "upright" / file.name
    bad.write_bytes(bad.read_bytes()[:-2])
    with pytest.raises(EventFileError, match=rf"upright/{file.name}: byte \d+"):
        compared(recordings(tmp_path), tmp_path / "all", "hats")


def test_a_fold_is_kept_until_code_or_settings_change(learning, tmp_path, monkeypatch):
    folder = tmp_path / "all"

    def written(*names, **more):
        before = {file: file.stat().st_mtime_ns for file in folder.glob("*.json")}
        compared(learning, folder, *names, **more)
        return sorted(f.name for f in folder.glob("*.json") if before.get(f) != f.stat().st_mtime_ns)

    both = ["hats-0-0.json", "hats-0-1.json"]
    assert (written("hats"), written("hats")) == (both, [])
    assert written("hats", targets=("loihi",), backend="reference") == [], "neither concerns it"
    monkeypatch.setattr("neuro_recognise.compare.code_of", lambda method: "other")
    assert (written("hats"), written("hats:poker")) == (both, ["hats-poker-0-0.json", "hats-poker-0-1.json"])


def test_another_target_runs_one_fold_again(letters, small, tmp_path, monkeypatch, learning):
    monkeypatch.setattr("neuro_recognise.compare.observe", lambda *args, **more: letters.take(range(24)))
    monkeypatch.setattr("neuro_recognise.compare._observing_ms", lambda *args: 1.0)
    monkeypatch.setattr("neuro_recognise.compare.method_of", lambda name, preset: small)
    folder = tmp_path / "all"
    (first,) = compared(learning, folder, "remus", targets=("gpu",))
    before = {file.name: file.stat().st_mtime_ns for file in folder.glob("*.json")}
    (second,) = compared(learning, folder, "remus", targets=("loihi", "gpu"))
    again = {file.name: file.stat().st_mtime_ns for file in folder.glob("*.json")}
    assert [name for name in sorted(again) if again[name] != before[name]] == ["remus-0-0.json"]
    assert (list(second.bills), second.bills["gpu"]) == (["loihi", "gpu"], first.bills["gpu"])


@pytest.mark.parametrize("name", METHODS)
def test_every_setting_has_a_meaning_and_a_source_and_survives_a_file(name):
    method = method_of(name)
    for row in method.rows():
        assert row.doc, f"{name}: {row.name} has no meaning"
        assert row.source or row.name == "size", f"{name}: {row.name} has no source"
    assert type(method).from_words(json.loads(json.dumps(method.as_words()))) == method
    for preset in method.presets:
        other = method_of(name, preset)
        assert (other == method) == (not method.presets[preset]), f"{name}: preset {preset} changes nothing"
        assert type(method).from_words(json.loads(json.dumps(other.as_words()))) == other


def test_values_change_by_their_own_name_or_that_of_their_part():
    boe = method_of("boe", values={"threshold": 120, "segmenter.tau": 0.03, "C": 2})
    assert (boe.segmenter.threshold, boe.segmenter.tau, boe.readout.C) == (120.0, 0.03, 2.0)
    rbf = method_of("boe", values={"readout": "rbf", "readout.gamma": 0.5, "segmenter": "counts", "count": 99})
    assert (rbf.readout.called(), rbf.readout.gamma, rbf.segmenter.count) == ("rbf", 0.5, 99)
    assert method_of("boe", values={"readout": "svm"}) == method_of("boe")
    assert method_of("edhmax_tempotron", "remus_front_end", {"representation": "leaky"}).called() == "edhmax_tempotron"
    assert method_of("hats", "poker").cell == 12


def test_wrong_values(messages):
    messages(refusals_of(messages.cases, globals()))
