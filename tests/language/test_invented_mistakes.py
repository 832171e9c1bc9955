"""What stands in for a broken part decides nothing: no mistake is made up for it, and none beside it is lost."""

from pathlib import Path

import pytest

from neuro.compiler.mistakes import mistakes
from rewording import same_if_reworded

POPULATIONS = """\
neuro: 1
populations:
  in: {model: poisson_generator, shape: 1}
  noise: {model: {noise_generator: {std: 10}}, shape: 1}
  a: {model: iaf_psc_exp, shape: 4}
  b: {model: iaf_psc_delta, shape: 4}
"""
CASES = {
    "a broken index": (
        """\
projections:
  d: {from: {a: "0:9"}, to: a, rule: all_to_all, weight: 3 pA}
probes:
  y: {of: d, record: weight, pre: {a: 3}}
""",
        ["projection 'd': from: a[0:9]: found 9: expected -4 to 4"],
    ),
    "a broken index and a wrong unit": (
        """\
projections:
  d: {from: {a: "0:9"}, to: a, rule: all_to_all, weight: 3 mV}
""",
        ["projection 'd': from: a[0:9]: found 9", "projection 'd': weight = 3 mV: expected a current"],
    ),
    "an unknown source": (
        "projections:\n  d: {from: nose, to: a, rule: all_to_all, weight: 3 pA}\n",
        ["projection 'd': unknown population 'nose'"],
    ),
    "an unknown target": (
        "projections:\n  d: {from: a, to: nose, rule: all_to_all, weight: 3 mV}\n",
        ["projection 'd': unknown population 'nose'"],
    ),
    "an unknown source, and neurons of it": (
        """\
projections:
  d: {from: nose, to: a, rule: all_to_all}
probes:
  y: {of: d, record: weight, pre: {b: 3}, synapses: [0, 99]}
""",
        ["projection 'd': unknown population 'nose'"],
    ),
    "a projection to a generator": (
        """\
projections:
  d: {from: a, to: in, rule: all_to_all}
  e: {from: a, to: b, rule: all_to_all}
probes:
  y: {of: d, record: weight, synapses: [0, 99]}
  z: {of: e, record: weight, synapses: [0, 99]}
""",
        ["projection 'd': its target 'in'", "probe 'z': synapses: found 99: expected at most 15"],
    ),
    "a projection that is gone": (
        """\
projections:
  d: [a, b]
probes:
  y: {of: d, record: weight, synapses: [0, 99]}
  z: {of: d, record: weight, pre: {a: 0}}
""",
        ["projection 'd': found [a, b]: expected"],
    ),
    "an unknown synapse": (
        """\
projections:
  p: {from: a, to: a, rule: all_to_all, synapse: {stpd: {Wmax: 3}}}
probes:
  y: {of: p, record: K_plus, every: 1.05}
""",
        ["projection 'p': unknown synapse 'stpd'", "probe 'y': every = 1.05 ms"],
    ),
    "a recording that is not there": (
        "  cam: {model: {event_camera: {file: no.aedat4}}, shape: auto}\n",
        ["population 'cam': no file 'no.aedat4'"],
    ),
    "a recording that is not there, with a shape": (
        "  cam: {model: {event_camera: {file: no.aedat4}}, shape: 7}\n",
        ["population 'cam': no file 'no.aedat4'"],
    ),
    "all of a probe": (
        "probes:\n  v: {of: {a: 9}, record: Vm, every: 1.05}\n",
        ["probe 'v': of: a[9]: found 9", "'a', an iaf_psc_exp, has no state 'Vm'", "probe 'v': every = 1.05 ms"],
    ),
    "a probe of nobody": (
        "probes:\n  v: {of: bb, record: c, every: 1.05, mean: 3}\n",
        ["probe 'v': unknown population 'bb'", "probe 'v': every = 1.05 ms", "probe 'v': mean = 3"],
    ),
    "a probe of spikes": (
        "probes:\n  v: {of: in, record: c, every: 1.05}\n",
        ["'in', a poisson_generator, has no state 'c'", "probe 'v': every = 1.05 ms"],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_told(folder, case):
    text, expected = CASES[case]
    Path("net.yaml").write_text(POPULATIONS + text)
    found = [str(error).partition(" ")[2].partition("\n")[0] for error in mistakes("net.yaml", None, 0).mistakes]
    assert len(found) == len(expected), found
    for message in expected:
        assert sum(message in line for line in found) == 1, (message, found)


@pytest.mark.parametrize("case", CASES)
def test_no_program_reads_the_messages(folder, case):
    same_if_reworded(POPULATIONS + CASES[case][0])
