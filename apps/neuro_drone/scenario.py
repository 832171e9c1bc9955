"""A scenario: world, camera, drone and task; made by name, from a YAML file, or from words."""

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
"""The scenarios that come along."""

TASKS: dict[str, type[Ball | Line]] = {"ball": Ball, "line": Line}
NOWHERE = Where("")
BULLET_A_MAX = 8.0
"""m/s^2; a rigid body that is asked for more sinks and turns away, since its rotors are at their limits."""
SEED = Quantity(whole=True, at_least=0)
ERROR = Quantity(at_least=-180, at_most=180)
"""Of an axis at the beginning, px or degrees."""
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
        name: what it is called.
        step: between two actions, ms.
        task: what is followed.
        camera, ground, drone, wind, load, motors: of the world.
        light: factor on all brightness.
        start: error on each axis at the beginning of each episode, ball px and px, line px and degrees; None draws it.
            Of three axes the third may be left out, it is then 0.
        seed: of the first episode when `reset` is given none; None takes one from the machine.

    Raises:
        ModelError: a value is out of its range, or two do not go together.
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
        self._together()

    def _together(self) -> None:
        """Refuse what cannot be at the same time."""
        kind, task = self.kind, self.task
        way = task.speed * self.step / 1000.0
        lap = task.lap if isinstance(task, Ball) else 6.0 * task.side
        if way > 0.01 * lap:
            raise ModelError(
                f"task.{kind}.speed = {task.speed:g}: {way:g} m in a step of {self.step:g} ms: "
                f"expected at most a hundredth of the lap of {lap:g} m",
                path=("task", kind, "speed"),
            )
        if self.drone.physics == "bullet" and self.drone.a_max > BULLET_A_MAX:
            raise ModelError(
                f"drone.a_max = {self.drone.a_max:g}: expected at most {BULLET_A_MAX:g} m/s^2 with physics bullet, "
                "whose rotors have no more to steer with",
                path=("drone", "a_max"),
            )
        blown, wind = self.drone.drag * self.wind.speed, self.wind
        most = min(self.drone.a_max, self.drone.v_max / self.drone.lag)
        if blown > most:
            raise ModelError(
                f"wind.speed = {wind.speed:g}: it accelerates the drone by {blown:g} m/s^2, and the drone has at most "
                f"{most:g} against it",
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
        why = {"drone.spin": "where actions turn", "motors.angle": "where actions turn", "camera.roll": "which leans"}
        for name, reason in why.items():
            part, word = name.split(".")
            if value := getattr(getattr(self, part), word):
                raise ModelError(f"{name} = {value:g}: expected 0 along a line, {reason}", path=(part, word))

    @property
    def kind(self) -> str:
        """Of the task: ball or line."""
        return "ball" if isinstance(self.task, Ball) else "line"

    @property
    def axes(self) -> int:
        """Actions, and errors that go with them."""
        return self.task.axes if isinstance(self.task, Ball) else 2

    def as_words(self) -> dict[str, Any]:
        """All values as plain data in the grammar of the YAML files; what is None is left out."""
        out = asdict(self) | {"task": {self.kind: asdict(self.task)}}
        if self.start is not None:
            out["start"] = list(self.start)
        return {word: value for word, value in out.items() if value is not None}

    @classmethod
    def from_words(cls, said: Mapping[str, Any]) -> Scenario:
        """What `as_words` gave, also after a way through JSON or YAML; what is not said has its default.

        Raises:
            ModelError: as `load`.
        """
        try:
            return _scenario(_node(said))
        except ModelError as error:
            raise error.but(where=None) from None


def load(scenario: Scenario | str | Path, /, **changes: Any) -> Scenario:
    """A scenario with some values changed.

    Args:
        scenario: one of `NAMES`, a YAML file, or a scenario.
        **changes: values in the grammar of the files, ``camera={"tilt": 30}``; of a part only what is named changes.
            Names with dots do the same: ``**{"camera.tilt": 30}``.

    Raises:
        ModelError: there is none of that name, or a value is not as expected; in a file with line and column.
    """
    if isinstance(scenario, Scenario):
        base = scenario
    else:
        path = _file(scenario)
        document = read(path, "a scenario", "task: {ball: {}}")
        base = _scenario(document, path.stem)
    if not changes:
        return base
    said = base.as_words()
    for name, value in changes.items():
        *way, word = name.split(".")
        for outer in reversed([*way, word]):
            value = {outer: value}
        _merge(said, value)
    return Scenario.from_words(said)


def _file(name: str | Path) -> Path:
    """The file of a scenario."""
    if isinstance(name, str) and name in NAMES:
        return FOLDER / f"{name}.yaml"
    path = Path(name)
    if isinstance(name, Path) or path.suffix in (".yaml", ".yml") or len(path.parts) > 1:
        return path
    raise unknown("scenario", name, NAMES)


def _scenario(root: Node, name: str = "") -> Scenario:
    """The scenario that a document describes."""
    said = words(root, [one.name for one in fields(Scenario)], "a scenario")
    values = {word: _plain(word, node) for word, node in said.items()}
    with about(root):
        for word, kind in PARTS.items():
            if word in values:
                values[word] = kind(**values[word])
        if "task" in values:
            [(kind_, task)] = values["task"].items()
            values["task"] = TASKS[kind_](**task)
        return Scenario(**{"name": name or "scenario", **values})


def _plain(word: str, node: Node) -> Any:
    """What is said of a part as plain data, with known words only."""
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


def _words(part: type[WorldPart], node: Node, what: str) -> dict[str, Any]:
    known = [one.name for one in fields(part)]  # type: ignore[arg-type]
    return {word: plain(inner) for word, inner in words(node, known, what).items()}


def _node(value: Any) -> Node:
    """Words as if they were read."""
    if isinstance(value, Mapping):
        value = {str(word): _node(inner) for word, inner in value.items()}
    elif isinstance(value, (list, tuple)):
        value = [_node(inner) for inner in value]
    return Node(value, NOWHERE, NOWHERE)


def errors(what: str, value: Any, axes: int) -> tuple[float, ...]:
    """The error on each axis at the beginning of an episode.

    Args:
        what: its name, for messages.
        value: two numbers, or one for each axis.
        axes: how many there are.

    Raises:
        ModelError: it is not.
    """
    value = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(value, (list, tuple)) or len(value) not in (2, axes):
        expected = (
            "two numbers, the error on both axes" if axes == 2 else "two or three numbers, the error on each axis"
        )
        raise ModelError(f"{what} = {value!r}: expected {expected}", path=("start",))
    return tuple(check(ERROR, one, what) for one in value)


def _merge(said: dict[str, Any], changes: Mapping[str, Any]) -> None:
    for word, value in changes.items():
        if is_dataclass(value) and not isinstance(value, type):
            value = {"ball" if isinstance(value, Ball) else "line": asdict(value)} if word == "task" else asdict(value)
        inner = said.get(word)
        if isinstance(value, Mapping) and isinstance(inner, dict) and not (word == "task" and _other(inner, value)):
            _merge(inner, value)
        elif value is None:
            said.pop(word, None)
        else:
            said[word] = dict(value) if isinstance(value, Mapping) else value


def _other(task: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether a task is another one, which replaces the first as a whole."""
    return any(kind in other and kind not in task for kind in TASKS)
