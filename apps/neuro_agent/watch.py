"""An episode as one page for a browser: the environment's frames, spikes, value, error, return and weights.

Frames lie in the page as small pictures.
"""

from __future__ import annotations

import base64
import io
import math
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Environments, Moment, NetworkPilot, check, episode_seed, html, player, sealed, why
from neuro_agent.deployed import Frozen
from neuro_agent.network import CRITIC, GAIN, REST, SEED, circuit
from neuro_agent.training import TESTS, fitting

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

EDGE = 92
"""Pixels of the names beside drawings."""
COLOURS = ("a", "b", "d", "c", "e", "f")
"""Of the actors of a circuit."""

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

    def make() -> tuple[str, Episode]:
        episode = played(agent, env, seed, learning)
        return page(agent, episode, seed), episode

    return player.write(Path(path), PAGE, "an episode is written as", make)


def played(agent: Learner, env: Any, seed: int = 0, learning: bool = False) -> Episode:
    """An episode: of the agent as a test has it, with values of a copy that learns nothing; or of one that learns."""
    worlds = fitting(agent, env, 60.0)
    if worlds.n != 1:
        raise ModelError(f"watch: a vector of {worlds.n} environments: expected one", hint="gymnasium.make")
    pilot = agent.pilot(worlds, check(SEED, seed, "seed"))
    if not isinstance(pilot, NetworkPilot):
        raise ModelError(f"watch: {type(agent).__name__} has no spikes to show: expected an ActorCritic")
    pilot.put(agent.arrays())
    pilot.begin(1, 0)
    episode = Episode(learning, worlds.name)
    camera = _Camera(env)
    with worlds.watched():
        _play(agent, pilot, None if learning else Frozen(agent, seed, "event"), worlds, episode, camera, seed)
    episode.frames, episode.blank = camera.frames(), camera.blank
    return episode


def _play(
    agent: Learner,
    pilot: NetworkPilot,
    frozen: Frozen | None,
    worlds: Environments,
    episode: Episode,
    camera: _Camera,
    seed: int,
) -> None:
    sim = pilot.copies[0] if frozen is None else frozen.sim
    error: Any = pilot.taught["error"]
    scale, circuits = error.scale, [circuit(k) for k in range(len(agent.actions.sizes))]
    seen = worlds.reset([episode_seed(seed, TESTS)])
    reward, before, ended, cut = 0.0, 0.0, False, False
    first = np.ones(1, dtype=np.bool_)
    for k in range(STEPS + 1):
        camera.take(k)
        pilot.act(seen, worlds.infos)
        counts, unit = pilot.counts, 1.0 / scale.factor
        chosen = np.array([counts[name][0].argmax() for name in circuits])
        winners = chosen if frozen is None else frozen.decide(seen)[0]
        value = unit * (scale.first + (counts[CRITIC].sum() / counts[CRITIC].size - REST) / GAIN)
        episode.observations.append(seen[0])
        episode.places.append(agent.places.cells(seen[0]))
        episode.critic.append(counts[CRITIC][0])
        episode.winners.append(winners)
        episode.chances.append(np.concatenate([sim.get(name, "p") for name in circuits]))
        episode.values.append(value)
        after = 0.0 if ended else agent.settings.discount * value
        episode.errors.append(reward + after - before if k else math.nan)
        episode.rewards.append(reward)
        if episode.learning or k == 0:
            policies = [pilot.weights[name].reshape(agent.places.size, -1) for name in agent.projections[1:]]
            _keep(episode.weights, k, np.concatenate(policies, axis=1), MOMENTS)
        if worlds.over[0]:
            break
        last = worlds.over
        seen, rewards, ends, cuts = worlds.step(agent.actions.of(winners[None]), [0])
        reward, before, ended, cut = float(rewards[0]), value, bool(ends[0]), bool(cuts[0])
        if episode.learning:
            moment = Moment(counts, first, last, rewards, ends, worlds.infos, seen, 0.0, k + 1, ())
            pilot.teach(moment)
        first = last
    episode.end = "terminated" if ended else "cut off by the environment" if cut else f"cut off after {STEPS} steps"


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
        from PIL import Image

        try:
            frame = np.asarray(self._env.render())
            if frame.ndim != 3 or frame.shape[2] not in (3, 4) or not frame.size:
                raise ModelError(f"render() gave an array of shape {list(frame.shape)}")
            if frame.dtype != np.uint8:
                raise ModelError(f"render() gave numbers of {frame.dtype}: expected uint8")
            image = Image.fromarray(frame[..., :3])
            if max(image.size) > WIDTH:
                image.thumbnail((WIDTH, WIDTH), Image.Resampling.BOX)
            _keep(self._images, k, image, FRAMES)
        except KeyboardInterrupt:
            raise
        except Exception as error:
            self._images, self.blank, self._env = {}, why(error), None

    def frames(self) -> dict[int, str]:
        """The pictures by control step, as data URIs."""
        return {k: _picture(image) for k, image in self._images.items()}


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
    sizes = " + ".join(map(str, agent.actions.sizes))
    about = [
        f"an agent of {agent.places.size} places, {agent.settings.critics} critics and {sizes} actors",
        f"after {steps:,} steps of training (seed {agent.seed})" if steps else "not trained yet",
        "learning goes on" if episode.learning else "weights frozen",
        f"episode of seed {seed}",
        str(episode),
    ]
    series = {
        "value": np.array(episode.values),
        "error": np.array(episode.errors),
        "return": np.cumsum(episode.rewards),
    }
    n = episode.moves + 1
    timeline = player.Timeline(
        end=episode.moves,
        begin=min(episode.moves, round(0.4 * n)),
        rate=0.001,
        speeds=[(str(speed), speed) for speed in (1, 2, 5, 10, 30, 60, 120)],
        speed=2 if n < 60 else 4,
        shift=10,
        help="move by a step, with <kbd>shift</kbd> by ten",
        speed_label="steps/s",
        label="step ",
        readouts=[player.Readout(name, values) for name, values in series.items()],
    )
    names = ["a", "e", "d"]
    lanes = [
        {"name": name, "low": min(0.0, np.nanmin(each)), "high": max(0.0, np.nanmax(each)), "marks": 4,
         "lines": [{"y": each, "colour": colour}]}
        for colour, (name, each) in zip(names, series.items(), strict=True)
    ]  # fmt: skip
    curves = {"lanes": lanes, "edge": EDGE, "cursor": "off", "click": True}
    below = [
        player.Panel(
            "Spikes",
            [_raster(agent, episode)],
            "by control step of 20 ms: active places, spikes of each critic, the actor that spiked",
        ),
        player.Panel(
            "Value, error, return",
            [player.Track("curve", "traces", "value, error and return", curves, 216)],
            "of the whole episode, in the reward's unit; click to go there",
            controls=True,
        ),
        _weights(agent, episode),
    ]
    columns = "minmax(0, 1.25fr) minmax(0, 1fr)"
    return player.page("neuro agent watch", episode.name, about, timeline, _top(agent, episode), below, columns=columns)


def _top(agent: Learner, episode: Episode) -> list[player.Panel | list[player.Panel]]:
    """The environment, or the observation where there are no frames; the policy."""
    lit = np.concatenate([np.eye(size, dtype=bool)[[one[k] for one in episode.winners]]
                          for k, size in enumerate(agent.actions.sizes)], axis=1)  # fmt: skip
    names, colours = _actors(agent)
    row = max(9.0, min(28.0, 150 / len(names)))
    chances = {"labels": names, "colours": colours, "values": np.ravel(episode.chances), "low": [0], "high": [1],
               "lit": lit.ravel(), "row": row, "unit": " %", "factor": 100}  # fmt: skip
    policy = player.Panel(
        "Policy",
        [player.Track("bars", "policy", "probabilities of the actions", chances)],
        "with which probability each actor spikes; in colour: the one that did",
    )
    if not episode.frames:
        observed = player.Panel(
            "Environment", [_observation(agent, episode, "large")], f"the observation {_bounds(agent, 24)}"
        )
        return [observed, [policy]]
    frames = {"frames": list(episode.frames.values()), "at": list(episode.frames)}
    shown = player.Panel("Environment", [player.Track("frames", "frame", "the environment", frames, 330)])
    return [shown, [policy, player.Panel("Observation", [_observation(agent, episode, "state")], _bounds(agent, 12))]]


def _bounds(agent: Learner, most: int) -> str:
    many = len(agent.places.dimensions)
    return "within its bounds" if many <= most else f"within its bounds, the first {most} of {many} numbers"


def _observation(agent: Learner, episode: Episode, name: str) -> player.Track:
    most, row = (24, 24) if name == "large" else (12, 19)
    dimensions, seen = agent.places.dimensions[:most], np.array(episode.observations)[:, :most]
    low = np.array([one.first if one.states else one.low for one in dimensions], dtype=np.float64)
    high = np.array([one.first + one.states - 1 if one.states else one.high for one in dimensions], dtype=np.float64)
    data = {
        "labels": [one.name.removeprefix("observation") or "state" for one in dimensions], "values": seen.ravel(),
        "low": np.where(np.isfinite(low), low, seen.min(axis=0)),
        "high": np.where(np.isfinite(high), high, seen.max(axis=0)), "mark": True, "unit": "", "row": row,
    }  # fmt: skip
    return player.Track("bars", name, "the observation", data)


def _actors(agent: Learner) -> tuple[list[str], list[str]]:
    """Names and colours of the actors of all circuits."""
    labels = _labels(agent)
    names = [f"{k}: {each}" if len(labels) > 1 else each for k, one in enumerate(labels) for each in one]
    return names, [COLOURS[k % len(COLOURS)] for one in labels for k in range(len(one))]


def _raster(agent: Learner, episode: Episode) -> player.Track:
    """Active places, spikes of critics and actors, by control step."""
    names, colours = _actors(agent)
    critic, steps = np.minimum(episode.critic, 255), np.arange(episode.moves)
    at, spiking = critic.nonzero()
    firsts = np.cumsum([0, *agent.actions.sizes[:-1]])
    actors = (np.array(episode.winners[:-1]).reshape(len(steps), -1) + firsts).ravel()
    levels = np.rint(255 * critic[at, spiking] / max(1, critic.max())).astype(np.uint8)
    strips = [
        {"name": "places", "size": agent.places.size, "height": 132, "ids": np.concatenate(episode.places),
         "times": np.repeat(np.arange(episode.moves + 1), list(map(len, episode.places)))},
        {"name": "critics", "size": agent.settings.critics, "height": 70, "times": at, "ids": spiking, "level": levels},
        {"name": "actors", "size": len(names), "height": len(names) * max(4.0, min(16.0, 90 / len(names))),
         "times": np.repeat(steps, len(firsts)), "ids": actors, "labels": [f"actor {name}" for name in names],
         "colours": colours},
    ]  # fmt: skip
    window = max(24, min(160, episode.moves + 1))
    data = {"strips": [one | {"each": 1} for one in strips], "window": window, "lead": 0.25, "edge": EDGE}
    return player.Track("raster", "raster", "spikes by control step", data)


def _weights(agent: Learner, episode: Episode) -> player.Panel:
    """The weights of the policy as pictures by moment, with marks at the active places."""
    names, colours = _actors(agent)
    weights = np.stack([_columns(each) for each in episode.weights.values()])
    largest = max(float(np.abs(weights).max()), 1e-9)
    data = {
        "rows": weights.shape[1], "columns": weights.shape[2], "at": list(episode.weights), "edge": EDGE,
        "values": np.round(127 * weights / largest).astype(np.int8).ravel(), "shade": ["paper", "on", 0.5, "off"],
        "labels": [f"actor {name}" for name in names], "colours": colours, "size": len(names), "rowsOf": "actors",
        "marks": {"first": np.cumsum([0, *map(len, episode.places)]), "places": np.concatenate(episode.places),
                  "of": agent.places.size},
        "largest": largest,
    }  # fmt: skip
    note = html.Html(
        'from each place onto each actor: <i style="background:var(--on)"></i>for it '
        '<i style="background:var(--off);margin-left:4px"></i>against it <b style="margin-left:6px">▾</b> active '
        f"places; largest {largest:.3g} mV"
    )
    return player.Panel(
        "Weights of the policy", [player.Track("image", "weights", "weights of the policy", data)], note
    )


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
