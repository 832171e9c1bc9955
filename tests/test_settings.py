"""Settings of applications: checked values, changes by name, plain data, options of commands."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import typer
from typer.testing import CliRunner

from neuro.apps import Part, Registry, Settings, part, setting, with_settings


@dataclass(frozen=True)
class Wheel(Part):
    """Base of wheels."""

    kind = "wheel"
    radius: float = setting(0.3, "m", "to the tyre", "a guess", above=0)


@dataclass(frozen=True)
class Spoked(Wheel):
    """A wheel with spokes."""

    spokes: int = setting(32, "", "of a wheel", at_least=3)


@dataclass(frozen=True)
class Solid(Wheel):
    """A wheel without."""


Wheel.known = Registry("wheel", (Spoked, Solid))


@dataclass(frozen=True)
class Bicycle(Settings):
    """Two wheels and what else there is."""

    front: Wheel = part(Wheel, Spoked())
    back: Wheel = part(Wheel, Spoked())
    colour: str = setting("red", "", "of the frame", words=("red", "blue"), option="NAME")
    gears: tuple[int, ...] = setting((11, 13), "", "teeth", at_least=9)
    bells: int | None = setting(None, "", "how many", kind="integer", at_least=0, option="--ring N")
    load: float = setting(0.0, "kg", "on the rack", at_least=0, option="KG")
    bags: tuple[str, ...] = setting((), "", "what hangs on it; repeatable", kind="names", option="--with-bag NAME")
    owner: Any = None
    number: int = field(default=7, metadata={"fixed": True})


def test_values_are_checked_and_have_one_form():
    one = Bicycle(load=3, gears=[12, 14.0], bags="left")
    assert (one.load, one.gears, one.bags) == (3.0, (12, 14), ("left",))
    assert [row.name for row in one.rows()][:3] == ["front", "front.radius", "front.spokes"]


def test_what_cannot_be_is_refused(messages):
    messages.calls(globals())


def test_plain_data_gives_the_same_settings():
    one = Bicycle(number=8).changed({"front": "solid", "back.spokes": 28, "owner": "me", "bags": ["left", "right"]})
    assert one.number == 8
    assert "number" not in one.as_words()
    again = Bicycle.from_words(json.loads(json.dumps(one.as_words())))
    assert again.changed({}) == Bicycle(**{**vars(one), "number": 7})


def test_a_command_has_options_for_the_fields_that_ask_for_them():
    app = typer.Typer(pretty_exceptions_enable=False)

    @app.command()
    @with_settings
    def ride(bicycle: Bicycle, far: bool = False) -> None:
        typer.echo(f"{bicycle.colour} {bicycle.bells} {bicycle.load} {bicycle.bags} {far}")

    words = ["--colour", "blue", "--ring", "2", "--with-bag", "a", "--with-bag", "b", "--far"]
    assert CliRunner().invoke(app, words).output == "blue 2 0.0 ('a', 'b') True\n"
    assert CliRunner().invoke(app, []).output == "red None 0.0 () False\n"
    shown = " ".join(CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200", "TERM": "dumb"}).output.split())
    assert "--ring" in shown
    assert "What hangs on it; repeatable." in shown
    assert "--owner" not in shown
