"""A comparison of methods as a table, as Markdown and as a page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from neuro.apps import console, html, sealed, table, wilson, write_text
from neuro.chips import COLUMNS, cells
from neuro_recognise.compare import Compared, MethodComparison
from neuro_recognise.telling.pictures import accuracies, confusion

PAGE = sealed(
    "a page of 'neuro recognise compare'",
    '<meta name="generator" content="neuro recognise compare">',
    "<!-- digest {} -->",
)
TABLE = sealed("a table of 'neuro recognise compare'", "<!-- neuro recognise compare -->", "<!-- digest {} -->")
HEAD = ("method", "runs on", ">accuracy", ">95 % interval", "other votes", ">look, ms", ">train, s", ">decide, ms")
ABOUT = (
    "Networks run on a backend, the other methods on none. "
    "Accuracy is that of all recordings, each decided by what was learnt from the other folds; after it the deviation "
    "between seeds. The interval is Wilson's, of one seed's recordings. Times are of one core: to look at a recording, "
    "to learn from the other folds, to decide on a recording that was looked at."
)
BILLS = ("method", "chip", *COLUMNS)
BILL = (
    "Joules of a recording: what the network does, and what the chip takes while it does; the host that turns events "
    "into its input is not in the bill. Counts times published figures, in brackets the range of these. The chip is on "
    "for as long as it works, or, in real time, for as long as the recording lasts. A total behind > lacks costs for "
    "which no figure is published: static power, or learning."
)


def show(found: Sequence[Compared], plan: MethodComparison) -> None:
    """Print the table."""
    out = console()
    out.print(table(HEAD, [_row(one, plan) for one in found]))
    if bills := list(_bills(found)):
        out.print(table(BILLS, bills, title="joules of a recording"))
    for one in found:
        if one.refused:
            print(f"- {one.contestant.name}: {one.refused}")
    for line in _unpriced(found):
        print(f"- {line}")


def write(found: Sequence[Compared], plan: MethodComparison, data: str) -> tuple[Path, Path]:
    """Write the table and the page into the folder.

    Args:
        found: of each method.
        plan: what was compared.
        data: what on, for the title.

    Returns:
        The files.
    """
    markdown, page = plan.folder / "table.md", plan.folder / "compare.html"
    text = _markdown(HEAD, [_row(one, plan) for one in found])
    if bills := list(_bills(found)):
        text += "\nJoules of a recording:\n\n" + _markdown(BILLS, bills)
    if unpriced := list(_unpriced(found)):
        text += "\n" + "".join(f"- {line}\n" for line in unpriced)
    write_text(markdown, f"<!-- neuro recognise compare -->\n\n{text}", TABLE)
    write_text(page, html.page("neuro recognise compare", f"Recognisers on {data}", _parts(found, plan, data)), PAGE)
    return markdown, page


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table as Markdown; a head that begins with > stands over numbers."""
    rule = ["---:" if name.startswith(">") else "---" for name in head]
    return "".join(f"| {' | '.join(row)} |\n" for row in ([name.lstrip(">") for name in head], rule, *rows))


def _parts(found: Sequence[Compared], plan: MethodComparison, data: str) -> Iterator[Any]:
    tag, ran = html.tag, [one for one in found if one.of_seeds]
    n = ran[0].of_seeds[0].n if ran else 0
    yield tag("h1", "Recognisers side by side")
    seeds = f"{len(plan.seeds)} seed" + ("s" if len(plan.seeds) > 1 else "")
    yield tag("p", f"{n} recordings of {data}, {plan.folds} folds, {seeds}.", class_="lead")
    if ran:
        yield html.picture(accuracies([(one.contestant.name, one.of_seeds) for one in ran]), "accuracy of each method")
    yield html.table(HEAD, [_row(one, plan) for one in found])
    yield tag("p", ABOUT)
    if bills := list(_bills(found)):
        yield tag("h2", "Joules of a recording")
        yield html.table(BILLS, bills)
        yield tag("p", BILL)
    if unpriced := list(_unpriced(found)):
        yield tag("ul", *(tag("li", line) for line in unpriced))
    if refused := [one for one in found if one.refused]:
        yield tag("h2", "What could not be run")
        yield tag("ul", *(tag("li", f"{one.contestant.name}: {one.refused}") for one in refused))
    yield tag("h2", "What is taken for what")
    yield tag("div", *(_card(one, plan.seeds[0]) for one in ran), class_="cards")


def _card(one: Compared, seed: int) -> Any:
    """The confusion of a method under its name."""
    picture = html.picture(confusion(one.of_seeds[0]), f"confusion of {one.contestant.name}, seed {seed}")
    return html.tag("div", html.tag("h3", one.contestant.name), html.tag("p", one.contestant.method.title), picture)


def _row(one: Compared, plan: MethodComparison) -> tuple[str, ...]:
    runs = plan.backend if one.contestant.method.spikes else "-"
    if not one.of_seeds:
        return (one.contestant.name, runs, "not run", *[""] * (len(HEAD) - 3))
    spread = "" if np.isnan(one.spread) else f" ± {100 * one.spread:.1f}"
    n = one.of_seeds[0].n
    low, high = wilson(round(one.accuracy * n), n)
    votes = {vote: np.mean([found.accuracy for found in each]) for vote, each in (one.votes or {}).items()}
    text = ", ".join(f"{vote} {100 * share:.1f}" for vote, share in votes.items())
    shares = (f"{100 * one.accuracy:.1f}{spread} %", f"{100 * low:.0f} - {100 * high:.0f}", text or "-")
    return one.contestant.name, runs, *shares, *(f"{took:.2g}" for took in (one.observe_ms, one.train_s, one.answer_ms))


def _bills(found: Sequence[Compared]) -> Iterator[tuple[str, ...]]:
    """Of each network the bill on each target; a refusal in its place."""
    for one in found:
        for target, bill in (one.bills or {}).items():
            refused = ("refused", *["-"] * (len(COLUMNS) - 1))
            yield one.contestant.name, target, *(refused if bill.get("refused") else cells(bill))


def _unpriced(found: Sequence[Compared]) -> Iterator[str]:
    """Networks that a target refuses, and why."""
    for one in found:
        for target, bill in (one.bills or {}).items():
            if bill.get("refused"):
                yield f"{target} refuses {one.contestant.name}: {bill['refused']}"
