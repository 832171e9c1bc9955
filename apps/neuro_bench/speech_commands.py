"""Speech Commands: words of a second, with the official lists of what is validated and tested."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from neuro import ModelError
from neuro_bench.sounds import Sounds
from neuro_bench.task import Fold, Folds

LISTS = ("validation_list.txt", "testing_list.txt")
NOISE = "_background_noise_"


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
        validated, tested = (self._listed(name) for name in LISTS)
        names, heard = [], []
        for name, rate, sound in self.sounds():
            if (word := self._folder(name)) != NOISE:
                names.append(f"{word}/{Path(name).name}")
                heard.append((word, rate, sound))
        held, kept = (np.isin(names, list(part)) for part in (validated, tested))
        for what, part in ((LISTS[0], held), (LISTS[1], kept), ("what is in no list", ~held & ~kept)):
            if not part.any():
                raise ModelError(f"{self.data}: {what} has no recording: expected some", hint=self.source)
        return Folds(self.examples(heard), [("official", ~held & ~kept, held, kept)])

    def _listed(self, name: str) -> set[str]:
        assert self.data is not None
        try:
            return set((self.data / name).read_text("utf-8").split())
        except OSError as error:
            raise ModelError(f"{self.data / name}: cannot be read: {error.strerror}", hint=self.source) from None
