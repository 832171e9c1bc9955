"""What the codes make of nine values between 0.1 and 1, as a figure: `codes.png`."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from neuro import coding

VALUES = 0.1 + 0.9 * np.linspace(0.0, 1.0, 9) ** 1.5
WINDOW = 40.0  # ms
BOUNDS = {"r_min": 0.1, "r_max": 1.0}
CODES = {
    "rate, then poisson": coding.poisson(coding.rate(VALUES, **BOUNDS, max_rate=250.0), WINDOW, seed=1),
    "intensity_to_latency": coding.intensity_to_latency(VALUES, **BOUNDS, window=WINDOW)[:, None],
    "log_intensity_to_latency": coding.log_intensity_to_latency(VALUES, **BOUNDS, window=WINDOW)[:, None],
    "rank": coding.rank(VALUES, window=WINDOW)[:, None],
    "phase": coding.phase(VALUES, 0.0, 1.0, window=WINDOW),
    "burst": coding.burst(VALUES, 0.0, 1.0),
}

figure, axes = plt.subplots(2, 4, figsize=(12, 5), layout="constrained")
for axis, (name, times) in zip(axes.flat, CODES.items(), strict=False):
    axis.eventplot([row[np.isfinite(row)] for row in times], lineoffsets=VALUES, linelengths=0.06, colors="C0")
    axis.set(title=name, xlim=(-1, WINDOW + 1), xlabel="time (ms)", ylabel="value")
    print(f"{name}: {np.isfinite(times).sum()} spikes, the last at {np.nanmax(times):.1f} ms")
line = np.linspace(0.0, 1.0, 500)
for axis, fields in zip(axes.flat[6:], ("gaussian", "cosine"), strict=True):
    axis.plot(line, coding.population(line, 6, 0.0, 1.0, 100.0, fields))
    axis.set(title=f"population, {fields}", xlabel="value", ylabel="rate (Hz)")
figure.savefig(Path("codes.png"), dpi=80)
