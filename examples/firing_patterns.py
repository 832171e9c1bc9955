"""Twenty firing patterns of one neuron, as a figure: `firing_patterns.png`.

Source: Izhikevich, IEEE Trans. Neural Networks 15:1063, 2004, figure 1; parameters, steps and currents are those of its
published file, figure1.m. Most are the model `izhikevich`. Seven are written as equations: three need others than the
rest (G, L, R), and four show their pattern only in the file's order, where u follows the new V_m (P, Q, S, T).
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

import neuro

Current = Callable[[float], float]


def pulses(*given: tuple[float, float, float], base: float = 0.0) -> Current:
    """A current of `base` that is higher by `value` within each (begin, end, value)."""
    return lambda t: base + sum(value for begin, end, value in given if begin < t < end)


def ramp(begin: float, slope: float, base: float = 0.0) -> Current:
    """A current that rises from a time on."""
    return lambda t: base + slope * max(t - begin, 0.0)


def slow_then_fast(t: float) -> float:
    """Two ramps: 8 in 200 ms, and 4 in 12.5 ms."""
    return t / 25.0 if t < 200.0 else 0.0 if t < 300.0 or t >= 312.5 else (t - 300.0) * 0.32


def dip(t: float) -> float:
    """A current that is lower from 50 to 250 ms."""
    return 75.0 if 50.0 <= t <= 250.0 else 80.0


PUBLISHED = neuro.equations(
    "published",
    doc="Izhikevich's neuron in Euler steps of `step`, in which u follows the new V_m.",
    let={"dV": "0.04/(mV*ms)*V_m^2 + slope*V_m + offset - u + I_e"},
    equations={"V_m": "dV", "u": "a*(b*(V_m + step*dV - V_u) - decay*u)"},
    threshold="V_m > V_th",
    reset={"V_m": "c", "u": "u + d"},
    initial={"V_m": "c", "u": "b*c"},
    parameters={
        "a": "0.02 1/ms",
        "b": "0.2 1/ms",
        "c": "-65 mV",
        "d": "8 mV/ms",
        "slope": "5 1/ms",
        "offset": "140 mV/ms",
        "V_u": "0 mV",
        "decay": 1.0,
        "V_th": "30 mV",
        "I_e": "0 mV/ms",
        "step": "0.25 ms",
    },
    integrator="euler",
)
CLASS_1 = {"slope": 4.1, "offset": 108.0}
SAME: dict[str, float] = {}


@dataclass(frozen=True)
class Pattern:
    """A neuron (a, b, c, d), where it starts, the step and the duration in ms, and its input.

    Attributes:
        other: None for the model `izhikevich`; for equations the parameters that differ.
        u: where u starts, b V if None.
    """

    abcd: tuple[float, float, float, float]
    v: float
    step: float
    ms: float
    current: Current
    other: dict[str, float] | None = None
    u: float | None = None

    def model(self) -> neuro.izhikevich:
        """The neuron."""
        numbers = dict(zip("abcd", self.abcd, strict=True))
        return neuro.izhikevich(**numbers) if self.other is None else PUBLISHED(**numbers, step=self.step, **self.other)


RESONANT = pulses((40.0, 44.0, 0.65), (60.0, 64.0, 0.65), (280.0, 284.0, 0.65), (320.0, 324.0, 0.65))
PAIRS = pulses((100 / 11, 100 / 11 + 2, 9.0), (100 / 11 + 5, 100 / 11 + 7, 9.0), (70.0, 72.0, 9.0), (80.0, 82.0, 9.0))
EXCITED_INHIBITED = pulses((10.0, 15.0, 1.0), (70.0, 75.0, -6.0), (80.0, 85.0, 1.0))
TWICE = pulses((37.5, 42.5, 1.0), (216.0, 221.0, 1.0), base=0.24)
PATTERNS = {
    "A tonic spiking": Pattern((0.02, 0.2, -65, 6), -70, 0.25, 100, pulses((10, 100, 14))),
    "B phasic spiking": Pattern((0.02, 0.25, -65, 6), -64, 0.25, 200, pulses((20, 200, 0.5))),
    "C tonic bursting": Pattern((0.02, 0.2, -50, 2), -70, 0.25, 220, pulses((22, 220, 15))),
    "D phasic bursting": Pattern((0.02, 0.25, -55, 0.05), -64, 0.2, 200, pulses((20, 200, 0.6))),
    "E mixed mode": Pattern((0.02, 0.2, -55, 4), -70, 0.25, 160, pulses((16, 160, 10))),
    "F spike frequency adaptation": Pattern((0.01, 0.2, -65, 8), -70, 0.25, 85, pulses((8.5, 85, 30))),
    "G class 1 excitable": Pattern((0.02, -0.1, -55, 6), -60, 0.25, 300, ramp(30, 0.075), CLASS_1),
    "H class 2 excitable": Pattern((0.2, 0.26, -65, 0), -64, 0.25, 300, ramp(30, 0.015, -0.5)),
    "I spike latency": Pattern((0.02, 0.2, -65, 6), -70, 0.2, 100, pulses((10, 13, 7.04))),
    "J subthreshold oscillations": Pattern((0.05, 0.26, -60, 0), -62, 0.25, 200, pulses((20, 25, 2))),
    "K resonator": Pattern((0.1, 0.26, -60, -1), -62, 0.25, 400, RESONANT),
    "L integrator": Pattern((0.02, -0.1, -55, 6), -60, 0.25, 100, PAIRS, CLASS_1),
    "M rebound spike": Pattern((0.03, 0.25, -60, 4), -64, 0.2, 200, pulses((20, 25, -15))),
    "N rebound burst": Pattern((0.03, 0.25, -52, 0), -64, 0.2, 200, pulses((20, 25, -15))),
    "O threshold variability": Pattern((0.03, 0.25, -60, 4), -64, 0.25, 100, EXCITED_INHIBITED),
    "P bistability": Pattern((0.1, 0.26, -60, 0), -61, 0.25, 300, TWICE, SAME),
    "Q depolarizing after-potential": Pattern((1.0, 0.2, -60, -21), -70, 0.1, 50, pulses((9, 11, 20)), SAME),
    "R accommodation": Pattern(
        (0.02, 1.0, -55, 4), -65, 0.5, 400, slow_then_fast, {"V_u": -65.0, "decay": 0.0}, u=-16.0
    ),
    "S inhibition-induced spiking": Pattern((-0.02, -1.0, -60, 8), -63.8, 0.5, 350, dip, SAME),
    "T inhibition-induced bursting": Pattern((-0.026, -1.0, -45, -2), -63.8, 0.5, 350, dip, SAME),
}

Floats = npt.NDArray[np.float64]


def response(pattern: Pattern, backend: str = "event") -> tuple[Floats, Floats, Floats, Floats]:
    """Times in ms, V_m and current after each step, and the times of the spikes."""
    slow = "U_m" if pattern.other is None else "u"
    start = pattern.abcd[1] * pattern.v if pattern.u is None else pattern.u
    net = neuro.Network("pattern", resolution=pattern.step)
    net.population("cell", 1, pattern.model(), initial={"V_m": pattern.v, slow: start})
    net.probe("v", "cell", "V_m", every=pattern.step)
    sim = neuro.compile(net, backend)
    currents = [pattern.current(k * pattern.step) for k in range(round(pattern.ms / pattern.step))]
    changes = [0, *(np.flatnonzero(np.diff(currents)) + 1), len(currents)]
    for k, until in pairwise(changes):
        sim.set("cell", I_e=currents[k])
        sim.run(pattern.step * (until - k))
    times, v = sim.trace("v")
    return times, v[:, 0], np.array(currents), sim.spikes("cell")[0]


def figure() -> Figure:
    """All patterns, as in the paper: the potential above, the current below."""
    drawing, axes = plt.subplots(5, 4, figsize=(11, 9), layout="constrained")
    for axis, (name, pattern) in zip(axes.flat, PATTERNS.items(), strict=True):
        times, v, current, spikes = response(pattern)
        v[np.isin(times, spikes)] = 30.0  # where it was when it was reset
        low, high = current.min(), current.max()
        axis.plot(times, v, lw=0.8)
        axis.plot(times, -100.0 + 12.0 * (current - low) / (high - low), lw=0.8, color="0.4")
        axis.set(xlim=(0, pattern.ms), ylim=(-105, 35), yticks=[])
        axis.set_title(name, fontsize=9)
        axis.tick_params(labelsize=7)
        axis.spines[["top", "left", "right"]].set_visible(False)
        print(f"{name}: {spikes.size} spikes, the first at {spikes[0]:.1f} ms")
    drawing.supxlabel("time (ms)", fontsize=9)
    return drawing


if __name__ == "__main__":
    figure().savefig("firing_patterns.png", dpi=110)
