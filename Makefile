# plumbline: `make diagnose` shows a verdict, `make test` proves it. `make help` lists the rest.
#
# A virtual environment is made in .venv the first time, and again when pyproject.toml changes.
# Settings: PYTHON (the interpreter to start from), WORKERS (of the tests), FOLDER (a recording).

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory --no-builtin-rules
.SUFFIXES:
.DELETE_ON_ERROR:

PYTHON ?= python3
WORKERS ?= 2
VENV := .venv
BIN := $(VENV)/bin
FOLDER ?= plumbline/experiments/recordings/bench-ur5
PACKAGES := plumbline
NOTEBOOKS := $(wildcard notebooks/*.ipynb)

# The linear algebra is small: threads of their own would only fight the workers.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: help diagnose test lint docs notebooks bench compare dist clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(firstword $(MAKEFILE_LIST))

diagnose: $(VENV)/.installed-core ## the verdict on a recording: FOLDER=..., or a bundled one
	@mkdir -p results
	@"$(BIN)/python" -m plumbline diagnose "$(FOLDER)" \
		--report "results/$$(basename "$(FOLDER)").html" --overwrite

test: export PYTHONDONTWRITEBYTECODE := # or each process that a test starts compiles all anew
test: $(VENV)/.installed-test ## all tests and notebooks
	@"$(BIN)/python" -m pytest -q -n $(WORKERS) --dist loadfile \
		--no-loadscope-reorder --nbmake $(NOTEBOOKS) tests

lint: $(VENV)/.installed-lint ## ruff (rules and format) and mypy
	@"$(BIN)/ruff" check --quiet .
	@"$(BIN)/ruff" format --check --quiet . \
		|| { echo "Some files are not formatted; run: $(BIN)/ruff format ." >&2; exit 1; }
	@"$(BIN)/mypy" --no-error-summary
	@echo "lint: clean"

docs: $(VENV)/.installed-docs ## the documents as HTML, in results/docs; a warning is an error
	@mkdir -p results
	@"$(BIN)/python" -m sphinx -q -W --keep-going -b html -d build/doctrees docs results/docs
	@echo "docs: results/docs/index.html"

notebooks: $(VENV)/.installed-test ## run the notebooks and store them with light outputs
	@"$(BIN)/python" docs/store_notebooks.py $(NOTEBOOKS)

bench: $(VENV)/.installed-core ## time and memory of the central computations
	@"$(BIN)/python" -m plumbline.experiments.benches.central
	@"$(BIN)/python" -m plumbline.experiments.benches.mpc

compare: $(VENV)/.installed-compare ## beside the peers, each in an environment of its own
	@mkdir -p results
	@"$(BIN)/python" -m plumbline.experiments.compare --json results/compare.json \
		--out docs/compare.md

# The wheel is built from the sdist, and tried away from the sources by what a first user does.
dist: export PYTHONPATH := # what lies there would count as installed
dist: ## sdist and wheel in results/dist, tried in an environment of their own
	@rm -rf results/dist build/dist && mkdir -p results/dist build/dist
	@"$(PYTHON)" -m venv build/dist/env
	@build/dist/env/bin/python -m pip install -qq --disable-pip-version-check build
	@build/dist/env/bin/python -m build --outdir results/dist . > build/dist/build.log \
		|| { tail -20 build/dist/build.log >&2; exit 1; }
	@"$(PYTHON)" -m venv --clear build/dist/env
	@build/dist/env/bin/python -m pip install -qq --disable-pip-version-check results/dist/*.whl
	@cd build/dist && export PATH="$$PWD/env/bin:$$PATH" && plumbline --version \
		&& bench="$$(python -c 'import plumbline; print(plumbline.__path__[0])')" \
		&& plumbline new try --robot ur5 --quiet \
		&& plumbline diagnose "$$bench/experiments/recordings/bench-ur5" --quiet \
			--json try.json --report try.html && test -s try.html
	@echo "dist: $$(cd results/dist && echo *)"

clean: ## remove the environment, results and caches
	@rm -rf $(VENV) results build *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	@find $(PACKAGES) tests notebooks -name __pycache__ -prune -exec rm -rf {} +

$(BIN)/python:
	@version="$$("$(PYTHON)" --version 2>/dev/null)" || version="not there"; \
	"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
		echo "plumbline needs Python >= 3.11, but '$(PYTHON)' is $$version;" \
			"name another: make ... PYTHON=python3.12" >&2; exit 1; }
	@echo "Making $(VENV) with $$("$(PYTHON)" --version) ..."
	@"$(PYTHON)" -m venv --clear $(VENV) || { rm -rf $(VENV); exit 1; }

# One stamp for each set of dependencies: core, test, lint. The stem picks the extra.
$(VENV)/.installed-%: pyproject.toml | $(BIN)/python
	@echo "Installing plumbline and its '$*' dependencies (a minute or two, once) ..."
	@"$(BIN)/python" -m pip install -qq --disable-pip-version-check \
		--editable ".$(if $(filter-out core,$*),[$*])"
	@touch $@
