"""The doctor lets a network live in its world: rewards that teach nothing are named, a healthy network has none."""

import runpy
from pathlib import Path

import pytest

import neuro
import neuro_models
from neuro_doctor import world

EXAMPLES = Path(__file__).parents[2] / "examples"
TEXT = (EXAMPLES / "follower.yaml").read_text()
FOLLOWER = runpy.run_path(str(EXAMPLES / "follower.py"))
INFO = "info: {key: offset, scale: $dopamine, opposed: true}"


@pytest.fixture
def named(tmp_path, monkeypatch):
    """The names of what is found in the follower's world, with some of the network replaced."""
    monkeypatch.setattr("neuro.realtime.environments._named_by_user", lambda: {"Light": FOLLOWER["Light"]})

    def find(*changes):
        text = TEXT
        for before, after in changes:
            assert before in text
            text = text.replace(before, after)
        (tmp_path / "net.yaml").write_text(text)
        net = neuro.load(tmp_path / "net.yaml")
        found = {each.name for each in world.findings(net, "event", 1)}
        assert found <= {each.name for each in neuro.doctor(net, ms=100.0)}
        return found

    return find


def test_a_network_that_learns_is_healthy(named):
    assert named() == set()


def test_a_reward_that_never_changes(named, monkeypatch):
    look = FOLLOWER["Light"]._look
    monkeypatch.setattr(FOLLOWER["Light"], "_look", lambda self: (look(self)[0], {"offset": 0.5}))
    assert named() == {"reward-constant"}


def test_a_reward_that_comes_when_the_eligibility_is_over(named):
    assert "eligibility-dies" in named(("tau_c: 200.0", "tau_c: 10.0"))


def test_weights_that_fall_whatever_the_reward(named):
    assert named((INFO, "reward: {scale: 0.001}"), ("A_minus: 0.5", "A_minus: 5.0")) == {"one-way"}


def test_a_world_that_is_not_there_is_a_note(monkeypatch):
    monkeypatch.setattr("neuro.realtime.environments._named_by_user", dict)
    (finding,) = world.findings(neuro.load(EXAMPLES / "follower.yaml"), "event", 1)
    assert (finding.name, finding.severity) == ("world-not-run", "note")
    assert "Light" in finding.evidence


def test_a_world_gives_the_input_and_the_signals_that_a_run_alone_lacks():
    net = neuro.load(neuro_models.path("grid_world"))
    assert not neuro.doctor(net, ms=100.0).findings
    net.world_section = None
    assert {each.name for each in neuro.doctor(net, ms=100.0).findings} >= {"no-input", "signal-not-set"}
