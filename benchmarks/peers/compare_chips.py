"""Time public emulators of Loihi and neuro with the same networks, one after the other, and print the ratios.

`python benchmarks/peers/compare_chips.py [--python PEERS_PYTHON]`: PEERS_PYTHON has nengo-loihi, brian2-loihi and
sanafe installed.
"""

from __future__ import annotations

import sys

from compare import HERE, OURS, peers_python, timed

STEPS = {"ff": "200", "rec": "50"}
PEERS = {"nengo-loihi": "on_nengo_loihi.py", "Brian2Loihi": "on_brian2_loihi.py", "SANA-FE": "on_sanafe.py"}


def main() -> int:
    """Print a table and one JSON line for each run."""
    python = peers_python(__doc__)
    rows = []
    for net, steps in STEPS.items():
        ours = timed([sys.executable, str(OURS), net])
        if ours is None:
            continue
        rate = ours["clock_steps_per_s"]  # as the peers' scripts take it
        rows.append((net, "neuro", rate, ""))
        for name, script in PEERS.items():
            theirs = timed([python, str(HERE / script), net, steps])
            if theirs is not None:
                rows.append((net, name, theirs["steps_per_s"], f"{rate / theirs['steps_per_s']:.0f}"))
    print(f"\n{'net':<6}{'emulator':<14}{'steps/s':>12}{'neuro is faster by':>20}")
    for net, name, rate, ratio in rows:
        print(f"{net:<6}{name:<14}{rate:>12.5g}{ratio:>20}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
