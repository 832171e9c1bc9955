"""The page of `neuro report`: what it shows is what the run left behind."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

import neuro
from neuro.files import results
from neuro.files.finished_runs import energy
from neuro.pages.curves import curves, few, prefixed, rates, ticks
from neuro.pages.histograms import histogram
from neuro.pages.raster import packed
from neuro.pages.report import page
from neuro.run.collect import collect
from rasters import Page, unpacked
from refused import mistakes_of

NETWORK = Path(__file__).with_name("small.yaml").read_text("utf-8")


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    file = tmp_path_factory.mktemp("report") / "net.yaml"
    file.write_text(NETWORK)
    return neuro.load(file)


@pytest.fixture(scope="module")
def ran(network):
    sim = neuro.compile(network, seed=3)
    sim.run(250.0)
    return sim


@pytest.fixture(scope="module")
def run(ran, network):
    return collect(ran, network)


def simulated(net, ms):
    """What is left of a network that ran."""
    sim = neuro.compile(net, seed=2)
    sim.run(ms)
    return collect(sim, net)


def shown(run, file="run.h5", **words):
    return Page(page(run, file, **words))


def test_its_numbers_raster_and_bill_are_those_of_the_run(run, ran, network):
    told, counts = shown(run), ran.counts()
    exc = counts.populations["exc"].spikes
    assert exc > 50
    fired, active = len(set(ran.spikes("exc")[1].tolist())), counts.populations["exc"].neuron_updates_active
    rest = ["20", f"{exc:,}", f"{exc / 20 / 0.25:.2f}", f"{fired}", f"{active:,}"]
    assert (told.row("exc", "iaf_psc_exp", "4 x 5"), told.row("noise", "poisson_generator", "30")[3]) == (rest, "-")
    weights = ran.weights("noise_exc")[2]
    values = [f"{n:.4g} pA" for n in (weights.min(), weights.mean(), weights.max())]
    carried = f"{counts.projections['noise_exc'].synaptic_ops:,}"
    assert told.row("noise_exc", "noise", "exc", "stdp") == [f"{weights.size}", *values, carried]
    for name, what in {"spikes": "spikes", "synaptic_ops": "synaptic operations"}.items():
        assert told.row(what) == [f"{getattr(counts, name):,}"]
    assert f"noise_exc {weights.size} synapses, {np.unique(weights).size} different weights" in told.text
    assert "small 250 ms in steps of 0.5 ms on event, seed 3, by neuro" in told.text
    assert "Silent: quiet." in told.text
    assert "Not kept: noise; neuro run --record NAME keeps them." in told.text
    [strip] = shown(run).data[0]["strips"]
    train = run.populations["exc"]
    steps, rows = np.divmod(np.array(unpacked(strip["kinds"]["spike"])), strip["rows"])
    found = set(zip(steps.tolist(), rows.tolist(), strict=True))
    assert (strip["rows"], found) == (20, set(zip(train.steps.tolist(), train.ids.tolist(), strict=True)))
    assert all(energy(run, network, target) == ran.energy(target) for target in ("loihi", "spinnaker", "cpu"))
    told = shown(run)
    _, *rows = ran.energy("loihi").sums()
    assert [(name, *told.row(name)) for name, *_ in rows] == rows
    scale = re.search(r'class="decades">(.*?)</div>', page(run, "run.h5"))[1]
    places, names = zip(*re.findall(r'left:([\d.]+)%">(.*?)<', scale), strict=True)
    joules = [float(name.split()[0]) * {"nJ": 1e-9, "uJ": 1e-6, "mJ": 1e-3}[name.split()[1]] for name in names]
    assert len(joules) > 2
    assert np.allclose(np.diff(np.log10(joules)), 1.0)
    assert np.allclose(np.array(places, float), np.linspace(0.0, 100.0, len(joules)), atol=0.1)


def test_what_the_page_needs_and_tells(run, ran, network, tmp_path):
    (tmp_path / "bare.yaml").write_text("limits:\n  cores_per_chip: {value: 128, source: me}\n")
    assert "chip 'bare' has no costs: none is published" in shown(run, target=str(tmp_path / "bare.yaml")).text
    assert energy(collect(ran, network, record=["quiet"]), network, "loihi") == ran.energy("loihi")
    text = page(run, "run.h5")
    assert (Page(text).links, text.count("<script>")) == (["data:,"], 1)
    assert "@import" not in text
    assert "url(" not in text
    text = shown(run, "my run.h5").text
    assert "neuro plot 'my run.h5'" in text
    assert 'results.read("my run.h5").network().save("net.yaml")' in text
    assert "neuro compare net.yaml --for 250 --seed 3 --html compare.html" in text
    assert "The run did not reach its end" not in shown(run).text
    early = replace(run, about=run.about | {"finished": False})
    assert "The run did not reach its end: the page shows its records so far." in shown(early).text


def test_what_probes_recorded_of_synapses_and_rates():
    net = neuro.Network("learns", resolution=1.0)
    noise = net.population("noise", 20, neuro.poisson_generator(rate=100.0))
    cells = net.population("cells", 4, neuro.iaf_psc_exp())
    learns = net.connect(noise, cells, neuro.all_to_all(), neuro.stdp(Wmax=900.0), weight=400.0, delay=1.0)
    net.probe("v", cells, "V_m", every=1.0)
    net.probe("r", cells, "rate", every=10.0)
    net.probe("w", learns, "weight", every=5.0)
    net.probe("wp", learns, "weight", at="pre_spikes")
    text = shown(simulated(net, 300.0)).text
    assert all(f" {name} {what} " in text for name, what in {"v": "V_m of cells", "r": "rate of cells"}.items())
    marks = "weight 400 450 0 to 0 400 450 6 to 2 400 450 13 to 0 400 450 19 to 3 0 100 200 300 ms"
    assert f" w weight of 4 of 80 synapses of noise_cells {marks}" in text
    assert f" wp weight of 4 of 80 synapses of noise_cells, as pre spikes leave it {marks}" in text


def test_other_networks():
    net = neuro.Network("odd")
    net.population("a", 1, neuro.iaf_psc_exp())
    run = simulated(net, 1.0)
    run.about["network"] = "<b>&"
    assert "<h1>&lt;b&gt;&amp;</h1>" in page(run, "run.h5")
    net = neuro.Network("still")
    net.population("cells", 3, neuro.iaf_psc_exp())
    told = shown(simulated(net, 0.1))
    assert told.data == []
    assert all(word in told.text for word in ("Silent: cells.", "Nothing is connected."))
    assert "of 3 neurons in 1 population" in told.text
    net = neuro.Network("wide", resolution=1.0)
    for k in range(200):
        net.population(f"p{k}", 4, neuro.iaf_psc_exp(I_e=500.0))
    told = shown(simulated(net, 100.0))
    assert [strip["name"] for strip in told.data[0]["strips"]] == [f"p{k}" for k in range(200)]
    assert "140 more populations are not drawn." in told.text  # as curves
    net = neuro.Network("two", resolution=1.0)
    for name, size in (("large", 800), ("small", 200)):
        net.population(name, size, neuro.spike_generator(spike_times=[[5.0]] * size))
    heights = re.findall(r'"height":(\d+)', page(simulated(net, 10.0), "run.h5"))
    assert heights == ["140", "35"]
    net = neuro.Network("driven", resolution=1.0)
    inputs = net.population("in", 10, neuro.spike_generator(spike_times=[[5.0]] * 10))
    net.connect(inputs, net.population("cells", 2, neuro.iaf_psc_exp()), neuro.all_to_all(), weight=2000.0)
    results = simulated(net, 20.0)
    spikes, text = results.populations["cells"].spikes, page(results, "run.h5")
    assert f'<p class="big">{spikes}</p><p>of 2 neurons in 1 population; generators emitted 10 more</p>' in text
    assert "2000 pA" in text
    net = neuro.Network("regular")
    net.population("in", 20, neuro.spike_generator(spike_times=[list(range(5, 1000, 100))] * 20))
    hz = [float(word) for word in words(rates(simulated(net, 1000.0)))[1:3]]
    assert 10.0 <= max(hz) <= 100.0


def test_of_very_many_spikes_an_even_choice_is_shown():
    net = neuro.Network("many", resolution=1.0)
    net.population("cells", 4000, neuro.iaf_psc_exp(I_e=2000.0, t_ref=1.0))  # 250 Hz each
    run = simulated(net, 1000.0)
    assert run.populations["cells"].times_ms.size == 1_000_000
    text = page(run, "run.h5")
    record = re.search(r'<meta name="provenance"[^>]*>', text)  # as long as this process has read files
    assert record
    assert len(text) - len(record[0]) < 150_000
    assert re.search(r"250\.00 Hz, 144 of 4,000 neurons, evenly chosen", text)


@pytest.mark.parametrize("projections", [1, 30])
def test_the_network_is_read_as_often_with_many_projections_as_with_few(monkeypatch, projections):
    net = neuro.Network("wide")
    cells = net.population("cells", 5, neuro.iaf_psc_exp())
    for k in range(projections):
        net.connect(cells, cells, neuro.one_to_one(), weight=1.0, delay=1.0, name=f"wires{k}")
    run, read, network = simulated(net, 1.0), [], results.Results.network
    monkeypatch.setattr(results.Results, "network", lambda *words, **named: read.append(1) or network(*words, **named))
    shown(run)
    assert len(read) == 2, "once for the bill, which needs no recordings"


@given(st.lists(st.integers(0, 2**50), unique=True))
def test_packed_keys_are_the_keys(keys):
    assert unpacked(packed(np.array(sorted(keys), np.int64))) == sorted(keys)


@pytest.mark.parametrize("values", [[1.0, np.nextafter(1.0, 2.0)], [-1e300, 1e300], [1e-300, 1e300], [0.0, 5e-324]])
def test_weights_of_any_size_have_a_histogram(values):
    part = histogram("p", "", {"end": np.array(values)})
    assert part.extent == {"end": (values[0], values[1])}
    assert not part.counts or part.counts["end"].sum() == 2


def test_curves_have_units_round_ticks_and_names():
    x, y = np.arange(4.0), np.array([0.0, np.nan, np.inf, 2.0])
    assert 'd="M0.0 82.0L282.0 2.0"' in curves(x, [y], None, 3.0, "mV", "v")
    x, y = np.arange(4.0), np.array([-70.0, -65.0, -56.0, -55.0])
    assert words(curves(x, [y], None, 3.0, "mV", "v")) == ["mV", "-70", "-65", "-60", "-55", "0", "1", "2", "3 ms"]
    two = words(curves(x, [y, y], None, 400.0, "mV", "v", ["neuron 3", "neuron 7"]))
    assert two == ["mV", "-70", "-60", "neuron 3", "-70", "-60", "neuron 7", "0", "200", "400 ms"]
    assert words(curves(x, [np.full(4, 5.0)], None, 3.0, "mV", "v"))[:2] == ["mV", "4.95"]
    assert words(curves(x, [np.zeros(4)], 0.0, 3.0, "Hz", "v"))[:2] == ["Hz", "0.0"]
    factor, unit = prefixed(7.84e-5, "J")
    assert (round(7.84e-5 * factor, 6), unit, prefixed(5e4, "Hz")) == (78.4, "uJ", (1.0, "Hz"))
    assert prefixed(0.0, "J") == (1.0, "J")


def words(picture: str) -> list[str]:
    return re.findall(r"<text[^>]*>([^<]*)</text>", picture)


@given(st.floats(-1e300, 1e300), st.floats(-1e300, 1e300), st.integers(2, 6))
@example(3.999999998e16, -1.999999998e16, 3)
@example(-2.0, 4.0, 3)
@example(-95.0, -7.0, 3)
@example(-45.4, 40.6, 4)
def test_ticks_are_few_and_inside(a, b, most):
    picture = curves(np.arange(2.0), [np.array([a, b])], None, 1.0, "mV", "v")
    assert "nan" not in picture
    low, high = min(a, b), max(a, b)
    if high - low > 1e-9 * max(abs(high), abs(low)) and high - low > 1e-290:
        marks, gap = ticks(low, high, most), (high - low) * 1e-6
        assert len(marks) <= most
        assert all(low - gap <= mark <= high + gap for mark in marks)
        assert len(marks) >= 2 or most == 2


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.01234, "0.0123"), (16.449, "16.4"), (302179.0, "302,000"), (999.9, "1,000"), (1.5e-7, "1.50e-07")],
)
def test_numbers_have_three_digits(value, text):
    assert (few(value), few(-value)) == (text, f"-{text}")


def test_the_command(tmp_path, answer, monkeypatch, run, messages):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.yaml").write_text(NETWORK)
    results.write(run, "run.h5")
    assert answer("report", "run.h5") == (0, "run.html: written\n", "")
    assert answer("report", "run.h5", "--out", "other.html", "--chip", "cpu") == (0, "other.html: written\n", "")
    assert "energy on cpu" in (tmp_path / "other.html").read_text()
    assert answer("report", "run.h5", "--out", "x.HTML").status == 0
    messages(mistakes_of(answer, messages.cases))
    assert not (tmp_path / "x.pdf").exists()
