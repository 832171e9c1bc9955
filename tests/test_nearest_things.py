"""Messages that name the nearest right thing."""

import pytest

import neuro
import neuro_models
from neuro import ModelError
from neuro.events import Events


def told(make) -> str:
    with pytest.raises(ModelError) as caught:
        make()
    return str(caught.value).partition(": ")[2]


@pytest.fixture
def net() -> neuro.Network:
    net = neuro.Network("n")
    net.population("cells", [2, 3], neuro.iaf_psc_exp())
    net.connect("cells", "cells", neuro.all_to_all(), name="d")
    return net


def test_a_choice_as_a_mapping():
    assert told(lambda: neuro.distance_dependent(mask={"circular": {"radius": 0.3}})) == (
        "distance_dependent.mask = {circular: {radius: 0.3}}: expected a mask\n  hint: write neuro.circular(radius=0.3)"
    )
    assert told(lambda: neuro.distance_dependent(p={"gaussian": {"std": 2, "a": 0.5}})).endswith(
        "hint: write neuro.gaussian(std=2, a=0.5)"
    )
    assert "hint" not in told(lambda: neuro.distance_dependent(mask={"oval": 3}))


def test_a_function_of_distance_as_a_weight(net):
    message = told(
        lambda: net.connect("cells", "cells", neuro.all_to_all(), weight=neuro.gaussian(std=0.2), name="again")
    )
    assert message == (
        "projection 'again': weight = gaussian(std=0.2): expected a number\n"
        "  hint: write neuro.of_distance(neuro.gaussian(std=0.2))"
    )


def test_projections_can_be_probed(net):
    assert told(lambda: net.probe("zz", "dd", "weight")) == (
        "probe 'zz': unknown population 'dd'\n  hint: did you mean 'd'?"
    )
    assert told(lambda: net.probe("zz", "other", "weight")).endswith("hint: known: cells, d")


def test_words_of_a_part():
    assert told(lambda: neuro.event_camera(crop=[0, 0, 32, 48])) == (
        "event_camera.crop = [0, 0, 32, 48]: expected the words of crop\n  hint: its words are x, y"
    )


def test_files_and_formats(tmp_path):
    neuro.events.save(Events([1], [0], [0], [0], (2, 2)), tmp_path / "walk.dat")
    near = "hint: did you mean 'walk.dat'?"
    assert told(lambda: neuro.events.load(tmp_path / "wlk.dat")).endswith(f"no such file\n  {near}")
    net = neuro.Network("seen")
    net.population("eyes", "auto", neuro.event_camera(file=tmp_path / "wlk.dat"))
    assert told(lambda: neuro.compile(net)).endswith(near)
    assert told(lambda: neuro.events.load(tmp_path / "other")).endswith("no such file")
    message = told(lambda: neuro.events.load(tmp_path / "walk.dat", format="aedat9"))
    assert message.endswith("hint: did you mean 'aedat2' or 'aedat3' or 'aedat4'?")


@pytest.mark.parametrize("name", ["dense", "dense.yaml"])
def test_a_published_network_by_name(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    hint = "the published network is neuro.load(neuro_models.path('dense'))"
    assert told(lambda: neuro.load(name)) == f"no such file\n  hint: {hint}"
    assert neuro.load(neuro_models.path("dense")).populations
    assert told(lambda: neuro.load("dens")) == "no such file"
    neuro.Network("mine").save(tmp_path / "mine.yaml")
    (tmp_path / "mine.yaml").rename(tmp_path / name)
    assert neuro.load(name).name == "mine"


@pytest.mark.parametrize("micro", ["\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}"])
def test_micro(micro):
    message = told(lambda: neuro.iaf_psc_exp(tau_m=f"10000 {micro}s"))
    assert message.endswith("expected a number > 0 ms\n  hint: write 10000 us")


def test_a_name_of_the_library():
    with pytest.raises(AttributeError) as caught:
        neuro.noise_genertor  # noqa: B018
    assert str(caught.value) == "module 'neuro' has no attribute 'noise_genertor': did you mean 'noise_generator'?"
    with pytest.raises(AttributeError) as caught:
        neuro.nothing_like_it  # noqa: B018
    assert str(caught.value) == "module 'neuro' has no attribute 'nothing_like_it'"
