"""Time one network: `python benchmarks/run.py brunel|cuba|stdp|loop [--threads 1] [--T 1000] -> one JSON line`."""

from __future__ import annotations

import argparse
import json
import time

began = time.perf_counter()
import neuro  # noqa: E402

import_s = time.perf_counter() - began

from measure import ClosedLoop, PlainLoop, in_pairs, looping, running  # noqa: E402
from networks import NETWORKS, loop  # noqa: E402


def main() -> None:
    """Print the line."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("case", choices=[*NETWORKS, "loop"])
    options.add_argument("--threads", type=int, default=1)
    options.add_argument("--T", type=float, default=1000.0, help="ms of biological time")
    options.add_argument("--pairs", type=int, default=0, help="so many windows of T on one thread and on two, in turn")
    options.add_argument("--steps", type=int, default=20_000, help="of the closed loop")
    options.add_argument("--resolution", type=float, default=0.1, help="of the closed loop, ms")
    options.add_argument("--plain", action="store_true", help="the closed loop without ports")
    asked = options.parse_args()
    if asked.case == "loop":
        figures = looping(loop(asked.resolution), asked.steps, PlainLoop if asked.plain else ClosedLoop)
    elif asked.pairs:
        figures = in_pairs(NETWORKS[asked.case](), asked.T, asked.pairs)
    else:
        figures = running(NETWORKS[asked.case](), asked.T, asked.threads)
    line = {"peer": "neuro", "version": neuro.__version__, "case": asked.case, "threads": asked.threads, **figures}
    line["import_s"] = import_s
    print(json.dumps({name: round(v, 4) if isinstance(v, float) else v for name, v in line.items()}))


if __name__ == "__main__":
    main()
