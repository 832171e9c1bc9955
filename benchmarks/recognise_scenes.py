"""Detection of several objects in scenes: `python benchmarks/recognise_scenes.py hats --out FOLDER`.

The training recordings are divided into folds. For each fold a recogniser learns from crops of scenes that are composed
of recordings of the other folds, and is tested on scenes of this fold. All results are stored in the folder, so the
same command continues an interrupted run. All methods use the same scenes and crops. The script prints the mean over
folds of each case, and the mAP of all pictures together. A class has few objects in a fold, so figures of a single fold
are rough.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from kept import NMNIST

from neuro.cli.options import assignments
from neuro.events import Recordings, recordings
from neuro_recognise import Recogniser, fit
from neuro_recognise.detection import Detecting, Detector, Scenery, write_scenes
from neuro_recognise.detection.boxes import Boxes, precision
from neuro_recognise.detection.detector import WAYS, try_out, write_crops
from neuro_recognise.detection.scenes import fold_of
from neuro_recognise.recogniser import method_of

PLAIN = Scenery()
LONG = {"length": 2000.0, "sensor": (160, 120)}
"""Settings of long scenes. In 2 s objects move by 20 px, for which the small sensor has too little room."""
CASES = {
    "apart": PLAIN,
    "touching": replace(PLAIN, touching=True),
    "noise": replace(PLAIN, noise=10.0),
    "still": replace(PLAIN, speed=0.0),
    "long": replace(PLAIN, **LONG),
    "long_touching": replace(PLAIN, touching=True, **LONG),
}
LEARNT = {"apart": 4, "touching": 4, "noise": 2}
"""Share of each case among the scenes to learn from, in tenths."""


def main() -> None:
    """Measure all folds and print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("method", help="see 'neuro recognise list'")
    options.add_argument("--out", type=Path, required=True, help="folder for scenes, recognisers and figures")
    options.add_argument("--data", type=Path, default=NMNIST)
    options.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="of the method")
    options.add_argument("--detecting", action="append", default=[], metavar="NAME=VALUE", help="of the detector")
    options.add_argument("--way", choices=WAYS, default="proposals", help="of finding objects")
    options.add_argument("--cases", nargs="+", choices=CASES, default=["apart", "touching", "noise", "long"])
    options.add_argument("--folds", type=int, default=5)
    options.add_argument("--only", type=int, nargs="+", help="these folds")
    options.add_argument("--scenes", type=int, default=20, help="of a fold and case")
    options.add_argument("--learn", type=int, default=800, help="scenes that crops come from")
    asked = options.parse_args()
    data = recordings(asked.data, part="Train")
    found: dict[str, list[dict[str, Any]]] = {case: [] for case in asked.cases}
    for fold in asked.only or range(asked.folds):
        for case, figures in fold_figures(asked, data, fold).items():
            found[case].append(figures)
            print(fold, case, told(figures), flush=True)
    for case, figures in found.items():
        print(f"{asked.method}, {case}, {sum(one['scenes'] for one in figures)} scenes: {told(*figures)}")
        print(f"  all pictures together: {pooled(figures, len(data.classes))}")


def fold_figures(asked: argparse.Namespace, data: Recordings, fold: int) -> dict[str, dict[str, Any]]:
    """Return the figures of a fold, by case."""
    held_out = fold_of(data, asked.folds, fold)
    settings = Detecting().changed(assignments(asked.detecting))
    name = "-".join([asked.method, *asked.set])
    way = [] if asked.way == "proposals" else [asked.way]
    tried = "-".join([name, *asked.detecting, *way])
    detector, figures = None, {}
    for case in asked.cases:
        file = asked.out / f"{tried}-{case}-{fold}.json"
        if not file.exists():
            scenes = write_scenes(
                asked.out / f"{case}-{fold}", data, CASES[case], asked.scenes, seed=1, chosen=held_out
            )
            detector = detector or Detector(learnt(asked, data, fold, held_out, name), settings, way=asked.way)
            tried_out = try_out(detector, scenes)
            pictures = [[as_rows(boxes) for boxes in pair] for pair in tried_out.pictures]
            file.write_text(json.dumps(tried_out.as_words(data.classes) | {"pictures": pictures}))
        figures[case] = json.loads(file.read_text())
    return figures


def learnt(asked: argparse.Namespace, data: Recordings, fold: int, held_out: Any, name: str) -> Recogniser:
    """Return a recogniser that has learnt from the other folds."""
    crops, whole = asked.out / f"crops-{fold}", asked.out / f"crops-{fold}.whole"
    if not whole.exists():
        others = np.setdiff1d(np.arange(len(data)), held_out)
        for case, tenths in LEARNT.items():
            count = asked.learn * tenths // 10
            scenes = write_scenes(asked.out / f"learn-{case}-{fold}", data, CASES[case], count, seed=2, chosen=others)
            write_crops(crops, scenes, Detecting(), before=f"{case}-")
        whole.touch()
    method = method_of(asked.method, values=assignments(asked.set))
    return fit(recordings(crops, classes=data.classes), method, out=asked.out / f"{name}-{fold}.h5")


def as_rows(boxes: Boxes) -> list[Any]:
    """Return boxes as plain data."""
    names = ("start", "stop", "identity", "label", "score", "box")
    return list(zip(*(getattr(boxes, name).tolist() for name in names), strict=True))


def pooled(figures: Iterable[dict[str, Any]], classes: int) -> str:
    """Return the mAP of the pictures of all folds as text. Scores of several recognisers are ranked together."""
    pictures = [picture for one in figures for picture in one["pictures"]]
    found = precision([(Boxes.of(there), Boxes.of(boxes)) for there, boxes in pictures], classes)
    return f"mAP {found.mean:.3f}, box AP {found.box:.3f}"


def told(*figures: dict[str, Any]) -> str:
    """Return figures as one line of text."""
    mean = {name: np.mean([one[name] for one in figures]) for name in ("map", "box_ap", "ms")}
    sums = {name: sum(one[name] for one in figures) for name in ("switches", "objects", "missed", "boxes")}
    return (
        f"mAP {mean['map']:.3f}, box AP {mean['box_ap']:.3f}, {mean['ms']:.0f} ms a scene, "
        f"{sums['switches']} switches of {sums['objects']} objects, {sums['missed']} of {sums['boxes']} boxes missed"
    )


if __name__ == "__main__":
    main()
