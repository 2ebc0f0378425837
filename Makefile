# Everything runs in .venv, which the first target that needs it makes: nothing but Python 3.11 or newer and a package
# index is required. `make help` lists the targets. PYTHON=/path/to/python chooses the interpreter.

SHELL := /bin/sh
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

PYTHON ?=
BIN := .venv/bin
STAMP := .venv/ready
FLIGHT ?= data/sample_flight/flight.toml
OUT ?= out/demo
ARGS ?=
NOTEBOOKS ?= notebooks/*.ipynb
# Tests start more than a hundred processes; where the environment forbids byte code, each would compile every module
# anew. Two files run at a time: threads of the linear algebra beside them would spin for a core that they do not get.
TESTING := PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1

.PHONY: help setup demo test test-bounds test-lowest test-wheel coverage notebooks pair docs lint check-rules check-format check-types check-imports format bench clean

help:  ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-11s %s\n", $$1, $$2 }' Makefile

setup: $(STAMP)  ## make .venv and install the package with its test tools

demo: $(STAMP)  ## replay the sample flight, print the summary, write the run and its page to out/demo
	$(BIN)/insgnss replay "$(FLIGHT)" --output "$(OUT)" --report "$(OUT)/report.html"

test: $(STAMP)  ## run the whole test suite, two files at a time (ARGS='-n 0 -k jacobian' to choose)
	$(TESTING) $(BIN)/python -c "from insgnss.runs.first_run import main; main()"
	$(TESTING) $(BIN)/python -m pytest -n 2 --dist loadfile $(ARGS)

# What computes indices: filter, point solution, antennas, a replay of wild numbers. Code with bounds checks has a cache
# of its own (insgnss/kernels/jit.py). Every test of the suite may run so, but not in a few minutes. The sample calls of
# the kernels need it least: tests/test_jit.py runs each as plain Python too, where NumPy checks every index.
BOUNDS := tests/filter/test_soundness.py tests/filter/test_gating.py tests/filter/test_faults.py \
    tests/filter/test_scalar_update.py tests/gnss/test_point_integrity.py tests/gnss/test_plausible_messages.py \
    tests/gnss/test_glonass_orbit.py tests/gnss/test_troposphere.py tests/antenna/test_gain_pattern.py \
    tests/antenna/test_visibility.py tests/runs/test_wild_cells.py

# Nearly all of its time is compiling: the lists of kernels first, in a process a core, then the rest test by test.
test-bounds: $(STAMP)  ## run what computes indices with every index checked (NUMBA_BOUNDSCHECK=1)
	NUMBA_BOUNDSCHECK=1 $(TESTING) $(BIN)/python -c "from insgnss.runs.first_run import main; main()"
	NUMBA_BOUNDSCHECK=1 $(TESTING) $(BIN)/python -m pytest -n 2 --dist worksteal $(BOUNDS) $(ARGS)

# By hand, before a release: makes an environment of its own in build/. Another interpreter, for which the lowest versions
# have no wheels: make test-lowest PYTHON=python3.13 ARGS=--newest
test-lowest:  ## run the tests with the lowest declared versions (ARGS='tests/log' for a part)
	$(or $(PYTHON),python3) tests/lowest_versions.py $(ARGS)

# By hand, before a release: the suite does the same with the libraries that are there, and without compiling
test-wheel: $(STAMP)  ## build sdist and wheel, install the wheel without extras in build/wheel, run its commands
	$(BIN)/python -m tests.installed_wheel

# The report leaves compiled kernels out; the last line counts them too, as tests/test_jit.py runs each of them as Python.
# A test that fails does not hide the number.
coverage: $(STAMP)  ## measure which lines the tests run (ARGS='tests/log' for a part)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input -e ".[coverage]"
	rm -rf build/coverage
	-$(TESTING) $(BIN)/coverage run -m pytest -n 2 --dist loadfile -m "not slow" $(ARGS)
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report
	@echo "lines with those of the kernels: $$($(BIN)/coverage report --rcfile=/dev/null --data-file=build/coverage/data --format=total) %"

notebooks: $(STAMP)  ## run every notebook, write them with their outputs to out/notebooks (NOTEBOOKS='notebooks/00*' to choose)
	mkdir -p out/notebooks
	$(BIN)/jupyter execute --timeout=120 --output=../out/notebooks/{notebook_name} $(NOTEBOOKS)

pair: $(STAMP)  ## write each notebook file anew from its text; the cells keep their ids
	$(BIN)/jupytext --quiet --update --to ipynb notebooks/*.py

docs: $(STAMP)  ## build the documentation site into out/site; a warning is an error
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input -e ".[docs]"
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

lint: check-rules check-format check-types check-imports  ## ruff, format, mypy --strict, import contracts

check-rules: $(STAMP)
	$(BIN)/ruff check .

check-format: $(STAMP)
	$(BIN)/ruff format --check .

check-types: $(STAMP)
	$(BIN)/mypy

check-imports: $(STAMP)
	$(BIN)/lint-imports

format: $(STAMP)  ## sort the imports, repair what ruff can, format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(STAMP)  ## run the benchmarks, add their medians to tests/benchmarks/history.csv (ARGS='-k loop' for a part)
	$(BIN)/python -m tests.benchmarks.history $(ARGS)

clean:  ## remove .venv, results and caches
	rm -rf .venv .venv.lock out build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamp is written last, so an interrupted set-up starts anew. Two makes at a time wait for each other where the
# system has flock; the second one then finds the stamp.
$(STAMP): pyproject.toml insgnss/version.py
	@if command -v flock >/dev/null 2>&1; then exec 9>.venv.lock; flock 9; fi; \
	if [ "$@" -nt pyproject.toml ] && [ "$@" -nt insgnss/version.py ]; then exit 0; fi; \
	usable='import sys, ensurepip, venv; sys.exit(sys.version_info < (3, 11))'; \
	if ! $(BIN)/python -c "$$usable" >/dev/null 2>&1; then \
	    found=; \
	    for candidate in $(if $(PYTHON),"$(PYTHON)",python3.11 python3.12 python3.13 python3.14 python3 python); do \
	        if "$$candidate" -c "$$usable" >/dev/null 2>&1; then found=$$candidate; break; fi; \
	    done; \
	    if [ -z "$$found" ]; then \
	        echo "insgnss needs Python 3.11 or newer with the venv module; none was found among:" >&2; \
	        echo "  $(if $(PYTHON),$(PYTHON),python3.11 python3.12 python3.13 python3.14 python3 python)" >&2; \
	        echo "Install one (Debian, Ubuntu: apt install python3 python3-venv), or name it: make PYTHON=/path/to/python" >&2; \
	        exit 1; \
	    fi; \
	    echo "Setting up .venv with $$found: once, about a minute"; \
	    "$$found" -m venv --clear .venv || exit 1; \
	fi; \
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input -e ".[test]" || { \
	    echo "The packages could not be installed: is a package index reachable (see 'pip config list')?" >&2; exit 1; }; \
	touch "$@"
