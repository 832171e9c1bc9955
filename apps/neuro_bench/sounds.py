"""Sounds as tasks: wav files by path, mel levels from where speech begins, and spikes where levels cross thresholds.

| a recording becomes | |
| --- | --- |
| levels | 32 mel bands every 12.5 ms, in dB below the loudest of the recording, 50 dB as 1 to 0 |
| frames, for artificial networks | the levels, two in time as one, shape (1, bands, frames) |
| spikes, for spiking ones | where a band passes one of four levels, downward and upward |

Who learns hears each recording in several versions: as it is, and as if other speakers had said it. Who is tested hears
it as it is.
"""

from __future__ import annotations

import io
import re
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from neuro import ModelError
from neuro.apps import record_input
from neuro.coding import MelBands, crossings
from neuro_bench.task import Examples, Floats, Fold, Folds, Series, Spikes, Task, grouped_folds, random_folds

Sound = tuple[str, float, Series]
"""Name, rate in Hz and samples in [-1, 1] of a recording."""

BANDS, HOP, WINDOW, POOLED = 32, 12.5, 32.0, 2
"""Mel bands; ms from level to level; ms that a level sees; levels in time that are one for artificial networks."""
RANGE, ONSET, BEFORE = 50.0, 30.0, 3
"""dB below the loudest that count; speech begins at these dB below the loudest, and so many levels before are heard."""
THRESHOLDS = (0.3, 0.45, 0.6, 0.8)
"""Levels at whose crossing a band spikes."""
VOICE, TEMPO, COLOUR, NOISE = 0.2, 0.25, 5.0, (-80.0, -35.0)
"""Of versions: shares by which a voice is higher or lower, and speech faster or slower; dB of a room's colour, and of
white noise, as standard deviation relative to the largest sample."""


class Sounds(Task):
    """Which class a sound is of: any folder or zip of folders of wav files, a folder a class."""

    called_by = "sounds"
    title = "sounds in folders of classes"
    licence = "that of your files"
    source = "your own wav files: a folder or zip of CLASS/NAME.wav"
    steps: ClassVar[int] = 56
    """Levels in time that are seen of each recording."""
    versions: ClassVar[int] = 8
    """Of each recording, for who learns."""

    def folds(self) -> Sequence[Fold]:
        """Five random ones.

        Raises:
            ModelError: a file is no sound or in no folder, or there are too few.
        """
        heard = [(self._folder(name), rate, sound) for name, rate, sound in self.sounds()]
        return random_folds(self.examples(heard), 5, self.seed)

    def _folder(self, name: str) -> str:
        if not (folder := Path(name).parent.name):
            raise ModelError(f"{self.data}: {name} is in no folder: expected CLASS/NAME.wav", hint=self.source)
        return folder

    def sounds(self) -> Iterator[Sound]:
        """Name, rate in Hz and samples in [-1, 1] of each wav file.

        Raises:
            ModelError: there is none, or a file is no sound.
        """
        assert self.data is not None
        record_input(self.data)
        found = False
        for name, content in _files(self.data):
            found = True
            yield name, *_wav(f"{self.data}: {name}", content)
        if not found:
            raise ModelError(f"{self.data}: has no wav files: expected recordings of each class", hint=self.source)

    def examples(self, heard: Sequence[Sound]) -> Examples:
        """Examples, in all versions, of recordings whose names are those of their classes."""
        rng = np.random.default_rng((self.seed, 4))
        classes = tuple(sorted({label for label, _, _ in heard}))
        labels = np.array([classes.index(label) for label, _, _ in heard] * self.versions)
        each = [loudness(rate, sound, self.steps) for _, rate, sound in heard]
        for _ in range(self.versions - 1):
            each += [loudness(rate, sound, self.steps, rng) for _, rate, sound in heard]
        levels = np.stack(each)
        frames = levels.reshape(len(levels), -1, POOLED, BANDS).mean(axis=2).transpose(0, 2, 1)[:, None]
        return Examples(np.ascontiguousarray(frames), labels, classes, spikes_of(levels), self.versions)


def loudness(rate: float, sound: Series, steps: int, rng: np.random.Generator | None = None) -> Floats:
    """Levels of a recording from where its speech begins, in [0, 1]; 0 after the end, shape (steps, bands).

    Args:
        rate: Hz.
        sound: samples.
        steps: that are seen.
        rng: draws a version: another height of the voice, tempo, colour and noise; None: as it is.
    """
    if rng is not None:
        higher = _about_1(rng, VOICE)
        sound = np.interp(np.arange(0.0, len(sound), higher), np.arange(len(sound)), sound)
        noise = 10.0 ** (rng.uniform(*NOISE) / 20.0) * np.abs(sound).max(initial=0.0)
        sound = sound + rng.normal(0.0, noise, len(sound))
    levels = MelBands(rate, BANDS, window=WINDOW, hop=HOP).hear(sound)
    shares = np.zeros((steps, BANDS), dtype=np.float32)
    if not len(levels):
        return shares
    begins = int((levels.max(axis=1) > levels.max() - ONSET).argmax())
    if rng is not None:
        begins += int(rng.integers(-2, 3))
    levels = levels[max(0, begins - BEFORE) :]
    if rng is not None:
        at = np.arange(0.0, len(levels) - 1.0, _about_1(rng, TEMPO))
        part, at = (at % 1.0)[:, None], at.astype(np.int64)
        levels = (1.0 - part) * levels[at] + part * levels[at + 1]
        levels += np.interp(np.arange(BANDS), np.linspace(0, BANDS - 1, 5), rng.normal(0.0, COLOUR, 5))
    levels = levels[:steps]
    if len(levels):
        shares[: len(levels)] = np.clip(1.0 + (levels - levels.max()) / RANGE, 0.0, 1.0)
    return shares


def _about_1(rng: np.random.Generator, share: float) -> float:
    """A factor between 1 / (1 + share) and 1 + share, as often below 1 as above."""
    return float((1.0 + share) ** rng.uniform(-1.0, 1.0))


def spikes_of(levels: Floats) -> Spikes:
    """Where bands pass the thresholds, on two sheets, down and up, with a row a threshold and a column a band.

    Args:
        levels: shape (examples, steps, bands).
    """
    places = [crossings(each, THRESHOLDS).reshape(len(each), -1).nonzero() for each in levels]
    at, neuron = np.concatenate(places, axis=1)
    example = np.repeat(np.arange(len(levels)), [len(steps) for steps, _ in places])
    return Spikes((2, len(THRESHOLDS), levels.shape[2]), levels.shape[1], HOP, example, at, neuron)


def _files(path: Path) -> Iterator[tuple[str, bytes]]:
    """Names and contents of the wav files of a folder, of a zip, or of the only zip in a folder."""
    if path.is_dir():
        files = sorted(path.rglob("*.wav"))
        zips = sorted(path.glob("*.zip"))
        if files or len(zips) != 1:
            yield from ((str(file.relative_to(path)), file.read_bytes()) for file in files)
            return
        path = zips[0]
    try:
        with zipfile.ZipFile(path) as packed:
            names = sorted(name for name in packed.namelist() if name.lower().endswith(".wav"))
            yield from ((name, packed.read(name)) for name in names)
    except zipfile.BadZipFile:
        raise ModelError(f"{path}: is no zip: expected a folder or a zip of wav files") from None


def _wav(place: str, content: bytes) -> tuple[float, Series]:
    """Rate in Hz and samples in [-1, 1], the mean of the channels."""
    from scipy.io import wavfile

    try:
        with warnings.catch_warnings(action="ignore", category=wavfile.WavFileWarning):
            rate, samples = wavfile.read(io.BytesIO(content))
    except (ValueError, EOFError) as error:
        raise ModelError(f"{place}: is no wav file: {error}") from None
    values = samples.astype(np.float64)
    if samples.dtype == np.uint8:  # 8 bits have no sign in wav files
        values = (values - 128.0) / 127.0
    elif samples.dtype.kind == "i":
        values /= np.iinfo(samples.dtype).max
    return float(rate), values if values.ndim == 1 else values.mean(axis=1)


_NAME = re.compile(r"(?P<label>[^_/]+)_(?P<speaker>[^_/]+)_[^/]*\.wav", re.I)


class SpokenDigits(Sounds):
    """Which digit is spoken: a folder or a zip of CLASS_SPEAKER_INDEX.wav."""

    called_by = "spoken-digits"
    title = "spoken digits, 8 kHz, six speakers"
    licence = "CC BY-SA 4.0"
    source = "https://github.com/Jakobovski/free-spoken-digit-dataset: a folder or zip of CLASS_SPEAKER_INDEX.wav"
    splits = ("random", "speakers")

    def folds(self) -> Sequence[Fold]:
        """Five random ones, or one for each speaker, who is heard in no other part.

        Raises:
            ModelError: a file is no sound, names no class, or there are too few.
        """
        heard, speakers = [], []
        for name, rate, sound in self.sounds():
            if (said := _NAME.fullmatch(Path(name).name)) is None:
                message = f"{self.data}: {name} names no class: expected CLASS_SPEAKER_INDEX.wav"
                raise ModelError(message, hint="7_jackson_32.wav; the task 'sounds' takes folders of classes")
            heard.append((said["label"], rate, sound))
            speakers.append(said["speaker"])
        examples = self.examples(heard)
        return random_folds(examples, 5, self.seed) if self.split == "random" else grouped_folds(examples, speakers)


LISTS = ("validation_list.txt", "testing_list.txt")
BACKGROUND = "_background_noise_"


class SpeechCommands(Sounds):
    """Which word is said, of the 35 of version 0.02, or of the folders that are there."""

    called_by = "speech-commands"
    title = "Speech Commands, one second at 16 kHz"
    licence = "CC BY 4.0"
    source = "Warden, arXiv:1804.03209; speech_commands_v0.02.tar.gz, unpacked: WORD/NAME.wav and the official lists"
    splits = ("official",)
    steps: ClassVar[int] = 80
    versions: ClassVar[int] = 1

    def folds(self) -> Sequence[Fold]:
        """The official one.

        Raises:
            ModelError: a list is missing, or a part of the fold is empty.
        """
        assert self.data is not None
        listed = []
        for file in (self.data / name for name in LISTS):
            try:
                listed.append(file.read_text("utf-8").split())
            except OSError as error:
                raise ModelError(f"{file}: cannot be read: {error.strerror}", hint=self.source) from None
        names, heard = [], []
        for name, rate, sound in self.sounds():
            if (word := self._folder(name)) != BACKGROUND:
                names.append(f"{word}/{Path(name).name}")
                heard.append((word, rate, sound))
        held, kept = (np.isin(names, part) for part in listed)
        for what, part in ((LISTS[0], held), (LISTS[1], kept), ("what is in no list", ~held & ~kept)):
            if not part.any():
                raise ModelError(f"{self.data}: {what} has no recording: expected some", hint=self.source)
        return Folds(self.examples(heard), [("official", ~held & ~kept, held, kept)])
