"""Why a network does not work: `neuro doctor`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.apps import Backend, Duration, NetworkFile, Seed, Set, assignments, milliseconds, stoppable

if TYPE_CHECKING:
    from neuro_doctor.diagnosis import Diagnosis
    from neuro_doctor.doctor import Options


def hertz(text: str) -> float:
    """A rate >= 0 Hz: a number, or one with its unit."""
    from neuro import ModelError
    from neuro.apps import converted, is_measure

    try:
        rate = converted(text, "Hz") if is_measure(text) else float(text)
    except ModelError as error:
        raise typer.BadParameter(f"'{text}': {error.message}") from None
    except ValueError:
        rate = -1.0
    if not 0.0 <= rate < float("inf"):
        raise typer.BadParameter(f"'{text}': expected a rate >= 0 Hz")
    return rate


Chip = Annotated[str | None, typer.Option("--chip", metavar="NAME", help="Judge it on this chip, too.")]
Train = Annotated[bool, typer.Option("--train", help="Judge the gradients of surrogates, too.")]
Drive = Annotated[
    float, typer.Option("--drive", metavar="HZ", parser=hertz, help="Drive inputs that list no spikes at this rate.")
]
RewardAfter = Annotated[
    float | None,
    typer.Option("--reward-after", metavar="MS", parser=milliseconds, help="How late a reward comes, in ms."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
Html = Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write a page with pictures, too.")]


def doctor(
    file: NetworkFile,
    duration: Duration = 1000.0,
    backend: Backend = "event",
    seed: Seed = 0,
    set: Set = [],  # noqa: B006
    chip: Chip = None,
    train: Train = False,
    drive: Drive = 0.0,
    reward_after: RewardAfter = None,
    as_json: Json = False,
    html: Html = None,
) -> None:
    """Say why a network does not work: findings with evidence and remedy. The exit status is 1 if there is a fault."""
    from neuro.apps import check_output, output
    from neuro_doctor.diagnosis import PAGE
    from neuro_doctor.doctor import options_of

    options = options_of(ms=duration, backend=backend, chip=chip, train=train, drive=drive, reward_after=reward_after)
    if html is not None:
        check_output(html, PAGE)
    with stoppable("nothing is judged") as bar:
        bar.say("examining")
        found = examined(file, assignments(set), seed, options)
        if html is not None:
            with output(html, PAGE) as part:
                part.write_text(PAGE.seal(found.page()), "utf-8")
    typer.echo(json.dumps(found.as_dict(), indent=2) if as_json else str(found))
    if html is not None and not as_json:
        typer.echo(f"{html}: written")
    if found.faults:
        raise typer.Exit(1)


def examined(file: Path, params: dict[str, object], seed: int, options: Options) -> Diagnosis:
    """The diagnosis of a file; all its mistakes are faults, and then nothing runs."""
    from neuro import ModelError, load
    from neuro.apps import mistakes
    from neuro_doctor.doctor import examine, lived, refused

    if not file.exists():
        raise ModelError(f"{file}: no such file")
    found = mistakes(file, params, seed)
    if found.mistakes or found.program is None:
        return refused(file.stem, found.mistakes)
    diagnosis = examine(found.program, options)
    return lived(diagnosis, load(file, params=params), options, seed)
