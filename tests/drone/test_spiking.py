"""The spiking controller: eq. 129, dopamine, frozen networks, networks of users, chips."""

import warnings

import numpy as np
import pytest

import neuro
from neuro_drone.controllers import make
from neuro_drone.controllers.fields import DOWN, RIGHT
from neuro_drone.scenario import load

BALL = load("B60")
RNG = np.random.default_rng(5)
SCENE = [RNG.poisson(0.3, (8, 8)) * RNG.integers(1, 8, (8, 8)) for _ in range(40)]
CHIP = pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning", "ignore::neuro.OverflowWarning")


def taught(name="snn", steps=60, **settings):
    controller = make(name, BALL, 3, settings)
    controller.begin()
    for k in range(steps):
        controller.act(SCENE[k % len(SCENE)], {})
        controller.learn({"supervised_error": np.array([0.4, -0.2])})
    return controller


def weights(controller):
    return controller.learnt()["cells_motors"].reshape(64, 2, 2)


def test_action_is_eq_129():
    controller = make("snn", BALL, 0, {"gain": 1.0})
    action = controller.act(SCENE[0], {})
    _, ids = controller.sim.spikes("motors")
    assert len(ids) == 0  # forgotten, so that memory does not grow
    assert (action * 25 == np.round(action * 25)).all()  # 50 ms over 2 ms of rest


def test_dopamine_moves_a_pair_apart():
    w = weights(taught())
    assert w[:, 0, 0].mean() > 1500 > w[:, 0, 1].mean()
    assert w[:, 1, 1].mean() > 1500 > w[:, 1, 0].mean()
    assert (weights(taught("snn-eta0")) == 1500).all()
    flipped = weights(taught("snn-flipped"))
    assert flipped[:, 0, 0].mean() < 1500 < flipped[:, 0, 1].mean()


def test_static_weights_steer():
    controller = make("static", BALL)
    controller.begin()
    counts = np.zeros((8, 8), np.int64)
    counts[6, 7] = 10
    assert (controller.act(counts, {}) > 0.2).all()
    linear = weights(make("static-linear", BALL))
    assert linear[:, 0, 0] - linear[:, 0, 1] == pytest.approx(3000 * RIGHT.ravel() / np.abs(RIGHT).max())
    assert linear[:, 1, 0] - linear[:, 1, 1] == pytest.approx(3000 * DOWN.ravel() / np.abs(DOWN).max())


def test_frozen_learns_nothing_and_begins_anew():
    controller = taught()
    frozen = controller.frozen()
    laps = []
    for _ in range(2):
        frozen.begin()
        laps.append([frozen.act(counts, {}).tolist() for counts in SCENE])
        frozen.learn({"supervised_error": np.array([1.0, 1.0])})
    assert laps[0] == laps[1]
    assert (weights(frozen) == weights(controller)).all()
    assert frozen.network().signals == {}


def test_state_goes_on_bit_for_bit():
    one, other = taught(), make("snn", BALL, 3)
    other.restore(one.state())
    for counts in SCENE:
        assert (one.act(counts, {}) == other.act(counts, {})).all()
        for controller in (one, other):
            controller.learn({"supervised_error": np.array([-0.3, 0.3])})
    assert (weights(one) == weights(other)).all()


@pytest.mark.parametrize("backend", ["loihi", "spinnaker", "reference"])
def test_frozen_runs_on_every_backend(backend):
    controller = taught(start="linear")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", neuro.ApproximationWarning)
        other = controller.frozen(backend)
    event = controller.frozen()
    means = []
    for one in (event, other):
        one.begin()
        means.append(np.mean([one.act(counts, {}) for counts in SCENE[:20]], axis=0))
    assert means[1] == pytest.approx(means[0], abs=0.05)


def test_a_network_of_a_user(tmp_path):
    net = neuro.Network("own", resolution=0.5)
    cells = net.population("cells", 64, neuro.poisson_generator())
    motors = net.population("motors", 4, neuro.iaf_psc_exp(t_ref=5.0))
    net.connect(cells, motors, weight=900.0, delay=1.0, rule=neuro.all_to_all())
    net.save(tmp_path / "own.yaml")
    controller = make("snn", BALL, 0, {"network": str(tmp_path / "own.yaml"), "gain": 1.0})
    action = controller.act(SCENE[0], {})
    controller.learn({"supervised_error": np.ones(2)})  # it has no signal: nothing happens
    assert (action * 10 == np.round(action * 10)).all()


@pytest.mark.parametrize(
    ("cells", "motors", "message"),
    [
        (None, 4, "network 'own': expected a population 'cells' of 64, one a field of the picture: found none"),
        ((4, 4), 4, "network 'own': expected a population 'cells' of 64, one a field of the picture: "
         "found one of shape [4, 4]"),
        (64, None, "network 'own': expected a population 'motors' of 4, two an axis: found none"),
        (64, 2, "network 'own': expected a population 'motors' of 4, two an axis: found one of shape [2]"),
    ],
)  # fmt: skip
def test_a_network_that_does_not_fit(cells, motors, message):
    net = neuro.Network("own")
    if cells is not None:
        net.population("cells", cells, neuro.poisson_generator())
    if motors is not None:
        net.population("motors", motors, neuro.iaf_psc_exp())
    with pytest.raises(neuro.ModelError) as error:
        make("snn", BALL, 0, {"network": net})
    assert str(error.value) == message


def test_cells_must_have_rates():
    net = neuro.Network("own")
    net.population("cells", 64, neuro.parrot_neuron())
    net.population("motors", 4, neuro.iaf_psc_exp())
    with pytest.raises(neuro.ModelError) as error:
        make("snn", BALL, 0, {"network": net})
    assert str(error.value) == "network 'own': expected 'cells' to be a poisson_generator, whose rate is set"


def test_start_weights_need_the_projection():
    net = neuro.Network("own")
    net.population("cells", 64, neuro.poisson_generator())
    net.population("motors", 4, neuro.iaf_psc_exp())
    with pytest.raises(neuro.ModelError) as error:
        make("static", BALL, 0, {"network": net})
    assert str(error.value) == (
        "start = sign: expected a projection 'cells_motors' of all cells to all motors\n"
        "  hint: start = equal takes the network's own weights"
    )


def test_parameters_of_the_network():
    controller = make("snn", BALL, 0, {"resolution": 0.1, "w_init": 100.0})
    assert controller.sim.program.resolution == 0.1
    assert (weights(controller) == 100.0).all()
    with pytest.raises(neuro.ModelError, match=r"unknown parameter 'tau_d'\n  hint: "):
        make("snn", BALL, 0, {"tau_d": 1.0})


def test_a_step_is_a_multiple_of_the_resolution():
    net = neuro.Network("own", resolution=0.3)
    net.population("cells", 64, neuro.poisson_generator())
    net.population("motors", 4, neuro.iaf_psc_exp(t_ref=3.0))
    with pytest.raises(neuro.ModelError) as error:
        make("snn", BALL, 0, {"network": net})
    assert str(error.value) == "network 'own': resolution = 0.3 ms: expected a whole part of the step of 50 ms"


@CHIP
def test_learns_on_loihi():
    controller = taught("snn-loihi")
    w = weights(controller)
    assert w[:, 0, 0].mean() > 1500 > w[:, 0, 1].mean()
    assert w[:, 1, 1].mean() > 1500 > w[:, 1, 0].mean()
    other = make("snn-loihi", BALL, 3)
    other.restore(controller.state())
    for one in (controller, other):
        for counts in SCENE[:10]:
            one.act(counts, {})
            one.learn({"supervised_error": np.array([-0.3, 0.3])})
    assert (weights(controller) == weights(other)).all()
    assert (weights(controller) != w).any()


def test_what_would_not_learn_on_a_chip_is_told():
    with pytest.raises(neuro.ModelError) as error:
        make("snn", BALL, 0, {"backend": "loihi", "eta": 0.003})
    told = str(error.value).splitlines()
    assert told[0] == "learning with eta = 0.003: backend 'loihi' cannot run this network (1 problem)"
    assert told[1].endswith("a change of 0.00408 mantissas cannot be represented: the smallest is 0.00781")
    assert told[-1] == "  hint: a larger eta and a shorter tau_c let the network learn there"
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        make("snn", BALL, 0, {"backend": "loihi", "eta": 0.02})
    assert "a change is 0.027 of a weight step: below 0.125 much of it is cut away" in str(said[-1].message)
    with pytest.raises(neuro.ModelError) as error:
        make("snn", BALL, 0, {"backend": "spinnaker"})
    told = str(error.value).splitlines()
    assert told[1].endswith("stdp_dopa: pairwise learning is not emulated on spinnaker")
    assert told[2].startswith("  hint: run it on loihi or event, or send static weights")


@CHIP
def test_controls_fail_on_loihi_as_well():
    assert len(np.unique(weights(taught("snn-eta0", backend="loihi")))) == 1
    flipped = weights(taught("snn-flipped", backend="loihi", eta=-0.1))
    assert flipped[:, 0, 0].mean() < 1500 < flipped[:, 0, 1].mean()
