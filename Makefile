# For a newcomer: `make demo` and `make test`. Both make the virtual environment first if it is missing.
# `make docs` builds the documentation, `make notebooks` runs its notebooks again.
# `make benchmarks` takes about ten minutes and has an environment of its own, which holds the peers as well.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed
BENCH_BIN := .venv-bench/bin
BENCH_STAMP := .venv-bench/.installed
PYTEST_ARGS ?=

.PHONY: demo test lint docs notebooks benchmarks clean
.DELETE_ON_ERROR:

demo: $(STAMP)
	@$(BIN)/cartpend demo --out build/demo

test: $(STAMP)
	@$(BIN)/pytest -n 2 --dist loadgroup -q -rs $(PYTEST_ARGS)

lint: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright --pythonpath $(BIN)/python

docs: $(STAMP)
	@$(BIN)/sphinx-build -W --keep-going -q -b html docs build/docs
	@echo 'Open build/docs/index.html.'

notebooks: $(STAMP)
	@$(BIN)/python docs/run_notebooks.py

benchmarks: $(BENCH_STAMP)
	$(BENCH_BIN)/python tests/benchmarks/scale.py --write docs/benchmarks.md
	$(BENCH_BIN)/python tests/benchmarks/simulate.py --write docs/benchmarks.md

clean:
	rm -rf .venv .venv-bench build dist docs/_build docs/reference/generated .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("cartpend_dae needs Python 3.11 or newer, but $(PYTHON) is %d.%d. Name another one: make PYTHON=python3.11" % sys.version_info[:2] if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@

$(BENCH_STAMP): pyproject.toml
	$(PYTHON) -m venv .venv-bench
	$(BENCH_BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[bench]'
	@touch $@
