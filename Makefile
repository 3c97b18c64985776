# `make figures` and `make test` need Python 3.10 or newer and nothing else; each makes .venv first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT := figures

.PHONY: figures gallery test fuzz study reference docs bench lint format clean

# The runtime packages are enough for the figures; what tests and linting need is installed with them.
$(VENV)/installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
		|| { echo "radar-sense needs Python 3.10 or newer; try make PYTHON=python3.12" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

# Dependency groups need pip 25.1.
$(VENV)/pip: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=25.1'
	touch $@

$(VENV)/installed-dev: $(VENV)/pip
	$(BIN)/python -m pip install --quiet --group dev
	@# not for every platform; without it the tests in a browser are skipped
	@$(BIN)/python -m pip install --quiet --only-binary :all: --group browser \
		|| echo "playwright cannot be installed: no tests in a browser" >&2
	touch $@

# The peers of the benchmarks are large, and have no wheels for every platform: each is installed by
# itself, and where one cannot be had its rows are not measured. The stamp waits for all.
$(VENV)/installed-bench: $(VENV)/installed-dev
	@all=yes; for peer in numba jax openturns; do \
		$(BIN)/python -m pip install --quiet --only-binary :all: --group "bench-$$peer" \
			|| { all=; echo "$$peer cannot be installed: bench goes without it" >&2; }; \
	done; test -z "$$all" || touch $@

# The figures of the paper, with table and record each; --out is a folder that git ignores.
figures: $(VENV)/installed
	@for analysis in variance montecarlo sensitivity budget; do \
		$(BIN)/radar-sense $$analysis --out $(OUT) || exit; \
	done

# All that the documentation shows, in a minute of CPU; OUT=docs/figures renews the pictures of its pages.
# Exit code 3 is an answer: the threshold is passed, or the paper's linearization is not valid.
gallery: figures
	@$(BIN)/radar-sense range --p-d 0.1 --p-d 0.5 --p-d 0.9 --out $(OUT)
	@$(BIN)/radar-sense range configs/valley.yaml --step-deg 2 --out $(OUT)
	@$(BIN)/radar-sense detectors --out $(OUT)
	@$(BIN)/radar-sense convergence --out $(OUT)
	@$(BIN)/radar-sense compare --level high --out $(OUT)
	@$(BIN)/radar-sense validate --digits 1 --out $(OUT) || test $$? = 3
	@$(BIN)/radar-sense rcs configs/table.yaml --out $(OUT)
	@$(BIN)/radar-sense variance configs/path.yaml --out $(OUT)
	@$(BIN)/radar-sense map configs/path.yaml --out $(OUT)
	@$(BIN)/radar-sense variance configs/corridor.yaml --threshold 0.1 --k 3 --out $(OUT) || test $$? = 3
	@$(BIN)/radar-sense budget configs/corridor.yaml --method form --out $(OUT)
	@$(BIN)/radar-sense map configs/corridor.yaml --out $(OUT)
	@$(BIN)/radar-sense mission configs/corridor.yaml --m 3 --n 5 --runs 2500 --out $(OUT)

# The tests start many processes, which would compile every module if Python were not to keep them.
test: $(VENV)/installed-dev
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n auto --dist worksteal

# Random scenarios, files and options: make fuzz SECONDS=600 SEED=7
fuzz: $(VENV)/installed-dev
	$(BIN)/python tests/fuzz --seconds $(or $(SECONDS),60) $(if $(SEED),--seed $(SEED))

# How often a band or a verdict is wrong; make study STUDY="--poses 400 --seed 7" for a part of it.
# OUT=docs/figures renews the pictures of docs/reference_data.md.
study: $(VENV)/installed-dev
	@mkdir -p $(OUT)
	PYTHONPATH=tests $(BIN)/python tests/studies/calibration.py --out $(OUT)
	PYTHONPATH=tests $(BIN)/python tests/studies/reference_errors.py --out $(OUT)
	PYTHONPATH=tests/studies $(BIN)/python -m bands $(STUDY)
	$(BIN)/python tests/studies/mission_bounds.py

# The pages of docs/reference, and the schema in the package, from what the program declares.
reference: $(VENV)/installed
	$(BIN)/python docs/make_reference.py

docs: $(VENV)/pip
	$(BIN)/python -m pip install --quiet --group docs
	$(BIN)/sphinx-build -W --keep-going --nitpicky -q -b html docs docs/_build
	@echo "docs/_build/index.html"

bench: $(VENV)/installed-bench
	$(BIN)/python tests/bench

lint: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/installed-dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) build dist docs/_build .pytest_cache .mypy_cache .ruff_cache .hypothesis
