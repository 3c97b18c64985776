# `make figures` and `make test` need Python 3.10 or newer and nothing else; each makes .venv first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
FIGURES := variance montecarlo sensitivity budget

.PHONY: figures test lint format clean

# The runtime packages are enough for the figures; what tests and linting need is installed with them.
$(VENV)/installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
		|| { echo "radar-sense needs Python 3.10 or newer; try make PYTHON=python3.12" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/installed-dev: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

figures: $(VENV)/installed
	@for analysis in $(FIGURES); do \
		$(BIN)/radar-sense $$analysis --out figures --format pdf --format png || exit; \
	done
	@$(BIN)/radar-sense compare --level high --runs 200000 \
		--out figures --format pdf --format png
	@# 3: the answer is that the paper's linearization is not valid at every angle
	@$(BIN)/radar-sense validate --digits 1 --out figures --format pdf --format png || test $$? = 3

test: $(VENV)/installed-dev
	$(BIN)/python -m pytest -n auto

lint: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/installed-dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
