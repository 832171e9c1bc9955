from pathlib import Path

import pytest

import neuro
from neuro.compare import compare

NETWORK = Path(__file__).with_name("relay.yaml").read_text("utf-8")


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
