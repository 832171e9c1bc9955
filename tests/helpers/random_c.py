"""Random small networks that a chip runs and C can be: all layouts, delays, groups, and registers of every neuron."""

from typing import Any

import numpy as np

import neuro

STEPS = 60
"""That a test compares."""


def random_network(seed: int, chip: str) -> neuro.Network:
    """A network of a number."""
    draws = np.random.default_rng([seed, len(chip)])
    net = neuro.Network(f"random{seed}", resolution=1.0)
    n = int(draws.integers(1, 9))
    net.population("noise", n, neuro.poisson_generator(rate=float(draws.choice([60.0, 200.0, 900.0]))))
    times = [(np.flatnonzero(draws.random(STEPS) < 0.1) + 1.0).tolist() for _ in range(n)]
    net.population("listed", n, neuro.spike_generator(spike_times=times))
    sources, cells = ["noise", "listed"], list[str]()
    if draws.random() < 0.4:
        net.population("parrots", int(draws.integers(1, 9)), neuro.parrot_neuron())
        _connect(net, draws, "noise", "parrots", 1.0)
    for k in range(int(draws.integers(1, 4))):
        cells.append(f"cells{k}")
        size = int(draws.integers(1, 10))
        net.population(cells[-1], size, _neurons(draws, chip, size))
    if "parrots" in net.populations:
        sources.append("parrots")
    for name in cells:
        _connect(net, draws, str(draws.choice(sources)), name, _unit(net, name))
    for _ in range(int(draws.integers(0, 5))):
        pre, post = str(draws.choice([*sources, *cells])), str(draws.choice(cells))
        _connect(net, draws, pre, post, _unit(net, post))
    if draws.random() < 0.5:
        _grid(net, draws, chip)
        cells.append("maps")
    if draws.random() < 0.5:
        of = str(draws.choice(cells))
        axis = int(draws.integers(0, len(net.populations[of].shape)))
        once = bool(draws.integers(0, 2))
        rival = draws.random() < 0.5
        net.group(
            "choice",
            neuro.lateral_reset(of=of, axis=axis) if rival else neuro.winner_take_all(of=of, first_to_fire=once),
        )
    return net


def _neurons(draws: np.random.Generator, chip: str, n: int) -> Any:
    """Neurons of either model of the chip, whose parameters are one or each their own."""

    def some(low: float, high: float) -> Any:
        values = np.round(draws.uniform(low, high, n), 3)
        return values if n > 1 and draws.random() < 0.4 else float(values[0])

    rest = float(draws.choice([0.0, -65.0]))
    words: dict[str, Any] = {
        "E_L": rest,
        "V_reset": rest,
        "t_ref": float(draws.integers(0, 4)),
        "tau_m": some(5.0, 30.0),
    }
    words["V_th"] = rest + some(4.0, 15.0)
    if draws.random() < 0.4:
        words["I_e"] = some(-100.0, 250.0)
    if draws.random() < 0.5:
        if draws.random() < 0.3:
            words["V_min"] = rest - 8.0
        if chip == "spinnaker" and words["t_ref"] == 0.0:
            words["reset_by_subtraction"] = True
        return neuro.iaf_psc_delta(**words)
    tau = float(draws.choice([2.0, 5.0]))
    if chip == "spinnaker":
        words["V_reset"] = rest - 3.0
    return neuro.iaf_psc_exp(**words, tau_syn_ex=tau, tau_syn_in=3.0 if chip == "spinnaker" else tau)


def _unit(net: neuro.Network, name: str) -> float:
    """A weight that moves a neuron."""
    return 4.0 if isinstance(net.populations[name].model, neuro.iaf_psc_delta) else 300.0


def _connect(net: neuro.Network, draws: np.random.Generator, pre: str, post: str, unit: float) -> None:
    n_pre, n_post = (int(net.populations[name].shape[0]) for name in (pre, post))
    rules = [neuro.all_to_all(), neuro.fixed_indegree(int(draws.integers(1, 5))), neuro.pairwise_bernoulli(p=0.4)]
    rules += [neuro.one_to_one()] if n_pre == n_post else []
    chosen = rules[int(draws.integers(0, len(rules)))]
    weights = [unit, -unit / 2, neuro.normal(mean=unit / 2, std=unit), neuro.uniform(low=0.1, high=unit)]
    longest = float(draws.choice([1.0, 7.0, 40.0]))
    delays = [longest, neuro.uniform(low=1.0, high=longest)] if longest > 1.0 else [1.0]
    weight, delay = weights[int(draws.integers(0, 4))], delays[int(draws.integers(0, len(delays)))]
    net.connect(
        pre, post, chosen, weight=1.0 if unit == 1.0 else weight, delay=delay, name=f"wires{len(net.projections)}"
    )


def _grid(net: neuro.Network, draws: np.random.Generator, chip: str) -> None:
    """A sheet under a shared kernel."""
    channels, height, width = (int(draws.integers(low, high)) for low, high in ((1, 3), (3, 6), (3, 6)))
    net.population("sheet", (channels, height, width), neuro.poisson_generator(rate=60.0))
    cells = neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=6.0, tau_m=20.0, t_ref=float(draws.integers(0, 3)))
    depthwise = bool(draws.integers(0, 2))
    net.population("maps", (channels * int(draws.integers(1, 3)), "auto", "auto"), cells)
    size = (int(draws.integers(1, 4)), int(draws.integers(1, 4)))
    padding = int(draws.integers(0, min(size)))
    rule = neuro.grid(kernel=size, stride=int(draws.integers(1, 3)), padding=padding, depthwise=depthwise)
    weight = [3.0, neuro.normal(mean=1.0, std=2.0)][int(draws.integers(0, 2))]
    net.connect("sheet", "maps", rule, weight=weight, delay=float(draws.integers(1, 9)), name="kernels")
