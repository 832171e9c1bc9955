"""One network on several backends: what is seen of it must be the same."""

import neuro
from neuro.run.simulation import Simulation
from neuro.testing import observe
from neuro.testing.case import differences, run_on


def alike(
    net: neuro.Network, ms: float, *backends: str, seed: int = 1, exact: bool = False, **options: object
) -> list[Simulation]:
    """Run a network on some backends, else on reference and event, compare all that is seen; the simulations."""
    sims = [neuro.compile(net, backend, seed=seed, **options) for backend in backends or ("reference", "event")]
    for sim in sims:
        run_on(sim, ms)
    same(*sims, exact=exact)
    return sims


def same(first: Simulation, *others: Simulation, exact: bool = True) -> None:
    """Compare all that is seen of simulations."""
    expected = observe(first)
    for other in others:
        assert differences(expected, observe(other), exact=exact) == []
