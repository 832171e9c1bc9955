"""Time public emulators of Loihi and neuro with the same networks, one after the other, and print the ratios.

`python benchmarks/peers_chips.py --scripts FOLDER --python PEERS_PYTHON`: FOLDER holds bench_nengo_loihi.py,
bench_brian2loihi.py and bench_sanafe.py, PEERS_PYTHON has nengo-loihi, brian2-loihi and sanafe installed.
"""

from __future__ import annotations

import sys

from peers import OURS, asked, timed

STEPS = {"ff": "200", "rec": "50"}
PEERS = {
    "nengo-loihi": ("bench_nengo_loihi.py",),
    "Brian2Loihi": ("bench_brian2loihi.py",),
    "SANA-FE": ("bench_sanafe.py",),
}


def main() -> int:
    """Print a table and one JSON line for each run; 0 also where the scripts are missing, which is said."""
    found = asked(__doc__, PEERS.values())
    if found is None:
        return 0
    scripts, python = found
    rows = []
    for net, steps in STEPS.items():
        ours = timed([sys.executable, str(OURS), net])
        if ours is None:
            continue
        rate = ours["clock_steps_per_s"]  # as the peers' scripts take it
        rows.append((net, "neuro", rate, ""))
        for name, (script,) in PEERS.items():
            theirs = timed([python, str(scripts / script), net, steps])
            if theirs is not None:
                rows.append((net, name, theirs["steps_per_s"], f"{rate / theirs['steps_per_s']:.0f}"))
    print(f"\n{'net':<6}{'emulator':<14}{'steps/s':>12}{'neuro is faster by':>20}")
    for net, name, rate, ratio in rows:
        print(f"{net:<6}{name:<14}{rate:>12.5g}{ratio:>20}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
