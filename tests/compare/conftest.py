import pytest

import neuro
from neuro.compare import compare

NETWORK = """\
neuro: 1
name: relay
resolution: 1.0
populations:
  noise: {model: {poisson_generator: {rate: 60.0}}, shape: 40}
  list: {model: {spike_generator: {spike_times: [[5.0, 20.0], [6.0]]}}, shape: 2}
  bias: {model: {dc_generator: {amplitude: 100.0}}, shape: 1}
  exc: {model: {iaf_psc_exp: {tau_m: 20.0}}, shape: 24}
  out: {model: {iaf_psc_exp: {tau_m: 10.0}}, shape: 6}
projections:
  noise_exc: {from: noise, to: exc, rule: all_to_all, weight: {normal: {mean: 120.0, std: 40.0}}, delay: 1.0}
  list_out: {from: list, to: out, rule: all_to_all, weight: 900.0, delay: 2.0}
  exc_out: {from: exc, to: out, rule: all_to_all, weight: {uniform: {low: 20.0, high: 90.0}}, delay: 3.0}
"""


@pytest.fixture(scope="session")
def net(tmp_path_factory):
    """A network that floats and chips run, with input of both kinds."""
    file = tmp_path_factory.mktemp("compare") / "relay.yaml"
    file.write_text("\n".join(line for line in NETWORK.splitlines() if "bias" not in line))
    return neuro.load(file)


@pytest.fixture(scope="session")
def driven(tmp_path_factory):
    """The same with a constant current, which is no spike train."""
    file = tmp_path_factory.mktemp("compare") / "driven.yaml"
    file.write_text(NETWORK + "  bias_exc: {from: bias, to: exc, rule: all_to_all, weight: 1.0, delay: 1.0}\n")
    return neuro.load(file)


@pytest.fixture(scope="session")
def three(net):
    return compare(net, ["event", "loihi", "spinnaker"], 200.0, 1)
