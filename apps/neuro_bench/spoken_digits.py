"""Spoken digits: the Free Spoken Digit Dataset, or other sounds whose names say class and speaker."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from neuro import ModelError
from neuro_bench.sounds import Sounds
from neuro_bench.task import Fold, grouped_folds, random_folds

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
