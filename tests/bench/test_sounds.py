"""Tasks of sounds: who learns hears versions, who is tested the recording; official parts are kept."""

import numpy as np
import pytest
from scipy.io import wavfile

from neuro_bench.event_cameras import SHD
from neuro_bench.sounds import BANDS, Sounds, SpeechCommands, SpokenDigits, loudness, spikes_of
from refused import refusals_of

h5py = pytest.importorskip("h5py")


def tone(frequency=600.0, before=0.0, rate=8000.0):
    t = np.arange(round(0.3 * rate)) / rate
    return np.concatenate((np.zeros(round(before * rate)), np.sin(2 * np.pi * frequency * t)))


def write(folder, name, sound, rate=8000):
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    wavfile.write(folder / name, rate, (8000 * sound).astype(np.int16))


def test_loudness_and_spikes():
    heard = loudness(8000.0, tone(before=0.1), 40)
    assert heard.shape == (40, BANDS)
    assert loudness(8000.0, 0.1 * tone(before=0.4), 40) == pytest.approx(heard, abs=1e-5)
    assert not heard[30:].any()
    rng = np.random.default_rng(0)
    bands = [loudness(8000.0, tone(), 40, rng).sum(axis=0).argmax() for _ in range(20)]
    assert len(set(bands)) > 2
    assert max(bands) - min(bands) < 10
    assert loudness(8000.0, np.zeros(10), 8, rng).shape == (8, BANDS)
    assert np.isfinite(loudness(8000.0, np.zeros(4000), 8, rng)).all()
    levels = np.zeros((2, 5, 3), dtype=np.float32)
    levels[1, 2:4, 1] = 0.5
    spikes = spikes_of(levels)
    assert (spikes.shape, spikes.steps, spikes.step, spikes.example.tolist()) == ((2, 4, 3), 5, 12.5, [1] * 4)
    assert spikes.at.tolist() == [2, 2, 4, 4]
    assert spikes.neuron.tolist() == [12 + 1, 12 + 3 + 1, 1, 3 + 1]  # up by two thresholds, down by them


def test_who_is_tested_hears_recordings_as_they_are(sounds):
    for split in ("random", "speakers"):
        made = SpokenDigits(sounds, split).folds()
        assert len(made) == {"random": 5, "speakers": 3}[split]
        for fold in made:
            assert [part.versions for part in (fold.train, fold.validation, fold.both, fold.test)] == [8, 1, 8, 1]
            assert fold.train.recordings + fold.validation.recordings + fold.test.recordings == 36
            learnt = {one.tobytes() for one in fold.both.frames}
            assert len(learnt) == 8 * fold.both.recordings
            assert not learnt & {one.tobytes() for one in fold.test.frames}
            n = fold.both.recordings
            assert (fold.both.labels.reshape(8, n) == fold.both.labels[:n]).all()


def test_any_folder_of_sounds(tmp_path):
    for k in range(12):
        write(tmp_path, f"{'low' if k % 2 else 'high'}/{k}.wav", tone(300.0 if k % 2 else 2000.0))
    made = Sounds(tmp_path).folds()
    assert (made[0].test.classes, sum(len(fold.test) for fold in made)) == (("high", "low"), 12)


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.int32, np.float32])
def test_samples_of_every_type_are_heard_alike(tmp_path, kind):
    sound = 0.5 * tone()
    if kind == np.float32:
        samples = sound.astype(kind)
    else:
        largest = np.iinfo(kind).max if kind != np.uint8 else 127
        samples = np.rint(sound * largest + (128 if kind == np.uint8 else 0)).astype(kind)
    wavfile.write(tmp_path / "1_a_0.wav", 8000, np.stack((samples, samples), axis=1))
    (read,) = SpokenDigits(tmp_path).sounds()
    assert (read[:2], read[2]) == (("1_a_0.wav", 8000.0), pytest.approx(sound, abs=0.005))


@pytest.fixture
def commands(tmp_path):
    for k in range(6):
        write(tmp_path, f"{'yes' if k % 2 else 'no'}/s{k}_nohash_0.wav", tone(300.0 * (1 + k % 2), rate=16000.0), 16000)
    write(tmp_path, "_background_noise_/hum.wav", tone())
    (tmp_path / "validation_list.txt").write_text("no/s0_nohash_0.wav\n")
    (tmp_path / "testing_list.txt").write_text("yes/s1_nohash_0.wav\nno/s2_nohash_0.wav\n")
    return tmp_path


def test_speech_commands_have_their_official_parts(commands):
    (fold,) = SpeechCommands(commands).folds()
    assert fold.test.classes == ("no", "yes")
    assert [len(part) for part in (fold.train, fold.validation, fold.both, fold.test)] == [3, 1, 4, 2]
    assert (fold.test.labels.tolist(), fold.test.frames.shape) == ([0, 1], (2, 1, BANDS, 40))


def test_what_is_refused(tmp_path, commands, messages):
    def without(folder, name):
        (folder / name).unlink()
        return folder

    def listing(folder, text):
        (folder / "testing_list.txt").write_text(text)
        return folder

    def labels_alone(folder):
        with h5py.File(folder / "shd_train.h5", "w") as file:
            file["labels"] = [0]
        return folder

    for name in ("lost", "none", "wide", "labels"):
        (tmp_path / name).mkdir()
    write(tmp_path / "lost", "a/lost.wav", tone())
    write(tmp_path / "lost", "lost.wav", tone())
    messages(refusals_of(messages.cases, globals() | locals(), folder=tmp_path))


def heidelberg(folder, **changes):
    for name, count in (("shd_train.h5", 12), ("shd_test.h5", 4)):
        rng = np.random.default_rng(count)
        with h5py.File(folder / name, "w") as file:
            times = file.create_dataset("spikes/times", count, dtype=h5py.vlen_dtype(np.float16))
            units = file.create_dataset("spikes/units", count, dtype=h5py.vlen_dtype(np.uint16))
            for k in range(count):
                times[k] = np.sort(rng.uniform(0.0, 1.2, 30)).astype(np.float16)
                units[k] = changes.get("units", rng.integers(350 * (k % 2), 350 * (1 + k % 2), 30))
            file["labels"] = np.arange(count) % 2
            file["extra/keys"] = np.array([b"null", b"eins"])
    return folder


def test_heidelberg_digits(tmp_path):
    (fold,) = SHD(heidelberg(tmp_path)).folds()
    assert [len(part) for part in (fold.train, fold.validation, fold.both, fold.test)] == [11, 1, 12, 4]
    assert (fold.test.classes, fold.test.frames.shape) == (("null", "eins"), (4, 1, 140, 50))
    assert fold.test.spikes.shape == (1, 1, 140)
    lower = fold.test.spikes.neuron[np.isin(fold.test.spikes.example, (0, 2))]
    assert lower.max() < 70
    assert fold.test.spikes.at.max() < 100
    with h5py.File(tmp_path / "shd_test.h5") as file:
        counted = sum((times < 1.0).sum() for times in file["spikes/times"][()])
    assert np.expm1(fold.test.frames).sum() == pytest.approx(counted, rel=1e-4)
