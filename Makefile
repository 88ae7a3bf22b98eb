# Everything runs in .venv, which is made at need. PYTHON chooses the interpreter.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet install --constraint constraints.txt
SPHINX := $(BIN)/python -m sphinx --quiet --keep-going --doctree-dir build/doctrees
ARGS ?=
# As the commands do for themselves: matrices are small here, and threads that wait for each other take most of the time.
export OPENBLAS_NUM_THREADS ?= 1

.DEFAULT_GOAL := help
.PHONY: help figures test test-slow test-lowest test-newest check check-release format bench claims report data findings pages notebook docs docs-links mutants clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-13s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

figures: $(VENV)/.run  ## both experiments: every figure and table under reports/
	$(BIN)/tendonrepro reproduce $(ARGS)

test: $(VENV)/.test  ## the test suite, offline, a few minutes
	$(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 --dist loadfile $(ARGS)

test-slow: $(VENV)/.test  ## the tests that take longer
	$(BIN)/python -m pytest -m "slow and not network" $(ARGS)

# What uses a library. The other quick tests need the equations, the pages or the benchmarks alone.
VERSIONS_TESTS := tests --ignore=tests/physics --ignore=tests/docs --ignore=tests/benchmarks
RESOLUTION_lowest := lowest-direct
RESOLUTION_newest := highest

test-lowest: build/lowest/.test  ## quick tests with the lowest versions that pyproject.toml allows
	build/lowest/$(notdir $(BIN))/python -m pytest --numprocesses auto --maxprocesses 4 --dist loadfile $(VERSIONS_TESTS) $(ARGS)

test-newest: build/newest/.test  ## quick tests with the newest versions that there are
	build/newest/$(notdir $(BIN))/python -m pytest --numprocesses auto --maxprocesses 4 --dist loadfile $(VERSIONS_TESTS) $(ARGS)

# pip has no way to ask for the lowest versions; uv has.
build/%/.test: pyproject.toml | $(VENV)/.python
	rm -rf build/$* && $(PYTHON) -m venv build/$*
	build/$*/$(notdir $(BIN))/python -m pip --disable-pip-version-check --quiet install --constraint constraints.txt uv
	build/$*/$(notdir $(BIN))/uv pip install --quiet --python build/$* --resolution $(RESOLUTION_$*) --editable ".[test]"
	@touch $@

check: $(VENV)/.dev  ## lint, format, types, architecture
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m pytest --quiet tests/test_architecture.py

check-release: $(VENV)/.test  ## are the stored results of today's readings, claims, configuration and physics?
	$(BIN)/python -m pytest -m release $(ARGS)

format: $(VENV)/.dev  ## put the code into its format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(VENV)/.run  ## speed and memory, one JSON object
	$(BIN)/python benchmarks/bench.py

claims: $(VENV)/.run  ## the verdict on every printed number and claim, from what lies under reports/
	$(BIN)/tendonrepro claims $(ARGS)

report: $(VENV)/.run  ## one HTML file for a reviewer, of what lies under reports/
	$(BIN)/tendonrepro report $(ARGS)

data: $(VENV)/.run  ## the paper's data set from its repository, into data/zenodo; uses the network
	$(BIN)/tendonrepro data fetch $(ARGS)

findings: $(VENV)/.test  ## docs/results, and from it the made parts of findings.md and tables.md, and their pictures
	$(BIN)/python docs/generate.py reports

pages: $(VENV)/.run  ## the parts of docs that are made from configurations, readings and commands
	$(BIN)/python docs/pages.py

notebook: $(VENV)/.test  ## the notebook of examples run again
	$(BIN)/python docs/notebook.py

docs: $(VENV)/.docs  ## the site, build/docs/index.html, offline
	@rm -rf docs/api build/docs build/doctrees
	$(SPHINX) -W -n -b html docs build/docs $(ARGS)

docs-links: $(VENV)/.docs  ## the links of the pages that lead elsewhere; uses the network
	$(SPHINX) -b linkcheck docs build/links $(ARGS)

mutants: $(VENV)/.test  ## mutation run over the physics, half an hour
	$(PIP) mutmut
	$(BIN)/mutmut run $(ARGS)
	@$(BIN)/mutmut results

clean:  ## remove the environment and caches, keep results
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache .hypothesis build dist docs/api mutants

$(VENV)/.python:
	@$(PYTHON) -c "import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v < (3, 15) else 'tendonrepro needs Python 3.11 to 3.14, this is %d.%d: make PYTHON=python3.12 ...' % v)"
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.run: $(VENV)/.python pyproject.toml constraints.txt
	$(PIP) --editable .
	@touch $@

$(VENV)/.test: $(VENV)/.run
	$(PIP) --editable ".[test]"
	@touch $@

$(VENV)/.dev: $(VENV)/.test
	$(PIP) --editable ".[test,dev]"
	@touch $@

$(VENV)/.docs: $(VENV)/.run
	$(PIP) --editable ".[docs]"
	@touch $@
