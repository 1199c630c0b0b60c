# make demo     plan and test eight grasps of a rubber duck with an Allegro hand
# make test     run the tests
# make check    linters, types, import rules and tests, as CI does
# make bench    measure speed
# Each makes the virtual environment $(VENV) first, if it is missing or out of date.

PYTHON ?= python3
VENV ?= .venv
STAMP := $(VENV)/.installed
BIN := $(VENV)/bin
# one test process per core, up to two: more than that need more memory than laptops have
PARALLEL ?= --numprocesses 2 --dist worksteal

.PHONY: demo test check bench

demo: $(STAMP)
	$(BIN)/gdg grasp hand=allegro object=rubber_duck n=8 out=demo
	@echo "Pictures and report are in $(CURDIR)/demo:"
	@find demo -name '*.png' -o -name '*.html'

test: $(STAMP)
	$(BIN)/pytest $(PARALLEL)

check: $(STAMP)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports
	$(BIN)/pytest $(PARALLEL)

bench: $(STAMP)
	$(BIN)/pytest --benchmark-only

$(STAMP): pyproject.toml setup.py constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet -c constraints.txt -e '.[dev]'
	touch $(STAMP)
