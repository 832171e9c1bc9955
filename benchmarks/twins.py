"""What one part costs beside another in the same network: `python benchmarks/twins.py triplets|equations`.

`triplets`: `stdp_triplet` beside `stdp`. `equations`: `iaf_psc_exp` as equations beside the built-in.

The two networks take turns of 20 ms. Seconds of the processor are compared turn by turn and the median of the ratios is
told, since other work on the machine slows both.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import yaml
from networks import driven, stdp, triplets

import neuro

MODELS = Path(__file__).parents[1] / "tests" / "equations" / "models.yaml"
TURN_MS = 20.0


def equations() -> neuro.Model:
    """`iaf_psc_exp` as text."""
    words = yaml.safe_load(MODELS.read_text())["models"]["own_iaf_psc_exp"]
    model: neuro.Model = neuro.equations("own_iaf_psc_exp", **words)()
    return model


CASES = {
    "triplets": lambda: (triplets(), stdp()),
    "equations": lambda: (driven(equations(), 100.0), driven(neuro.iaf_psc_exp(), 100.0)),
}


def ratios(first: neuro.Network, second: neuro.Network, turns: int) -> np.ndarray:
    """How much longer the first takes than the second, turn by turn, after 100 ms."""
    sims = [neuro.compile(net, seed=12345, threads=1) for net in (first, second)]
    for sim in sims:
        sim.run(100.0)
    taken = np.zeros((turns, 2))
    for turn in range(turns):
        for k in (0, 1) if turn % 2 else (1, 0):
            began = time.process_time()
            sims[k].run(TURN_MS)
            taken[turn, k] = time.process_time() - began
    return taken[:, 0] / taken[:, 1]


def main() -> None:
    """Print a line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("case", choices=list(CASES))
    options.add_argument("--turns", type=int, default=60)
    asked = options.parse_args()
    low, median, high = np.percentile(ratios(*CASES[asked.case](), asked.turns), [25, 50, 75])
    print(f"{asked.case}: {median:.3f} times as long; quartiles {low:.3f} and {high:.3f}")


if __name__ == "__main__":
    main()
