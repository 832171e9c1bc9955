"""Trials that failed, done again: the journal forgets that they have ended, the folder what failed of their runs."""

from __future__ import annotations

from neuro.core.errors import ModelError
from neuro.sweeps.claims import claimed
from neuro.sweeps.folder import Folder
from neuro.sweeps.tuning.journal import journal_of, locked, optuna, trials_of
from neuro.sweeps.tuning.plan import Plan
from neuro.sweeps.tuning.sampling import point_of


def retry_failed(plan: Plan, before: str, folder: Folder) -> int:
    """Leave trials of which a run has failed as if they were under way, so that who asks next takes them over.

    Args:
        plan: how the search goes.
        before: what decides what comes of a run, beside its point and seed.
        folder: of the search.

    Returns:
        How many there are.

    Raises:
        ModelError: others work in the folder, or the journal is damaged.
    """
    with locked(folder.claims / ".ask"):
        if others := claimed(folder.claims):
            told = f"{folder.path}: others work in it, on {len(others)} runs or trials"
            raise ModelError(told, hint="what failed is done again when nobody does")
        state = optuna().trial.TrialState.FAIL
        trials = [trial for trial in trials_of(folder) if trial.state == state]
        items = {trial._trial_id: plan.items(before, point_of(plan, trial.params)) for trial in trials}
        found = folder.outcomes({item.key: None for each in items.values() for item in each})
        failed = {key for key, outcome in found.items() if outcome.failed}
        again = {number for number, each in items.items() if any(item.key in failed for item in each)}
        journal_of(folder).forget_ends(again, state.value)
        for key in failed:
            folder.forget(key)
        return len(again)
