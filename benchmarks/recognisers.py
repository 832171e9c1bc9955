"""How well a method recognises: `python benchmarks/recognisers.py nmnist|poker|poker-upright METHOD`.

`--settings` and `--set` change it as they do `neuro recognise train`.

N-MNIST: three random splits of the 1000 recordings to train on, 900 to learn from and 100 to test. POKER-DVS: five
stratified folds. Prints the accuracy by each vote, mean and deviation of the splits, and seconds of one core.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from remus_folds import FIELD, FILES, SHARED, Split

from neuro.cli.options import assignments
from neuro.events import Recordings, recordings
from neuro_recognise.method import choose
from neuro_recognise.observations import observe
from neuro_recognise.recogniser import learn, method_of


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("case", choices=FILES)
    options.add_argument("method")
    options.add_argument("--settings", default="")
    options.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options.add_argument("--splits", type=int, default=3)
    options.add_argument("--seed", type=int, default=0)
    asked = options.parse_args()
    method = method_of(asked.method, asked.settings, assignments(asked.set)).fitting(FIELD)
    data = recordings(SHARED / FILES[asked.case])
    shown = observe(method, data)
    if asked.case == "poker-upright":
        upright = [k for k, name in enumerate(shown.names) if not Path(name).stem.endswith("i")]
        data, shown = data.take(upright), shown.take(upright)
    found: dict[str, list[float]] = {}
    learning, deciding, decided = 0.0, 0.0, 0
    for number, (to_learn, to_test) in enumerate(splits(asked.case, data, asked.splits)):
        began = time.process_time()
        made = learn(method, shown.take(to_learn), f"split {number}", seed=asked.seed + number)
        learnt, part = time.process_time(), shown.take(to_test)
        answer = method.answer(made.learnt, part)
        learning, deciding = learning + learnt - began, deciding + time.process_time() - learnt
        decided += len(part)
        for vote, scores in {"own": answer.scores, **answer.votes}.items():
            found.setdefault(vote, []).append(float(np.mean(choose(scores) == part.labels)))
        print(number, *(f"{vote} {shares[-1]:.1%}" for vote, shares in found.items()), flush=True)
    for vote, shares in found.items():
        print(f"{asked.method} on {asked.case} by {vote}: {np.mean(shares):.1%} +- {np.std(shares):.1%}")
    print(f"learning {learning / len(found['own']):.1f} s, deciding {1e3 * deciding / decided:.1f} ms a recording")


def splits(case: str, data: Recordings, n: int) -> Iterator[Split]:
    """Recordings to learn from, and to test."""
    if case != "nmnist":
        yield from data.folds(5, seed=0)
        return
    for number in range(n):
        order = np.random.default_rng([number, 14]).permutation(len(data))
        yield order[100:], order[:100]


if __name__ == "__main__":
    main()
