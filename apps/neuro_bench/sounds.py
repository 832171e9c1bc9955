"""Tasks with sounds: wav files become mel levels from the onset of speech, and spikes at threshold crossings.

| representation | contents |
| --- | --- |
| levels | 32 mel bands every 12.5 ms, relative to the loudest value: 0 dB is 1, -50 dB and less is 0 |
| frames, for non-spiking networks | means of two consecutive levels, shape (1, bands, frames) |
| spikes, for spiking networks | a spike when a band crosses one of four thresholds, downward or upward |

Training uses several versions of each recording: the original, and versions that resemble other speakers. Tests use the
original only.
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
"""Name, sampling rate in Hz and samples in [-1, 1] of a recording."""

BANDS, HOP, WINDOW, POOLED = 32, 12.5, 32.0, 2
"""Number of mel bands; hop and window of the levels in ms; number of levels that are averaged into a frame."""
RANGE, ONSET, BEFORE = 50.0, 30.0, 3
"""Range of levels in dB; onset of speech in dB below the loudest level; number of levels kept before the onset."""
THRESHOLDS = (0.3, 0.45, 0.6, 0.8)
"""Levels; a band spikes when it crosses one of them."""
VOICE, TEMPO, COLOUR, NOISE = 0.2, 0.25, 5.0, (-80.0, -35.0)
"""Augmentation: largest relative change of pitch, and of tempo; standard deviation of the room's frequency response in
dB; range of white noise in dB relative to the largest sample."""


class Sounds(Task):
    """Classification of sounds: a folder or zip with a folder of wav files for each class."""

    called_by = "sounds"
    title = "sounds in folders of classes"
    licence = "that of your files"
    source = "your own wav files: a folder or zip of CLASS/NAME.wav"
    steps: ClassVar[int] = 56
    """Number of levels from the onset of a recording."""
    versions: ClassVar[int] = 8
    """Number of versions of each recording for training."""

    def folds(self) -> Sequence[Fold]:
        """Return five random folds.

        Raises:
            ModelError: a file is not a wav file or not in a folder, or there are too few files.
        """
        sounds = [(self._folder(name), rate, sound) for name, rate, sound in self.sounds()]
        return random_folds(self.examples(sounds), 5, self.seed)

    def _folder(self, name: str) -> str:
        if not (folder := Path(name).parent.name):
            raise ModelError(f"{self.data}: {name} is in no folder: expected CLASS/NAME.wav", hint=self.source)
        return folder

    def sounds(self) -> Iterator[Sound]:
        """Yield the name, sampling rate in Hz and samples in [-1, 1] of each wav file.

        Raises:
            ModelError: there is no wav file, or a file is damaged.
        """
        assert self.data is not None
        record_input(self.data)
        n_files = 0
        for name, content in _files(self.data):
            n_files += 1
            yield name, *_wav(f"{self.data}: {name}", content)
        if not n_files:
            raise ModelError(f"{self.data}: has no wav files: expected recordings of each class", hint=self.source)

    def examples(self, sounds: Sequence[Sound]) -> Examples:
        """Return all versions of recordings as examples.

        Args:
            sounds: class, sampling rate in Hz and samples of each recording.
        """
        rng = np.random.default_rng((self.seed, 4))
        classes = tuple(sorted({label for label, _, _ in sounds}))
        labels = np.array([classes.index(label) for label, _, _ in sounds] * self.versions)
        versions = [loudness(rate, sound, self.steps) for _, rate, sound in sounds]
        for _ in range(self.versions - 1):
            versions += [loudness(rate, sound, self.steps, rng) for _, rate, sound in sounds]
        levels = np.stack(versions)
        frames = levels.reshape(len(levels), -1, POOLED, BANDS).mean(axis=2).transpose(0, 2, 1)[:, None]
        return Examples(np.ascontiguousarray(frames), labels, classes, spikes_of(levels), self.versions)


def loudness(rate: float, sound: Series, steps: int, rng: np.random.Generator | None = None) -> Floats:
    """Return the levels of a recording from the onset of speech, in [0, 1], shape (steps, bands); 0 after the end.

    Args:
        rate: sampling rate, Hz.
        sound: samples.
        steps: number of levels.
        rng: random generator of the pitch, tempo, frequency response and noise of an augmented version; None for the
            original.
    """
    if rng is not None:
        pitch = _random_factor(rng, VOICE)
        sound = np.interp(np.arange(0.0, len(sound), pitch), np.arange(len(sound)), sound)
        noise = 10.0 ** (rng.uniform(*NOISE) / 20.0) * np.abs(sound).max(initial=0.0)
        sound = sound + rng.normal(0.0, noise, len(sound))
    levels = MelBands(rate, BANDS, window=WINDOW, hop=HOP).hear(sound)
    relative_levels = np.zeros((steps, BANDS), dtype=np.float32)
    if not len(levels):
        return relative_levels
    onset = int((levels.max(axis=1) > levels.max() - ONSET).argmax())
    if rng is not None:
        onset += int(rng.integers(-2, 3))
    levels = levels[max(0, onset - BEFORE) :]
    if rng is not None:
        times = np.arange(0.0, len(levels) - 1.0, _random_factor(rng, TEMPO))
        fraction, lower = (times % 1.0)[:, None], times.astype(np.int64)
        levels = (1.0 - fraction) * levels[lower] + fraction * levels[lower + 1]
        levels += np.interp(np.arange(BANDS), np.linspace(0, BANDS - 1, 5), rng.normal(0.0, COLOUR, 5))
    levels = levels[:steps]
    if len(levels):
        relative_levels[: len(levels)] = np.clip(1.0 + (levels - levels.max()) / RANGE, 0.0, 1.0)
    return relative_levels


def _random_factor(rng: np.random.Generator, share: float) -> float:
    """Draw a factor from 1 / (1 + share) to 1 + share, log-uniformly."""
    return float((1.0 + share) ** rng.uniform(-1.0, 1.0))


def spikes_of(levels: Floats) -> Spikes:
    """Return a spike for each threshold crossing.

    The first sheet has the downward crossings, the second sheet the upward crossings. A row is a threshold, a column is
    a band.

    Args:
        levels: levels in [0, 1], shape (examples, steps, bands).
    """
    spikes = [crossings(level, THRESHOLDS).reshape(len(level), -1).nonzero() for level in levels]
    step, neuron = np.concatenate(spikes, axis=1)
    example = np.repeat(np.arange(len(levels)), [len(steps) for steps, _ in spikes])
    return Spikes((2, len(THRESHOLDS), levels.shape[2]), levels.shape[1], HOP, example, step, neuron)


def _files(path: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the name and content of each wav file in a folder, in a zip, or in the only zip of a folder."""
    if path.is_dir():
        files = sorted(path.rglob("*.wav"))
        zips = sorted(path.glob("*.zip"))
        if files or len(zips) != 1:
            yield from ((str(file.relative_to(path)), file.read_bytes()) for file in files)
            return
        path = zips[0]
    try:
        with zipfile.ZipFile(path) as archive:
            names = sorted(name for name in archive.namelist() if name.lower().endswith(".wav"))
            yield from ((name, archive.read(name)) for name in names)
    except zipfile.BadZipFile:
        raise ModelError(f"{path}: is not a zip: expected a folder or a zip of wav files") from None


def _wav(place: str, content: bytes) -> tuple[float, Series]:
    """Return the sampling rate in Hz and the samples in [-1, 1], averaged over the channels."""
    from scipy.io import wavfile

    try:
        with warnings.catch_warnings(action="ignore", category=wavfile.WavFileWarning):
            rate, samples = wavfile.read(io.BytesIO(content))
    except (ValueError, EOFError) as error:
        raise ModelError(f"{place}: is not a wav file: {error}") from None
    values = samples.astype(np.float64)
    if samples.dtype == np.uint8:  # samples of 8 bits are unsigned in wav files
        values = (values - 128.0) / 127.0
    elif samples.dtype.kind == "i":
        values /= np.iinfo(samples.dtype).max
    return float(rate), values if values.ndim == 1 else values.mean(axis=1)


_NAME = re.compile(r"(?P<label>[^_/]+)_(?P<speaker>[^_/]+)_[^/]*\.wav", re.I)


class SpokenDigits(Sounds):
    """Classification of spoken digits: a folder or a zip of CLASS_SPEAKER_INDEX.wav."""

    called_by = "spoken-digits"
    title = "spoken digits, 8 kHz, six speakers"
    licence = "CC BY-SA 4.0"
    source = "https://github.com/Jakobovski/free-spoken-digit-dataset: a folder or zip of CLASS_SPEAKER_INDEX.wav"
    splits = ("random", "speakers")

    def folds(self) -> Sequence[Fold]:
        """Return five random folds, or one fold per speaker, in which only the test part has this speaker.

        Raises:
            ModelError: a file is damaged or its name has no class, or there are too few files.
        """
        sounds, speakers = [], []
        for name, rate, sound in self.sounds():
            if (fields := _NAME.fullmatch(Path(name).name)) is None:
                message = f"{self.data}: {name} has no class in its name: expected CLASS_SPEAKER_INDEX.wav"
                raise ModelError(message, hint="e.g. 7_jackson_32.wav; the task 'sounds' reads folders of classes")
            sounds.append((fields["label"], rate, sound))
            speakers.append(fields["speaker"])
        examples = self.examples(sounds)
        return random_folds(examples, 5, self.seed) if self.split == "random" else grouped_folds(examples, speakers)


LISTS = ("validation_list.txt", "testing_list.txt")
"""Files with the official validation and test part."""
BACKGROUND = "_background_noise_"
"""Folder of recordings that are no words."""


class SpeechCommands(Sounds):
    """Classification of spoken words: the 35 words of version 0.02, or those with a folder in the data."""

    called_by = "speech-commands"
    title = "Speech Commands, one second at 16 kHz"
    licence = "CC BY 4.0"
    source = "Warden, arXiv:1804.03209; speech_commands_v0.02.tar.gz, unpacked: WORD/NAME.wav and the official lists"
    splits = ("official",)
    steps: ClassVar[int] = 80
    versions: ClassVar[int] = 1

    def folds(self) -> Sequence[Fold]:
        """Return the official fold.

        Raises:
            ModelError: a list is missing, or a part of the fold is empty.
        """
        assert self.data is not None
        lists = []
        for file in (self.data / name for name in LISTS):
            try:
                lists.append(file.read_text("utf-8").split())
            except OSError as error:
                raise ModelError(f"{file}: cannot be read: {error.strerror}", hint=self.source) from None
        names, sounds = [], []
        for name, rate, sound in self.sounds():
            if (word := self._folder(name)) != BACKGROUND:
                names.append(f"{word}/{Path(name).name}")
                sounds.append((word, rate, sound))
        validation, test = (np.isin(names, part) for part in lists)
        train = ~validation & ~test
        for part, mask in ((LISTS[0], validation), (LISTS[1], test), ("the training part (in neither list)", train)):
            if not mask.any():
                raise ModelError(f"{self.data}: {part} has no recording: expected at least one", hint=self.source)
        return Folds(self.examples(sounds), [("official", train, validation, test)])
