# make run          install into .venv and open the dashboard; ARGS="--port 8090"
# make test         install, compile kernels, find a browser, run all tests; ARGS="-k hybrid"
# make test-fast    tests that take seconds, for the inner loop: no browser, no processes, no long simulations
# make check        lint, format, types, import rules, whether planted mistakes fit the sources and their document
# make bench        measure speed, pacing and memory, write docs/performance.md; ARGS="--quick", ARGS="--only step"
# make evidence     every number and figure of docs/evidence.md anew
# make soak         an hour in company, written to docs/reliability.md; ARGS="--minutes 10 --no-write"
# make soak-shared  the same for a server with sessions behind its gateway
# make mutations    planted mistakes, and which of them the tests see; ARGS="--only task_space"
# make fuzz         every parser fed with what breaks parsers; ARGS="--seconds 60 --only formula urdf"
# make screenshots  docs/screenshots/ anew
# make constraints  constraints.txt anew, every package at its newest version
# make clean        remove what these made

PYTHON ?= $(shell for python in python3 python3.13 python3.12 python3.11; do \
	$$python -c 'import sys, ensurepip, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
	&& command -v $$python && break; done)
BIN := .venv/bin

# The matrices are small: BLAS threads only take the cores from the loop and the page.
export OMP_NUM_THREADS = 1
# Tests and benchmarks start hundreds of processes: without bytecode on disk each would compile the program anew, for a
# third of a second. Empty counts as unset.
export PYTHONDONTWRITEBYTECODE =

.PHONY: run test test-browser test-others test-fast kernels browser check bench evidence soak soak-shared mutations fuzz screenshots constraints clean

run: .venv/run.stamp
	@$(BIN)/vsmrc serve $(ARGS)

# Kernels need only what runs: they are compiled while what tests need is still being installed. Then both kinds of
# tests run at once, since those of the browser mostly wait for it.
test:
	@$(MAKE) --no-print-directory --jobs 2 browser kernels
	@echo "Two parts run at once; each shows what it printed when it has ended"
	@rm -rf build/tests
	@$(MAKE) --no-print-directory --jobs 2 --output-sync=line test-browser test-others \
		|| { $(BIN)/python -m drivers.failures build/tests/browser.xml build/tests/others.xml; exit 1; }
	@grep -qs "<testcase" build/tests/*.xml || { echo "No test was run" >&2; exit 1; }

test-browser:
	$(BIN)/python -m pytest -n 2 --dist worksteal -m browser --junitxml=build/tests/browser.xml $(or $(ARGS),tests/browser) || test $$? -eq 5

test-others:
	$(BIN)/python -m pytest -n 3 --dist worksteal --ignore tests/browser -m "not browser" --junitxml=build/tests/others.xml $(ARGS) || test $$? -eq 5

test-fast: .venv/dev.stamp kernels
	$(BIN)/python -m pytest -n 2 --dist worksteal --ignore tests/browser -m "not slow" $(ARGS)

kernels: .venv/run.stamp
	@$(BIN)/python -m drivers.kernels

browser: .venv/dev.stamp
	@$(BIN)/python -m drivers.browser

check: .venv/dev.stamp
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright
	$(BIN)/lint-imports --no-logo
	$(BIN)/python -m benchmarks.mutations --check

bench: browser
	@$(BIN)/python -m benchmarks $(ARGS)

evidence: .venv/dev.stamp
	$(BIN)/python -m app figures --out docs $(ARGS)

soak: .venv/dev.stamp
	@$(BIN)/python -m benchmarks.soak $(ARGS)

soak-shared: .venv/dev.stamp
	@$(BIN)/python -m benchmarks.soak_shared $(ARGS)

mutations: .venv/dev.stamp
	@$(BIN)/python -m benchmarks.mutations $(ARGS)

fuzz: .venv/dev.stamp
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[fuzz]"
	@$(BIN)/python -m fuzzing $(ARGS)

screenshots: browser
	$(BIN)/python -m docs.make_screenshots $(ARGS)

.venv/run.stamp: pyproject.toml constraints.txt
	@python="$(PYTHON)"; test -n "$$python" || { \
		echo "No Python 3.11 or newer with venv found: install one (Debian: apt install python3-venv)" \
			"or name it: make PYTHON=/path/to/python" >&2; exit 1; }; \
	echo "Installing into .venv with $$python"; "$$python" -m venv .venv
	$(BIN)/python -m pip install --constraint constraints.txt --editable .
	@touch $@

.venv/dev.stamp: .venv/run.stamp
	$(BIN)/python -m pip install --constraint constraints.txt --editable ".[dev,bench,cluster]"
	@touch $@

# A fresh environment, so that nothing installed by hand slips in; `pip list` gives names and versions, never an address.
constraints:
	$(PYTHON) -m venv --clear build/constraints
	build/constraints/bin/python -m pip install --editable ".[dev,bench,cluster,fuzz]"
	echo "# Written by 'make constraints': versions that were tested together." > constraints.txt
	build/constraints/bin/python -m pip list --format freeze --exclude pip --exclude-editable >> constraints.txt
	rm -rf build/constraints

clean:
	rm -rf .venv build dist *.egg-info .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -prune -exec rm -rf {} +
