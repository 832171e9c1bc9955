"""Messages instead of values: a sigma-delta neuron sends how much its value has changed, once that is enough.

The larger the threshold, the fewer messages and the coarser what the receiver sums. The float simulator and the
emulated Loihi 2 send equal integers. Writes graded.png.
"""

import matplotlib.pyplot as plt
import numpy as np

import neuro

STEPS = 200
signal = np.round(400 * np.sin(2 * np.pi * np.arange(STEPS) / 80) * np.exp(-np.arange(STEPS) / 150)).astype(int)
changes = np.diff(signal, prepend=0)
spikes = [[float(step + 1), 0, int(change)] for step, change in enumerate(changes) if change]


def sent(vth: int, backend: str) -> tuple[np.ndarray, np.ndarray]:
    """The sums that a receiver has in each step, and the number of messages that it got."""
    net = neuro.Network("graded", resolution=1.0)
    net.population("input", 1, neuro.graded_spike_train(spikes=spikes))
    net.population("neuron", 1, neuro.sigma_delta(vth=vth, relu=False))
    net.population("receiver", 1, neuro.sigma_decoder())
    net.connect("input", "neuron", neuro.one_to_one(), weight=1.0, delay=1.0)
    net.connect("neuron", "receiver", neuro.one_to_one(), weight=1.0, delay=1.0)
    sim = neuro.compile(net, backend)
    sim.run(STEPS + 3.0)
    times, _, payloads = sim.payloads("receiver")
    return np.stack([times - 3.0, payloads]), len(sim.spikes("neuron")[0])


figure, axis = plt.subplots(figsize=(8, 3.6), layout="constrained")
axis.plot(signal, "k", linewidth=0.8, label="the value")
for vth in (1, 40, 120):
    received, messages = sent(vth, "event")
    same = np.array_equal(received, sent(vth, "loihi2")[0])
    print(f"threshold {vth}: {messages} messages in {STEPS} steps; Loihi 2 {'sends the same' if same else 'differs'}")
    axis.step(*received, where="post", label=f"threshold {vth}: {messages} messages")
axis.set(xlabel="step", ylabel="what the receiver has summed")
axis.legend(frameon=False)
figure.savefig("graded.png", dpi=100)
