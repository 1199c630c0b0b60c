# make demo     plan and test eight grasps of a rubber duck with an Allegro hand
# make test     run the tests
# make check    linters, types, import rules and tests, as CI does
# make bench    measure speed
# Each makes the virtual environment $(VENV) first, if it is missing or out of date.

PYTHON ?= python3
VENV ?= .venv
STAMP := $(VENV)/.installed
BIN := $(VENV)/bin

.PHONY: demo test check bench

demo: $(STAMP)
	$(BIN)/gdg grasp hand=allegro object=rubber_duck n=8 out=demo
	@echo "Pictures and report are in $(CURDIR)/demo:"
	@find demo -name '*.png' -o -name '*.html'

test: $(STAMP)
	$(BIN)/pytest

check: $(STAMP)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports
	$(BIN)/pytest

bench: $(STAMP)
	$(BIN)/pytest --benchmark-only

$(STAMP): pyproject.toml setup.py constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet -c constraints.txt -e '.[dev]'
	touch $(STAMP)
