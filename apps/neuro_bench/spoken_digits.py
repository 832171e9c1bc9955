"""Spoken digits: the Free Spoken Digit Dataset, or any folder of sounds whose names say class and speaker."""

from __future__ import annotations

import io
import re
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from neuro import ModelError
from neuro.apps import record_input
from neuro.coding import crossings, mel_levels
from neuro_bench.task import Examples, Fold, Series, Spikes, Task, grouped_folds, random_folds

BANDS, FRAMES, HOP, WINDOW = 32, 64, 12.5, 32.0
"""Bands; frames that are seen, of ms each, by a window of ms: the first 0.8 s."""
RANGE = 60.0
"""dB below the loudest band and frame of a recording that count."""
THRESHOLDS = (0.35, 0.5, 0.65, 0.8)
"""Levels, as shares of the range, at whose crossing a band spikes."""
_NAME = re.compile(r"(?P<label>[^_/]+)_(?P<speaker>[^_/]+)_[^/]*\.wav", re.I)


class SpokenDigits(Task):
    """Which digit is spoken.

    Sounds are in a folder or a zip, named CLASS_SPEAKER_INDEX.wav, or in folders of classes; these have no speakers.
    Artificial networks see 32 mel bands x 64 frames in [0, 1], relative to the loudest of the recording; spiking ones
    the crossings of four thresholds by the same levels, down and up.
    """

    called_by = "spoken-digits"
    title = "spoken digits, 8 kHz, six speakers"
    licence = "CC BY-SA 4.0"
    source = "https://github.com/Jakobovski/free-spoken-digit-dataset: a folder or zip of CLASS_SPEAKER_INDEX.wav"
    splits = ("random", "speakers")

    def folds(self) -> Sequence[Fold]:
        """Five random ones, or one for each speaker, who is heard in no other part.

        Raises:
            ModelError: a file is no sound, or there are too few.
        """
        examples, speakers = self._read()
        if self.split == "random":
            return random_folds(examples, 5, self.seed)
        return grouped_folds(examples, speakers)

    def _read(self) -> tuple[Examples, list[str]]:
        assert self.data is not None
        record_input(self.data)
        found, speakers = [], []
        for name, content in _sounds(self.data):
            said = _NAME.fullmatch(Path(name).name)
            label = said["label"] if said else Path(name).parent.name
            if not label:
                hint = "7_jackson_32.wav, or seven/32.wav"
                raise ModelError(f"{self.data}: {name} names no class: expected CLASS_SPEAKER_INDEX.wav", hint=hint)
            found.append((label, loudness(*_wav(f"{self.data}: {name}", content))))
            speakers.append(said["speaker"] if said else "")
        if not found:
            raise ModelError(f"{self.data}: has no wav files: expected recordings of each class", hint=self.source)
        classes = tuple(sorted({label for label, _ in found}))
        labels = np.array([classes.index(label) for label, _ in found])
        levels = np.stack([level for _, level in found])
        spikes = np.stack([crossings(level, THRESHOLDS) for level in levels])
        frames = levels.transpose(0, 2, 1)[:, None].astype(np.float32)
        return Examples(frames, labels, classes, Spikes.of_dense(spikes, HOP)), speakers


def loudness(rate: float, sound: Series) -> Series:
    """Mel levels of the first 0.8 s as shares of 60 dB below the loudest, 0 after the end, shape (frames, bands)."""
    levels = mel_levels(sound, rate, BANDS, window=WINDOW, hop=HOP)[:FRAMES]
    shares = np.zeros((FRAMES, BANDS))
    if len(levels):
        shares[: len(levels)] = np.clip(1.0 + (levels - levels.max()) / RANGE, 0.0, 1.0)
    return shares


def _sounds(path: Path) -> Iterator[tuple[str, bytes]]:
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
    largest = float(np.iinfo(samples.dtype).max) if samples.dtype.kind == "i" else 1.0
    values = samples.astype(np.float64) / largest
    return float(rate), values if values.ndim == 1 else values.mean(axis=1)
