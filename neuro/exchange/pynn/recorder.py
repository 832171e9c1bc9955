"""A simulator of PyNN that simulates nothing: it keeps what a script builds, and answers as if no neuron had fired.

It subclasses PyNN's own common classes, so names, checks, connectors and random numbers are PyNN's. Only the process of
the script imports it, see `confined`.
"""

from __future__ import annotations

from typing import Any

from pyNN import common, connectors, core, errors, random, space, standardmodels
from pyNN.network import Network

from neuro.exchange.pynn.clock import SIMULATOR, STATE, end, reset, run, run_until, setup
from neuro.exchange.pynn.populations import Assembly, Population, PopulationView
from neuro.exchange.pynn.projections import Projection
from neuro.exchange.pynn.standard import CELLS, DEPENDENCES, SOURCES, SYNAPSES, STDPMechanism


def list_standard_models() -> list[str]:
    """Names of the cells."""
    return list(CELLS)


def public_names() -> dict[str, Any]:
    """What a module of PyNN for one simulator offers, by name."""
    queries = common.build_state_queries(SIMULATOR)
    words = ("get_current_time", "get_time_step", "get_min_delay", "get_max_delay", "num_processes", "rank")
    kinds = {name: kind for name, kind in vars(connectors).items() if name.endswith("Connector")}
    ours = (
        *(setup, end, run, run_until, reset, list_standard_models),
        *(STDPMechanism, Population, PopulationView, Assembly, Projection),
    )
    return {
        **kinds,
        **{one.__name__: one for one in ours},
        **dict(zip(words, queries, strict=True)),
        **{"run_for": run, "initialize": common.initialize, "set": common.set},
        "create": common.build_create(Population),
        "connect": common.build_connect(Projection, connectors.FixedProbabilityConnector, SYNAPSES["StaticSynapse"]),
        "record": (record := common.build_record(SIMULATOR)),
        "record_v": lambda source, filename: record(["v"], source, filename),
        "record_gsyn": lambda source, filename: record(["gsyn_exc", "gsyn_inh"], source, filename),
        **CELLS,
        **SYNAPSES,
        **DEPENDENCES,
        **SOURCES,
        **{"space": space, "random": random, "errors": errors, "core": core, "Space": space.Space},
        **{"NumpyRNG": random.NumpyRNG, "GSLRNG": random.GSLRNG, "RandomDistribution": random.RandomDistribution},
        **{"NativeRNG": random.NumpyRNG, "StandardCellType": standardmodels.StandardCellType},
        **{"Line": space.Line, "Grid2D": space.Grid2D, "Grid3D": space.Grid3D},
        **{"state": STATE, "Network": Network},
    }
