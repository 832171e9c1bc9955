"""A scenario: world, camera, drone and task; loaded by name, from a YAML file, or from plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from math import isclose
from pathlib import Path
from typing import Any

from neuro import ModelError
from neuro.apps import Node, Quantity, Where, about, check, check_fields, mistake, plain, read, setting, unknown, words
from neuro_drone.parts import GRAVITY, MASS, Ball, Camera, Drone, Ground, Line, Load, Motors, Wind, WorldPart

FOLDER = Path(__file__).parent / "scenarios"
NAMES = tuple(sorted(file.stem for file in FOLDER.glob("*.yaml")))
"""Names of the scenarios in this package."""

TASKS: dict[str, type[Ball | Line]] = {"ball": Ball, "line": Line}
NOWHERE = Where("")
BULLET_A_MAX = 8.0
"""Largest a_max of physics bullet, m/s^2. Above it the rotors reach their limits, and the drone sinks and turns."""
SEED = Quantity(whole=True, at_least=0)
ERROR = Quantity(at_least=-180, at_most=180)
"""Limits of an initial error: -180 to 180 px or degrees."""
PARTS: dict[str, type[WorldPart]] = {
    "camera": Camera,
    "ground": Ground,
    "drone": Drone,
    "wind": Wind,
    "load": Load,
    "motors": Motors,
}


@dataclass(frozen=True, slots=True)
class Scenario:
    """World, camera, drone and task of an episode.

    Attributes:
        name: name of the scenario.
        step: control step, the time between two actions, ms.
        task: the ball or line to follow.
        camera, ground, drone, wind, load, motors: parts of the world.
        light: factor on all brightness.
        start: initial error on each axis in each episode: px and px for a ball, px and degrees for a line; None draws
            the errors. With three axes the third may be left out and is then 0.
        seed: seed of the first episode if `reset` gets no seed; None takes a seed from the operating system.

    Raises:
        ModelError: a value is out of its range, or two values are incompatible.
    """

    name: str = "B60"
    step: float = setting(50.0, "ms", at_least=0.1, at_most=1000.0)
    task: Ball | Line = field(default_factory=Ball)
    camera: Camera = field(default_factory=Camera)
    ground: Ground = field(default_factory=Ground)
    drone: Drone = field(default_factory=Drone)
    wind: Wind = field(default_factory=Wind)
    load: Load = field(default_factory=Load)
    motors: Motors = field(default_factory=Motors)
    light: float = setting(1.0, at_least=0.001, at_most=1000.0)
    start: tuple[float, ...] | None = None
    seed: int | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise ModelError(f"name = {self.name!r}: expected a word", path=("name",))
        check_fields(self)
        if not isclose(self.step * 1000.0, round(self.step * 1000.0), rel_tol=1e-12):
            raise ModelError(f"step = {self.step!r}: expected whole microseconds", path=("step",))
        if self.start is not None:
            object.__setattr__(self, "start", errors("start", self.start, self.axes))
        if self.seed is not None:
            check(SEED, self.seed, "seed")
            object.__setattr__(self, "seed", int(self.seed))
        self._check_combinations()

    def _check_combinations(self) -> None:
        """Raise an error for values that are incompatible with each other."""
        kind, task = self.kind, self.task
        path = task.speed * self.step / 1000.0
        lap = task.lap if isinstance(task, Ball) else 6.0 * task.side
        if path > 0.01 * lap:
            raise ModelError(
                f"task.{kind}.speed = {task.speed:g}: {path:g} m in a step of {self.step:g} ms: "
                f"expected at most a hundredth of the lap of {lap:g} m",
                path=("task", kind, "speed"),
            )
        if self.drone.physics == "bullet" and self.drone.a_max > BULLET_A_MAX:
            raise ModelError(
                f"drone.a_max = {self.drone.a_max:g}: expected at most {BULLET_A_MAX:g} m/s^2 with physics bullet, "
                "whose rotors have no more to steer with",
                path=("drone", "a_max"),
            )
        wind_acceleration, wind = self.drone.drag * self.wind.speed, self.wind
        limit = min(self.drone.a_max, self.drone.v_max / self.drone.lag)
        if wind_acceleration > limit:
            raise ModelError(
                f"wind.speed = {wind.speed:g}: the wind accelerates the drone by {wind_acceleration:g} m/s^2: expected "
                f"at most {limit:g}, which is all that the drone has against it",
                path=("wind", "speed"),
            )
        if isinstance(task, Ball):
            top = 2.0 * task.radius * (1.0 + task.swell) + task.rise + task.bounce
            if top >= self.drone.height:
                reaches = f": it reaches {top:g} m" if top > 2.0 * task.radius else ""
                raise ModelError(
                    f"task.ball.radius = {task.radius:g}: expected a ball below the drone, whose height is "
                    f"{self.drone.height:g} m{reaches}",
                    path=("task", "ball", "radius"),
                )
            sinks = self.drone.lag * GRAVITY * abs(self.load.mass) / MASS
            if task.axes == 3 and sinks > self.drone.climb_max:
                raise ModelError(
                    f"load.mass = {self.load.mass:g}: the drone sinks or rises by {sinks:.3g} m/s, and climb_max is "
                    f"{self.drone.climb_max:g}",
                    path=("load", "mass"),
                )
            return
        notes = {"drone.spin": "where actions turn", "motors.angle": "where actions turn", "camera.roll": "which leans"}
        for name, reason in notes.items():
            part, word = name.split(".")
            if value := getattr(getattr(self, part), word):
                raise ModelError(f"{name} = {value:g}: expected 0 along a line, {reason}", path=(part, word))

    @property
    def kind(self) -> str:
        """Kind of the task: "ball" or "line"."""
        return "ball" if isinstance(self.task, Ball) else "line"

    @property
    def axes(self) -> int:
        """Number of actions, and of the errors that they correct."""
        return self.task.axes if isinstance(self.task, Ball) else 2

    def as_words(self) -> dict[str, Any]:
        """Return all values that are not None as plain data in the grammar of the YAML files."""
        out = asdict(self) | {"task": {self.kind: asdict(self.task)}}
        if self.start is not None:
            out["start"] = list(self.start)
        return {word: value for word, value in out.items() if value is not None}

    @classmethod
    def from_words(cls, values: Mapping[str, Any]) -> Scenario:
        """Return the scenario that `as_words` has turned into plain data. Missing values have defaults.

        The data may have been written to JSON or YAML and read again.

        Raises:
            ModelError: see `load`.
        """
        try:
            return _scenario(_node(values))
        except ModelError as error:
            raise error.but(where=None) from None


def load(scenario: Scenario | str | Path, /, **changes: Any) -> Scenario:
    """Return a scenario with some values changed.

    Args:
        scenario: a name of `NAMES`, a YAML file, or a scenario.
        **changes: values in the grammar of the files, e.g. ``camera={"tilt": 30}``. Other values of the part do not
            change. Dotted names have the same effect: ``**{"camera.tilt": 30}``.

    Raises:
        ModelError: there is no scenario of this name, or a value is wrong. Errors in a file have line and column.
    """
    if isinstance(scenario, Scenario):
        base = scenario
    else:
        path = _file(scenario)
        document = read(path, "a scenario", "task: {ball: {}}")
        base = _scenario(document, path.stem)
    if not changes:
        return base
    values = base.as_words()
    for name, value in changes.items():
        *parents, word = name.split(".")
        for outer in reversed([*parents, word]):
            value = {outer: value}
        _merge(values, value)
    return Scenario.from_words(values)


def _file(name: str | Path) -> Path:
    """Return the file of a scenario by its name or path."""
    if isinstance(name, str) and name in NAMES:
        return FOLDER / f"{name}.yaml"
    path = Path(name)
    if isinstance(name, Path) or path.suffix in (".yaml", ".yml") or len(path.parts) > 1:
        return path
    raise unknown("scenario", name, NAMES)


def _scenario(root: Node, name: str = "") -> Scenario:
    """Return the scenario that a document describes."""
    nodes = words(root, [f.name for f in fields(Scenario)], "a scenario")
    values = {word: _plain(word, node) for word, node in nodes.items()}
    with about(root):
        for word, kind in PARTS.items():
            if word in values:
                values[word] = kind(**values[word])
        if "task" in values:
            [(kind_, task)] = values["task"].items()
            values["task"] = TASKS[kind_](**task)
        return Scenario(**{"name": name or "scenario", **values})


def _plain(word: str, node: Node) -> Any:
    """Convert the node of a top-level word to plain data. The names in a part or task are checked."""
    if word in PARTS:
        return _words(PARTS[word], node, word)
    if word != "task":
        return plain(node)
    if isinstance(node.value, str) and node.value in TASKS:
        return {node.value: {}}
    tasks = words(node, TASKS, "a task", kind="task")
    if len(tasks) != 1:
        raise mistake(node, f"found {len(tasks)} tasks: expected one of {', '.join(TASKS)}")
    return {kind: _words(TASKS[kind], inner, kind) for kind, inner in tasks.items()}


def _words(part: type[WorldPart], node: Node, part_name: str) -> dict[str, Any]:
    names = [f.name for f in fields(part)]  # type: ignore[arg-type]
    return {word: plain(inner) for word, inner in words(node, names, part_name).items()}


def _node(value: Any) -> Node:
    """Convert plain data to nodes, as if they were read from a file."""
    if isinstance(value, Mapping):
        value = {str(word): _node(inner) for word, inner in value.items()}
    elif isinstance(value, (list, tuple)):
        value = [_node(inner) for inner in value]
    return Node(value, NOWHERE, NOWHERE)


def errors(what: str, value: Any, axes: int) -> tuple[float, ...]:
    """Check the initial error of an episode and return it as a tuple.

    Args:
        what: name of the value, for messages.
        value: two numbers, or one for each axis.
        axes: number of axes.

    Raises:
        ModelError: the value has another form or is out of range.
    """
    value = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(value, (list, tuple)) or len(value) not in (2, axes):
        expected = (
            "two numbers, the error on both axes" if axes == 2 else "two or three numbers, the error on each axis"
        )
        raise ModelError(f"{what} = {value!r}: expected {expected}", path=("start",))
    return tuple(check(ERROR, number, what) for number in value)


def _merge(values: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Write changes into the values. A change to None removes the value, so that its default holds."""
    for word, value in changes.items():
        if is_dataclass(value) and not isinstance(value, type):
            value = {"ball" if isinstance(value, Ball) else "line": asdict(value)} if word == "task" else asdict(value)
        inner = values.get(word)
        if isinstance(value, Mapping) and isinstance(inner, dict) and not (word == "task" and _replaces(inner, value)):
            _merge(inner, value)
        elif value is None:
            values.pop(word, None)
        else:
            values[word] = dict(value) if isinstance(value, Mapping) else value


def _replaces(task: Mapping[str, Any], change: Mapping[str, Any]) -> bool:
    """Return whether a change names another kind of task, which replaces the task as a whole."""
    return any(kind in change and kind not in task for kind in TASKS)
