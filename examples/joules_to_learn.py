"""Energy until an agent has learnt: `python joules_to_learn.py [return]`.

In CartPole a spiking agent that learns by reward, and PPO, a deep agent, learn until the mean return of 100 episodes
reaches the goal, both with their defaults. A bill counts all operations of a training. Lines reach from the lowest to
the highest published figure. An open marker is a lower bound: the chip refuses the network, or a cost is not published.
Processors compute the spiking agent as dense layers here. Needs the extras `agent` and `rl`. Writes
joules_to_learn.png.
"""

import json
import subprocess
import sys

import matplotlib.pyplot as plt

goal = sys.argv[1] if len(sys.argv) > 1 else "475"
COMMANDS = {
    "spiking agent": f"neuro energy cartpole --until {goal} --chips loihi,spinnaker,cpu,arm",
    "PPO": f"neuro agent energy CartPole-v1 --until {goal} --chips cpu,arm",
}
ENDS = ("", "_low", "_high")

figure, ax = plt.subplots(figsize=(8, 3.2), layout="constrained")
labels = []
for colour, (agent, command) in enumerate(COMMANDS.items()):
    words = [sys.executable, "-m", *command.split(), "--seed", "101", "--json"]
    printed = subprocess.run(words, capture_output=True, text=True, check=True)
    for bill in json.loads(printed.stdout)["bills"]:
        joules, lowest, highest = ((bill[f"dynamic{end}_j"] or 0.0) + (bill[f"static{end}_j"] or 0.0) for end in ENDS)
        is_bound = bool(bill["refused"] or set(bill["missing"]) - {"static_per_chip"})
        label = f"{agent}, {bill['target']}"
        print(f"{label:24} {'> ' * is_bound}{joules:.3g} J ({lowest:.3g} to {highest:.3g} J)")
        spread = [[joules - lowest], [highest - joules]]
        filling = "none" if is_bound else f"C{colour}"
        ax.errorbar(joules, len(labels), xerr=spread, fmt="o", mfc=filling, color=f"C{colour}", capsize=4)
        labels.append(label)
ax.set(yticks=range(len(labels)), yticklabels=labels, xscale="log", xlabel=f"energy to a mean return of {goal} (J)")
ax.set(title="joules to learn CartPole")
ax.invert_yaxis()
figure.savefig("joules_to_learn.png", dpi=100)
