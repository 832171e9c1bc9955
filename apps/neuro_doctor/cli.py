"""The command `neuro doctor`."""

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
    """Parse a rate >= 0 Hz: a number, or a number with a unit."""
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


Chip = Annotated[str | None, typer.Option("--chip", metavar="NAME", help="Also check the network on this chip.")]
Train = Annotated[bool, typer.Option("--train", help="Also check the surrogate gradients.")]
Drive = Annotated[
    float,
    typer.Option(
        "--drive", metavar="HZ", parser=hertz, help="Rate of Poisson spikes for inputs without spikes of their own."
    ),
]
RewardAfter = Annotated[
    float | None,
    typer.Option(
        "--reward-after", metavar="MS", parser=milliseconds, help="Check if eligibility lasts until a reward, in ms."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
Html = Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Web page with pictures to write.")]


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
    """Print why a network does not work: findings with evidence and remedy. The exit status is 1 for a fault."""
    from neuro.apps import check_output, output
    from neuro_doctor.diagnosis import PAGE
    from neuro_doctor.doctor import options_of

    options = options_of(ms=duration, backend=backend, chip=chip, train=train, drive=drive, reward_after=reward_after)
    if html is not None:
        check_output(html, PAGE)
    with stoppable("nothing is judged") as bar:
        bar.say("examining")
        diagnosis = examine_file(file, assignments(set), seed, options)
        if html is not None:
            with output(html, PAGE) as part:
                part.write_text(PAGE.seal(diagnosis.page()), "utf-8")
    typer.echo(json.dumps(diagnosis.as_dict(), indent=2) if as_json else str(diagnosis))
    if html is not None and not as_json:
        typer.echo(f"{html}: written")
    if diagnosis.faults:
        raise typer.Exit(1)


def examine_file(file: Path, params: dict[str, object], seed: int, options: Options) -> Diagnosis:
    """Return the diagnosis of a network file. If the file has errors, each is a fault, and nothing runs."""
    from neuro import load
    from neuro.apps import mistakes
    from neuro_doctor.doctor import add_world_findings, diagnose_errors, examine

    check = mistakes(file, params, seed)
    if check.mistakes or check.program is None:
        return diagnose_errors(file.stem, check.mistakes)
    return add_world_findings(examine(check.program, options), load(file, params=params), options, seed)
