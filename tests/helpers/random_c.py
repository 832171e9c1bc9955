"""Random small networks that a chip runs and C can be: all layouts, delays, groups, and registers of every neuron."""

from typing import Any

import numpy as np

import neuro
from neuro.model.synapses import spinnaker_learning

STEPS = 60
"""That a test compares."""


def random_network(seed: int, chip: str) -> neuro.Network:
    """A network of a number."""
    draws = np.random.default_rng([seed, len(chip)])
    if chip == "loihi2" and seed % 4:
        return _graded(draws, seed)
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
        _connect(net, draws, pre, post, _unit(net, post), chip == "loihi" and _alike(net, post))
    if chip != "loihi2" and draws.random() < 0.3:
        _native(net, draws, chip)
        cells.append("native")
    if draws.random() < 0.5:
        _grid(net, draws, chip)
        cells.append("maps")
    if draws.random() < 0.5:
        of = str(draws.choice([name for name in cells if name != "native"]))
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
        "t_ref": 0.0 if chip == "loihi2" else float(draws.integers(0, 4)),
        "tau_m": some(5.0, 30.0),
    }
    words["V_th"] = rest + some(4.0, 15.0)
    if draws.random() < 0.4:
        words["I_e"] = some(-100.0, 250.0)
    if draws.random() < 0.5:
        if chip != "loihi2" and draws.random() < 0.3:
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


def _alike(net: neuro.Network, name: str) -> bool:
    """Whether all neurons have the same parameters: only then synapses onto them may learn on Loihi."""
    return not any(isinstance(value, np.ndarray) for value in net.populations[name].model.parameters().values())


def _connect(
    net: neuro.Network, draws: np.random.Generator, pre: str, post: str, unit: float, learns: bool = False
) -> None:
    n_pre, n_post = (int(net.populations[name].shape[0]) for name in (pre, post))
    rules = [neuro.all_to_all(), neuro.fixed_indegree(int(draws.integers(1, 5))), neuro.pairwise_bernoulli(p=0.4)]
    rules += [neuro.one_to_one()] if n_pre == n_post else []
    chosen = rules[int(draws.integers(0, len(rules)))]
    weights = [unit, -unit / 2, neuro.normal(mean=unit / 2, std=unit), neuro.uniform(low=0.1, high=unit)]
    longest = float(draws.choice([1.0, 7.0, 40.0]))
    delays = [longest, neuro.uniform(low=1.0, high=longest)] if longest > 1.0 else [1.0]
    weight, delay = weights[int(draws.integers(0, 4))], delays[int(draws.integers(0, len(delays)))]
    words: dict[str, Any] = {"delay": delay, "name": f"wires{len(net.projections)}"}
    if learns and draws.random() < 0.6:
        first = neuro.uniform(low=0.1, high=unit)
        net.connect(pre, post, chosen, neuro.stdp(lambda_=0.2, Wmax=2.0 * unit), weight=first, **words)
    else:
        net.connect(pre, post, chosen, weight=1.0 if unit == 1.0 else weight, **words)


RULES = (
    {"dw": "2^-2*x1*y0 - 2^-2*x0*y1"},
    {"dw": "x0*y1*(x1 + 3) - u0*2^-3*w", "epoch": 4},
    {"dw": "2^-4*u1*t*(w - 20)", "dt": "2^-1*y0*x1 - x0*y2", "epoch": 2, "trace_decay": "exponential"},
    {"dw": "2^-3*x2*y0 - y1*x0", "rounding": "away", "num_weight_bits": 6},
)
"""Of Loihi's learning engine."""


def _native(net: neuro.Network, draws: np.random.Generator, chip: str) -> None:
    """Neurons in registers, so large that they wrap and clip."""
    n = int(draws.integers(1, 8))

    def some(low: int, high: int) -> Any:
        return draws.integers(low, high, n) if n > 1 else int(draws.integers(low, high))

    if chip == "spinnaker":
        words = {
            "v_rest": some(-99, 99),
            "v_reset": some(-99, 9),
            "v_thresh": some(2**15, 2**19),
            "r_m": some(2**14, 2**17),
        }
        words |= {"exp_tc": some(2**13, 2**15), "t_refract": some(0, 4), "i_offset": some(-(2**12), 2**15)}
        net.population("native", n, neuro.spinnaker_lif(**words, exc_shift=int(draws.integers(0, 16))))
        weight = np.rint(draws.uniform(-65535.0, 65535.0, (len(net.populations["listed"]), n)))
        net.connect("listed", "native", neuro.all_to_all(), weight=weight, delay=2.0, name="words")
        return
    words = {"du": some(0, 4096), "dv": some(0, 4096), "vth": some(100, 2**12), "bias_mant": some(-4096, 4096)}
    net.population("native", n, neuro.loihi_lif(**words, bias_exp=int(draws.integers(0, 8)), refractory=some(1, 64)))
    weight = np.rint(draws.uniform(-256.0, 254.0, (len(net.populations["listed"]), n)))
    exponent = int(draws.integers(-3, 8))
    net.connect(
        "listed", "native", neuro.all_to_all(), neuro.loihi_static(weight_exp=exponent), weight=weight, name="words"
    )
    rule = RULES[int(draws.integers(0, len(RULES)))]
    traces = {f"{name}_{word}": int(draws.integers(*span)) for name in TRACES for word, span in SPANS.items()}
    learning = neuro.loihi_learning(**rule, **traces, weight_exp=exponent)
    net.connect("noise", "native", neuro.fixed_indegree(3), learning, weight=20.0, delay=3.0, name="learnt")


TRACES = ("x1", "x2", "y1", "y2")
SPANS = {"impulse": (10, 100), "tau": (2, 20)}


def _grid(net: neuro.Network, draws: np.random.Generator, chip: str) -> None:
    """A sheet under a shared kernel."""
    channels, height, width = (int(draws.integers(low, high)) for low, high in ((1, 3), (3, 6), (3, 6)))
    net.population("sheet", (channels, height, width), neuro.poisson_generator(rate=60.0))
    cells = neuro.iaf_psc_delta(
        E_L=0.0, V_reset=0.0, V_th=6.0, tau_m=20.0, t_ref=0.0 if chip == "loihi2" else float(draws.integers(0, 3))
    )
    depthwise = bool(draws.integers(0, 2))
    net.population("maps", (channels * int(draws.integers(1, 3)), "auto", "auto"), cells)
    size = (int(draws.integers(1, 4)), int(draws.integers(1, 4)))
    padding = int(draws.integers(0, min(size)))
    rule = neuro.grid(kernel=size, stride=int(draws.integers(1, 3)), padding=padding, depthwise=depthwise)
    weight = [3.0, neuro.normal(mean=1.0, std=2.0)][int(draws.integers(0, 2))]
    net.connect("sheet", "maps", rule, weight=weight, delay=float(draws.integers(1, 9)), name="kernels")


def _graded(draws: np.random.Generator, seed: int) -> neuro.Network:
    """Neurons of Loihi 2 in registers, so large that they wrap and clip, and all of its connections."""
    net = neuro.Network(f"graded{seed}", resolution=1.0)
    n = int(draws.integers(1, 9))
    steps, ids = np.nonzero(draws.random((STEPS, n)) < 0.2)
    most = int(draws.choice([3, 127, 2**17, 2**30]))
    rows = np.stack([steps + 1, ids, draws.integers(-most, most, ids.size)], axis=1)
    net.population("graded", n, neuro.graded_spike_train(spikes=rows[rows[:, 2] != 0]))
    net.population("noise", n, neuro.poisson_generator(rate=float(draws.choice([60.0, 200.0]))))
    sources = ["graded", "noise"]
    for k in range(int(draws.integers(2, 7))):
        name, shape = f"cells{k}", int(draws.integers(1, 10))
        net.population(name, shape, _registers(draws, shape))
        for pre in sorted({str(draws.choice(sources)) for _ in range(3)}):
            _wire(net, draws, pre, name)
        sources.append(name)
    for _ in range(int(draws.integers(0, 3))):
        _wire(net, draws, str(draws.choice(sources)), str(draws.choice(sources[2:])))
    if draws.random() < 0.5:
        shape = (int(draws.integers(1, 3)), 4, 5)
        net.population("sheet", shape, neuro.graded_spike_train() if draws.random() < 0.5 else neuro.spike_generator())
        cells = neuro.sigma_delta(vth=int(draws.integers(0, 60)), bias=3)
        net.population("maps", (2, "auto", "auto"), cells if draws.random() < 0.5 else neuro.graded_vector())
        rule = neuro.grid(kernel=(3, 2), stride=int(draws.integers(1, 3)), padding=int(draws.integers(0, 2)))
        synapse = [neuro.loihi2_convolution(), neuro.loihi2_static(weight_exp=int(draws.integers(-4, 3)))][seed % 2]
        weight = draws.integers(-99, 99, 2 * shape[0] * 6).astype(float)
        net.connect("sheet", "maps", rule, synapse, weight=weight, delay=float(draws.integers(1, 5)), name="kernels")
    return net


def _registers(draws: np.random.Generator, n: int) -> Any:
    """A neuron of Loihi 2, whose parameters are one or each their own."""

    def some(low: int, high: int) -> Any:
        values = draws.integers(low, high, n)
        return values if n > 1 and draws.random() < 0.4 else int(values[0])

    exponents = {"spike_exp": int(draws.integers(0, 8)), "state_exp": int(draws.integers(0, 8))}
    encoding = {**exponents, "vth": some(0, 60), "cum_error": bool(draws.integers(0, 2))}
    relu = bool(draws.integers(0, 2))
    decays = {"du": some(0, 4096), "dv": some(0, 4097), "bias_mant": some(-4096, 4096), "bias_exp": some(0, 8)}
    if draws.random() < 0.5:
        decays |= {"reset_interval": int(draws.integers(1, 20)), "reset_offset": int(draws.integers(0, 30))}
    turning = {"cos_decay": some(-4096, 4097), "sin_decay": some(-2000, 2000), "state_exp": int(draws.integers(0, 8))}
    kinds = [
        lambda: neuro.loihi2_lif(**decays, vth=some(0, 2**12)),
        lambda: neuro.loihi2_ternary_lif(**decays, vth_hi=some(0, 2**12), vth_lo=some(-(2**12), 0)),
        lambda: neuro.sigma_delta(**encoding, bias=some(-50, 50), relu=relu),
        lambda: neuro.delta_encoder(**encoding),
        lambda: neuro.sigma_decoder(),
        lambda: neuro.graded_vector(vth=some(0, 2**10), relu=relu),
        lambda: neuro.graded_product(vth=some(0, 2**10), exp=int(draws.integers(0, 16))),
        lambda: neuro.loihi2_rf(**turning, vth=some(0, 999)),
        lambda: neuro.loihi2_rf_iz(**turning, vth=some(0, 999)),
    ]
    return kinds[int(draws.integers(0, len(kinds)))]()


def _wire(net: neuro.Network, draws: np.random.Generator, pre: str, post: str) -> None:
    """A projection of Loihi 2, dense or sparse, whose mantissas are clipped, cut and shifted."""
    n_pre, n_post = (int(net.populations[name].shape[0]) for name in (pre, post))
    sparse = np.nonzero(draws.random((n_pre, n_post)) < 0.5)
    rules = [(neuro.all_to_all(), n_pre * n_post), (neuro.pairs(pre=sparse[0], post=sparse[1]), sparse[0].size)]
    rules += [(neuro.one_to_one(), n_pre)] if n_pre == n_post else []
    longest = int(draws.choice([1, 4, 64]))
    delay: Any = neuro.uniform(low=1.0, high=float(longest)) if longest > 1 and draws.random() < 0.5 else float(longest)
    words = {"delay": delay, "name": f"wires{len(net.projections)}"}
    rule, synapses = rules[int(draws.integers(0, len(rules)))]
    receptor: dict[str, str] = {}
    if (model := net.populations[post].model).receptors == 2:
        receptor = {"receptor": str(draws.choice(model.receptor_names))}
    mode = str(draws.choice(["mixed", "excitatory", "inhibitory"]))
    bits, exponent = int(draws.integers(1, 9)), int(draws.integers(-8, 8))
    synapse = [
        neuro.loihi2_static(weight_exp=exponent, num_weight_bits=bits, sign_mode=mode, **receptor),
        neuro.loihi2_convolution(**receptor),
        neuro.static(**receptor),
    ][int(draws.integers(0, 3))]
    weight = draws.integers(-255, 255, synapses).astype(float)
    net.connect(pre, post, rule, synapse, weight=weight if draws.random() < 0.8 else 77.0, **words)


def random_learner(seed: int) -> neuro.Network:
    """A network of Loihi of a number that learns by dopamine: of signals, of spikes, of a baseline alone."""
    draws = np.random.default_rng(seed)
    net = neuro.Network(f"learner{seed}", resolution=1.0)
    n = int(draws.integers(1, 6))
    net.population("noise", n, neuro.poisson_generator(rate=float(draws.choice([60.0, 200.0]))))
    for k in range(int(draws.integers(1, 4))):
        name = f"cells{k}"
        cell = neuro.iaf_psc_delta if draws.random() < 0.5 else neuro.iaf_psc_exp
        t_ref = float(draws.integers(0, 3))
        net.population(name, int(draws.choice([n, 4])), cell(E_L=0.0, V_reset=0.0, V_th=8.0, tau_m=10.0, t_ref=t_ref))
        values = neuro.schedule(times=[3.0, 20.0], values=[0.004, -0.01]) if draws.random() < 0.3 else None
        net.signal(f"reward.{k}", to=name, values=values)
        for pre in draws.choice(list(net.populations), 2):
            _taught(net, draws, str(pre), name, f"reward.{k}")
    return net


def _taught(net: neuro.Network, draws: np.random.Generator, pre: str, post: str, signal: str) -> None:
    """A projection that learns by dopamine."""
    n_pre, n_post = (len(net.populations[name]) for name in (pre, post))
    rules = [neuro.all_to_all(), neuro.fixed_indegree(int(draws.integers(1, 4)))]
    rules += [neuro.one_to_one()] * (n_pre == n_post)
    of = str(draws.choice(list(net.populations)))
    by_spikes = {"dopamine": of, "dopamine_delay": float(draws.integers(1, 20))}
    if len(net.populations[of]) == n_post and draws.random() < 0.5:
        by_spikes["dopamine_rule"] = "one_to_one"
    source = [{"signal": signal}, {"signal": signal}, by_spikes, {}][int(draws.integers(0, 4))]
    top = _unit(net, post) * float(draws.choice([1.0, 2.0]))
    plus, minus = (float(size) * top for size in draws.choice([0.5, 1.0], 2))
    synapse = neuro.stdp_dopa(
        A_plus=plus,
        A_minus=minus * float(draws.choice([-1.0, 0.0, 1.0])),
        tau_plus=float(draws.choice([20.0, 5.0])),
        tau_c=float(draws.choice([200.0, 10.0])),
        tau_n=float(draws.choice([200.0, 20.0])),
        b=float(draws.choice([0.0, 0.01, -0.01] if source else [0.01])),
        Wmax=top,
        **source,
    )
    first, name = neuro.uniform(low=0.3 * top, high=top), f"wires-{len(net.projections)}"
    delay = float(draws.choice([1.0, 7.0]))
    net.connect(pre, post, rules[int(draws.integers(0, len(rules)))], synapse, weight=first, delay=delay, name=name)


def random_deferred(seed: int) -> neuro.Network:
    """A network of SpiNNaker of a number that learns by each of its rules: pairs, triplets, Vogels, dopamine."""
    draws = np.random.default_rng([seed, 9])
    net = neuro.Network(f"deferred{seed}", resolution=1.0)
    n = int(draws.integers(1, 6))
    net.population("noise", n, neuro.poisson_generator(rate=float(draws.choice([100.0, 200.0, 900.0]))))
    for k in range(int(draws.integers(1, 4))):
        name, rule = f"cells{k}", (seed + k) % len(DEFERRED)
        cell = neuro.iaf_psc_delta if draws.random() < 0.5 else neuro.iaf_psc_exp
        words = {"E_L": 0.0, "V_reset": 0.0, "V_th": 4.0, "tau_m": 20.0, "t_ref": float(draws.integers(0, 3))}
        net.population(name, int(draws.choice([n, 4])), cell(**words, tau_minus=20.0))
        unit = _unit(net, name)
        _connect(net, draws, "noise", name, unit)
        net.signal(f"reward.{k}", to=name)
        of = [pre for pre in net.populations if len(net.populations[pre]) == len(net.populations[name])]
        synapse = DEFERRED[rule](draws, 2.0 * unit, f"reward.{k}", str(draws.choice(list(net.populations))), of)
        for pre in {str(pre) for pre in draws.choice(list(net.populations), 2)}:
            rules = [neuro.all_to_all(), neuro.fixed_indegree(int(draws.integers(1, 4)))]
            rules += [neuro.one_to_one()] * (len(net.populations[pre]) == len(net.populations[name]))
            sign = -1.0 if synapse.Wmax < 0.0 else 1.0
            first = neuro.uniform(low=min(sign * unit, 0.0), high=max(sign * unit, 0.0))
            longest = float(draws.choice([1.0, 3.0, 7.0]))
            delay = neuro.uniform(low=1.0, high=longest) if longest > 1.0 and draws.random() < 0.5 else longest
            chosen = rules[int(draws.integers(0, len(rules)))]
            net.connect(pre, name, chosen, synapse, weight=first, delay=delay, name=f"wires-{len(net.projections)}")
    return net


def _pairs(kind: Any, mu: float) -> Any:
    """A rule of pairs with a dependence on the weight."""
    start = {"pre_at_start": True} if "pre_at_start" in kind.__dataclass_fields__ else {}
    return lambda draws, top, signal, by, of: kind(
        lambda_=float(draws.choice([0.02, 0.3])), alpha=1.2, mu_plus=mu, mu_minus=mu, Wmax=top, **start
    )


def _taught_by(draws: np.random.Generator, top: float, signal: str, by: str, of: list[str]) -> Any:
    """Dopamine of a signal, of all spikes of a population, or of the spike of one's own neuron."""
    source = [{"signal": signal}, {"dopamine": by}, {"dopamine": of[0], "dopamine_rule": "one_to_one"}]
    plus = top * float(draws.choice([0.02, 0.2]))
    times = {"tau_c": float(draws.choice([200.0, 30.0])), "tau_n": float(draws.choice([100.0, 20.0]))}
    words = {"A_minus": plus * float(draws.choice([0.0, 0.5])), **times, **source[int(draws.choice([0, 0, 1, 2]))]}
    return neuro.stdp_dopa(A_plus=plus, c_min=0.0, Wmax=top, **words)


DEFERRED = (
    _pairs(neuro.stdp, 0.0),
    _taught_by,
    _pairs(neuro.stdp, 1.0),
    _pairs(neuro.stdp_nn_symm, 0.0),
    _taught_by,
    _pairs(neuro.stdp_nn_restr, 1.0),
    lambda draws, top, signal, by, of: neuro.stdp_triplet(
        Aplus=0.1 * top, Aplus_triplet=0.2 * top, Aminus=0.2 * top, Aminus_triplet=0.05 * top, Wmax=top
    ),
    lambda draws, top, signal, by, of: neuro.vogels_sprekeler(eta=0.1 * top, Wmax=-top, alpha=0.9, tau=20.0),
    lambda draws, top, signal, by, of: spinnaker_learning(
        dependence="multiplicative", signal=signal, A_plus=0.1, A_minus=0.05, Wmax=top, c_max=top, tau_n=50.0
    ),
    lambda draws, top, signal, by, of: spinnaker_learning(
        timing="vogels", dopamine=by, alpha=0.0, A_plus=0.1, Wmax=-top, c_max=top, concentration=-0.01, tau_n=50.0
    ),
)
"""A synapse model of each released program of SpiNNaker but the recurrent rule; additive rules of dopamine twice."""
