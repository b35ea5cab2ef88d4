# Two commands are enough: `make demo` and `make test`. Both set up .venv on their first run.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.installed
# the tests in up to four processes, so each with one thread; they and the commands that they start
# read compiled modules, whatever the shell says
PYTEST := OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= \
	"$(BIN)/python" -m pytest -n auto --maxprocesses 4 \
	--no-loadscope-reorder

.PHONY: demo test validate bench docs style lint clean

demo: $(READY)
	"$(BIN)/python" -m palpmap demo

test: style
	$(PYTEST)

style: $(READY)
	"$(BIN)/ruff" check .
	"$(BIN)/ruff" format --check .

# pyright is one of the long tests, too: tests/test_types.py
lint: style
	"$(BIN)/pyright"

validate: $(READY)
	$(PYTEST) -m "slow or not slow"
	"$(BIN)/python" benchmarks/validate.py

docs: $(READY)
	NO_MKDOCS_2_WARNING=1 "$(BIN)/python" -m mkdocs build --strict

bench: $(READY)
	"$(BIN)/python" benchmarks/run.py

$(READY): pyproject.toml
	$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and 'palpmap needs Python 3.11 or newer: make PYTHON=python3.12 ...')"
	$(PYTHON) -m venv "$(VENV)"
	"$(BIN)/python" -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	touch "$(READY)"

clean:
	rm -rf "$(VENV)" build site *.egg-info .pytest_cache .ruff_cache .hypothesis
