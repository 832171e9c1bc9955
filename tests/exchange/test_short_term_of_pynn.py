"""The synapse of pyNN.nest beside which `tsodyks2` is measured is NEST's."""

import numpy as np
import pytest

from neuro_exchange.pynn.cells import effects

pytestmark = pytest.mark.usefixtures("nest")


@pytest.mark.parametrize("tau_fac", [0.0, 50.0])
@pytest.mark.parametrize("model", ["tsodyks2_synapse", "tsodyks_synapse"])
def test_what_spikes_send_is_as_in_nest(model, tau_fac, own_nest):
    nest = own_nest
    share, tau_rec, tau_syn = 0.2, 130.0, 4.0
    times = np.round(np.cumsum(np.random.default_rng(0).exponential(50.0, 60)) + 5.0, 1)
    nest.resolution = 0.1
    source, sends = nest.Create("spike_generator", params={"spike_times": times}), nest.Create("parrot_neuron")
    still = {"tau_m": 1e12, "C_m": 1.0, "V_th": 1e9, "E_L": 0.0, "V_m": 0.0}
    target = nest.Create("iaf_psc_delta", params=still)
    meter = nest.Create("multimeter", params={"record_from": ["V_m"], "interval": 0.1})
    words = {"weight": 1.0, "delay": 1.0, "U": share, "tau_rec": tau_rec, "tau_fac": tau_fac, "x": 1.0}
    words |= {"u": 0.0, "y": 0.0, "tau_psc": tau_syn} if model == "tsodyks_synapse" else {"u": share}
    nest.Connect(source, sends)
    nest.Connect(sends, target, syn_spec={"synapse_model": model, **words})
    nest.Connect(meter, target)
    nest.Simulate(float(times[-1]) + 10.0)
    jumps = np.diff(meter.events["V_m"])
    here, there = effects(np.diff(times, prepend=0.0).tolist(), share, tau_rec, tau_fac, tau_syn)
    expected = there if model == "tsodyks_synapse" else here
    assert np.allclose(jumps[np.abs(jumps) > 1e-6], expected, atol=1e-8)
