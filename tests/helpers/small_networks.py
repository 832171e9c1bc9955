"""Networks that several tests run."""

NETWORK = """\
neuro: 1
name: small
resolution: 0.1
parameters: {w: 300.0, rate: 100.0}
populations:
  noise: {model: {poisson_generator: {rate: $rate}}, shape: 20}
  current: {model: {dc_generator: {amplitude: 100.0}}, shape: 1}
  exc: {model: iaf_psc_exp, shape: [2, 4]}
  one: {model: {iaf_psc_exp: {I_e: 400.0}}, shape: 1}
projections:
  noise_exc: {from: noise, to: exc, rule: all_to_all, weight: $w, delay: 1.0, synapse: {stdp: {Wmax: 1000.0}}}
  current_exc: {from: current, to: exc, rule: all_to_all, weight: 1.0, delay: 1.0}
  exc_one: {from: exc, to: one, rule: {pairs: {pre: [0, 3], post: [0, 0]}}, weight: [10.0, 20.0], delay: 2.0}
probes:
  v: {of: exc, record: V_m, every: 1.0}
  v_one: {of: one, record: V_m}
"""
