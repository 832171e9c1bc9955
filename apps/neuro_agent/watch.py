"""An episode as an HTML page: the environment's frames, spikes, value, error, return and weights.

Frames are embedded as small pictures.
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
"""Maximum number of frames of a page; in longer episodes only every 2nd, 4th ... control step has a frame."""
WIDTH = 420
"""Longer side of a frame, px."""
STEPS = 5000
"""Control steps after which an episode is cut off."""
COLUMNS = 1024
"""Maximum number of columns of the picture of weights; places that share a column show the largest weight."""
MOMENTS = 40
"""Maximum number of pictures of the weights in an episode with learning."""

EDGE = 92
"""Width of the labels beside drawings, px."""
COLOURS = ("item2", "item1", "item4", "item3", "item5", "soft")
"""Colours of circuits."""

Floats = npt.NDArray[np.float64]


@dataclass
class Episode:
    """Record of an episode, one entry per control step; the last entry is the final observation.

    Attributes:
        observations: observations, (dimensions,) each.
        places: active places.
        critic: spikes of each neuron of the critic.
        winners: neuron of each circuit that spiked.
        chances: probability that an actor spikes, for each actor of all circuits.
        values: value by the critic, in the unit of rewards.
        errors: temporal-difference error of the last move, in the unit of rewards; NaN in the first entry.
        rewards: reward of the last move; 0 in the first entry.
        frames: pictures by control step, empty if there are none.
        blank: reason why there are no frames.
        weights: weights of the policy by control step, (places, actions of all circuits).
        learning: whether the agent learnt.
        end: reason for the end of the episode.
        name: name of the environment.
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
        """Number of control steps with an action."""
        return len(self.values) - 1

    def __str__(self) -> str:
        pictures = f"{len(self.frames)} frames" if self.frames else f"no frames, {self.blank}"
        return f"{self.moves} steps, return {sum(self.rewards):g}, {self.end}; {pictures}"


def watch(agent: Learner, env: Any, path: str | PathLike[str], seed: int = 0, *, learning: bool = False) -> Episode:
    """Play an episode and write it as an HTML page; the agent does not change.

    Args:
        agent: the agent.
        env: one environment. With render_mode "rgb_array" the page has frames; else it draws the observations.
        path: path of the page, which ends in .html.
        seed: seed of the network's draws and of the episode, which is the first of a test with this seed.
        learning: whether the agent learns during the episode.

    Returns:
        the record of the episode.

    Raises:
        ModelError: the file is not called .html or cannot be written, or as `ActorCritic.test`.
    """

    def make() -> tuple[str, Episode]:
        episode = played(agent, env, seed, learning)
        return page(agent, episode, seed), episode

    return player.write(Path(path), PAGE, "an episode is written as", make)


def played(agent: Learner, env: Any, seed: int = 0, learning: bool = False) -> Episode:
    """Play an episode. A frozen agent acts without learning, and a copy of its learning network gives the values."""
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
    observations = worlds.reset([episode_seed(seed, TESTS)])
    reward, last_value, ended, cut = 0.0, 0.0, False, False
    is_first = np.ones(1, dtype=np.bool_)
    for k in range(STEPS + 1):
        camera.take(k)
        pilot.act(observations, worlds.infos)
        counts, unit = pilot.counts, 1.0 / scale.factor
        chosen = np.array([counts[name][0].argmax() for name in circuits])
        winners = chosen if frozen is None else frozen.decide(observations)[0]
        value = unit * (scale.first + (counts[CRITIC].sum() / counts[CRITIC].size - REST) / GAIN)
        episode.observations.append(observations[0])
        episode.places.append(agent.places.cells(observations[0]))
        episode.critic.append(counts[CRITIC][0])
        episode.winners.append(winners)
        episode.chances.append(np.concatenate([sim.get(name, "p") for name in circuits]))
        episode.values.append(value)
        next_value = 0.0 if ended else agent.settings.discount * value
        episode.errors.append(reward + next_value - last_value if k else math.nan)
        episode.rewards.append(reward)
        if episode.learning or k == 0:
            policies = [pilot.weights[name].reshape(agent.places.size, -1) for name in agent.projections[1:]]
            _store_evenly(episode.weights, k, np.concatenate(policies, axis=1), MOMENTS)
        if worlds.over[0]:
            break
        was_over = worlds.over
        observations, rewards, ends, cuts = worlds.step(agent.actions.of(winners[None]), [0])
        reward, last_value, ended, cut = float(rewards[0]), value, bool(ends[0]), bool(cuts[0])
        if episode.learning:
            moment = Moment(counts, is_first, was_over, rewards, ends, worlds.infos, observations, 0.0, k + 1, ())
            pilot.teach(moment)
        is_first = was_over
    episode.end = "terminated" if ended else "cut off by the environment" if cut else f"cut off after {STEPS} steps"


def _interval(items: dict[int, Any]) -> int:
    """Return the interval of control steps between stored items."""
    steps = iter(items)
    return next(steps, 0) or next(steps, 1)


def _store_evenly(items: dict[int, Any], k: int, item: Any, most: int) -> None:
    """Store an item of a control step; at most `most` items stay, at equal intervals."""
    interval = _interval(items)
    if k % interval == 0:
        items[k] = item
    if len(items) > most:
        for old in [step for step in items if step % (2 * interval)]:
            del items[old]


class _Camera:
    """A camera that takes small pictures of an environment that renders.

    Attributes:
        blank: reason why there are no pictures.
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
        """Take the picture of a control step, if the interval includes the step."""
        if self._env is None or k % _interval(self._images):
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
            _store_evenly(self._images, k, image, FRAMES)
        except KeyboardInterrupt:
            raise
        except Exception as error:
            self._images, self.blank, self._env = {}, why(error), None

    def frames(self) -> dict[int, str]:
        """Return the pictures by control step, as data URIs."""
        return {k: _picture(image) for k, image in self._images.items()}


def _picture(image: Image) -> str:
    """Return a picture as a PNG of 64 colours or a JPEG, whichever is smaller."""
    from PIL.Image import Dither, Quantize

    png = _encoded(image.quantize(64, Quantize.FASTOCTREE, dither=Dither.NONE), "png")
    return min(png, _encoded(image, "jpeg", quality=78), key=len)


def _encoded(image: Image, kind: str, **options: Any) -> str:
    buffer = io.BytesIO()
    image.save(buffer, format=kind, **options)
    return f"data:image/{kind};base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"


def page(agent: Learner, episode: Episode, seed: int = 0) -> str:
    """Return the HTML page."""
    steps = int(agent.log.steps[-1]) if len(agent.log) else 0
    sizes = " + ".join(map(str, agent.actions.sizes))
    notes = [
        f"an agent of {agent.places.size} places, {agent.settings.critics} critics and {sizes} actors",
        f"after {steps:,} steps of training (seed {agent.seed})" if steps else "not trained yet",
        "learning continues" if episode.learning else "weights frozen",
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
    names = ["item2", "item5", "item4"]
    lanes = [
        {"name": name, "low": min(0.0, np.nanmin(curve)), "high": max(0.0, np.nanmax(curve)), "marks": 4,
         "lines": [{"y": curve, "colour": colour}]}
        for colour, (name, curve) in zip(names, series.items(), strict=True)
    ]  # fmt: skip
    curves = {"lanes": lanes, "edge": EDGE, "cursor": "off", "click": True}
    lower = [
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
    return player.page("neuro agent watch", episode.name, notes, timeline, _top(agent, episode), lower, columns=columns)


def _top(agent: Learner, episode: Episode) -> list[player.Panel | list[player.Panel]]:
    """Return the panels of the environment, or of the observation if there are no frames, and of the policy."""
    lit = np.concatenate([np.eye(size, dtype=bool)[[winners[k] for winners in episode.winners]]
                          for k, size in enumerate(agent.actions.sizes)], axis=1)  # fmt: skip
    names, colours = _actors(agent)
    row = max(9.0, min(28.0, 150 / len(names)))
    chances = {"labels": names, "colours": colours, "values": np.ravel(episode.chances), "low": [0], "high": [1],
               "lit": lit.ravel(), "row": row, "unit": " %", "factor": 100}  # fmt: skip
    policy = player.Panel(
        "Policy",
        [player.Track("bars", "policy", "probabilities of the actions", chances)],
        "probability of each actor to spike; in colour: the actor that spiked",
    )
    if not episode.frames:
        observed = player.Panel(
            "Environment", [_observation(agent, episode, "large")], f"the observation {_bounds(agent, 24)}"
        )
        return [observed, [policy]]
    frames = {"frames": list(episode.frames.values()), "at": list(episode.frames)}
    environment = player.Panel("Environment", [player.Track("frames", "frame", "the environment", frames, 330)])
    return [
        environment,
        [policy, player.Panel("Observation", [_observation(agent, episode, "state")], _bounds(agent, 12))],
    ]


def _bounds(agent: Learner, most: int) -> str:
    n = len(agent.places.dimensions)
    return "within its bounds" if n <= most else f"within its bounds, the first {most} of {n} numbers"


def _observation(agent: Learner, episode: Episode, name: str) -> player.Track:
    most, row = (24, 24) if name == "large" else (12, 19)
    dimensions, observations = agent.places.dimensions[:most], np.array(episode.observations)[:, :most]
    low = np.array([d.first if d.states else d.low for d in dimensions], dtype=np.float64)
    high = np.array([d.first + d.states - 1 if d.states else d.high for d in dimensions], dtype=np.float64)
    data = {
        "labels": [d.name.removeprefix("observation") or "state" for d in dimensions],
        "values": observations.ravel(),
        "low": np.where(np.isfinite(low), low, observations.min(axis=0)),
        "high": np.where(np.isfinite(high), high, observations.max(axis=0)), "mark": True, "unit": "", "row": row,
    }  # fmt: skip
    return player.Track("bars", name, "the observation", data)


def _actors(agent: Learner) -> tuple[list[str], list[str]]:
    """Return names and colours of the actors of all circuits."""
    labels = _labels(agent)
    names = [f"{k}: {action}" if len(labels) > 1 else action for k, circuit in enumerate(labels) for action in circuit]
    return names, [COLOURS[k % len(COLOURS)] for circuit in labels for k in range(len(circuit))]


def _raster(agent: Learner, episode: Episode) -> player.Track:
    """Return the raster of active places and of spikes of critics and actors, by control step."""
    names, colours = _actors(agent)
    critic, steps = np.minimum(episode.critic, 255), np.arange(episode.moves)
    ks, spiking = critic.nonzero()
    firsts = np.cumsum([0, *agent.actions.sizes[:-1]])
    actors = (np.array(episode.winners[:-1]).reshape(len(steps), -1) + firsts).ravel()
    levels = np.rint(255 * critic[ks, spiking] / max(1, critic.max())).astype(np.uint8)
    strips = [
        {"name": "places", "size": agent.places.size, "height": 132, "ids": np.concatenate(episode.places),
         "times": np.repeat(np.arange(episode.moves + 1), list(map(len, episode.places)))},
        {"name": "critics", "size": agent.settings.critics, "height": 70, "times": ks, "ids": spiking, "level": levels},
        {"name": "actors", "size": len(names), "height": len(names) * max(4.0, min(16.0, 90 / len(names))),
         "times": np.repeat(steps, len(firsts)), "ids": actors, "labels": [f"actor {name}" for name in names],
         "colours": colours},
    ]  # fmt: skip
    window = max(24, min(160, episode.moves + 1))
    data = {"strips": [strip | {"each": 1} for strip in strips], "window": window, "lead": 0.25, "edge": EDGE}
    return player.Track("raster", "raster", "spikes by control step", data)


def _weights(agent: Learner, episode: Episode) -> player.Panel:
    """Return the panel of the policy's weights by time, with marks at the active places."""
    names, colours = _actors(agent)
    weights = np.stack([_columns(maps) for maps in episode.weights.values()])
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
    """Return the labels of the actions of each circuit, one for each neuron."""
    actions = agent.actions
    if actions.values:
        return [[f"{value:.3g}" for value in values] for values in actions.values]
    start = np.ravel(getattr(actions.space, "start", 0))
    starts = np.broadcast_to(start, (len(actions.sizes),))
    return [[str(first + k) for k in range(size)] for first, size in zip(starts, actions.sizes, strict=True)]


def _columns(weights: Floats) -> Floats:
    """Return weights as a picture, (actions, columns); places that share a column show the largest weight."""
    per_column = -(-len(weights) // COLUMNS)
    padded = np.zeros((-(-len(weights) // per_column) * per_column, weights.shape[1]))
    padded[: len(weights)] = weights
    groups = padded.reshape(-1, per_column, weights.shape[1])
    largest = np.abs(groups).argmax(axis=1)
    return np.take_along_axis(groups, largest[:, None], axis=1)[:, 0].T
