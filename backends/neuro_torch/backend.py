"""The torch backend: checks, options and construction of the engine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from neuro.core.errors import ModelError, nearest
from neuro.core.extras import needed
from neuro.program.backend import Problem
from neuro.program.program import Program
from neuro_torch.problems import problems

if TYPE_CHECKING:
    import torch

    from neuro_torch.engine import TorchEngine

_TRIALS = "trials: torch runs none"
_GROUP = "torch has no winner-take-all"
_COMPETITION = "torch has no competition"
_RIVALS = "torch has no lateral reset"
_PAIRS = "torch has static synapses only"

_LAWS = (
    *("a_seed_repeats", "seeds_differ", "threads_do_not_matter", "a_reset_repeats", "a_reset_keeps_weights"),
    *("another_population_does_not_matter", "counts_follow_from_spikes", "cutting_does_not_matter"),
    *("cutting_does_not_matter_when_steered", "probes_do_not_matter"),
    *("a_saved_state_continues", "a_state_saved_after_a_change_continues"),
)

UNSUPPORTED: dict[str, str] = {
    **dict.fromkeys(("first_to_fire", "exact_best_of_each_step"), _GROUP),
    **dict.fromkeys((f"{law}_of_fixed_weights" for law in _LAWS), _GROUP),
    **dict.fromkeys(("maps_that_reset_each_other", "exact_lateral_reset"), _RIVALS),
    "local_winners_without_trials": _COMPETITION,
    **dict.fromkeys((*_LAWS, *(f"{law}_of_learning" for law in _LAWS)), _PAIRS),
    **dict.fromkeys(
        (
            *("stdp_multiplicative", "stdp_additive", "stdp_between", "stdp_within_a_population", "stdp_onto_parrots"),
            *("stdp_changes", "synapses_that_differ", "synapses_that_come_to_differ", "counts_of_learning"),
            *("dopamine_by_signal", "dopamine_by_spikes", "dopamine_one_to_one", "dopamine_without_a_source"),
            *("dopamine_from_the_target", "dopamine_changes", "ports_of_signals_and_weights", "weights_are_recorded"),
            *("weights_at_pre_spikes", "states_at_pre_spikes", "views_are_connected"),
            *("single_plastic_weights_change",),
        ),
        _PAIRS,
    ),
    **dict.fromkeys(
        (
            *("silent_trials", "rewarded_learning", "rescued_learning"),
            *("dropout_of_each_trial", "rewarded_learning_with_padding", "rewarded_learning_of_all_pairs"),
            *("rewarded_learning_by_channel", "rewarded_learning_with_delays", "rewarded_learning_from_a_layer"),
            *("learning_without_labels", "learning_at_the_peak", "states_that_go_on"),
            *("exact_decisions", "exact_full_trials", "exact_run_after_a_decision", "exact_rewards", "exact_rescue"),
            *("exact_growth", "exact_local_winners", "exact_local_winners_to_the_last", "local_winners_learn"),
            *("local_winners_are_rewarded", "saved_trials_continue", "cutting_a_batch_does_not_matter"),
        ),
        _TRIALS,
    ),
}


def torch_module(what: str = "backend 'torch'") -> Any:
    """Return the module torch, or raise an error that says how to install it."""
    return needed("torch", "torch", f"{what}: torch is not installed")


def device_of(name: str | torch.device) -> torch.device:
    """Return an existing device that supports double precision.

    Args:
        name: "cpu", "cuda" (the first GPU), "cuda:1", or a `torch.device`.

    Raises:
        ModelError: torch is not installed, or the device does not exist.
    """
    library = torch_module()
    devices = ["cpu", *(f"cuda:{number}" for number in range(library.cuda.device_count()))]
    try:
        device: torch.device | None = library.device(name)
    except (RuntimeError, TypeError):
        device = None
    if device is None or device.type not in ("cpu", "cuda"):
        raise ModelError(f"device = {name!r}: expected 'cpu' or 'cuda'", hint=f"available: {', '.join(devices)}")
    if device.type == "cuda" and f"cuda:{device.index or 0}" not in devices:
        raise ModelError(f"device = '{device}': torch sees no such GPU", hint=f"available: {', '.join(devices)}")
    return device


class TorchBackend:
    """Networks as tensors of doubles on a CPU or a GPU, through which torch computes gradients."""

    name = "torch"
    description = "networks as tensors of torch, if installed, also on a GPU: what neuro_torch trains"
    unsupported = UNSUPPORTED

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """Return the features of a program that this backend cannot run; nothing is approximated."""
        return problems(program)

    def build(self, program: Program, *, threads: int = 1, device: str = "cpu", **options: Any) -> TorchEngine:
        """Make an engine at step 0.

        Args:
            program: the network, which `problems` accepts.
            threads: number of threads that torch uses during a run.
            device: "cpu", "cuda" or "cuda:1".
            options: `strict` has no effect; any other name is an error.

        Raises:
            ModelError: torch is not installed, the device does not exist, or an option is unknown.
        """
        for name in options.keys() - {"strict"}:
            option_names = ["device", "strict", "threads"]
            raise ModelError(f"backend 'torch' has no option '{name}'", hint=nearest(name, option_names))

        torch_device = device_of(device)
        from neuro_torch.engine import TorchEngine

        return TorchEngine(program, threads, torch_device)
