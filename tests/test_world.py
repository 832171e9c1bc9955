"""A network in its world: the loop is that of an agent, goes on after a kill, and tells each mistake."""

import inspect
import shutil
import time
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest

import neuro
import neuro_models
from neuro.apps import dimensions_of
from neuro.coding import (
    OneHot,
    Population,
    Tiles,
    world_decoders as decoders,
    world_encoders as encoders,
    world_teachers as teachers,
)
from neuro.coding.world import Shown
from neuro.files.results import write
from neuro_agent import ActorCritic
from refused import refused

EXAMPLES = Path(__file__).parents[1] / "examples"
LINE = """
neuro: 1
name: line
resolution: 1.0
populations:
  fields: {model: poisson_generator, shape: 9}
  motors: {model: {iaf_psc_exp: {t_ref: 2.0}}, shape: 2}
projections:
  steer:
    from: fields
    to: motors
    rule: all_to_all
    weight: 1500.0
    synapse: {stdp_dopa: {A_minus: 0.5, tau_c: 200.0, tau_n: 200.0, Wmax: 3000.0, signal: dopamine}}
signals:
  dopamine: {to: motors}
world:
  environment: {id: Line}
  step: 50.0
  observe: {fields: {shares: {total: 200.0}}}
  act: {difference: {of: motors, gain: 2.0}}
  reward: {dopamine: {info: {key: error, scale: 0.3, opposed: true}}}
  block: 300
"""


class Line(gymnasium.Env):
    """A dot drifts on a line; the cart shall stay under it."""

    observation_space = gymnasium.spaces.Box(0.0, 1.0, (9,), np.float64)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float64)
    fault = None

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.offset, self.drift, self.left = self.np_random.uniform(-0.8, 0.8), self.np_random.uniform(-0.05, 0.05), 50
        return self._seen(), {"error": self.offset}

    def step(self, action):
        self.offset = float(np.clip(self.offset + self.drift - 0.3 * float(action[0]), -1, 1))
        self.left -= 1
        reward = 1.0 - abs(self.offset)
        info = {"error": self.offset}
        while self.fault == "hangs":
            pass
        if self.fault == "raises":
            raise ValueError("out of paint")
        if self.fault == "info":
            info = {"eror": self.offset}
        seen = self._seen()[:5] if self.fault == "shape" else self._seen()
        return seen * (np.nan if self.fault == "nan" else 1.0), reward, False, self.left == 0, info

    def _seen(self):
        return np.exp(-((np.linspace(-1, 1, 9) - self.offset) ** 2) / 0.02)


@pytest.fixture
def line(tmp_path, monkeypatch):
    """Load the network of a text, with some of it replaced."""
    monkeypatch.chdir(tmp_path)

    def load(*changes):
        text = LINE
        for before, after in changes:
            assert before in text
            text = text.replace(before, after)
        (tmp_path / "line.yaml").write_text(text)
        return neuro.load("line.yaml")

    return load


def weights(loop):
    return loop.sim.weights("steer")[2]


def test_the_agent_of_a_file_is_the_agent_bit_for_bit():
    loop = neuro.closed_loop(neuro.load(neuro_models.path("cartpole")), seed=101)
    loop.run(steps=3000)
    env = gymnasium.make("CartPole-v1")
    agent = ActorCritic(env.observation_space, env.action_space, seed=101)
    agent.train(env, steps=3000)
    assert loop.log.returns.tolist() == agent.log.returns.tolist()
    for name, values in agent.weights.items():
        assert np.array_equal(loop.sim.get(name, "weight"), values.ravel()), name


def test_it_learns_and_acts_frozen(line):
    loop = neuro.closed_loop(line(), Line, seed=1)
    loop.run(steps=1500)
    frozen = loop.network(frozen=True)
    assert not frozen.signals
    assert frozen.world_section.reward is None
    before, after = (neuro.closed_loop(net, Line, learns=False).test(10).mean for net in (line(), frozen))
    assert after > 45 > 30 > before


def test_a_run_that_was_stopped_goes_on_to_the_same_bits(line, tmp_path):
    whole = neuro.closed_loop(line(), Line, seed=2)
    whole.run(steps=800)

    def stop(loop):
        raise KeyboardInterrupt

    for after in (stop, stop, None):
        loop = neuro.closed_loop(line(), Line, seed=2)
        if after is None:
            loop.run(steps=800, out=tmp_path / "out.h5")
        else:
            with pytest.raises(KeyboardInterrupt):
                loop.run(steps=800, out=tmp_path / "out.h5", after=after)
    assert np.array_equal(weights(whole), weights(loop))
    assert whole.log.returns.tolist() == loop.log.returns.tolist()
    other = neuro.closed_loop(line(), Line, seed=3)
    assert "seed = 2" in refused(other.run, steps=800, out=tmp_path / "out.h5")


def test_event_acts_as_the_reference(line):
    loops = [neuro.closed_loop(line(), Line, backend=backend, record=True) for backend in ("event", "reference")]
    for loop in loops:
        loop.run(steps=150)
    assert np.array_equal(*(loop.recorded()["actions"] for loop in loops))
    assert np.allclose(*map(weights, loops), rtol=1e-12)


def test_copies_add_up_what_moves_taught_and_no_other_rule_has_copies(line):
    loop = neuro.closed_loop(neuro.load(neuro_models.path("cartpole")), copies=3)
    loop.run(steps=1500)
    assert len(loop.log) > 20
    each = [sim.get("value", "weight") for sim in loop.pilot.copies]
    assert all(np.array_equal(each[0], one) for one in each)
    assert "'steer' learns from spike to spike" in refused(neuro.closed_loop, line(), Line, copies=2)


class Slow(Line):
    """Its 20th step takes longer than two control steps at the pace of the test."""

    def step(self, action):
        if self.left == 31:
            time.sleep(0.025)
        return super().step(action)


@pytest.mark.usefixtures("frozen_heap")
def test_a_pace_is_that_of_the_clock_and_changes_no_bit(line):
    """Steps of 500 ms are due every 10 ms at 50 times real time; the first, which compiles, is not counted."""
    net = line(("step: 50.0", "step: 500.0"))
    paced, plain = (neuro.closed_loop(net, Slow, record=True, pace=pace) for pace in (50.0, None))
    paced.run(steps=1)  # the kernels are compiled
    began = time.monotonic()
    paced.run(steps=42)
    taken, account = time.monotonic() - began, paced.account
    plain.run(steps=1)
    plain.run(steps=42)
    assert np.array_equal(weights(paced), weights(plain))
    assert np.array_equal(paced.recorded()["actions"], plain.recorded()["actions"])
    assert plain.account is None
    assert account.ticks == 40
    assert account.misses >= 1
    assert account.skipped >= 1
    assert taken >= 0.01 * (account.ticks + account.skipped)
    assert account.response.ms(0.5) < 10.0
    assert account.largest_tick[1]["act"] > 24.0
    assert paced.results().live["misses"] == account.misses
    assert refused(neuro.closed_loop, net, Slow, pace=0) == "pace = 0: expected a number > 0"


def test_a_world_is_written_as_it_was_said(line, tmp_path):
    net = line()
    net.save(tmp_path / "again.yaml")
    assert neuro.load(tmp_path / "again.yaml") == net


MISTAKES = {
    "population": ("observe: {fields:", "observe: {field:"),
    "motors": ("of: motors, gain", "of: motor, gain"),
    "signal": ("reward: {dopamine", "reward: {dopamin"),
    "critic": ("{info: {key: error,", "{td: {critic: motor,"),
    "module": ("{id: Line}", "{id: 'evil:Line'}"),
    "file": ("{id: Line}", "{id: evil.py}"),
    "python": ("{id: Line}", "{python: evil.py}"),
    "encoder": ("shares:", "sharse:"),
    "decoder": ("act: {difference:", "act: {diference:"),
    "teacher": ("{info: {key", "{infos: {key"),
    "option": ("total: 200.0", "totel: 200.0"),
    "twice": ("dopamine: {to: motors}", "dopamine: {to: motors, values: 0.1}"),
}
JOINED = {
    "size": ("shape: 9", "shape: 8"),
    "pairs": ("shape: 2}", "shape: 4}"),
    "kind": ("{shares: {total: 200.0}}", "pulse"),
    "unknown": ("{id: Line}", "{id: Lime}"),
    "fields": ("{info: {key: error,", "{td: {critic: motors, novelty: 1.0, places: fields,"),
}


def test_mistakes_of_a_description(line, messages):
    found = {name: refused(line, change) for name, change in MISTAKES.items()}
    for name, change in JOINED.items():
        net = line(change)
        found[name] = refused(neuro.closed_loop, net, None if name == "unknown" else Line)
    messages(found)


def test_mistakes_of_an_environment(line, messages, monkeypatch):
    found = {}
    for fault in ("raises", "info", "shape", "nan", "hangs"):
        monkeypatch.setattr(Line, "fault", fault)
        found[fault] = refused(neuro.closed_loop(line(), Line, patience=0.5).run, steps=10)
    messages(found)


def test_commands_know_the_world(line, tmp_path, answer):
    line()
    (tmp_path / "mine.py").write_text(f"import gymnasium\nimport numpy as np\n\n\n{inspect.getsource(Line)}")
    own = ("line.yaml", "--with", "mine.py")
    assert answer("run", *own, "--steps", 700, "--out", "a.h5", "--save-frozen", "frozen.yaml").status == 0
    paced = answer("run", "frozen.yaml", "--with", "mine.py", "--episodes", 4, "--pace", 1000, "--out", "b.h5")
    assert paced.status == 0
    assert " steps late; due to done: p50 " in paced.err
    assert neuro.results.read(tmp_path / "b.h5").live["ticks"] > 190
    returns = [neuro.results.read(tmp_path / f"{name}.h5").world["returns"] for name in "ab"]
    assert returns[1].mean() > returns[0][:4].mean()
    assert answer("report", "a.h5").status == 0
    assert "mean return" in (tmp_path / "a.html").read_text()
    assert answer("rerun", "a.h5", "--with", "mine.py").out == "a.h5: the same bits\n"
    pytest.importorskip("websockets")
    words = ("--page", "--no-browser", "--speed", "inf", "--for", 2000)
    assert answer("live", *own, *words).out.startswith("page: http://127.0.0.1:")
    assert "expected --page" in answer("live", *own).err
    assert "decisions alike" in answer("compare", *own, "--backends", "event,reference", "--for", 5000).out
    assert "energy per step" in answer("energy", *own, "--chips", "loihi", "--for", 5000).out


SWEEP = """
network: follower.yaml
for: 2000 ms
parameters:
  dopamine: [0.0, 0.001, 0.002, 0.004]
  w_init: [300.0, 400.0]
seeds: 1
metrics: [return]
"""


def test_an_own_environment_is_trained_frozen_compared_priced_watched_and_swept(tmp_path, monkeypatch, answer):
    """The example: an environment of 25 lines and a network of as many, with nothing registered."""
    for name in ("follower.yaml", "follower.py"):
        shutil.copy(EXAMPLES / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sweep.yaml").write_text(SWEEP)
    text = (tmp_path / "follower.py").read_text()
    assert len((tmp_path / "follower.yaml").read_text().splitlines()) <= 25
    assert text[text.index("class Light") : text.index("def main")].strip().count("\n") < 25
    own = ("--with", "follower.py")
    assert (
        answer("run", "follower.yaml", *own, "--steps", 1500, "--save-frozen", "frozen.yaml", "--out", "a.h5").status
        == 0
    )
    assert answer("run", "frozen.yaml", *own, "--episodes", 2, "--out", "b.h5").status == 0
    assert answer("run", "follower.yaml", *own, "--frozen", "--episodes", 2, "--out", "c.h5").status == 0
    copies = ("--frozen", "--copies", 2, "--for", 1000, "--out", "d.h5")
    assert "d.h5: 1000 ms" in answer("run", "follower.yaml", *own, *copies).out
    after, before = (neuro.results.read(tmp_path / f"{name}.h5").world["returns"].mean() for name in "bc")
    assert after > before + 20.0
    assert "decisions alike" in answer("compare", "frozen.yaml", *own, "--backends", "event,loihi", "--for", 2000).out
    assert "energy per step" in answer("energy", "frozen.yaml", *own, "--chips", "loihi", "--for", 2000).out
    assert answer("sweep", "run", "sweep.yaml", *own, "--out", "runs", "--workers", 1).status == 0
    assert "8 runs: 8 done" in answer("sweep", "status", "runs").out
    pytest.importorskip("websockets")
    page = ("--page", "--no-browser", "--speed", "inf", "--for", 1000)
    assert answer("live", "follower.yaml", *own, *page).out.startswith("page: http://127.0.0.1:")


EVENTS = SimpleNamespace(t=np.array([0, 24_000, 24_000, 49_999]), x=np.array([0, 1, 1, 2]), y=np.array([0, 0, 0, 1]))
SEEN = np.array([[1.0, 3.0, 0.0, 4.0]])
SPACE = gymnasium.spaces.Box(0.0, 4.0, (4,), np.float64)


def test_rates_of_encoders():
    """By hand: shares of all, of rows of two, and of what is beyond twice the mean; a rate for each number."""
    for encoder, expected in (
        (encoders.shares(total=80.0), [10.0, 30.0, 0.0, 40.0]),
        (encoders.shares(total=80.0, of="rows"), [10.0, 30.0, 0.0, 40.0]),
        (encoders.shares(total=80.0, of="peaks"), [0.0, 0.0, 0.0, 0.0]),
        (encoders.shares(total=80.0, most=35.0), [10.0, 30.0, 0.0, 35.0]),
        (encoders.rates(rate=2.0, dimensions=[1, 3]), [6.0, 8.0]),
    ):
        assert encoder.made(SPACE, (2, 2)).rates(SEEN).tolist() == [expected], encoder


def test_spikes_of_encoders():
    """Fields are those of `neuro.coding`; events of a pixel in one tick are one spike; a pulse comes in each copy."""
    rng = np.random.default_rng(0)
    whole = gymnasium.spaces.MultiDiscrete([2, 5, 3, 5])
    for encoder, fields in (
        (encoders.one_hot(), OneHot),
        (encoders.tiles(), Tiles),
        (encoders.population(), Population),
    ):
        shown, twin = encoder.made(whole, ()), fields(dimensions_of(whole))
        assert shown.size == twin.size
        assert all(map(np.array_equal, shown.spikes(SEEN, (), 20, rng), twin.spikes(SEEN, 20)))
    offsets, ticks, ids = encoders.events().made(SPACE, (2, 3)).spikes(SEEN, ({"events": EVENTS},), 50, rng)
    assert (offsets.tolist(), ticks.tolist(), ids.tolist()) == ([0, 3], [1, 25, 50], [0, 1, 5])
    offsets, ticks, ids = encoders.pulse(at=0.5).made(SPACE, (2,)).spikes(np.repeat(SEEN, 2, axis=0), (), 20, rng)
    assert (offsets.tolist(), ticks.tolist(), ids.tolist()) == ([0, 2, 4], [10] * 4, [0, 1, 0, 1])


def test_rewards_come_as_spikes():
    """2 volleys for 0.5 in 10 of 20 ticks, none below 0, and no more than there are ticks."""
    rng, seen = np.random.default_rng(0), np.repeat(SEEN, 3, axis=0)
    in_use = encoders.rewards(gain=4.0).made(SPACE, (2,))
    in_use.rewarded(np.array([0.5, -1.0, 0.25]))
    offsets, ticks, ids = in_use.spikes(seen, (), 20, rng)
    assert offsets.tolist() == [0, 4, 4, 6]
    assert ticks.tolist() == [1, 1, 6, 6, 1, 1]
    assert ids.tolist() == [0, 1] * 3
    assert in_use.work(20, (2,)) == (
        24.0,
        8.0,
    )  # product, rounding, two limits; product and division of 10 times; a double
    punished = encoders.rewards(gain=-4.0, within=0.1).made(SPACE, (1,))
    punished.rewarded(np.array([0.5, -1.0, 0.0]))
    offsets, ticks, _ = punished.spikes(seen, (), 20, rng)
    assert (offsets.tolist(), ticks.tolist()) == ([0, 0, 2, 2], [1, 2])


def test_a_reward_is_shown_with_what_the_action_led_to(line):
    """Actions do not depend on the reward, and the first observation of an episode has none."""
    net = line(
        ("populations:\n", "populations:\n  food: {model: spike_generator, shape: 1}\n"),
        ("observe: {", "observe: {food: {rewards: {gain: 10.0, within: 1.0}}, "),
    )
    loop = neuro.closed_loop(net, Line, seed=1, record=True)
    loop.run(steps=60)
    rewards = np.array(loop.rewards).ravel()
    steps = (np.ceil(loop.sim.spikes("food")[0] / 50.0) - 1).astype(int)
    shown = np.bincount(steps, minlength=rewards.size)
    assert shown.tolist() == [0, *np.maximum(np.rint(10.0 * rewards[:-1]), 0)]
    assert rewards[50] == 0.0


def test_actions_of_decoders():
    box = gymnasium.spaces.Box(-2.0, 2.0, (2,), np.float64)
    fired = {"a": np.array([[0, 3, 1]]), "b": np.array([[0, 0, 0]]), "four": np.array([[5, 1, 0, 2]])}
    for decoder, expected in (
        (decoders.mean(of=["a", "b"]), [0.5, 0.0]),
        (decoders.winner(of=["a", "b"]), [0.0, -2.0]),
        (decoders.difference(of="four", gain=[10.0, 5.0]), [2.0, -0.5]),
    ):
        sizes = [fired[name].shape[1] for name in decoder.of]
        assert decoder.made(box, sizes, [20.0] * len(sizes))(fired).tolist() == [expected], decoder
    eight = {"eight": np.array([[5, 1, 1, 1, 0, 2, 0, 4]])}  # two pairs for each number
    act = decoders.difference(of="eight", gain=[10.0, 5.0], votes=2).made(box, [8], [20.0])
    assert act(eight).tolist() == [[1.0, -0.75]]
    two = decoders.counts(of="two", gain=0.5, offset=-1.0).made(box, [2], [20.0])
    assert two({"two": np.array([[1, 9]])}).tolist() == [[-0.5, 2.0]]


def test_a_reward_less_its_mean():
    """The mean follows by a quarter of each difference; the first observation of an episode brings none."""
    taught = teachers.reward(less=4.0).made()
    moment = SimpleNamespace(last=np.array([False]), rewards=np.array([2.0]))
    assert [taught.values(moment)[0, 0] for _ in range(3)] == [2.0, 1.5, 1.125]
    moment.last[0] = True
    assert taught.values(moment)[0, 0] == 0.0


def test_a_world_in_a_process_of_its_own(line):
    returns = []
    for process in ("false", "true"):
        loop = neuro.closed_loop(line(("step: 50.0", f"step: 50.0\n  process: {process}")), Line)
        returns.append(loop.run(episodes=1).returns.tolist())
    assert returns[0] == returns[1]


OWN_DOPAMINE = (
    (
        "  dopamine: {to: motors}\n",
        "  dopamine: {to: motors, values: {population: {population: motors, baseline: 3.0}}}\n",
    ),
    ("  reward: {dopamine: {info: {key: error, scale: 0.3, opposed: true}}}\n", ""),
)


def test_a_network_that_teaches_itself_keeps_its_weights_from_block_to_block(line):
    loop = neuro.closed_loop(line(*OWN_DOPAMINE), Line, seed=1)
    loop.run(steps=290)
    before = weights(loop)
    loop.pilot.begin(1, block=1)
    assert before.std() > 0
    assert np.array_equal(weights(loop), before)


SPIKE_PAIRS = (
    ("stdp_dopa: {A_minus: 0.5, tau_c: 200.0, tau_n: 200.0, Wmax: 3000.0, signal: dopamine}", "stdp: {Wmax: 3000.0}"),
    ("signals:\n  dopamine: {to: motors}\n", ""),
    ("  reward: {dopamine: {info: {key: error, scale: 0.3, opposed: true}}}\n", ""),
)


@pytest.mark.parametrize("changes", [OWN_DOPAMINE, SPIKE_PAIRS], ids=["own dopamine", "pairs of spikes"])
def test_a_network_that_teaches_itself_learns_nothing_if_the_loop_does_not(line, changes):
    loop = neuro.closed_loop(line(*changes), Line, seed=1, learns=False)
    loop.test(1)
    assert np.array_equal(np.unique(weights(loop)), [1500.0])


def host_of(loop, target="loihi"):
    return {item.of: item for item in loop.sim.energy(target).items if item.kind == "host"}


def test_a_bill_has_the_operations_of_the_host(line, tmp_path):
    """Shares of 9 numbers: a sum, a division, a product and a limit each. Dopamine of a pair: a factor and a sign."""
    loop = neuro.closed_loop(line(), Line())
    loop.run(steps=400)
    rows, steps = host_of(loop), loop.sim.time / 50.0
    assert {of: item.count for of, item in rows.items()} == {
        "shares of fields, cpu": 36 * steps,
        "info of dopamine, cpu": 2 * steps,
    }
    assert all(item.joules == pytest.approx(item.count * 8.6e-9) for item in rows.values())
    assert {item.joules_each for item in host_of(loop, "arm").values()} == {0.9e-9}
    bill = loop.sim.energy("cpu")
    assert "host: shares of fields 36 mac and 144 bytes a control step" in "".join(bill.notes)
    write(loop.results(), tmp_path / "run.h5")
    assert neuro.results.read(tmp_path / "run.h5").energy("cpu") == bill
    frozen = neuro.closed_loop(line(), Line(), learns=False)
    frozen.run(steps=20)
    assert [*host_of(frozen)] == ["shares of fields, cpu"]


def test_the_host_of_the_cartpole_by_hand():
    loop = neuro.closed_loop(neuro.load(neuro_models.path("cartpole"), {"critics": 5}))
    loop.run(steps=420)
    steps = loop.sim.time / 20.0
    counts = {of: item.count / steps for of, item in host_of(loop).items()}
    assert counts == {
        # 24 grids of 2 dimensions: 5 operations to the share, 3 to the place; 19 ticks of 24 comparisons.
        "places of places, cpu": pytest.approx(24 * 2 * 8 + 24 * 19),
        "winner of actor0, cpu": pytest.approx(2),
        # The mean of 5 critics, 3 to the value, 2 of the error, the scale of a reward, 6 of its adaptation, a factor.
        "td of error, cpu": pytest.approx(6 + 3 + 2 + 1 + 6 + 1),
        "same of error0, cpu": pytest.approx(1),
    }


def test_an_encoder_without_a_count_leaves_the_total_open(line, monkeypatch):
    monkeypatch.setattr(encoders._Rates, "work", Shown.work)
    loop = neuro.closed_loop(line(), Line(), learns=False)
    loop.run(steps=20)
    bill = loop.sim.energy("loihi")
    assert bill.total().startswith("> ")
    assert "host" in bill.missing
    assert "host: no count of operations: shares of fields" in bill.notes


def test_operations_of_fields_and_readouts_by_hand():
    space = gymnasium.spaces.Box(0.0, 1.0, (2,), np.float64)
    curves = encoders.population(fields=4).made(space, ()).work(11, (8,))
    # Of 2 dimensions: 9 to the place, 4 bells of 5, 4 neurons of 3 and of a phase with 10 ticks of 5.
    assert curves.macs == 2 * (9 + 4 * 5 + 4 * 3 + 4 * (2 + 5 * 10))
    drawn = encoders.tiles(active=3, spikes="poisson").made(space, ()).work(11, (1,))
    assert drawn.macs == 3 * 2 * 8 + 3 * 10 * 2
    assert encoders.shares(of="peaks").made(space, (2,)).work(1, (2,)) == (2 * 7, 32)
    assert encoders.rates().made(space, (2,)).work(1, (2,)).macs == 6
    assert encoders.pulse().made(space, (3,)).work(20, (3,)) == (0, 0)
    assert encoders.events().made(space, (3, 3)).work(20, (3, 3)) == (0, 0)
    assert decoders.winner(of="a", votes=3).work([6]).macs == 6 + 2
    assert decoders.mean(of=["a", "b"]).work([4, 4]).macs == 2 * (2 * 4 + 2)
    assert decoders.counts(of="a").work([4]) == decoders.difference(of="a").work([4]) == (0, 0)
    assert teachers.reward(less=10).made().work().macs == 3
    assert teachers.reward().made().work().macs == 0
    assert teachers.same(as_="error", size=1.0).made().work().macs == 7
    assert teachers.reward(opposed=True, settle=5.0, others=0.5).spread_work(4, False).macs == 2 + 2 + 4
    assert teachers.info(key="a", opposed=True).spread_work(4, True).macs == 2 * 2


def test_the_loop_without_a_host_learns_by_its_own_dopamine():
    net = neuro.load(neuro_models.path("loop"))
    assert net.world_section.reward is None
    loop = neuro.closed_loop(net, seed=1)
    loop.run(steps=120)
    assert np.ptp(loop.sim.get("columns_motors_x", "weight")) > 1.0
    assert np.ptp(loop.sim.get("columns_critic_x", "weight")) > 1.0
    still = neuro.closed_loop(neuro.load(neuro_models.path("loop"), {"eta": 0.0, "eta_critic": 0.0}), seed=1)
    still.run(steps=120)
    assert np.array_equal(np.unique(still.sim.get("columns_motors_x", "weight")), [600.0])
