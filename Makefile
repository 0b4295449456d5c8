# Everything from a bare machine with Python 3.11–3.13 and make: each target sets up .venv first, and reuses it
# until pyproject.toml or constraints.txt change.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help

BIN := .venv/bin
# The pins hold for what pip installs and for what it builds with (older and newer pip read different names).
export PIP_CONSTRAINT := constraints.txt
export PIP_BUILD_CONSTRAINT := constraints.txt
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
SUITABLE := import sys, venv, ensurepip; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist loadfile --no-loadscope-reorder
PYTHON ?= $(shell for python in python3 python3.13 python3.12 python3.11 python; do \
	if $$python -c '$(SUITABLE)' 2>/dev/null; then echo $$python; break; fi; done)

.PHONY: help demo test coverage quick long slicer lint format clean

help:  ## this list
	@grep -E '^[a-z]+: .*##' Makefile | sed -E 's/^([a-z]+):.*## /make \1\t/' | expand -t 14

demo: .venv/.compiled  ## a nose, pictures of it, a network trained on them, a report: about five minutes
	$(BIN)/naris demo

test: lint  ## all checks, and all tests but the long ones
	$(PYTEST)

coverage: .venv/.installed-dev  ## all tests, and which lines none of them reaches (a quarter slower)
	$(PYTEST) -m "" --cov --cov-report=term

quick: .venv/.installed-dev  ## the tests that take no time
	$(PYTEST) -m "not slow"

long: .venv/.installed-dev  ## the tests that take too long for every change: benchmarks in small, many noses
	$(PYTEST) -m long

slicer: .venv/.installed-dev .venv-slicer/.installed  ## what 3D Slicer's own readers make of our files (1 GB)
	$(BIN)/python -m pytest tests/test_slicer.py

lint: .venv/.installed-dev  ## style, types, import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: .venv/.installed-dev  ## lay the code out
	$(BIN)/ruff check --fix-only .
	$(BIN)/ruff format .

clean:  ## remove the environment, caches and outputs
	rm -rf .venv .venv-slicer build dist out htmlcov coverage.xml .coverage .coverage.* .pytest_cache .mypy_cache .ruff_cache \
		.hypothesis .import_linter_cache
	find src tests examples benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/.python:
	@if [ -z "$(PYTHON)" ]; then \
		echo "naris needs Python 3.11, 3.12 or 3.13 with the venv module on the PATH (or make PYTHON=/path/to/python)" >&2; \
		exit 1; fi
	@if ! $(BIN)/python -c '$(SUITABLE)' 2>/dev/null; then $(PYTHON) -m venv --clear .venv; fi
	@touch $@

.venv/.installed: .venv/.python pyproject.toml constraints.txt
	$(PIP) -e .
	@touch $@

# The renderer is compiled when it is first used, which takes half a minute.
.venv/.compiled: .venv/.installed
	$(BIN)/python -c "from naris.anatomy.builtin import built_in_nose as nose; from naris.render.scene import Scene; Scene(nose())"
	@touch $@

.venv/.installed-dev: .venv/.python pyproject.toml constraints.txt
	$(PIP) -e '.[dev]'
	@touch .venv/.installed $@

# Apart from ours, whose VTK is another.
.venv-slicer/.installed: .venv/.python
	$(BIN)/python -m venv --clear .venv-slicer
	PIP_CONSTRAINT= .venv-slicer/bin/python -m pip install --quiet --disable-pip-version-check slicer-core==5.13.31053.0
	@touch $@
