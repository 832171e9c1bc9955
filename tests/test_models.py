"""What a neuron model or a synapse rule must have is told when its table is read, and a new one works by that table."""

import inspect
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

import neuro
from neuro.core.quantities import Value, quantity
from neuro.model.neurons import MODELS, State, iaf_psc_exp, own as neurons
from neuro.model.synapses import SYNAPSES, stdp, stdp_dopa
from neuro.model.synapses.own import complete

V_M, NOTE = State("V_m", "mV", "membrane potential"), State("note", "", "something else")


def arithmetic(of=iaf_psc_exp.arithmetic, **changed):
    names = ("constants", "step", "fire", "quiet", "on_pre", "on_post", "advance", "teach", "settle", "encourage")
    found = {name: getattr(of, name) for name in names if hasattr(of, name)} | changed
    return SimpleNamespace(__name__="mine", **{name: f for name, f in found.items() if f is not None})


@dataclass(frozen=True, kw_only=True, eq=False)
class mine(iaf_psc_exp):
    """A neuron model."""

    arithmetic: ClassVar = arithmetic()


def neuron(**changed):
    return type("mine", (mine,), changed)


def rule(base=stdp, **changed):
    return type("mine", (base,), changed)


def test_a_complete_model_passes():
    assert neurons.complete(mine) is mine
    assert complete(stdp) is stdp


def too_many(p, h, c):
    c[20] = 1.0


def another_first(p, h, c):
    c[0] = 1.0


def test_an_incomplete_neuron_is_refused(messages):
    messages.calls(globals())


def test_a_neuron_has_at_most_twenty_numeric_parameters():
    words = {f"p_{k}": (Value, quantity(0.0, "", "one of many")) for k in range(10)}
    body = {name: field for name, (_, field) in words.items()} | {
        "__annotations__": {n: t for n, (t, _) in words.items()}
    }
    many = dataclass(frozen=True, kw_only=True, eq=False)(type("many", (mine,), body))
    with pytest.raises(TypeError, match="'many' has 21 parameters with tau_minus: expected at most 20, its width"):
        neurons.complete(many)
    body = {"__annotations__": {"way": str}, "way": quantity("up", "", "a word", kind="word", words=("up",))}
    worded = dataclass(frozen=True, kw_only=True, eq=False)(type("worded", (mine,), body))
    with pytest.raises(TypeError, match="parameter 'way' is a word: expected a number or a boolean"):
        neurons.complete(worded)


def test_an_incomplete_rule_is_refused(messages):
    messages.calls(globals())


@pytest.mark.parametrize("model", [stdp, stdp_dopa])
def test_event_may_leave_out_post_spikes_where_k_plus_is_0(model):
    """It does, in the loop of our own rules."""
    c, y = np.zeros(model.width), np.ones((1 + len(model.states), 1))
    model.arithmetic.constants(model().vector(), 0.1, c)
    model.arithmetic.on_post(y, 0, c, (0.0,), (1.0,))
    assert np.all(y == 1.0)


def test_what_is_registered_is_called_by_its_name(monkeypatch):
    monkeypatch.setitem(MODELS._registered, "mine", mine)
    monkeypatch.setitem(SYNAPSES._registered, "yours", stdp)
    monkeypatch.setattr(MODELS, "_parts", dict(MODELS._parts))
    monkeypatch.setattr(SYNAPSES, "_parts", dict(SYNAPSES._parts))
    assert neuro.mine is mine
    assert neuro.yours is stdp
    with pytest.raises(AttributeError, match="module 'neuro' has no attribute 'nobody'"):
        _ = neuro.nobody


def test_every_model_says_where_it_is_from():
    for model in (*MODELS.values(), *SYNAPSES.values()):
        assert model.equation, model
        assert model.source, model
        assert inspect.getdoc(model), model
