"""Random networks of the rules of pairs, triplets and short-term plasticity: event and reference do what NEST does."""

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings, strategies as st

import neuro
from neuro.model.synapses import Synapse
from neuro.testing.case import Found, observe
from scenarios import differences

pytestmark = pytest.mark.usefixtures("nest")

NETWORKS = 10
SETTINGS = settings(
    max_examples=NETWORKS,
    deadline=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
    phases=[Phase.generate],
)
TAUS = st.sampled_from([2.0, 20.0, 100.0])


@st.composite
def rules(draw: st.DrawFn) -> Synapse:
    """A rule; its largest weight is 500 pA, of either sign."""
    w_max, step = draw(st.sampled_from([500.0, -500.0])), draw(st.sampled_from([0.01, 0.2]))
    mus = {word: draw(st.sampled_from([0.0, 0.4, 1.0])) for word in ("mu_plus", "mu_minus")}
    pairs: dict[str, Any] = {"lambda_": step, "alpha": 1.1, "tau_plus": draw(TAUS), "Wmax": w_max, **mus}
    match draw(st.integers(0, 6)):
        case 0:
            return neuro.stdp(**pairs)
        case 1:
            return neuro.stdp_nn_symm(**pairs, pre_at_start=True)
        case 2:
            return neuro.stdp_nn_restr(**pairs, pre_at_start=True)
        case 3:
            return neuro.stdp_nn_pre_centered(**pairs)
        case 4:
            return neuro.stdp_pl_hom(lambda_=10.0 * step, alpha=0.1, mu=draw(st.sampled_from([0.4, 1.0])))
        case 5:
            return neuro.vogels_sprekeler(tau=draw(TAUS), eta=100.0 * step, Wmax=w_max)
    slow = {word: draw(TAUS) for word in ("tau_plus", "tau_plus_triplet")}
    return neuro.stdp_triplet(
        Aplus=50.0 * step, Aplus_triplet=20.0 * step, Aminus=60.0 * step, Aminus_triplet=20.0 * step, Wmax=w_max, **slow
    )


@st.composite
def networks(draw: st.DrawFn) -> neuro.Network:
    """Driven neurons among which several rules learn, and parrots, which hear several spikes in a step."""
    h = draw(st.sampled_from([0.1, 1.0]))
    net = neuro.Network("rules", resolution=h)
    net.population("noise", 5, neuro.poisson_generator(rate=draw(st.sampled_from([20.0, 200.0]))))
    net.population("relay", 5, neuro.parrot_neuron())
    net.population("cells", 4, neuro.iaf_psc_exp(tau_minus=draw(TAUS), I_e=draw(st.sampled_from([0.0, 450.0]))))
    net.connect("noise", "relay", neuro.one_to_one(), delay=h)
    net.connect("noise", "cells", neuro.fixed_indegree(n=3), weight=600.0, delay=h)
    for k in range(draw(st.integers(1, 3))):
        rule, delays = draw(rules()), neuro.uniform(low=h, high=draw(st.sampled_from([1, 9])) * h)
        sign = np.sign(getattr(rule, "Wmax", 1.0))
        low, high = sorted((100.0 * sign, 400.0 * sign))
        source, target = draw(st.sampled_from([("relay", "cells"), ("cells", "cells"), ("noise", "relay")]))
        drawn = neuro.uniform(low=low, high=high)
        net.connect(source, target, neuro.fixed_indegree(n=3), rule, weight=drawn, delay=delays, name=f"learnt_{k}")
    short = neuro.tsodyks2(
        U=draw(st.sampled_from([0.1, 0.8])), tau_rec=draw(TAUS), tau_fac=draw(st.sampled_from([0.0, 50.0]))
    )
    net.connect("relay", "cells", neuro.fixed_indegree(n=2), short, weight=300.0, delay=3 * h, name="short")
    return net


def found(net: neuro.Network, backend: str) -> Found:
    sim = neuro.compile(net, backend, seed=5)
    sim.run(50.0)
    return {name: values for name, values in observe(sim).items() if "I_syn" not in name}


def test_event_and_reference_do_what_nest_does():
    moved = []

    @SETTINGS
    @given(networks())
    def check(net: neuro.Network) -> None:
        expected = found(net, "nest")
        assert differences(expected, found(net, "event")) == {}
        assert differences(expected, found(net, "reference")) == {}
        moved.append(sum(np.ptp(values) for name, values in expected.items() if name.startswith("weight of learnt")))

    check()
    assert len(moved) >= NETWORKS
    assert np.mean(np.array(moved) > 0.0) > 0.9
