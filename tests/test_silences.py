"""Neurons that sleep: after a silence of any length they are where steps one by one bring them."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import neuro
from alike import alike
from beside import evaluated
from built_in import NEURONS
from neuro.extend import Neuron, State, leak, quantity
from neuro.model.neurons.own import check_sleep
from neuro.testing.parts import check_silences


@dataclass(frozen=True, kw_only=True, eq=False)
class late_lif(Neuron):
    """A leaky neuron with a current; the class of each test says when the current moves V."""

    weight_unit: ClassVar[str] = "pA"
    states: ClassVar[tuple[State, ...]] = (State("V_m", "mV", "potential"), State("I_syn", "pA", "current"))
    linear: ClassVar[bool] = True

    tau_m: float = quantity(20.0, "ms", "membrane time constant", above=0)
    tau_syn: float = quantity(5.0, "ms", "decay of the current", above=0)
    V_th: float = quantity(15.0, "mV", "threshold")


class Arithmetic:
    """The functions of `late_lif`: V moves by the current of the end of a step, so n steps of h are not one of n h."""

    __name__ = "late_lif"

    @staticmethod
    def constants(p, h, c):
        c[0], c[1], c[2], c[3] = p[3], leak(p[1], h), leak(p[2], h), h / 250.0

    @staticmethod
    def step(s, c, x, i_0, lo, hi, fired):
        for i in range(lo, hi):
            s[1, i] = c[2] * s[1, i] + x[0, i]
            s[0, i] = c[1] * s[0, i] + c[3] * s[1, i]
            fired[i] = s[0, i] >= c[0]

    @staticmethod
    def fire(s, c, i):
        s[0, i] = 0.0

    @staticmethod
    def quiet(s, c, i_0, lo, hi):
        return all(max(s[0, i], 0.0) + 0.2 * max(s[1, i], 0.0) < c[0] for i in range(lo, hi))


class Restless(Arithmetic):
    """The same with an exact `catch_up`, but it sleeps where its current can still make it fire."""

    @staticmethod
    def catch_up(s, p, c, i_0, lo, hi, h, n):
        Arithmetic.constants(p, h, c)
        for _ in range(n):
            Arithmetic.step(s, c, np.zeros((1, s.shape[1])), i_0, lo, hi, np.zeros(s.shape[1]))

    @staticmethod
    def quiet(s, c, i_0, lo, hi):
        return True


def numbers(model):
    return {word: float(model.defaults()[word]) for word in model.quantities()}


AT_ONCE = (
    r"^neuron model 'late': 16 steps without input bring V_m to \S+, one step of their length to \S+: "
    "expected the same, as it is linear and `quiet` is true$"
)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ({"arithmetic": Arithmetic}, AT_ONCE),
        ({"arithmetic": Arithmetic, "linear": False}, "V_m to .*, skipping them to .*: expected the same, as `quiet`"),
        ({"arithmetic": Restless}, "fires without input where `quiet` is true: expected it to be false there"),
    ],
    ids=["no silence step by step", "changes", "fires"],
)
def test_a_neuron_that_does_else_while_it_sleeps_is_refused(words, told):
    model = type("late", (late_lif,), words)
    with pytest.raises(TypeError, match=told):
        check_sleep(model, numbers(model))


@pytest.mark.parametrize("model", NEURONS, ids=lambda model: model.__name__)
def test_every_model_may_sleep_where_it_does(model):
    check_sleep(model, numbers(model))


def test_cuba_lif_is_right_after_quiet_time():
    for weight, second in ((80.0, 120.0), (100.0, 97.0), (110.0, 105.0)):
        net = neuro.Network("quiet", resolution=1.0)
        net.population("g", 1, neuro.spike_generator(spike_times=[[1.0, second]]))
        net.population("c", 1, neuro.cuba_lif(tau_m=100.0, tau_syn_ex=60.0))
        net.connect("g", "c", neuro.all_to_all(), weight=weight)
        net.probe("v", "c", "V_m", every=1.0)
        alike(net, 300.0)


LEAKY = neuro.equations(
    "leaky",
    parameters={"tau_m": "10 ms", "tau_s": "30 ms", "C_m": "250 pF", "V_th": "15 mV"},
    receptors={"I_syn": {"kernel": "exp", "tau": "tau_s"}},
    equations={"V_m": "-V_m/tau_m + I_syn/C_m"},
    threshold="V_m >= V_th",
    reset={"V_m": "0 mV"},
)
SLEEPERS = evaluated(__file__, "SLEEPERS", globals())


@pytest.mark.parametrize("model", SLEEPERS, ids=lambda model: model.name)
def test_every_step_of_a_long_silence_is_that_of_the_reference(model):
    check_silences(model)
