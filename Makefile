# make reproduce | test | test-slow | coverage | bench | lint | docs; see README.md
PYTHON ?= python3
PROFILE ?= quick
TASK ?=
PHYSICS ?=
OUT ?= results/$(PROFILE)
VENV := .venv
BIN := $(VENV)/bin
# A file of tests is one process's, in the order that conftest.py gives the files.
ON_TWO := -n 2 --dist loadfile --no-loadscope-reorder

.PHONY: reproduce test test-slow coverage bench lint docs clean
.DEFAULT_GOAL := reproduce

# The stamp is newer than pyproject.toml as long as what is installed is what it asks for.
$(VENV)/installed: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "qboot needs Python 3.11 or newer, this is " + sys.version.split()[0] + ": make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $@

reproduce: $(VENV)/installed
	$(BIN)/qboot reproduce --profile $(PROFILE) $(if $(TASK),--task $(TASK)) $(if $(PHYSICS),--physics $(PHYSICS)) --out $(OUT)

test: $(VENV)/installed
	$(BIN)/pytest $(ON_TWO)

test-slow: $(VENV)/installed
	$(BIN)/pytest -m slow

# Lines of qboot/ that the tests run.
coverage: $(VENV)/installed
	$(BIN)/pytest $(ON_TWO) --cov --cov-report=term:skip-covered

bench: $(VENV)/installed
	$(BIN)/python experiments/bench.py

lint: $(VENV)/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(VENV)/installed
	$(BIN)/mkdocs build --quiet
	@echo site/index.html

clean:
	rm -rf $(VENV) results site
