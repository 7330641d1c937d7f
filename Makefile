# make demo   install what a run needs, and plan the first mission, offline, on the packaged wind
# make desk   draw missions and plan them in a browser
# make test   run the tests of the day; make test-all: those before a change is taken in; make test-night: all,
#             with fuzz, kills and the corpus (tests/levels.py); make coverage: which lines they run
# make fuzz   read CASES=100000 spoilt files and texts of every kind (ARGS="scenes automata" for some kinds)
# make docs   build the docs site into site/
# make peers  compare with OMPL, Drake and MONA, each in an environment of its own (docs/peers.md)
# demo and desk first install requirements.lock into .venv, the others requirements-dev.lock, which has more: with
# uv, which is fetched if it is not on PATH, else with pip (release/environment.py).
# Another interpreter: make demo PYTHON=python3.12

PYTHON ?= python3
VENV ?= .venv
ARGS ?=
CASES ?= 100000
DIST ?= dist
KINDS ?=
COVERAGE ?= $(abspath build/coverage)
UNCOMPILED := tests/kernels tests/planning/test_step_programme.py
BIN := $(VENV)/bin
READY := $(VENV)/.ready
RUN_READY := $(VENV)/.ready-run
PINS ?=
PIN = UV_NO_CONFIG=1 $(BIN)/uv pip compile --quiet --universal --generate-hashes --no-header --no-annotate \
  --no-emit-index-url --no-emit-find-links --python-version 3.11 $(PINS)
# Hydra 1.3, the newest that is final, fails on Python 3.14.
SUPPORTED = $(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 13) else \
  "pareto_ltl needs Python 3.11, 3.12 or 3.13, and $(PYTHON) is %d.%d%s: name one, e.g. make PYTHON=python3.13" % \
  (v + (", for which Hydra 1.4 is awaited" if v > (3, 13) else "",)))' || exit 2

PEERS := build/peers

.PHONY: demo desk test test-all test-night coverage coverage-report fuzz faults bench corpus scale gallery peers lint types docs dist archives lock install clean
.DELETE_ON_ERROR:

demo: $(RUN_READY)
	@$(BIN)/python release/demo.py

desk: $(RUN_READY)-serve
	$(BIN)/pareto-ltl serve

test: $(READY)
	PARETO_LTL_TESTS=day $(BIN)/python -m pytest -n logical $(ARGS)

test-all: $(READY)
	$(BIN)/python -m pytest $(ARGS)

test-night: $(READY)
	PARETO_LTL_TESTS=night $(BIN)/python -m pytest -n logical $(ARGS)
	$(MAKE) fuzz faults corpus coverage

# Lines that the suite runs; the kernels count where they run uncompiled.
coverage: $(READY)
	rm -rf $(COVERAGE) && mkdir -p $(COVERAGE)
	COVERAGE_FILE=$(COVERAGE)/data.compiled $(BIN)/python -m pytest --cov --cov-report= $(ARGS)
	NUMBA_DISABLE_JIT=1 COVERAGE_FILE=$(COVERAGE)/data.kernels $(BIN)/python -m pytest --cov --cov-report= $(ARGS) $(UNCOMPILED)
	$(MAKE) --no-print-directory coverage-report

coverage-report: $(READY)
	COVERAGE_FILE=$(COVERAGE)/data $(BIN)/coverage combine --quiet $(COVERAGE)
	COVERAGE_FILE=$(COVERAGE)/data $(BIN)/coverage report --fail-under=92

fuzz: $(READY)
	cd tests && "$(abspath $(BIN))/python" -m fuzz.harness --cases $(CASES) $(ARGS)

# Kill runs and sweeps at 200 random moments each, which takes about half an hour.
faults: $(READY)
	PARETO_LTL_FAULTS=200 $(BIN)/python -m pytest tests/run/test_faults.py -v $(ARGS)

bench: $(READY)
	$(BIN)/python -m pytest benchmarks/bench_*.py $(ARGS)

# Plan 100 missions of many kinds with five seeds each; the page of results is outputs/corpus/index.html. Many hours;
# ARGS="--tenth --seeds 0,1" plans one mission of each kind (docs/corpus.md).
corpus: $(READY)
	cd benchmarks && "$(abspath $(BIN))/python" -m corpus $(ARGS)

# Seconds and memory against the size of a problem, with figures in outputs/scale (ARGS="states steps" for some).
scale: $(READY)
	cd benchmarks && "$(abspath $(BIN))/python" -m scale $(ARGS)

# Pictures of missions planned anew, and docs/gallery.md that shows them; some minutes.
gallery: $(READY)
	$(BIN)/python benchmarks/gallery.py $(ARGS)

# A peer that cannot be installed here is left out of the comparison.
peers: $(READY)
	-$(MAKE) --keep-going $(PEERS)/ompl $(PEERS)/drake $(PEERS)/mona
	PYTHONPATH=benchmarks $(BIN)/python -m peers.compare $(ARGS)

$(PEERS)/%: benchmarks/peers/requirements-%.txt
	$(PYTHON) -m venv --clear $@
	$@/bin/python -m pip install --quiet --disable-pip-version-check -r $< || { rm -rf $@; exit 1; }
	@touch $@

lint: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports

types: $(READY)
	$(BIN)/mypy

# The source archive, the wheel from it, and the wheel with machine code for this Python and numba, in DIST
# (RELEASING.md). KINDS="full paper" compiles only these kinds of runs, which takes less time.
dist: archives
	$(BIN)/python release/machine_code.py $(DIST)/*-py3-none-any.whl $(if $(KINDS),--kinds $(KINDS))

archives: $(READY)
	$(BIN)/python -m build --outdir $(DIST) .

# The site, into site/; warnings are errors. The variable keeps an advertisement of the theme off the screen.
docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# Also compile the kernels of the default settings, which a first run would do otherwise.
install: $(READY)
	$(BIN)/python -m pareto_ltl +experiment=phi1 report=none exports=none hydra.run.dir=build/compiled > /dev/null

# What a run needs; what tests, checks and documentation need besides, in the same environment.
$(RUN_READY): requirements.lock pyproject.toml
	@$(SUPPORTED)
	@$(PYTHON) release/environment.py "$(VENV)" run

$(READY): requirements-dev.lock requirements.lock pyproject.toml
	@$(SUPPORTED)
	@$(PYTHON) release/environment.py "$(VENV)" dev

$(RUN_READY)-%: $(RUN_READY)
	@$(PYTHON) release/environment.py "$(VENV)" $*

# Pins for all supported Python versions; no addresses or paths end up in them. PINS="--upgrade" takes new versions.
lock: $(READY)
	$(PIN) pyproject.toml -o requirements.lock
	$(PIN) --all-extras -c requirements.lock pyproject.toml -o requirements-dev.lock

clean:
	rm -rf $(VENV) build dist site .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
