# Two commands: `make test` and `make nightly`. Both set everything up in .venv; they need Python >= 3.11 and make.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
MINUTES ?= 3
SEED ?=
OUT ?= reports/latest
ENGINES := exudyn,pinocchio,mujoco
# A worker for each processor: threads of linear algebra would only wait for each other, and take twice as long.
ONE_THREAD := OPENBLAS_NUM_THREADS=1
PYTEST := $(ONE_THREAD) $(BIN)/python -m pytest -n auto

.PHONY: test docs mutants mutation nightly lint types clean

test: $(READY) lint types
	$(PYTEST) tests

# The book, in docs/_build/html/index.html; a warning is a failure.
docs: $(READY)
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

# Each wrong formula of the documents, and more of their kinds, put in: a test has to see it. Part of `make test`.
mutants: $(READY)
	$(PYTEST) tests/mutation/test_mutants.py

# A seeded sample of random mutants over refkin and the judging code, in at most 20 minutes on two cores. Which tests
# reach what is noted first, in .mutation.json.gz, and again only for test files that changed.
mutation: $(READY)
	$(ONE_THREAD) $(BIN)/python -m tests.mutation.sample $(if $(SEED),--seed $(SEED))

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy refkin crosscheck

# A finished run makes room for a new one (nothing else is removed); one that was killed is resumed.
nightly: $(READY)
	$(BIN)/crosscheck nightly --fresh --minutes $(MINUTES) $(if $(SEED),--seed $(SEED)) --engines $(ENGINES) \
		--require-engines $(ENGINES) --out "$(OUT)"

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[engines,cluster,docs,dev]"
	@touch $@

clean:
	rm -rf $(VENV) .mutation.json.gz reports/latest .pytest_cache .mypy_cache .ruff_cache .hypothesis
