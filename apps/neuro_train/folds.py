"""Every recording tested once, by what was learnt from the others: what is done already is not done again."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro.apps import kept_json, sealed, write_text
from neuro_train.data import BatchData
from neuro_train.plan import TrainingPlan
from neuro_train.room import rooms
from neuro_train.tested import by_module, on_backend
from neuro_train.trainer import begun, identity, learn

FORMAT = "neuro train fold 1"
RESULT = sealed("a result of 'neuro train --folds'", f'"format": "{FORMAT}"', ', "digest": "{}"')

Fold = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]


def cross_validate(
    net: neuro.Network,
    shown: BatchData,
    folds: Sequence[Fold],
    plan: TrainingPlan,
    backends: Sequence[str],
    out: Path,
    report: Callable[[str, int, int], None],
) -> list[dict[str, Any]]:
    """Train and test each fold.

    Args:
        net: the network.
        shown: all recordings.
        folds: of each the indices to learn from, and those to test on.
        plan: settings of each training.
        backends: to test on, beside what learnt.
        out: of the networks: fold 1 of trained.yaml is trained-1.yaml, with its figures in trained-1.json.
        report: called with how far it is.

    Returns:
        Of each fold `n`, `right` by backend, `equal` decisions by backend, overflows and joules by chip, `room` in
        registers, and seconds of one core.
    """

    def of_fold(k: int, parts: Fold) -> dict[str, Any]:
        name = f"fold {k + 1} of {len(folds)}"
        own = out.with_name(f"{out.stem}-{k + 1}{out.suffix}")
        file = own.with_suffix(".json")
        of = identity(net, shown, plan) | {"fold": name, "backends": list(backends)}
        kept = kept_json(file)
        if kept.get("of") == json.loads(json.dumps(of)):
            return kept
        checkpoint = begun(net, own, shown, plan, name)

        def tell(epoch: int, noted: Mapping[str, float]) -> None:
            report(f"{name}: learning, {noted.get('right', 0.0):.1%} right", epoch, plan.epochs)

        learnt_from = shown.take(parts[0])
        trained = learn(net, learnt_from, plan, checkpoint, tell)
        trained.net.save(own)
        room = [one for name in dict.fromkeys(backends) for one in rooms(trained.net, name, learnt_from, plan)]
        unseen = shown.take(parts[1])
        tried = [by_module(trained.module, unseen, plan)]
        tried += [on_backend(trained.net, backend, unseen, plan, room=room) for backend in backends]
        result = {"format": FORMAT, "of": of, "n": len(unseen), "cpu_s": trained.cpu_s}
        result |= {"right": {one.backend: one.own.correct for one in tried}}
        result |= {"equal": {one.backend: one.agrees(tried[0]) for one in tried}}
        result |= {"same_spikes": {one.backend: one.same_spikes(tried[0]) for one in tried}}
        result |= {"overflows": {one.backend: one.overflows for one in tried if one.overflows}}
        result |= {"room": [asdict(one) for one in room]}
        result |= {"sent": {one.backend: one.sent for one in tried if one.sent}}
        result |= {"bills": {one.backend: one.bill.as_dict() for one in tried if one.bill}}
        write_text(file, json.dumps(result, indent=1), RESULT)
        checkpoint.remove()
        return result

    return [of_fold(k, parts) for k, parts in enumerate(folds)]
