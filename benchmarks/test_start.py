"""Time until a first run in fresh processes."""

import os
import subprocess
import sys

SMALL = """
import neuro
net = neuro.Network()
net.population("noise", 10, neuro.poisson_generator(rate=100.0))
net.population("out", 10, neuro.iaf_psc_exp())
net.connect("noise", "out", neuro.all_to_all(), weight=100.0)
neuro.compile(net).run(100.0)
"""


def python(code, **environment):
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, **environment})


def test_interpreter(benchmark, figure):
    benchmark.pedantic(python, args=("pass",), rounds=5)
    figure("python alone", benchmark.stats.stats.min, "s")


def test_import(benchmark, figure):
    benchmark.pedantic(python, args=("import neuro",), rounds=5)
    figure("python with import neuro", benchmark.stats.stats.min, "s", "at most 0.3 more")


def test_first_start(benchmark, figure, tmp_path):
    benchmark.pedantic(python, args=(SMALL,), kwargs={"XDG_CACHE_HOME": str(tmp_path)}, rounds=1)
    figure("first start after install", benchmark.stats.stats.min, "s", "at most 20")


def test_later_start(benchmark, figure):
    python(SMALL)
    benchmark.pedantic(python, args=(SMALL,), rounds=5)
    figure("later start of a small network", benchmark.stats.stats.min, "s", "at most 1")
