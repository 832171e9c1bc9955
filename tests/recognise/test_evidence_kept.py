"""What a data set shows is kept: by contents, settings and code, and read one recording at a time."""

import os
import pickle
import sys

import numpy as np
import pytest

from neuro.core.extension import run_extension
from neuro_recognise import fit, observations
from neuro_recognise.compare import MethodComparison, compare, contestants
from neuro_recognise.method import METHODS
from neuro_recognise.methods.descriptor import Hats
from neuro_recognise.observations import KeptAnswers, keep, observe
from neuro_recognise.parts.readouts import Ridge
from neuro_recognise.recogniser import method_of, settled
from refused import refused

OWN = """
from dataclasses import dataclass

import neuro
import numpy as np
from neuro_recognise.methods.descriptor import Descriptor
{more}

@dataclass(frozen=True)
class Sums(Descriptor):
    title = "sums"
    source = "a test"

    def describe(self, events):
        return {sums}


neuro.register(Sums)
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Write and run a file with a method of one's own, as a new process would."""
    folder = tmp_path / "own"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python does not see an edit of the same second and length

    def run(sums, more=""):
        file = folder / "my_sums.py"
        file.write_text(OWN.format(sums=sums, more=more))
        monkeypatch.setattr("neuro.core.extension._run", {})
        for where in ("_parts", "_registered"):
            getattr(METHODS, where).pop("sums", None)
        for name in ("my_sums", "my_helper"):
            sys.modules.pop(name, None)
        observations._text.cache_clear()
        run_extension(file)
        return METHODS["sums"]()

    yield run
    for where in ("_parts", "_registered"):
        getattr(METHODS, where).pop("sums", None)


def vectors(method, data, cache):
    return observe(settled(method, data), data, cache=cache).stacked("vector")


def test_edited_code_looks_anew(own, learning, tmp_path):
    before = vectors(own("np.array([len(events), 1.0])"), learning, tmp_path / "cache")
    assert (before[:, 1] == 1.0).all()
    (kept,) = (tmp_path / "cache").iterdir()
    again = vectors(own("np.array([len(events), 1.0])"), learning, tmp_path / "cache")
    np.testing.assert_array_equal(again, before)
    assert list((tmp_path / "cache").iterdir()) == [kept]
    after = vectors(own("np.array([len(events), 2.0])"), learning, tmp_path / "cache")
    assert (after[:, 1] == 2.0).all()
    helper = tmp_path / "own" / "my_helper.py"
    for factor in (2.0, 3.0):
        helper.write_text(f"def scaled(n):\n    return {factor} * n\n")
        shown = vectors(own("np.array([scaled(1.0)])", "from my_helper import scaled"), learning, tmp_path / "cache")
        assert (shown == factor).all()


@pytest.fixture
def other_code(monkeypatch, tmp_path):
    """Pretend that our packages are a folder with a file of this text."""

    def pretend(text):
        file = tmp_path / "ours" / "part.py"
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
        monkeypatch.setattr(observations, "_folders", lambda: [file.parent])
        observations._ours.cache_clear()

    yield pretend
    observations._ours.cache_clear()


def test_the_digest_is_of_all_that_computes(monkeypatch):
    names = {folder.name for folder in observations._folders()}
    assert names == {"neuro", "neuro_event", "neuro_models", "neuro_recognise", "neuro_torch", "neuro_train"}
    assert all((one / "__init__.py").is_file() for one in observations._folders())

    def typed(factor, constant=1):
        space = {"__name__": "typed_in", "CONSTANT": constant, "Hats": Hats}
        exec(f"class Mine(Hats):\n    def observe(self, events):\n        return {factor} * CONSTANT", space)
        return space["Mine"]()

    told = [observations.code_of(typed(*values)) for values in ((1,), (1,), (2,), (1, 2))]
    assert told[0] == told[1] != observations.code_of(Hats())
    assert len(set(told)) == 3
    other = type("Other", (Ridge,), {"fit": lambda self, *more: {}, "__module__": "somewhere"})
    assert observations.code_of(Hats(readout=other())) != observations.code_of(Hats(readout=Ridge()))


def test_any_recording_is_read_by_itself(tmp_path):
    rng = np.random.default_rng(1)
    shown = [{"a": rng.random((k % 3, 2)), "b": np.arange(k, dtype=np.uint16), "c": np.array(k > 2)} for k in range(7)]
    file = tmp_path / "some.h5"
    keep(file, shown)
    for several in (KeptAnswers(file, 7), pickle.loads(pickle.dumps(KeptAnswers(file, 7)))):
        for k in (6, 0, 3, -1, 2):
            one = dict(several[k])
            assert list(one) == ["a", "b", "c"]
            for name, array in one.items():
                np.testing.assert_array_equal(array, shown[k][name], strict=True)
        assert [len(one["b"]) for one in several[4:]] == [4, 5, 6]
    with pytest.raises(IndexError):
        several[7]


def test_a_file_that_lost_its_end_is_told(tmp_path):
    file = tmp_path / "some.h5"
    keep(file, [{"a": np.arange(100)}])
    single = KeptAnswers(file, 1)
    assert len(single[0]["a"]) == 100
    os.truncate(file, file.stat().st_size - 8)
    told = f"{file}: damaged neuro recognise evidence 1: it ends too early"
    assert refused(lambda: single[0]["a"]) == told


def test_random_order_opens_a_file_once(learning, tmp_path, monkeypatch):
    monkeypatch.setattr("neuro_recognise.observations.AT_ONCE", 4)
    shown, opened = observe(settled(method_of("hots"), learning), learning, cache=tmp_path), []
    monkeypatch.setattr(
        "neuro_recognise.observations._File", lambda path, make=observations._File: opened.append(path) or make(path)
    )
    for k in np.random.default_rng(0).permutation(100) % len(learning):
        np.testing.assert_array_equal(shown.evidence[k]["x"], learning[int(k)].load().x)
    assert len(opened) == len(set(opened)) == 6


def test_recordings_are_fingerprinted_once(learning, tmp_path, monkeypatch):
    asked, real = [], type(learning).fingerprint
    monkeypatch.setattr(type(learning), "fingerprint", lambda self: asked.append(1) or real(self))
    fit(learning, "hats", cache=tmp_path)
    assert len(asked) == 1
    plan = MethodComparison(contestants(["hats", "tar_hats"]), 2, (0,), (), tmp_path / "compared", jobs=1)
    compare(learning.take(range(0, 24, 2)), plan, lambda progress: None)
    assert len(asked) == 2


def test_edited_code_of_ours_looks_anew_and_its_models_are_others(learning, tmp_path, other_code):
    out, cache = tmp_path / "m.h5", tmp_path / "cache"
    for text in ("1", "1"):
        other_code(text)
        fit(learning, "hats", out=out, cache=cache)
    other_code("2")
    assert refused(fit, learning, "hats", out=out).startswith(f"{out}: a recogniser that was trained with other code")
    fit(learning, "hats", out=out, replace=True, cache=cache)
    assert len(list(cache.iterdir())) == 2
