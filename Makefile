# Needs python3 (3.10 to 3.13, with venv) and make; everything else goes into .venv.

PYTHON ?= python3
WORKERS ?= 2
VENV := .venv
PY := $(VENV)/bin/python
INSTALLED := $(VENV)/.installed

# The tests run side by side; each keeps to one thread.
TEST_ENV := NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1

.PHONY: help install lint types unit test acceptance demo bench clean

help:
	@echo "make demo        calibrate a simulated camera and write a report"
	@echo "make test        style, types and tests, as .ci/run does"
	@echo "make lint        style alone"
	@echo "make types       types alone"
	@echo "make unit        tests alone"
	@echo "make acceptance  whole calibrations of the real captures, if ../shared is there"
	@echo "make bench       seconds and megabytes on this machine, into benchmarks/results"
	@echo "make clean       remove .venv and everything that was built"

install: $(INSTALLED)

$(INSTALLED): pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null || { \
	  echo "There is no $(PYTHON). Install Python 3.10 to 3.13, or name it: make PYTHON=python3.12"; \
	  exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' || { \
	  echo "$(PYTHON) is $$($(PYTHON) -V 2>&1). Needed: 3.10 to 3.13, e.g. make PYTHON=python3.12"; \
	  exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "$(PYTHON) cannot make virtual environments. On Debian and Ubuntu: apt-get install python3-venv"; \
	  exit 1; }
	test -x $(PY) || $(PYTHON) -m venv $(VENV)
	$(PY) -m pip install --quiet --constraint constraints.txt torch
	$(PY) -m pip install --quiet --constraint constraints.txt --editable ".[all,dev]"
	touch $@

lint: $(INSTALLED)
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .

types: $(INSTALLED)
	PYRIGHT_PYTHON_IGNORE_WARNINGS=1 $(PY) -m pyright

unit: $(INSTALLED)
	$(TEST_ENV) $(PY) -m pytest -q -n $(WORKERS)

test: lint types unit

acceptance: $(INSTALLED)
	$(PY) -m pytest -q -m acceptance tests/acceptance

demo: $(INSTALLED)
	$(PY) -m easyhecpp demo

# embree, which one of the benchmarks compares with, is needed by nothing else.
bench: $(INSTALLED)
	-$(PY) -m pip install --quiet embreex
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) benchmarks/run.py

clean:
	rm -rf $(VENV) src/easyhecpp/__pycache__ .pytest_cache .ruff_cache .hypothesis build dist
