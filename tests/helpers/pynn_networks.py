"""Small networks that PyNN's standard can say: each a model, a rule and synapses of its own, drawn by its number."""

import numpy as np

import neuro

MODELS = {
    "iaf_psc_exp": (neuro.iaf_psc_exp, 400.0),
    "iaf_psc_alpha": (neuro.iaf_psc_alpha, 200.0),
    "iaf_psc_delta": (neuro.iaf_psc_delta, 5.0),
    "iaf_cond_exp": (neuro.iaf_cond_exp, 80.0),
    "iaf_cond_alpha": (neuro.iaf_cond_alpha, 40.0),
    "aeif_cond_exp": (neuro.aeif_cond_exp, 120.0),
    "izhikevich": (neuro.izhikevich, 10.0),
}
LEARNS = (14, 17)
"""Networks that learn; pyNN.brian2 takes delays of STDP as axonal, so it learns something else."""


def network(number: int) -> neuro.Network:
    """The network of a number from 1."""
    rng = np.random.default_rng(number)
    model, weight = list(MODELS.values())[number % len(MODELS)]
    net = neuro.Network(f"net{number}")
    trains = [
        np.sort(rng.choice(np.arange(20, 2000), 6, replace=False)) * 0.1 for _ in range(30)
    ]  # one in a step at most
    net.population("input", 30, neuro.spike_generator(spike_times=[train.tolist() for train in trains]))
    spread = {} if model is neuro.izhikevich else {"V_th": neuro.normal(mean=-54.0, std=1.0)}
    excite = net.population("excite", 20, model(**spread), initial={"V_m": neuro.uniform(low=-70.0, high=-62.0)})
    net.population("inhibit", 8, model())
    rules = (neuro.pairwise_bernoulli(0.3), neuro.fixed_indegree(8), neuro.all_to_all(), neuro.fixed_outdegree(6))
    plastic = neuro.stdp(Wmax=2.0 * weight, mu_plus=0.0, mu_minus=float(number % 2)) if number in LEARNS else None
    net.connect("input", "excite", rules[number % 4], weight=neuro.normal(mean=weight, std=weight / 10), delay=1.0)
    net.connect(
        "input", excite[:5], neuro.fixed_indegree(2), weight=weight, delay=neuro.uniform(low=0.5, high=4.0), name="some"
    )
    net.connect("excite", "inhibit", rules[(number + 1) % 4], plastic, weight=weight / 2, delay=0.7, name="learnt")
    net.connect(
        "inhibit", "excite", rules[(number + 2) % 4], weight=-weight / 4, delay=neuro.uniform(low=0.5, high=2.0)
    )
    if number % 5 == 0 and plastic is None:
        net.population("current", 1, neuro.dc_generator(amplitude=float(rng.uniform(50.0, 90.0)), start=5.0, stop=80.0))
        net.connect("current", "inhibit", neuro.all_to_all(), weight=1.0, delay=0.1, name="injected")
    net.probe("v", "inhibit", "V_m", every=1.0)
    return net
