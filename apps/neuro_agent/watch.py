"""An episode as one page for a browser: the environment's frames, spikes, value, error, return and weights.

All data lie in the page, frames as small pictures and numbers as base64 of little-endian arrays, so it needs nothing
else; no screen is needed to make it.
"""

from __future__ import annotations

import base64
import io
import json
import math
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files as resources
from os import PathLike
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import html, output, sealed
from neuro_agent import files
from neuro_agent.deployed import Frozen
from neuro_agent.environments import Environments, why
from neuro_agent.network import circuit
from neuro_agent.training import TESTS, episode_seed, fitting

if TYPE_CHECKING:
    from PIL.Image import Image

    from neuro_agent.learner import Learner


PAGE = sealed(
    "a page of 'neuro agent watch'", '<meta name="generator" content="neuro agent watch">', "<!-- digest {} -->"
)
FRAMES = 300
"""Frames of a page; of longer episodes every second, fourth ... control step has one."""
WIDTH = 420
"""Pixels of a frame's longer side."""
STEPS = 5000
"""Control steps after which an episode is cut off."""
COLUMNS = 1024
"""Columns of the picture of weights; of more places the largest of each few is shown."""
MOMENTS = 40
"""Pictures of the weights of an episode in which an agent learns."""

Floats = npt.NDArray[np.float64]


@dataclass
class Episode:
    """What came of an episode, an entry for each control step; the last is the observation at which it ended.

    Attributes:
        observations: (dimensions,) each.
        places: the active ones.
        critic: spikes of each of its neurons.
        winners: the neuron of each circuit that spiked.
        chances: with which probability each would, of all circuits one after the other.
        values: what the critic expects of rewards to come, in their unit.
        errors: of the move before, in their unit; NaN at the first.
        rewards: of the move before; 0 at the first.
        frames: pictures by control step, empty where there are none.
        blank: why there are none.
        weights: of the policy by control step, (places, actions of all circuits).
        learning: whether it learnt.
        end: how it ended.
        name: of the environment.
    """

    learning: bool
    name: str
    observations: list[Floats] = field(default_factory=list)
    places: list[npt.NDArray[np.int64]] = field(default_factory=list)
    critic: list[npt.NDArray[np.int64]] = field(default_factory=list)
    winners: list[npt.NDArray[np.int64]] = field(default_factory=list)
    chances: list[Floats] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)
    frames: dict[int, str] = field(default_factory=dict)
    blank: str = ""
    weights: dict[int, Floats] = field(default_factory=dict)
    end: str = ""

    @property
    def moves(self) -> int:
        """Control steps in which it acted."""
        return len(self.values) - 1

    def __str__(self) -> str:
        pictures = f"{len(self.frames)} frames" if self.frames else f"no frames, {self.blank}"
        return f"{self.moves} steps, return {sum(self.rewards):g}, {self.end}; {pictures}"


def watch(agent: Learner, env: Any, path: str | PathLike[str], seed: int = 0, *, learning: bool = False) -> Episode:
    """Play an episode and write it as a page; the agent stays as it is.

    Args:
        agent: that acts.
        env: one environment; one of render_mode "rgb_array" gives frames, of others the observations are drawn.
        path: of the page, which ends in .html.
        seed: of the episode, the first that a test of that seed has, and of the network's draws.
        learning: whether it learns meanwhile.

    Returns:
        what came of it.

    Raises:
        ModelError: the file is not called .html or cannot be written, or as of `ActorCritic.test`.
    """
    file = Path(path)
    if file.suffix.lower() not in (".html", ".htm"):
        raise ModelError(f"{file}: an episode is written as a page for a browser: expected a name that ends in .html")
    with output(file, PAGE) as part:
        episode = played(agent, env, seed, learning)
        part.write_text(PAGE.seal(page(agent, episode, seed)), "utf-8")
    return episode


def played(agent: Learner, env: Any, seed: int = 0, learning: bool = False) -> Episode:
    """An episode: of the agent as a test has it, with values of a copy that learns nothing; or of one that learns."""
    worlds = fitting(agent, env, 60.0)
    if worlds.n != 1:
        raise ModelError(f"watch: a vector of {worlds.n} environments: expected one", hint="gymnasium.make")
    twin = type(agent)(agent.observations, agent.actions.space, seed=seed, **agent.settings.plain())
    files.put_arrays(twin, files.arrays_of(agent))
    twin.begin(1)
    if twin._copies is None:
        raise ModelError(f"watch: {type(agent).__name__} has no spikes to show: expected an ActorCritic")
    episode = Episode(learning, worlds.name)
    camera = _Camera(env)
    with worlds.watched():
        _play(twin, None if learning else Frozen(agent, seed, "event"), worlds, episode, camera, seed)
    episode.frames, episode.blank = camera.frames(), camera.blank
    return episode


def _play(
    twin: Learner, frozen: Frozen | None, worlds: Environments, episode: Episode, camera: _Camera, seed: int
) -> None:
    assert twin._copies is not None
    unit, sim = 1.0 / twin.rewards.factor, twin._copies[0] if frozen is None else frozen.sim
    seen = worlds.reset([episode_seed(seed, TESTS)])
    reward, before, ended, cut = 0.0, 0.0, False, False
    for k in range(STEPS + 1):
        camera.take(k)
        found = twin.decide(seen)
        winners = (found.winners if frozen is None else frozen.decide(seen))[0]
        value = float(found.values[0])
        error = 0.0 if k == 0 else reward / unit + (0.0 if ended else twin.settings.discount * value) - before
        twin.teach(np.array([error if episode.learning else 0.0]))
        episode.observations.append(seen[0])
        episode.places.append(twin.places.cells(seen[0]))
        episode.critic.append(found.spikes[0])
        episode.winners.append(winners)
        each = range(len(twin.actions.sizes))
        episode.chances.append(np.concatenate([sim.get(circuit(i), "p") for i in each]))
        episode.values.append(value * unit)
        episode.errors.append(error * unit if k else math.nan)
        episode.rewards.append(reward)
        if episode.learning or k == 0:
            _keep(episode.weights, k, _policy(twin), MOMENTS)
        if worlds.over[0]:
            break
        seen, rewards, ends, cuts = worlds.step(twin.actions.of(winners[None]), [0])
        reward, before, ended, cut = float(rewards[0]), value, bool(ends[0]), bool(cuts[0])
    episode.end = "terminated" if ended else "cut off by the environment" if cut else f"cut off after {STEPS} steps"


def _policy(agent: Learner) -> Floats:
    weights = agent.weights
    return np.concatenate([weights[name] for name in agent.projections[1:]], axis=1)


def _every(kept: dict[int, Any]) -> int:
    """Of how many control steps one is kept."""
    steps = iter(kept)
    return next(steps, 0) or next(steps, 1)


def _keep(kept: dict[int, Any], k: int, what: Any, most: int) -> None:
    """Keep what belongs to a control step, of all steps evenly so many."""
    every = _every(kept)
    if k % every == 0:
        kept[k] = what
    if len(kept) > most:
        for old in [step for step in kept if step % (2 * every)]:
            del kept[old]


class _Camera:
    """Takes small pictures of an environment that renders.

    Attributes:
        blank: why there are none.
    """

    def __init__(self, env: Any) -> None:
        self._images: dict[int, Image] = {}
        mode = getattr(env, "render_mode", None)
        self._env = env if mode == "rgb_array" else None
        self.blank = ""
        if self._env is None and "rgb_array" in (env.metadata or {}).get("render_modes", ()):
            self.blank = f"the environment's render_mode is {mode!r}: expected 'rgb_array'"
        elif self._env is None:
            self.blank = "the environment renders no rgb_array"

    def take(self, k: int) -> None:
        """Take the picture of a control step, if it is one that has one."""
        if self._env is None or k % _every(self._images):
            return
        try:
            frame = np.asarray(self._env.render())
            if frame.ndim != 3 or frame.shape[2] not in (3, 4) or not frame.size:
                raise ModelError(f"render() gave an array of shape {list(frame.shape)}")
            if frame.dtype != np.uint8:
                raise ModelError(f"render() gave numbers of {frame.dtype}: expected uint8")
            _keep(self._images, k, _small(frame[..., :3]), FRAMES)
        except KeyboardInterrupt:
            raise
        except Exception as error:
            self._images, self.blank, self._env = {}, why(error), None

    def frames(self) -> dict[int, str]:
        """The pictures by control step, as data URIs."""
        return {k: _picture(image) for k, image in self._images.items()}


def _small(frame: npt.NDArray[np.uint8]) -> Image:
    from PIL import Image

    image = Image.fromarray(frame)
    if max(image.size) > WIDTH:
        image.thumbnail((WIDTH, WIDTH), Image.Resampling.BOX)
    return image


def _picture(image: Image) -> str:
    """The smaller of a PNG of 64 colours and a JPEG."""
    from PIL.Image import Dither, Quantize

    png = _written(image.quantize(64, Quantize.FASTOCTREE, dither=Dither.NONE), "png")
    return min(png, _written(image, "jpeg", quality=78), key=len)


def _written(image: Image, kind: str, **options: Any) -> str:
    into = io.BytesIO()
    image.save(into, format=kind, **options)
    return f"data:image/{kind};base64,{base64.b64encode(into.getvalue()).decode('ascii')}"


def page(agent: Learner, episode: Episode, seed: int = 0) -> str:
    """The page as text."""
    steps = int(agent.log.steps[-1]) if len(agent.log) else 0
    taught = f"after {steps:,} steps of training (seed {agent.seed})" if steps else "not trained yet"
    sizes = " + ".join(map(str, agent.actions.sizes))
    about = [
        f"an agent of {agent.places.size} places, {agent.settings.critics} critics and {sizes} actors",
        taught,
        "learning goes on" if episode.learning else "weights frozen",
        f"episode of seed {seed}",
        str(episode),
    ]
    template = Template(resources("neuro_agent").joinpath("watch.html").read_text("utf-8"))
    return template.substitute(
        head=html.head("neuro agent watch", episode.name),
        style=html.player_style(),
        script=html.player_script(),
        title=escape(episode.name),
        told=escape(" · ".join(about)),
        data=json.dumps(_data(agent, episode)).replace("<", "\\u003c"),
    )


def _data(agent: Learner, episode: Episode) -> dict[str, Any]:
    dimensions = agent.places.dimensions
    observations = np.array(episode.observations)
    low = np.array([one.first if one.states else one.low for one in dimensions], dtype=np.float64)
    high = np.array([one.first + one.states - 1 if one.states else one.high for one in dimensions], dtype=np.float64)
    low = np.where(np.isfinite(low), low, observations.min(axis=0))
    high = np.where(np.isfinite(high), high, observations.max(axis=0))
    weights = np.stack([_columns(each) for each in episode.weights.values()])
    largest = max(float(np.abs(weights).max()), 1e-9)
    return {
        "moves": episode.moves,
        "places": agent.places.size,
        "critics": agent.settings.critics,
        "circuits": _labels(agent),
        "dimensions": [one.name.removeprefix("observation") or "state" for one in dimensions],
        "frames": list(episode.frames.values()),
        "shown": list(episode.frames),
        "first": _base64(np.cumsum([0, *map(len, episode.places)]), "<u4"),
        "cells": _base64(np.concatenate(episode.places), "<u4"),
        "critic": _base64(np.minimum(episode.critic, 255), "u1"),
        "winners": _base64(episode.winners, "u1"),
        "chances": _base64(episode.chances, "<f4"),
        "observations": _base64(observations, "<f4"),
        "low": _base64(low, "<f4"),
        "high": _base64(high, "<f4"),
        "values": _base64(episode.values, "<f4"),
        "errors": _base64(np.nan_to_num(episode.errors), "<f4"),
        "returns": _base64(np.cumsum(episode.rewards), "<f4"),
        "moments": list(episode.weights),
        "columns": weights.shape[2],
        "largest": largest,
        "weights": _base64(np.round(127 * weights / largest), "i1"),
    }


def _labels(agent: Learner) -> list[list[str]]:
    """What the neurons of each circuit stand for."""
    actions = agent.actions
    if actions.values:
        return [[f"{value:.3g}" for value in values] for values in actions.values]
    start = np.ravel(getattr(actions.space, "start", 0))
    starts = np.broadcast_to(start, (len(actions.sizes),))
    return [[str(first + k) for k in range(size)] for first, size in zip(starts, actions.sizes, strict=True)]


def _columns(weights: Floats) -> Floats:
    """Weights as a picture, (actions, columns): of places that share a column the one that is largest."""
    each = -(-len(weights) // COLUMNS)
    padded = np.zeros((-(-len(weights) // each) * each, weights.shape[1]))
    padded[: len(weights)] = weights
    groups = padded.reshape(-1, each, weights.shape[1])
    largest = np.abs(groups).argmax(axis=1)
    return np.take_along_axis(groups, largest[:, None], axis=1)[:, 0].T


def _base64(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")
