"""The method `hfirst`: its scores, what its evidence depends on, its network, and why it has no bill."""

import numpy as np
import pytest

import neuro
from neuro_recognise import Recogniser
from neuro_recognise.compare import Compared, Plan, contestants
from neuro_recognise.hfirst import Heard, Spikes, decisive
from neuro_recognise.recogniser import method_of
from neuro_recognise.telling.compare_report import show
from neuro_recognise.telling.energy import check_targets

NO_BILL = "layers S1 and C1 run once for all folds and are not counted, and chips refuse their linear leak"
SMALL = {"size": [8, 8], "orientations": 2}


@pytest.fixture
def made():
    method = method_of("hfirst", values=SMALL)
    return Recogniser(method, ("a", "b", "c"), {"templates": np.arange(3.0 * 2 * 2 * 2).reshape(3, -1)})


def test_equal_spikes_are_decided_by_potentials_which_weigh_less_than_a_spike():
    heard = Heard(Spikes(np.arange(3.0), np.array([1, 2, 2])), np.array([[9.0, 1.0, 0.0], [0.0, 5.0, 2.0]]))
    np.testing.assert_allclose(decisive(heard, "hard"), [2 / 3, 1 + 1 / 3, 2.0])
    np.testing.assert_allclose(decisive(heard, "soft"), [2 / 9, 4 / 9, 2 / 3])
    np.testing.assert_array_equal(decisive(heard, "potentials"), [9.0, 6.0, 2.0])
    without = heard._replace(spikes=Spikes(np.zeros(0), np.zeros(0, np.int64)))
    np.testing.assert_allclose(decisive(without, "soft"), [2 / 3, 1 / 3, 0.0])


@pytest.mark.parametrize("reading", ["hard", "soft", "potentials"])
def test_where_nothing_was_heard_all_are_silent(reading):
    heard = Heard(Spikes(np.zeros(0), np.zeros(0, np.int64)), np.zeros((0, 3)))
    assert np.isnan(decisive(heard, reading)).all()


def test_what_is_observed_does_not_depend_on_s2():
    first = method_of("hfirst").observing()
    assert method_of("hfirst", values={"s2_threshold": 90.0, "s2_leak": 2.0, "below": 0.5}).observing() == first
    assert method_of("hfirst", values={"unseen": -2.0, "reading": "soft"}).observing() == first
    assert method_of("hfirst", values={"s1_leak": 50.0}).observing() != first
    assert method_of("hfirst", "poker").observing() != first


def test_the_network_has_what_was_learnt(made):
    net = made.network()
    assert net.populations["s1_on"].shape == (2, "auto", "auto")
    *_, weights = neuro.compile(net).weights("c1_s2")
    np.testing.assert_array_equal(weights.reshape(8, 3), made.learnt["templates"].T)


def test_it_has_no_bill(made):
    with pytest.raises(neuro.ModelError) as error:
        check_targets(made, ["cpu"])
    assert str(error.value) == f"method 'hfirst' has no bill: {NO_BILL}"


def test_chips_refuse_its_leak(made):
    with pytest.raises(neuro.ModelError, match="iaf_linear_leak"):
        neuro.compile(made.network(), backend="loihi")


def test_a_comparison_tells_why(capsys, tmp_path):
    (one,) = contestants(["hfirst"])
    plan = Plan((one,), 5, (0,), ("loihi",), tmp_path)
    show([Compared(one, refused="not run")], plan)
    assert capsys.readouterr().out.splitlines()[-1] == f"- hfirst has no bill: {NO_BILL}"
