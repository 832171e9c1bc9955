import re
from dataclasses import replace

import numpy as np
import pytest

import neuro
from neuro.chips import chip, place
from neuro.compare import compare, report
from neuro.compare.report import chip_map, page
from neuro.core.html import Html, join, svg, table, tag
from neuro.pages.raster import script
from rasters import Page


def test_the_page_tells_all(three):
    text = page(three)
    tree = Page(text)
    assert text.startswith("<!doctype html>")
    assert not [part for part in tree.attributes if part[1].startswith("on")]
    assert text.count("<script>") == 1  # ours, which the page's policy names
    assert tree.links == ["data:,"]  # no icon, so that none is asked for
    assert "@import" not in text
    assert "url(" not in text
    assert "http" not in script()
    assert len(text) < 500_000
    told = Page(page(three)).text
    for part in ("In numbers", "Spikes", "Weights", "Chips", "Energy", "Rounding", "Warnings and notes"):
        assert f" {part} " in told
    assert "relay 200 ms in steps of 1 ms, seed 1, on event, loihi and spinnaker, each compared with event." in told
    assert "on loihi the same, several spikes in a step as one; on spinnaker the same." in told
    assert "merged spikes of noise" in told
    assert three.runs[1].warnings[0].split("\n")[0] in told
    for bill in three.bills:
        assert all(" ".join(item.source.split()) in told for item in bill.energy.items)
    for fixed in (three.runs[1].fixed, three.runs[2].fixed):
        assert all(note in told for note in fixed.notes)
    told, cpu = Page(page(three)).text, next(bill.energy for bill in three.bills if bill.target == "cpu")
    *_, dynamic, static, total = cpu.sums()
    assert static == ("static", "not priced", "not priced")
    assert " ".join((*dynamic, *static, *total)) in told
    assert "static 0 J" not in told
    tree, expected = Page(report.rasters(three)), {"same": 0, "missing": 0, "extra": 0}
    for run in three.ran:
        for name, its in run.trains.items():
            mine, first = set(zip(its.steps.tolist(), its.ids.tolist(), strict=True)), three.first.trains[name]
            theirs = set(zip(first.steps.tolist(), first.ids.tolist(), strict=True))
            expected["same"] += len(mine & theirs)
            expected["missing"] += len(theirs - mine)
            expected["extra"] += len(mine - theirs)
    assert tree.dots == {kind: count for kind, count in expected.items() if count}
    assert "evenly chosen" not in tree.text


@pytest.mark.parametrize(("dots", "rows", "end"), [(3000, 27, 400), (400, 8, 203)])
def test_rasters_of_many_spikes_are_a_choice_and_say_so(monkeypatch, dots, rows, end):
    """Fewer neurons first; where these still have too many spikes, the first part of the run."""
    net = neuro.Network("many", resolution=1.0)
    net.population("cells", 500, neuro.iaf_psc_exp(I_e=2000.0, t_ref=1.0))  # 250 Hz each
    found = compare(net, ["event", "reference"], 400.0)
    monkeypatch.setattr(report, "MOST_DOTS", dots)
    tree = Page(report.rasters(found))
    assert found.first.populations["cells"].spikes == 50_000
    assert dots * 0.89 < tree.dots["same"] / 2 <= dots
    told = f"cells {rows} of 500 neurons, evenly chosen"
    assert re.search(f"{told}; the first {end} of 400 ms" if end < 400 else f"{told} ←", tree.text)


def test_refusals_missing_bills_and_silence_are_told(net):
    found = compare(net, ["event", "reference", "loihi"], 20.0)
    refused = replace(
        found.runs[2],
        refused="backend 'loihi' cannot run this\nthe <reason>\n  hint: do",
        reason="the <reason>",
        counts=None,
    )
    told = Page(page(replace(found, runs=(*found.runs[:2], refused)))).text
    assert all(word in told for word in ("loihi refused the <reason>", "refused: the <reason>"))
    assert "loihi refused: backend 'loihi' cannot run this the <reason> hint: do" in told
    found = compare(net, ["event", "reference"], 20.0)
    bills = tuple(replace(bill, energy=None, reason="no room") for bill in found.first.bills)
    told = Page(page(replace(found, runs=(replace(found.first, bills=bills), found.runs[1])))).text
    assert all(word in told for word in ("There is no bill.", "no bill for loihi: no room"))
    net = neuro.Network("quiet", resolution=1.0)
    net.population("cells", 3, neuro.iaf_psc_exp())
    tree = Page(page(compare(net, ["event", "reference"], 10.0)))
    assert "Silent on every backend: cells." in tree.text
    assert tree.dots == {}


def test_maps_of_chips(net):
    placement = place(neuro.compile(net, backend="reference").program, chip("spinnaker"), neurons_per_core=1)
    assert (len(placement.cores), placement.chips_used) == (30, 2)
    drawing = chip_map(placement, chip("spinnaker"))
    tree = Page(drawing)
    rects = [value for name, key, value in tree.attributes if (name, key) == ("rect", "class")]
    assert rects.count("core") == 8 + 30  # the scale's and the map's
    assert rects.count("chip") == 2
    spots = re.findall(r'<rect x="([\d.]+)" y="([\d.]+)" width="22" height="22"', drawing)
    assert len(set(spots)) == 30  # none lies on another
    assert "30 of 32 cores on 2 chips of SpiNNaker 1; " in tree.text
    assert "chip 0, tile 0,0, core 0 " in tree.text
    assert "1 neuron, " in tree.text
    placement = place(neuro.compile(net, backend="reference").program, chip("loihi"))
    core = replace(placement.cores[0], load={"axons_in_per_core": 1.5})
    drawing = chip_map(replace(placement, cores=(core, *placement.cores[1:])), chip("loihi"))
    assert drawing.count('height="22" class="core over" fill-opacity="1">') == 1
    assert "the fullest core uses 150% of its axons in" in drawing


def test_elements_escape_what_is_text():
    assert tag("p", "a < b & c", title='"x"', class_="k", aria_label=None) == (
        '<p title="&quot;x&quot;" class="k">a &lt; b &amp; c</p>'
    )
    assert join([Html("<i></i>"), "<i>", None, 1.0, 0.126]) == "<i></i>&lt;i&gt;10.13"
    assert svg(10.0, 5, "x", label="a") == (
        '<svg viewBox="0 0 10 5" role="img" aria-label="a" style="max-width:10px">x</svg>'
    )
    assert '<th class="n" scope="col">n</th>' in table(("what", ">n"), [("a", 1)])


def test_a_network_that_learns(tmp_path):
    net = neuro.Network("learns", resolution=1.0)
    noise = net.population("noise", 20, neuro.poisson_generator(rate=100.0))
    cells = net.population("cells", 2, neuro.iaf_psc_exp())
    net.connect(noise, cells, neuro.all_to_all(), neuro.stdp(Wmax=900.0), weight=400.0, delay=1.0)
    found = compare(net, ["event", "loihi"], 300.0, 2)
    assert found.runs[1].weights["noise_cells"].largest > 0.0
    assert not np.allclose(found.first.final["noise_cells"], 400.0)
    assert found.learnt[0].distinct["event"] > 1
    told = Page(page(found)).text
    assert "rules applied in noise_cells" in told
    assert "noise_cells 40 synapses, " in told  # its histogram at the end; at the start all weights are one
