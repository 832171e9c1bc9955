"""Networks, their parts, runs and recordings as people read them."""

from xml.etree import ElementTree

import numpy as np
import pytest

import neuro
from beside import evaluated
from neuro.run.collect import collect


@pytest.fixture
def net():
    net = neuro.Network("brunel", resolution=0.1)
    noise = net.population("noise", 100, neuro.poisson_generator(rate=8000.0))
    exc = net.population(
        "exc",
        (80, 100),
        neuro.iaf_psc_exp(tau_m=20.0, I_e=np.linspace(0.0, 10.0, 8000)),
        initial={"V_m": neuro.uniform(low=-70.0, high=-55.0)},
    )
    inh = net.population("inh", 2000, neuro.iaf_psc_exp())
    net.signal("reward", to=exc)
    net.connect(noise, exc, neuro.all_to_all(), weight=20.0)
    net.connect(exc, inh, neuro.fixed_indegree(n=100), neuro.stdp(lambda_=0.02), weight=20.0, delay=1.5)
    net.connect(inh, exc, neuro.pairwise_bernoulli(p=0.1), weight=-100.0, delay=1.5)
    net.connect(exc, exc, neuro.pairs([0, 1], [2, 3]), weight=[3.0, 4.0], name="listed")
    net.group("wta", neuro.winner_take_all(of="inh"))
    net.probe("v", exc, "V_m", every=1.0)
    net.probe("s", noise)
    return net


def test_networks_and_parts_as_text(net, messages):
    exc, inh = net.populations["exc"], net.populations["inh"]
    weight = neuro.normal(mean=20.0, std=2.0)
    told = {"the network": str(net), "in short": repr(net)}
    parts = (exc, net.projections["exc_inh"], net.signals["reward"], net.groups["wta"], net.probes["s"])
    told |= {f"{part.name} in short": repr(part) for part in parts}
    told |= {part.name: str(part) for part in (exc, inh, net.projections["exc_inh"], net.projections["noise_exc"])}
    some = net.connect(exc[:2, ::25], inh[::4], neuro.all_to_all(), weight=weight, name="some")
    messages(told | {"some": str(some)})
    head, rows = tables(some._repr_html_())
    assert head == "projection 'some'"
    assert rows[1:3] == [["from", "exc[:2, ::25], shape [2, 4]", ""], ["to", "inh[::4], shape [500]", ""]]
    head, rows = tables(exc._repr_html_())
    assert (head, rows[1]) == ("population 'exc'", ["shape", "[80, 100]", ""])


def test_sizes_that_a_grid_decides():
    net = neuro.Network("sheet", resolution=1.0)
    net.population("in", (1, 9, 9), neuro.spike_generator())
    net.population("out", (2, "auto", "auto"), neuro.iaf_psc_delta())
    net.connect("in", "out", neuro.grid(kernel=(3, 3)), weight=np.zeros((2, 1, 3, 3)))
    net.trials(input="in", duration=20.0)
    lines = str(net).splitlines()
    assert lines[0] == "sheet: 2 populations, resolution 1 ms"
    assert "  out   iaf_psc_delta    2 x auto x auto" in lines
    assert "0 .. 0 (18 values)" in lines[11]
    assert lines[-1] == "  input=in, duration=20"


def test_a_current_is_no_silent_spiker():
    net = neuro.Network("driven")
    net.population("bias", 1, neuro.dc_generator(amplitude=100.0))
    net.population("noise", 1, neuro.noise_generator(std=10.0))
    net.population("cells", 2, neuro.iaf_psc_exp())
    for name in ("bias", "noise"):
        net.connect(name, "cells", neuro.all_to_all())
    sim = neuro.compile(net, backend="reference")
    sim.run(20.0)
    for told in (sim, collect(sim, net)):
        rows = tables(told._repr_html_())[1]
        assert rows[1] == ["bias", "dc_generator", "1", "-", "-"]
        assert rows[2] == ["noise", "noise_generator", "1", "-", "-"]
        assert rows[3] == ["cells", "iaf_psc_exp", "2", "0", "0.00"]


@pytest.mark.parametrize("rule", evaluated(__file__, "RULES", globals()), ids=repr)
def test_as_many_synapses_as_are_made(rule):
    net = neuro.Network()
    net.population("a", 5, neuro.iaf_psc_exp())
    net.population("b", 5, neuro.iaf_psc_exp())
    for target in "ab":
        net.connect("a", target, rule)
    sim = neuro.compile(net, backend="reference")
    for target in "ab":
        assert rule.synapses(5, 5, target == "a") == sim.program.projections["ab".index(target)].size


def test_html_is_escaped(net):
    net.name = "<script>"
    page = net._repr_html_()
    assert page.startswith("<p><b>&lt;script&gt;: 10,100 neurons")
    assert "<script" not in page
    assert page.count("<table") == 5


def test_views_are_said(net):
    net.connect(net.populations["exc"][:10, ::2], net.populations["inh"][[5, 3]], neuro.all_to_all(), name="some")
    net.probe("few", net.populations["exc"][:3, 4], "V_m")
    text = str(net)
    assert "  some       exc[:10, ::2]  inh[[5, 3]]  all_to_all                         1,000" in text
    assert "  few   exc[:3, 4]  V_m            0.1" in text


TAGS = {"div", "p", "b", "i", "table", "caption", "thead", "tbody", "tr", "th", "td"}


def tables(page):
    """Rows of cells of the tables of a piece of HTML that has nothing else in it."""
    root = ElementTree.fromstring(f"<div>{page}</div>")
    assert {each.tag for each in root.iter()} <= TAGS
    return root.find("p/b").text, [[cell.text or "" for cell in row] for row in root.iter("tr")]


@pytest.fixture
def sim():
    net = neuro.Network("two")
    net.population("in", 4, neuro.spike_generator(spike_times=[[10.0, 20.0]] * 4))
    net.population("out", (2, 3), neuro.iaf_psc_exp())
    net.connect("in", "out", neuro.all_to_all(), neuro.stdp())
    net.probe("v", "out", "V_m", every=1.0)
    sim = neuro.compile(net, backend="reference")
    sim.run(50.0)
    return sim


def lines(shown):
    """A head and rows of cells, as one text."""
    head, rows = tables(shown._repr_html_())
    return "\n".join([head, *(" | ".join(row) for row in rows)])


def test_runs_and_recordings_as_pages(sim, messages):
    results = collect(sim, sim.network())
    compared = neuro.compare.compare(sim.network(), ["reference", "event"], 20.0)
    events = neuro.events.Events([0, 5, 500_000], [1, 2, 3], [0, 0, 1], [1, 1, 0], (4, 3), {"camera": "<script>"})
    shown = {"a simulation": sim, "results": results, "a comparison": compared, "events": events, "none": events[:0]}
    messages({name: lines(one) for name, one in shown.items()})
    assert [tables(one._repr_html_())[0] for one in (sim, results, compared)] == [*map(repr, (sim, results, compared))]
    assert str(sim).startswith(f"{sim!r}\n\npopulations\n  name  model")
    sim.reset()
    assert tables(sim._repr_html_())[1][1] == ["in", "spike_generator", "4", "0", "-"]


def test_what_is_played_and_what_is_of_distance():
    events = neuro.events.Events([1, 5, 9], [0, 1, 2], [0, 0, 1], [1, 0, 1], (4, 3))
    net = neuro.Network("seen")
    net.population("held", "auto", neuro.event_camera(events=events))
    net.population("streamed", [2, 3, 4], neuro.event_camera(events=iter([events])))
    net.population("read", "auto", neuro.event_camera(file="walk.dat"))
    sheet = net.population("sheet", [5, 5], neuro.iaf_psc_exp(), extent=[1.0, 1.0])
    near = neuro.of_distance(neuro.exponential(a=2.0, beta=0.2))
    net.connect(sheet, sheet, neuro.all_to_all(), weight=near)
    told = str(net)
    for words in ("events = 3 events of 4x3 px", "events = an iterator of events", "file = walk.dat"):
        assert words in told
    assert "of_distance(exponential(beta=0.2, a=2))" in told
