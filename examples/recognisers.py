"""Recognisers learn four shapes from recordings made here: their accuracy, and a picture of what each has learnt.

A cross, a ring, a square and a diamond move once round a small triangle before the pixel model of an event camera,
each time from another place and in another size. All recognisers learn from the same half of the recordings. Others
need more recordings than these (`edhmax_tempotron`), or the extra `recognise` or `torch`. Writes recognisers.png, and a
picture of each recogniser.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

from neuro.events import DVSParameters, Events, dvs_events, recordings, save
from neuro_recognise import fit

EACH = 16  # recordings of a shape
CAMERA = DVSParameters(pos_thres=0.2, neg_thres=0.2, leak_rate_hz=0.05, shot_noise_rate_hz=0.05)
SHAPES = {  # how far a place is from the lines of a shape, px
    "cross": lambda x, y: np.where(np.maximum(abs(x), abs(y)) < 8.0, np.minimum(abs(x), abs(y)), 8.0),
    "ring": lambda x, y: abs(np.hypot(x, y) - 8.0),
    "square": lambda x, y: abs(np.maximum(abs(x), abs(y)) - 7.0),
    "diamond": lambda x, y: abs(abs(x) + abs(y) - 10.0) / np.sqrt(2.0),
}
METHODS = ("remus", "mozafari", "hfirst", "must", "hots")


def recorded(shape: str, seed: int) -> Events:
    """A shape that moves for 300 ms."""
    rng = np.random.default_rng(seed)
    size, place = rng.uniform(0.5, 1.1), 14.0 + rng.uniform(-4.0, 4.0, 2)
    times = np.arange(0, 301, 2)  # ms
    right, down = (np.interp(times, (0, 100, 200, 300), corners) for corners in ((0, 3, 6, 0), (0, 6, 0, 0)))
    y, x = np.mgrid[:34, :34]
    away = size * SHAPES[shape](
        (x - place[0] - right[:, None, None]) / size,
        (y - place[1] - down[:, None, None]) / size,
    )
    images = np.rint(200.0 - 150.0 * np.clip(1.5 - away, 0.0, 1.0)).astype(np.uint8)
    return dvs_events(1000 * times, images, CAMERA, seed=seed)


with TemporaryDirectory() as folder:
    for label, shape in enumerate(SHAPES):
        (Path(folder) / shape).mkdir()
        for k in range(EACH):
            save(recorded(shape, 100 * label + k), Path(folder) / shape / f"{k:02}.bin")
    data = recordings(folder)
    learn, unseen = data[::2], data[1::2]
    right = {}
    for name in METHODS:
        recogniser = fit(learn, name, seed=1)
        right[name] = np.mean(recogniser.predict(unseen) == unseen.labels)
        print(f"{name}: {right[name]:.0%} of {len(unseen)} recordings held out; chance is {1 / len(SHAPES):.0%}")
        drawings = recogniser.method.pictures(recogniser.learnt, recogniser.classes)
        next(iter(drawings.values())).savefig(f"recognisers_{name}.png", dpi=80)

figure, axis = plt.subplots(figsize=(7, 3), layout="constrained")
axis.barh(list(right), [100.0 * share for share in right.values()])
axis.axvline(100.0 / len(SHAPES), color="k", linestyle="--", label="chance")
axis.set(xlabel="right, of recordings held out (%)", xlim=(0.0, 100.0))
axis.invert_yaxis()
axis.legend(loc="lower left")
figure.savefig("recognisers.png", dpi=80)
