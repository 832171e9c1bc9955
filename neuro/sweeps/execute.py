"""Sweeps and searches done: all runs that a folder does not have, and how far it is."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing

from neuro.core.errors import ModelError
from neuro.core.progress import Bar
from neuro.core.provenance import provenance
from neuro.sweeps.asking import Asker, point_of
from neuro.sweeps.claims import claimed, waiting
from neuro.sweeps.cores import POLL_S
from neuro.sweeps.definition import Definition, Search, Sweep
from neuro.sweeps.executors import Executor, doing
from neuro.sweeps.folder import Folder
from neuro.sweeps.journal import journal_of, locked, optuna, trials_of
from neuro.sweeps.plan import SearchPlan
from neuro.sweeps.space import Point
from neuro.sweeps.table import as_text

Hear = Callable[[str], None]
"""Gets the key of each run when it is there."""


def execute(
    sweep: Sweep,
    folder: Folder,
    place: Executor,
    *,
    retry: bool = False,
    bar: Bar | None = None,
    hear: Hear | None = None,
) -> dict[str, int]:
    """Do all runs of a sweep that its folder does not have.

    Args:
        sweep: the sweep.
        folder: where runs are kept; made if it is not there.
        place: where they are done.
        retry: whether to do those again that failed.
        bar: shows how far it is.
        hear: gets the key of each run when it is there.

    Returns:
        How many runs are done, failed and left.

    Raises:
        ModelError: the folder is another's, cannot be written, or there are no such workers.
    """
    folder.begin(_recorded(sweep), "digest_of_runs", "same")
    share = place.share
    items = [item for k, item in enumerate(sweep.items, 1) if share is None or k % share[1] == share[0]]
    there = folder.outcomes(item.key for item in items)
    if retry:
        for key in [key for key, outcome in there.items() if outcome.failed]:
            folder.forget(key)
            del there[key]
    failed = sum(outcome.failed for outcome in there.values())
    counts = {"done": len(there) - failed, "failed": failed, "left": len(items) - len(there)}
    total = counts["left"]

    def tell(key: str, failed: bool) -> None:
        counts["failed" if failed else "done"] += 1
        counts["left"] -= 1
        if bar is not None:
            bar.show(total - counts["left"], total, as_text(counts))
        if hear is not None:
            hear(key)

    if bar is not None:
        bar.say(as_text(counts))
    if total:
        with doing(sweep, folder, place, tell, say=None if bar is None else bar.say, wait=False) as do:
            do([item for item in items if item.key not in there])
    return counts


def _recorded(definition: Definition) -> dict[str, object]:
    """What the file of a folder has."""
    inputs = definition.inputs
    return definition.as_dict() | {"inputs": list(inputs), "provenance": provenance(inputs)}


def execute_search(
    search: Search,
    folder: Folder,
    place: Executor,
    *,
    retry: bool = False,
    bar: Bar | None = None,
    hear: Hear | None = None,
) -> dict[str, int]:
    """Ask for trials and do their runs until there are as many as the plan says.

    Args:
        search: the search.
        folder: where runs and the journal are kept; made if it is not there.
        place: where runs are done; one that has a share asks for so many trials and does not wait for others.
        retry: whether to do those trials again of which a run failed; not of a share.
        bar: shows how far it is.
        hear: gets the key of each run when it is there.

    Returns:
        How many trials are done, failed, pruned and left.

    Raises:
        ModelError: the folder is another's, cannot be written, its journal is damaged, Optuna is not installed, no run
            has a metric of the objectives, or there are no such workers.
    """
    optuna()  # whether it is there shows before a folder is made
    if retry and place.share is not None:
        message = "what failed is done again by one process for all"
        raise ModelError(f"{message}: expected no share", hint="run it once without, then the shares")
    _begin_search(search, folder)
    if retry:
        _retry_failed(search.plan, search.before, folder)
    with closing(Asker(search.plan, search.before, folder, _share(search.plan.most, place.share))) as asker:
        _ask(asker, search, folder, place, bar, hear)
        return asker.counts()


def _ask(asker: Asker, search: Search, folder: Folder, place: Executor, bar: Bar | None, hear: Hear | None) -> None:
    """Do the runs that are asked for, and wait for trials of others where this has no share."""

    def tell(key: str, failed: bool) -> None:
        asker.tell(key)
        if bar is not None:
            counts = asker.counts()
            bar.show(search.plan.most - counts["left"], search.plan.most, as_text(counts))
        if hear is not None:
            hear(key)

    if bar is not None:
        bar.say(as_text(asker.counts()))
    say = None if bar is None else bar.say
    with doing(search, folder, place, tell, asker.more, say=say) as do:
        do(())
        while place.share is None and not asker.finished():
            if say is not None and (others := asker.others()):
                say(waiting(folder.claims, others, "trial"))
            time.sleep(POLL_S)  # others work on what is left, and may die
            if items := asker.more(1):
                do(items)


def hold_out(search: Search, folder: Folder, points: Sequence[Point], place: Executor, bar: Bar) -> None:
    """Run points on what is held out from all folds.

    Args:
        search: the search.
        folder: where it is kept.
        points: values of the parameters.
        place: where runs are done.
        bar: shows how far it is.

    Raises:
        ModelError: as `execute_search`.
    """
    _begin_search(search, folder)
    items = list({item.key: item for point in points for item in search.plan.tests(search.before, point)}.values())
    left = [item for item in items if folder.outcome(item.key) is None]
    done = len(items) - len(left)
    bar.begin(done)

    def tell(key: str, failed: bool) -> None:
        nonlocal done
        done += 1
        bar.show(done, len(items), f"{done:,} of {len(items):,} tested")

    with doing(search, folder, place, tell, say=bar.say) as do:
        do(left)


def _begin_search(search: Search, folder: Folder) -> None:
    """Make the folder of a search, or go on in it, also with another number of trials."""
    content = _recorded(search)
    folder.begin(content, "same", "same")
    there = folder.read()
    if there["plan"]["trials"] != search.plan.trials:
        kept = {word: value for word, value in there.items() if word not in ("format", "digest")}
        folder.write(kept | {"plan": content["plan"]})


def _share(most: int, share: tuple[int, int] | None) -> int | None:
    """Of how many trials a share asks at most."""
    return None if share is None else most // share[1] + (0 < share[0] <= most % share[1])


def _retry_failed(plan: SearchPlan, before: str, folder: Folder) -> None:
    """Leave trials of which a run has failed as if they were under way, so that the next asker takes them over.

    Raises:
        ModelError: others work in the folder, or the journal is damaged.
    """
    with locked(folder.claims / ".ask"):
        if others := claimed(folder.claims):
            message = f"{folder.path}: others work in it, on {len(others)} runs or trials"
            raise ModelError(message, hint="what failed is done again when no other call does")
        state = optuna().trial.TrialState.FAIL
        trials = [trial for trial in trials_of(folder) if trial.state == state]
        items = {trial._trial_id: plan.items(before, point_of(plan, trial.params)) for trial in trials}
        found = folder.outcomes({item.key: None for each in items.values() for item in each})
        failed = {key for key, outcome in found.items() if outcome.failed}
        again = {number for number, each in items.items() if any(item.key in failed for item in each)}
        journal_of(folder).forget_ends(again, state.value)
        for key in failed:
            folder.forget(key)
