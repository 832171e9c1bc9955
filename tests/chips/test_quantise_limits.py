"""Every limit of a chip: what is just inside runs, what is just beyond is refused with the limit and a way out."""

import math

import pytest

import neuro
from one_projection import delta, exp, one, refusals

LIMITS = {
    "tau_m below a step": (
        "loihi",
        lambda tau: one(exp(tau_m=tau)),
        (1.0, 0.999),
        (
            "population 'out': tau_m = 0.999 ms",
            "it is below a step of 1 ms",
            "use a finer resolution or a longer time constant",
        ),
    ),
    "tau_syn below a step": (
        "spinnaker",
        lambda tau: one(exp(tau_syn_ex=tau)),
        (1.0, 0.999),
        (
            "population 'out': tau_syn_ex = 0.999 ms",
            "it is below a step of 1 ms",
            "use a finer resolution or a longer time constant",
        ),
    ),
    "tau_m beyond 12 bits": (
        "loihi",
        lambda tau: one(exp(tau_m=tau), h=0.1),
        (409.549, 409.551),
        (
            "population 'out': tau_m = 409.551 ms",
            "a 12-bit decay holds at most 409.55 ms at a resolution of 0.1 ms",
            "use at most 409.55 ms, a coarser resolution, or .inf for no leak",
        ),
    ),
    "tau_syn beyond 12 bits": (
        "loihi",
        lambda tau: one(exp(tau_syn_ex=tau)),
        (4095.4, 4095.6),
        (
            "population 'out': tau_syn_ex = 4095.6 ms",
            "a 12-bit decay holds at most 4095.5 ms at a resolution of 1 ms",
            "use at most 4095.5 ms or a coarser resolution",
        ),
    ),
    "tau_m beyond 15 bits": (
        "spinnaker",
        lambda tau: one(exp(tau_m=tau, C_m=1e4)),
        (32767.4, 32767.6),
        (
            "population 'out': tau_m = 32767.6 ms",
            "a decay of 15 bits holds at most 32767.5 ms at a resolution of 1 ms",
            "use at most 32767.5 ms or a coarser resolution",
        ),
    ),
    "refractory register": (
        "loihi",
        lambda t: one(delta(t_ref=t), h=0.5),
        (31.5, 32.0),
        (
            "population 'out': t_ref = 32 ms",
            "it is 64 steps, and the refractory register holds at most 63",
            "use at most 31.5 ms, or a coarser resolution",
        ),
    ),
    "V_reset off E_L": (
        "loihi",
        lambda v: one(delta(V_reset=v)),
        (0.0, -1e-9),
        (
            "population 'out': V_reset = -1e-09 mV",
            "a spike sets the voltage register to 0, which is E_L = 0 mV",
            "set V_reset to 0, or run on spinnaker",
        ),
    ),
    "V_min": (
        "loihi",
        lambda v: one(delta(V_min=v)),
        (-math.inf, -80.0),
        ("population 'out': V_min = -80 mV", "a compartment has no lowest potential", "leave V_min out"),
    ),
    "V_min on spinnaker": (
        "spinnaker",
        lambda v: one(delta(V_min=v)),
        (-math.inf, -80.0),
        ("population 'out': V_min = -80 mV", "the chip's programs have no lowest potential", "leave V_min out"),
    ),
    "refractory_input": (
        "loihi",
        lambda keep: one(delta(refractory_input=keep)),
        (False, True),
        ("population 'out': refractory_input", "a compartment loses input while it is refractory", "leave it out"),
    ),
    "refractory_input on spinnaker": (
        "spinnaker",
        lambda keep: one(delta(refractory_input=keep)),
        (False, True),
        (
            "population 'out': refractory_input",
            "the chip's programs lose input while a neuron is refractory",
            "leave it out",
        ),
    ),
    "two synaptic time constants": (
        "loihi",
        lambda tau: one(exp(tau_syn_ex=2.0, tau_syn_in=tau), n=2, weight=[5.0, -5.0]),
        (2.0, 3.0),
        (
            "population 'out': tau_syn_ex = 2 ms and tau_syn_in = 3 ms",
            "a compartment has one current and so one synaptic time constant",
            "use one time constant for both, or run on spinnaker",
        ),
    ),
    "two synaptic time constants by the current at step 0": (
        "loihi",
        lambda i: one(exp(tau_syn_ex=2.0, tau_syn_in=3.0), initial={"I_syn_in": i}),
        (0.0, -1.0),
        (
            "population 'out': tau_syn_ex = 2 ms and tau_syn_in = 3 ms",
            "a compartment has one current and so one synaptic time constant",
            "use one time constant for both, or run on spinnaker",
        ),
    ),
    "delay of a current synapse": (
        "loihi",
        lambda d: one(exp(), h=0.1, delay=d),
        (6.2, 6.3),
        (
            "projection 'in_out': a delay of 6.3 ms",
            "63 steps in the delay register, which holds at most 62 on loihi",
            "use at most 6.2 ms, a coarser resolution, or a chain of parrots",
        ),
    ),
    "delay of a delta synapse": (
        "loihi",
        lambda d: one(delta(), delay=d),
        (63.0, 64.0),
        (
            "projection 'in_out': a delay of 64 ms",
            "63 steps in the delay register, which holds at most 62 on loihi",
            "use at most 63 ms, a coarser resolution, or a chain of parrots",
        ),
    ),
    "delay on spinnaker": (
        "spinnaker",
        lambda d: one(exp(), delay=d),
        (143.0, 144.0),
        (
            "projection 'in_out': a delay of 144 ms",
            "145 steps in the delay register, which holds at most 144 on spinnaker",
            "use at most 143 ms, a coarser resolution, or a chain of parrots",
        ),
    ),
    "delay of a delta synapse on spinnaker": (
        "spinnaker",
        lambda d: one(delta(), delay=d),
        (144.0, 145.0),
        (
            "projection 'in_out': a delay of 145 ms",
            "145 steps in the delay register, which holds at most 144 on spinnaker",
            "use at most 144 ms, a coarser resolution, or a chain of parrots",
        ),
    ),
    "no leak on spinnaker": (
        "spinnaker",
        lambda tau: one(exp(tau_m=tau)),
        (100.0, math.inf),
        (
            "population 'out': tau_m = inf",
            "the membrane resistance tau_m / C_m would be infinite",
            "use a finite tau_m, or iaf_psc_delta",
        ),
    ),
    "s16.15 of a threshold": (
        "spinnaker",
        lambda v: one(exp(V_th=v)),
        (65535.9, 65536.0),
        (
            "population 'out': V_th = 65536 mV",
            "it takes 65536 in s16.15, which holds numbers below 65536",
            "scale the model down",
        ),
    ),
    "s16.15 of V_m": (
        "spinnaker",
        lambda v: one(exp(), initial={"V_m": v}),
        (-65535.9, -65537.0),
        (
            "population 'out': V_m = -65537 mV at step 0",
            "it takes 65537 in s16.15, which holds numbers below 65536",
            "scale the model down",
        ),
    ),
    "s16.15 of the resistance": (
        "spinnaker",
        lambda c: one(exp(tau_m=10.0, C_m=c)),
        (0.1526, 0.1525),
        (
            "population 'out': tau_m / C_m = 65573.8 MOhm",
            "it takes 65573.8 in s16.15, which holds numbers below 65536",
            "scale the model down",
        ),
    ),
    "s16.15 of a current": (
        "spinnaker",
        lambda i: one(exp(I_e=i)),
        (65.5e6, 66e6),
        (
            "population 'out': a constant current of 6.6e+07 pA",
            "it takes 66000 in s16.15, which holds numbers below 65536",
            "scale the model down",
        ),
    ),
    "s16.15 of a generator's current": (
        "spinnaker",
        lambda i: one(exp(I_e=1e6), weight=-1.0, generator=neuro.dc_generator(amplitude=i)),
        (64e6, 65e6),
        (
            "population 'out': a constant current of 6.6e+07 pA",
            "it takes 66000 in s16.15, which holds numbers below 65536",
            "scale the model down",
        ),
    ),
    "refractory ticks": (
        "spinnaker",
        lambda t: one(delta(t_ref=t)),
        (2147483647.0, 2147483648.0),
        (
            "population 'out': t_ref = 2.14748e+09 ms",
            "2.14748e+09 ticks, and t_refract holds at most 2147483647",
            "use at most 2.14748e+09 ms",
        ),
    ),
    "weight word": (
        "spinnaker",
        lambda w: one(delta(), weight=w),
        (65535.0, 65536.0),
        (
            "projection 'in_out': weight = 65536",
            "a word of 16 bits holds at most 65535 at exc_shift 15",
            "scale the weights down",
        ),
    ),
}


@pytest.mark.parametrize("case", LIMITS)
def test_a_limit(case):
    name, build, (inside, beyond), text = LIMITS[case]
    assert refusals(build(inside), name) == []
    assert refusals(build(beyond), name) == [text]


@pytest.mark.parametrize(
    ("mode", "low", "high"), [("mixed", -256, 254), ("excitatory", 0, 255), ("inhibitory", -255, 0)]
)
def test_mantissas(mode, low, high):
    def program(weight):
        return one(neuro.loihi_lif(), weight=weight, synapse=neuro.loihi_static(sign_mode=mode))

    assert refusals(program(float(low)), "loihi") == refusals(program(float(high)), "loihi") == []
    for beyond in (low - 1, high + 1, 0.5 * (low + high) + 0.25):
        assert refusals(program(float(beyond)), "loihi") == [
            (
                f"projection 'in_out': weight = {beyond:g}",
                f"a mantissa in sign mode {mode} is a whole number from {low} to {high}",
                "raise weight_exp and lower the mantissas",
            )
        ]


def test_words_of_a_spinnaker_lif():
    for word in (65535.0, -65535.0):
        assert refusals(one(neuro.spinnaker_lif(), weight=word), "spinnaker") == []
    for word in (65536.0, -65536.0, 1.5):
        assert refusals(one(neuro.spinnaker_lif(), weight=word), "spinnaker") == [
            (
                f"projection 'in_out': weight = {word:g}",
                "a word is a whole number from -65535 to 65535",
                "change exc_shift or inh_shift",
            )
        ]


def test_delays_of_a_loihi_lif():
    def program(delay):
        return one(neuro.loihi_lif(), weight=2.0, delay=delay, synapse=neuro.loihi_static())

    assert refusals(program(63.0), "loihi") == []
    assert refusals(program(64.0), "loihi") == [
        (
            "projection 'in_out': a delay of 64 ms",
            "63 steps in the delay register, which holds at most 62 on loihi",
            "use at most 63 ms, a coarser resolution, or a chain of parrots",
        )
    ]
