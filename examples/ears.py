"""A sound becomes spikes in three ways, as a figure: `ears.png`. `ears.py FILE.wav` hears a file, else two vowels."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.io import wavfile
from scipy.signal import sosfilt

from neuro import coding

RATE, BANDS = 8000.0, 32
THRESHOLDS = [-40.0, -30.0, -20.0, -10.0]  # dB below the loudest
FORMANTS = ((730.0, 270.0), (1090.0, 2290.0), (2440.0, 3010.0))  # Hz, of a and i (Peterson and Barney, 1952)


def vowels():
    """A voice of 120 Hz whose formants glide from those of a to those of i."""
    pulses = np.zeros(4000)
    pulses[400:3600:67] = 1.0
    sound = np.zeros(4000)
    for start in range(0, 4000, 40):
        share = np.clip((start - 1600) / 800, 0.0, 1.0)
        piece = pulses[start : start + 40]
        for k, (first, second) in enumerate(FORMANTS):
            f = (1.0 - share) * first + share * second
            decay, angle = np.exp(-np.pi * 90.0 / RATE), 2.0 * np.pi * f / RATE
            section = [[1.0 - decay, 0.0, 0.0, 1.0, -2.0 * decay * np.cos(angle), decay**2]]
            piece, states[k] = sosfilt(section, piece, zi=states.get(k, np.zeros((1, 2))))
        sound[start : start + 40] = piece
    return sound


states = {}
if sys.argv[1:]:
    RATE, samples = wavfile.read(sys.argv[1])
    sound, name = samples.astype(float), Path(sys.argv[1]).stem
else:
    sound, name = vowels(), "vowels a to i"
sound /= np.abs(sound).max()

ear = coding.Cochlea(RATE, BANDS)
heard = ear.hear(sound)  # half-waves, (samples, channels)
times, channels = coding.HairCells(BANDS, RATE, gain=60.0).spikes(heard)
levels = coding.MelBands(RATE, BANDS).hear(sound)  # dB, (frames, bands)
shares = np.clip(1.0 + (levels - levels.max()) / 50.0, 0.0, 1.0)
down, up = coding.crossings(levels - levels.max(), THRESHOLDS).transpose(1, 0, 2, 3)
drawn = coding.poisson(coding.rate(shares**2, 0.0, 1.0, max_rate=200.0), window=10.0, seed=1)  # (frames, bands, most)

figure, axes = plt.subplots(6, 1, figsize=(8, 11), sharex=True, layout="constrained")
seconds = np.arange(len(sound)) * 1000.0 / RATE
end = seconds[-1]
axes[0].plot(seconds, sound, linewidth=0.5, color="black")
axes[0].set(title=name, ylabel="sound")
pooled = heard[: len(heard) // 40 * 40].reshape(-1, 40, BANDS).mean(axis=1)
axes[1].imshow(np.sqrt(pooled.T), origin="lower", aspect="auto", extent=(0, end, 0, BANDS), cmap="magma")
axes[1].set(title="Cochlea: gammatone channels, half-waves", ylabel="channel")
axes[2].scatter(times, channels, s=1.0, color="black")
axes[2].set(title="HairCells: integrate-and-fire", ylabel="channel")
axes[3].imshow(shares.T, origin="lower", aspect="auto", extent=(0, 10.0 * len(levels), 0, BANDS), cmap="magma")
axes[3].set(title="MelBands: 50 dB below the loudest", ylabel="band")
for passed, colour, shift in ((up, "C3", 0.0), (down, "C0", 0.3)):
    frame, _, band = passed.nonzero()
    axes[4].scatter(10.0 * (frame + 1), band + shift, s=4.0, color=colour)
axes[4].set(title="crossings of four levels, up (red) and down (blue)", ylabel="band")
frame, band, _ = np.isfinite(drawn).nonzero()
axes[5].scatter(10.0 * frame + drawn[np.isfinite(drawn)], band, s=1.0, color="black")
axes[5].set(title="rate, then poisson, frame by frame", ylabel="band", xlabel="time (ms)", xlim=(0, end))
figure.savefig(Path("ears.png"), dpi=80)
print(f"{name}: {len(times)} spikes of hair cells, {int(up.sum() + down.sum())} crossings, {len(frame)} drawn")
