"""Scenes that are functions of time, as images for an event camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from neuro.core.checks import argument
from neuro.core.errors import ModelError
from neuro.events.dvs import DVSParameters, Image, shares

Scene = Callable[[int], Image]
"""Time, us, to the image at it."""


def frames_of(
    scene: Scene,
    start_us: int,
    stop_us: int,
    *,
    step_us: int = 1000,
    change: float | None = None,
    shortest_us: int = 10,
    parameters: DVSParameters | None = None,
) -> Iterator[tuple[int, Image]]:
    """Images of a scene for `DVS.record` or `DVS.watch`, at fixed or at fitting steps.

    Between two images the camera takes the log intensity to go in a straight line. With `change` an
    interval in which any pixel changes by more is halved until it does not; a change that is over
    within one `step_us` is not seen.

    Args:
        scene: called with a time, us; gives an image as for `DVS.see`.
        start_us: of the first image.
        stop_us: of the last one, even where the steps do not fall on it.
        step_us: between images; the longest where `change` is given.
        change: largest change of log intensity from image to image; None for fixed steps. Half a
            threshold gives event times that hardly depend on it.
        shortest_us: no interval is made shorter than this, even where an edge jumps.
        parameters: whose curve makes the log; None takes the defaults.

    Yields:
        Time, us, and image.

    Raises:
        ModelError: a number is out of its range.

    Source: the idea of fitting the steps to the change of brightness: Rebecq, Gehrig, Scaramuzza,
        "ESIM", CoRL 2018, section 3.2; here by halving, so that nothing but the scene is needed.
    """
    for name, value in (("step_us", step_us), ("shortest_us", shortest_us)):
        argument(name, value, kind="microseconds", at_least=1)
    if stop_us < start_us:
        raise ModelError(f"stop_us is {stop_us}, expected at least start_us, {start_us}")
    argument("change", change, above=0, optional=True)
    return _frames(scene, start_us, stop_us, step_us, change, shortest_us, parameters or DVSParameters())


def _frames(
    scene: Scene, start: int, stop: int, step: int, change: float | None, shortest: int, parameters: DVSParameters
) -> Iterator[tuple[int, Image]]:
    image = np.array(scene(start))
    yield start, image
    at, log = start, _log(image, change, parameters)
    ahead: list[tuple[int, Image, npt.NDArray[np.float64]]] = []
    while at < stop:
        if not ahead:
            ahead.append(_look(scene, min(at + step, stop), change, parameters))
        while change is not None and ahead[-1][0] - at >= 2 * shortest and np.abs(ahead[-1][2] - log).max() > change:
            ahead.append(_look(scene, (at + ahead[-1][0]) // 2, change, parameters))
        at, image, log = ahead.pop()
        yield at, image


def _look(
    scene: Scene, t: int, change: float | None, parameters: DVSParameters
) -> tuple[int, Image, npt.NDArray[np.float64]]:
    image = np.array(scene(t))
    return t, image, _log(image, change, parameters)


def _log(image: Image, change: float | None, parameters: DVSParameters) -> npt.NDArray[np.float64]:
    """The log intensity, where it is asked for; of impossible intensities the camera tells."""
    if change is None:
        return np.zeros(0)
    return parameters.log_intensity(np.clip(shares(image), 0.0, 1e300))
