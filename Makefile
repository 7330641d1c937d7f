# `make help` lists the targets. demo and desk install requirements.lock into .venv, the others requirements-dev.lock,
# which has more: with uv, which is fetched if it is not on PATH, else with pip (release/environment.py).
# Another interpreter: make demo PYTHON=python3.12

PYTHON ?= python3
VENV ?= .venv
ARGS ?=
CASES ?= 100000
DIST ?= dist
LEVEL ?= day
KINDS ?=
SEED ?= $(shell date -u +%F)
NUMBER = $(subst -,,$(SEED))
COUNT ?= 100
SECONDS ?= 60
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

.PHONY: help docs-numbers demo desk test test-fast test-all test-night test-night-tests test-sample coverage coverage-report fuzz guided mutants faults planted-faults bench ratios corpus scale gallery peers lint types docs dist archives lock install clean
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

help: ## these lines
	@awk -F ': .*## ' '/^[a-z-]+:.*## / { printf "  make %-16s %s\n", $$1, $$2 }' Makefile


demo: $(RUN_READY) ## install what a run needs, and plan the first mission, offline, on the packaged wind
	@$(BIN)/python release/demo.py

desk: $(RUN_READY)-serve ## draw missions and plan them in a browser
	$(BIN)/pareto-ltl serve

test: $(READY) ## the tests of the day, some minutes; ARGS="tests/planning" goes to pytest
	PARETO_LTL_TESTS=$(LEVEL) $(BIN)/python -m pytest -n logical $(ARGS)

test-fast: $(READY) ## the tests that run no kernel and start no process, in seconds
	PARETO_LTL_TESTS=fast $(BIN)/python -m pytest -n logical $(ARGS)

test-all: $(READY) ## those before a change is taken in; ARGS="-n 2"
	$(BIN)/python -m pytest $(ARGS)

test-night: test-night-tests ## all, with fuzz, killed runs, the corpus and coverage (tests/levels.py)
	$(MAKE) fuzz guided mutants faults corpus coverage

test-night-tests: $(READY) ## the tests of test-night alone
	PARETO_LTL_TESTS=night $(BIN)/python -m pytest -n logical $(ARGS)

# A failure is repeated with the same SEED, which is printed.
test-sample: $(READY) ## a tenth of what only the night runs, for a minute; SEED=2026-11-28, the date of today
	@echo "SEED=$(SEED)"
	PARETO_LTL_TESTS=night PARETO_LTL_SAMPLE=$(SEED) $(BIN)/python -m pytest -n logical $(ARGS)

coverage: $(READY) ## which lines the tests run; kernels count where they run uncompiled
	rm -rf $(COVERAGE) && mkdir -p $(COVERAGE)
	COVERAGE_FILE=$(COVERAGE)/data.compiled $(BIN)/python -m pytest --cov --cov-report= $(ARGS)
	NUMBA_DISABLE_JIT=1 COVERAGE_FILE=$(COVERAGE)/data.kernels $(BIN)/python -m pytest --cov --cov-report= $(ARGS) $(UNCOMPILED)
	$(MAKE) --no-print-directory coverage-report

coverage-report: $(READY)
	COVERAGE_FILE=$(COVERAGE)/data $(BIN)/coverage combine --quiet $(COVERAGE)
	COVERAGE_FILE=$(COVERAGE)/data $(BIN)/coverage report --fail-under=92

fuzz: $(READY) ## read CASES=100000 spoilt files and texts of every kind; ARGS="scenes automata" for some
	cd tests && "$(abspath $(BIN))/python" -m fuzz.harness --cases $(CASES) $(ARGS)

guided: $(READY) ## fuzz led by the lines that cases reach, SECONDS=60 of each reader; SEED=7; ARGS="--keep telemetry"
	$(BIN)/uv pip install --quiet --python $(BIN)/python --require-hashes -r tests/fuzz/requirements.txt
	@echo "SEED=$(NUMBER)"
	cd tests && "$(abspath $(BIN))/python" -m fuzz.guided --seconds $(SECONDS) --seed $(NUMBER) $(ARGS)

mutants: $(READY) ## would the tests notice a fault? COUNT=100 mutants that stay the same, and as many drawn by SEED
	@echo "SEED=$(SEED)"
	cd tests && "$(abspath $(BIN))/python" -m mutants.harness --count $(COUNT) --seed 0 $(SEED) -- $(ARGS)

faults: $(READY) ## kill runs and sweeps at 200 random moments each, half an hour
	PARETO_LTL_FAULTS=200 $(BIN)/python -m pytest tests/run/test_faults.py -v $(ARGS)

planted-faults: $(READY) ## is every gate red with a fault that is planted for it? ARGS="types links", ARGS=--all
	$(BIN)/python release/planted_faults.py $(ARGS)

bench: $(READY) ## compare speeds with their budgets
	$(BIN)/python -m pytest benchmarks/bench_*.py $(ARGS)

ratios: $(READY) ## CPU time of runs over that of imports, and of the first run in empty caches over the second
	$(BIN)/python -m pytest benchmarks/bench_run.py -k "ratios or warm_process" $(ARGS)

corpus: $(READY) ## plan 100 missions with five seeds each, many hours; ARGS="--tenth --seeds 0,1" for a few
	cd benchmarks && "$(abspath $(BIN))/python" -m corpus $(ARGS)

scale: $(READY) ## seconds and memory against the size of a problem; ARGS="states steps" for some
	cd benchmarks && "$(abspath $(BIN))/python" -m scale $(ARGS)

gallery: $(READY) ## plan the missions of docs/gallery.md anew, and draw them; some minutes
	$(BIN)/python benchmarks/gallery.py $(ARGS)

# A peer that cannot be installed here is left out of the comparison.
peers: $(READY) ## compare with OMPL, Drake and MONA, each in its environment (docs/peers.md)
	-$(MAKE) --keep-going $(PEERS)/ompl $(PEERS)/drake $(PEERS)/mona
	PYTHONPATH=benchmarks $(BIN)/python -m peers.compare $(ARGS)

$(PEERS)/%: benchmarks/peers/requirements-%.txt
	$(PYTHON) -m venv --clear $@
	$@/bin/python -m pip install --quiet --disable-pip-version-check -r $< || { rm -rf $@; exit 1; }
	@touch $@

lint: $(READY) ## ruff, which module may import which, docs at 100 columns
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports
	$(BIN)/python release/waist.py
	$(BIN)/python release/wrap_docs.py --check

types: $(READY) ## mypy --strict
	$(BIN)/mypy

# Machine code is for this Python and numba (RELEASING.md).
dist: archives ## the source archive, the wheel, and the wheel with machine code; KINDS="full paper" for some kinds
	$(BIN)/python release/machine_code.py $(DIST)/*-py3-none-any.whl $(if $(KINDS),--kinds $(KINDS))

archives: $(READY)
	$(BIN)/python -m build --outdir $(DIST) .

docs: $(READY) ## the site of the documentation, into site/
	$(BIN)/python release/docs_site

docs-numbers: $(READY) ## the outputs that README and documents show, made anew
	$(BIN)/python release/docs_numbers.py

install: $(READY) ## the environment for development, with the kernels of default runs compiled
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

# No addresses or paths end up in the pins.
lock: $(READY) ## pins for all supported Python versions; PINS="--upgrade" takes new versions
	$(PIN) pyproject.toml -o requirements.lock
	$(PIN) --all-extras -c requirements.lock pyproject.toml -o requirements-dev.lock

clean: ## remove what the other targets made
	rm -rf $(VENV) build dist site .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
