"""What a larva's wiring diagram explains, beside three shuffles: `larva.png`, and `larva.yaml` to run again.

Named sensory neurons of the larva of Drosophila are driven, and the rates of named outputs are shown: with the diagram,
and with controls in which one property is drawn anew. The interval is that of 95 % of the seeds: of the diagram each
seed is another draw of the input, of a control also another shuffle.

    python examples/larva.py larva_winding2023.zip [--seeds 20] [--ms 1000]

Source of the diagram: Winding et al., Science 379:eadd9330, 2023, Supplementary Data S1, as a zip. Source of the model:
Shiu et al., Nature 634:210, 2024, for the brain of the adult fly: leaky integrate-and-fire, 0.275 mV a synapse.

The diagram has no transmitters. Here local neurons (LN) inhibit and all others excite, which is an assumption; the
control "signs" shows how much rests on it.
"""

import argparse
import csv
import io
import time
import zipfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

import neuro

INPUTS = ("olfactory", "gustatory-external", "gustatory-pharyngeal")
OUTPUTS = {"PN": "projection", "LN": "local", "KC": "Kenyon", "DN-SEZ": "to mouth", "DN-VNC": "to body"}
"""Types of neurons that are shown, and what they are."""

CONTROLS = {"edges": "targets exchanged", "signs": "signs exchanged", "weights": "weights exchanged"}
RATE = 200.0
"""Of the Poisson spikes that drive each neuron, in Hz, of which nearly every one makes it fire."""

INHIBITS = ("LN",)
COLOURS = ("#1d2733", "#d1495b", "#edae49", "#00798c")

Rates = dict[str, npt.NDArray[np.float64]]
"""By input, a row for each seed and a column for each output, in Hz."""


def tables(path: Path) -> tuple[Path, Path, list[str]]:
    """Write the diagram as a table of neurons and a list of edges; the types that there are."""
    with zipfile.ZipFile(path) as archive:

        def rows(name: str) -> list[list[str]]:
            with archive.open(f"Supplementary-Data-S1/{name}.csv") as file:
                return list(csv.reader(io.TextIOWrapper(file, "utf-8")))

        kinds = {
            neuron: (kind, notes.partition(";")[0], side)
            for left, right, kind, notes, _ in rows("annotations")[1:]
            for neuron, side in ((left, "left"), (right, "right"))
        }
        (_, *ids), *lines = rows("all-all_connectivity_matrix")
    with Path("neurons.csv").open("w", newline="") as file:
        known = [(neuron, *kinds.get(neuron, ("unknown", "unknown", ""))) for neuron in ids]
        csv.writer(file).writerows([("id", "type", "modality", "side"), *known])
    with Path("edges.csv").open("w", newline="") as file:
        edges = ((pre, ids[k], n) for pre, *row in lines for k, n in enumerate(map(float, row)) if n)
        csv.writer(file).writerows([("pre", "post", "synapses"), *edges])
    return Path("neurons.csv"), Path("edges.csv"), sorted({kind for _, kind, _, _ in known})


def larva(path: Path) -> neuro.Network:
    """The brain of the larva."""
    neurons, edges, types = tables(path)
    net = neuro.Network("larva")
    # R_m = tau_m / C_m = 1 GOhm: a weight in pA is one of the source's in mV.
    model = neuro.iaf_psc_exp(
        tau_m=20.0, C_m=20.0, tau_syn_ex=5.0, tau_syn_in=5.0, E_L=-52.0, V_reset=-52.0, V_th=-45.0, t_ref=2.2
    )
    signs = {kind: -1 if kind in INHIBITS else 1 for kind in types}
    net.wiring(
        "brain",
        neurons=neuro.neuron_table(neurons, id="id"),
        edges=neuro.from_file(edges, weight="synapses", transmitter="type", signs=signs, dale=True),
        model=model,
        weight=0.275,
        delay=1.8,
        initial={"V_m": -52.0},
        drive=75.0,
    )
    return net


def answers(net: neuro.Network, seed: int, ms: float) -> dict[str, list[float]]:
    """The mean rate of each output, in Hz, to each input."""
    brain = net.populations["brain"]
    sim = neuro.compile(net, seed=seed)
    found = {}
    for modality in INPUTS:
        sim.reset()
        sim.activate(brain, 0.0)
        sim.activate(brain.where(modality=modality), RATE)
        sim.run(ms)
        found[modality] = [1000.0 * len(sim.spikes(each)[0]) / (len(each) * ms) for each in outputs(net)]
    return found


def outputs(net: neuro.Network) -> list[neuro.View]:
    """The neurons of each output."""
    return [net.populations["brain"].where(type=kind) for kind in OUTPUTS]


def over_seeds(net: neuro.Network, what: str | None, seeds: int, ms: float) -> Rates:
    """The rates of the diagram, or of one of its controls, with several seeds."""
    nets = [net if what is None else neuro.shuffled(net, what, seed=seed) for seed in range(seeds)]
    found = [answers(each, seed, ms) for seed, each in enumerate(nets)]
    return {modality: np.array([each[modality] for each in found]) for modality in INPUTS}


def interval(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Between which 95 % of the seeds lie, for each output."""
    return np.percentile(values, (2.5, 97.5), axis=0)


def drawn(found: dict[str, Rates]) -> Figure:
    """Median and interval of each output, a panel for each input."""
    figure, panels = plt.subplots(1, len(INPUTS), figsize=(11.0, 4.2), sharey=True, layout="constrained")
    for panel, modality in zip(panels, INPUTS, strict=True):
        for k, (label, of) in enumerate(found.items()):
            low, high = interval(of[modality])
            middle = np.median(of[modality], axis=0)
            x = np.arange(len(OUTPUTS)) + 0.17 * (k - 1.5)
            panel.errorbar(x, middle, (middle - low, high - middle), fmt="o", ms=4, color=COLOURS[k], label=label)
        panel.set_xticks(range(len(OUTPUTS)), [f"{kind}\n{what}" for kind, what in OUTPUTS.items()], fontsize=8)
        panel.set_title(f"{modality} at {RATE:g} Hz", fontsize=10)
        panel.set_yscale("symlog", linthresh=1.0)
        panel.set_ylim(-0.05, None)
        panel.grid(axis="y", alpha=0.3)
    panels[0].set_ylabel("rate (Hz)")
    panels[-1].legend(fontsize=8, frameon=False)
    figure.suptitle("Larva of Drosophila: the wiring diagram beside shuffles of it; median and 95 % of the seeds")
    return figure


def main() -> None:
    """Run all, print what lies outside of the controls, and draw it."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("diagram", type=Path, nargs="?", default="../shared/data/connectome/larva_winding2023.zip")
    words.add_argument("--seeds", type=int, default=20)
    words.add_argument("--ms", type=float, default=1000.0)
    said = words.parse_args()
    net = larva(said.diagram)
    net.save("larva.yaml")
    print(net)

    sim = neuro.compile(net)
    sim.activate(net.populations["brain"].where(modality="olfactory"), RATE)
    begin = time.process_time()
    sim.run(said.ms)
    print(f"a run takes 1/{said.ms / 1000.0 / (time.process_time() - begin):.0f} of the time it stands for")

    found = {"diagram": over_seeds(net, None, said.seeds, said.ms)}
    found |= {label: over_seeds(net, what, said.seeds, said.ms) for what, label in CONTROLS.items()}
    print(f"{'':22}{'':8}" + "".join(f"{label:>22}" for label in found))
    for modality in INPUTS:
        for column, kind in enumerate(OUTPUTS):
            cells = []
            low, high = interval(found["diagram"][modality])[:, column]
            for label, of in found.items():
                least, most = interval(of[modality])[:, column]
                apart = "*" if label != "diagram" and (most < low or least > high) else " "
                cells.append(f"{np.median(of[modality][:, column]):8.2f} {least:.2f}-{most:.2f}{apart}".rjust(22))
            print(f"{modality:22}{kind:8}" + "".join(cells))
    print("* apart from the diagram: no seed of the 95 % is within its interval")
    drawn(found).savefig("larva.png", dpi=130)


if __name__ == "__main__":
    main()
