"""The cases of `neuro.testing` that NEST cannot run, each with its reason."""

from __future__ import annotations

_NO_LEAK = "without leak NEST's propagator of a current is no number"
_CURRENTS = "NEST neither shows nor sets synaptic currents between steps"
_TRIALS = "NEST has no trials"
_GROUP = "NEST has no winner-take-all"
_RIVALS = "NEST has no lateral reset"
_RULE = "NEST's stdp_synapse applies changed numbers and weights to post spikes from before, too"
_STATE = "NEST cannot write or read its state"
_AT_PRE = "weights that learn are shown between steps only"
_MOMENT = "NEST brings synapses under dopamine up to date at the moments of deliver_interval only"

_LAWS = (
    *("a_seed_repeats", "seeds_differ", "threads_do_not_matter", "a_reset_repeats", "a_reset_keeps_weights"),
    *("another_population_does_not_matter", "counts_follow_from_spikes", "cutting_does_not_matter_when_steered"),
)
_SAVING = ("a_saved_state_continues", "a_state_saved_after_a_change_continues")

UNSUPPORTED: dict[str, str] = {
    "exact_refractory_periods": _NO_LEAK,
    "exact_currents": _NO_LEAK,
    "alpha_neuron_equal_time_constants": _NO_LEAK,
    "initial_states": _CURRENTS,
    "states_and_parameters_change": _CURRENTS,
    "currents_to_both_receptors": "NEST filters a current by the time constant of excitation only",
    **dict.fromkeys(("stdp_changes", "synapses_that_come_to_differ"), _RULE),
    **dict.fromkeys(("several_states_means_and_rates", "sleeping_neurons_are_recorded"), _CURRENTS),
    **dict.fromkeys(("weights_at_pre_spikes", "states_at_pre_spikes"), _AT_PRE),
    "single_plastic_weights_change": _RULE,
    "ports_go_on_after_a_restore": _STATE,
    **dict.fromkeys(("best_of_each_step", "first_to_fire", "exact_best_of_each_step"), _GROUP),
    "local_winners_without_trials": "NEST has no competition",
    **dict.fromkeys(("first_along_an_axis", "maps_that_reset_each_other", "exact_lateral_reset"), _RIVALS),
    **dict.fromkeys((f"{law}_of_fixed_weights" for law in (*_LAWS, *_SAVING)), _GROUP),
    **dict.fromkeys((f"{law}_of_fixed_weights" for law in ("cutting_does_not_matter", "probes_do_not_matter")), _GROUP),
    **dict.fromkeys((*_LAWS, *(f"{law}_of_learning" for law in _LAWS)), _RULE),
    **dict.fromkeys((*_SAVING, *(f"{law}_of_learning" for law in _SAVING)), _STATE),
    **dict.fromkeys(("cutting_does_not_matter", "probes_do_not_matter"), _MOMENT),
    **dict.fromkeys(
        (
            *("trials_decide", "trials_run_to_their_end", "silent_trials", "rewarded_learning", "rescued_learning"),
            *("dropout_of_each_trial", "rewarded_learning_with_padding", "rewarded_learning_of_all_pairs"),
            *("rewarded_learning_by_channel",),
            *("rewarded_learning_with_delays", "rewarded_learning_from_a_layer", "states_that_go_on"),
            *("learning_without_labels", "learning_at_the_peak"),
            *("exact_decisions", "exact_full_trials", "exact_rewards", "exact_rescue", "exact_growth"),
            *("exact_run_after_a_decision",),
            *("exact_local_winners", "exact_local_winners_to_the_last"),
            *("local_winners_learn", "local_winners_are_rewarded"),
            *("saved_trials_continue", "cutting_a_batch_does_not_matter"),
        ),
        _TRIALS,
    ),
}
