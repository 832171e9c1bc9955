"""Numba told to compile nothing: a backend that must be compiled says so, the others run."""

import os
import subprocess
import sys

CODE = """
import sys
import neuro
net = neuro.Network("n", resolution=1.0)
net.population("a", 1, neuro.iaf_psc_delta(I_e=500.0))
sim = neuro.compile(net, sys.argv[1])
sim.run(50.0)
print(sim.spikes("a")[0].size > 0)
"""


def _run(backend):
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    return subprocess.run(
        [sys.executable, "-c", CODE, backend], env=environment, capture_output=True, text=True, check=False
    )


def test_the_event_backend_refuses():
    done = _run("event")
    assert done.stderr.splitlines()[-2:] == [
        "neuro.core.errors.ModelError: backend 'event' has to be compiled, and NUMBA_DISABLE_JIT is set: "
        "expected it to be unset",
        "  hint: unset it, or run on backend 'reference', which is not compiled",
    ]


def test_the_reference_runs():
    done = _run("reference")
    assert (done.stdout, done.stderr) == ("True\n", "")
