"""Read a module of a tool for torch as a `Network`, through the tool's own exporter to NIR."""

from __future__ import annotations

import contextlib
import copy
import io
import warnings
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from typing import Any

from neuro import ModelError, Network
from neuro.apps import unknown
from neuro_exchange.nir.graph import package
from neuro_exchange.nir.importing import from_nir
from neuro_exchange.verdict import APPROXIMATE, EXACT

STEPS = {"norse": 1.0, "snntorch": 0.1, "sinabs": 1.0, "spikingjelly": 0.1}
"""Default step in ms by tool."""


def from_torch(module: Any, example: Any, of: str, dt: float | None = None) -> Network:
    """Return a network with the spikes of a module of snnTorch, Norse, Sinabs or spikingjelly.

    Args:
        module: a `torch.nn.Module`, made of neurons of the tool and layers of torch.
        example: an input of the module for one step, a tensor whose first axis is the batch.
        of: the tool: "snntorch", "norse", "sinabs" or "spikingjelly".
        dt: length of a step in ms; default: 1 for Norse and Sinabs, 0.1 for snnTorch and spikingjelly.

    Returns:
        The network, see `from_nir`. Its attribute `verdicts` has a verdict for each node.

    Raises:
        ModelError: the tool is not installed, its exporter to NIR fails, or a node is refused.
    """
    if of not in WRITERS:
        raise unknown("tool", of, WRITERS)
    step = STEPS[of] if dt is None else dt
    try:
        write, reset = WRITERS[of](module)
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            graph = write(module, example, step / 1e3)
    except ModelError:
        raise
    except ImportError as error:
        raise ModelError(
            f"from_torch: {error.name or of} is not installed", hint=f"pip install {of} nirtorch"
        ) from None
    except Exception as error:  # the exporters raise many kinds
        reason = f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
        raise ModelError(f"from_torch: {of} cannot export the module to NIR: {reason}") from None
    net = from_nir(graph, step, of, reset=reset)
    if of == "snntorch":  # verdicts on recurrence are about snnTorch's importer, which is not used here
        recurrent = {n.node: n for n in net.verdicts if n.verdict == APPROXIMATE and n.kind in ("Linear", "Affine")}
        exact = {"verdict": EXACT, "how": "weights", "measured": ""}
        nodes = tuple(replace(n, **exact) if n.node in recurrent else n for n in net.verdicts)
        net.verdicts = replace(net.verdicts, nodes=nodes)
    return net


Writer = Callable[[Any, Any, float], Any]


def _norse(module: Any) -> tuple[Writer, str | None]:
    import_module("norse.torch")
    for part in module.modules():
        if type(part).__name__ in ("LIFCell", "LIF", "LIFRecurrentCell", "LIFRecurrent"):
            message = f"from_torch: Norse exports {type(part).__name__} as CubaLIF, but imports another neuron"
            raise ModelError(message, hint="use LIFBoxCell, or write the graph by hand and read it with from_='nir'")
    writer, nirtorch = import_module("norse.torch.utils.export_nir"), import_module("nirtorch")
    nir = package("from_torch")

    def export(module: Any, example: Any, step: float) -> Any:
        """Export as `norse.torch.to_nir` does, with three corrections.

        Norse's function writes dt / tau_mem_inv as a time constant (so dt is 1 s here), keeps the axis of the batch,
        and ignores Flatten.
        """

        def node(part: Any) -> Any:
            if type(part).__name__ == "Flatten":
                return nir.Flatten(None, max(part.start_dim - 1, 0), part.end_dim)
            return writer._extract_norse_module(part, dt=1.0)

        return nirtorch.extract_nir_graph(module, node, example, model_name="norse", ignore_dims=[0])

    return export, None


def _snntorch(module: Any) -> tuple[Writer, str | None]:
    write = import_module("snntorch.export_nir").export_to_nir
    resets = {_snntorch_reset(part) for part in module.modules() if hasattr(part, "reset_mechanism")}
    if len(resets) > 1:
        message = "from_torch: found neurons with different resets: expected one, since NIR does not store the reset"
        raise ModelError(message, hint="give all neurons one reset_mechanism and reset_delay")

    def export(module: Any, example: Any, step: float) -> Any:
        return write(_with_parameters_per_neuron(module, example), example, ignore_dims=[0])

    return export, next(iter(resets), None)


def _with_parameters_per_neuron(module: Any, example: Any) -> Any:
    """Return a copy with parameters per neuron, since the exporter derives the shapes of layers from parameters."""
    module_copy = copy.deepcopy(module)
    module_copy(example)
    for part in module_copy.modules():
        if not hasattr(part, "reset_mechanism"):
            continue
        for word in ("alpha", "beta", "threshold"):
            value = getattr(part, word, None)
            if value is not None and value.dim() == 0:
                part.register_buffer(word, value.detach().expand(part.mem.shape[1:]).clone())
        part.reset_mem()
    return module_copy


def _snntorch_reset(part: Any) -> str:
    """Return the reset rule of a neuron of snnTorch, as `reset` of `from_nir`."""
    if part.reset_mechanism == "none":
        raise ModelError("from_torch: reset_mechanism 'none'", hint="choose 'subtract' or 'zero'")
    if part.reset_mechanism == "zero":
        # Leaky resets before it integrates.
        resets_later = getattr(part, "reset_delay", True) and hasattr(part, "alpha")
        return "to_value_next" if resets_later else "to_value"
    return "subtract_next" if getattr(part, "reset_delay", True) else "subtract"


def _sinabs(module: Any) -> tuple[Writer, str | None]:
    write = import_module("sinabs.nir").to_nir
    return lambda module, example, step: write(module, example), None


def _spikingjelly(module: Any) -> tuple[Writer, str | None]:
    write = import_module("spikingjelly.activation_based.nir_exchange").export_to_nir
    return lambda module, example, step: write(module, example, dt=step), None


WRITERS: dict[str, Callable[[Any], tuple[Writer, str | None]]] = {
    "norse": _norse,
    "snntorch": _snntorch,
    "sinabs": _sinabs,
    "spikingjelly": _spikingjelly,
}
"""For each tool, a function of a module that returns the exporter to NIR, and the reset rule if NIR lacks it."""
