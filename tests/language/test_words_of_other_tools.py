"""Words of NEST, Brian2, PyNN, snnTorch, Norse, BindsNET and Lava are answered with ours."""

from __future__ import annotations

import pytest

import neuro

NET = """\
neuro: 1
populations:
  a: {{model: {model}, shape: 10}}
  b: {{model: iaf_psc_exp, shape: 10}}
projections:
  p: {{from: a, to: b, rule: {rule}, weight: 1.0, synapse: {synapse}}}
"""
WORDS = [
    ("rule", "{fixed_indegree: {indegree: 3}}", "n"),
    ("rule", "{fixed_indegree: {k: 3}}", "n"),
    ("rule", "{fixed_outdegree: {K: 3}}", "n"),
    ("rule", "FixedNumberPreConnector", "fixed_indegree"),
    ("rule", "AllToAllConnector", "all_to_all"),
    ("rule", "Dense", "all_to_all"),
    ("rule", "{pairwise_bernoulli: {probability: 0.1}}", "p"),
    ("model", "Leaky", "iaf_psc_delta"),
    ("model", "LIFNodes", "iaf_psc_delta"),
    ("model", "DiehlAndCookNodes", "iaf_psc_exp_adaptive_threshold"),
    ("model", "EIF_cond_exp_isfa_ista", "aeif_cond_exp"),
    ("model", "{iaf_psc_exp: {beta: 0.9}}", "tau_m"),
    ("model", "{iaf_psc_exp: {tau_mem_inv: 0.1}}", "tau_m"),
    ("model", "{iaf_psc_exp: {thresh: -52}}", "V_th"),
    ("model", "{iaf_psc_exp: {du: 3}}", "tau_syn_ex"),
    ("model", "{iaf_psc_exp: {bias: 3}}", "I_e"),
    ("model", "{iaf_psc_exp: {refrac: 3}}", "t_ref"),
    ("synapse", "PostPre", "stdp"),
    ("synapse", "TsodyksMarkramSynapse", "tsodyks2"),
    ("synapse", "{stdp: {taupre: 20}}", "tau_plus"),
    ("synapse", "{stdp: {gmax: 1}}", "Wmax"),
    ("synapse", "{stdp: {A_plus: 0.01}}", "lambda"),
]


@pytest.mark.parametrize(("part", "said", "ours"), WORDS)
def test_the_hint_is_our_word(tmp_path, part, said, ours):
    words = {"model": "iaf_psc_exp", "rule": "all_to_all", "synapse": "static", part: said}
    (tmp_path / "net.yaml").write_text(NET.format(**words))
    with pytest.raises(neuro.ModelError) as error:
        neuro.load(tmp_path / "net.yaml")
    assert error.value.hint == f"did you mean '{ours}'?"
