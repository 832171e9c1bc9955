"""A simulation is freed with its last name, not when garbage is collected: arrays of gigabytes must not wait."""

import gc
from collections.abc import Callable, Iterator

import numpy as np
import pytest

import neuro
from neuro.run.simulation import Simulation


def net() -> neuro.Network:
    made = neuro.Network("freed", resolution=1.0)
    made.population("input", 3, neuro.spike_generator())
    made.population("cells", 2, neuro.iaf_psc_delta())
    made.connect("input", "cells", neuro.all_to_all(), weight=1.0, delay=1.0)
    return made


def compiled(backend: str) -> Callable[[], None]:
    def use() -> None:
        sim = neuro.compile(net(), backend=backend)
        sim.inject("input", [1.0], [0])
        sim.run(5.0)
        sim.spikes("cells")

    return use


def stepped() -> None:
    sim = neuro.compile(net())
    sim.stepper(5.0, emit=["input"], count=["cells"]).step((np.array([1]), np.array([0])))
    sim.port("cells", "counts").get()


def copied() -> None:
    copies = neuro.compile(net(), copies=2, seed=1)
    copies.stepper(5.0, emit=["input"], count=["cells"])


def living() -> set[int]:
    """The simulations and engines that exist."""
    found = [o for o in gc.get_objects() if type(o) is Simulation or type(o).__name__.endswith("Engine")]
    return {id(o) for o in found if type(o).__module__.startswith("neuro")}


@pytest.fixture
def uncollected() -> Iterator[None]:
    """No garbage is collected but when a test asks for it; what other tests left is not looked at again."""
    gc.collect()
    gc.freeze()
    gc.disable()
    yield
    gc.enable()
    gc.unfreeze()


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize(
    "use",
    [*(pytest.param(compiled(b), id=b) for b in ("event", "reference", "loihi", "spinnaker")), stepped, copied],
)
def test_nothing_outlives_its_last_name(use: Callable[[], None], uncollected: None):
    use()  # modules that are imported and kernels that are compiled leave cycles of their own
    gc.collect()
    before = living()
    use()
    assert living() <= before
