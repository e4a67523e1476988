# Everything runs in a virtual environment that the first target to need it makes.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
SPHINX := $(BIN)/sphinx-build -W --keep-going -q -b html

.PHONY: train test check docs format clean

train: $(VENV)/.installed
	$(BIN)/rl_zoo3 train --algo sac --env HUCRL-Pendulum-v0 -P

test: check
	$(BIN)/python -m pytest -n 2 --dist worksteal
	# The tests have executed the tutorials.
	$(SPHINX) -D nb_execution_mode=off docs docs/_build

check: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(VENV)/.installed
	$(SPHINX) docs docs/_build

format: $(VENV)/.installed
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

$(VENV)/.installed: setup.cfg setup.py pyproject.toml constraints.txt sb3_hucrl/zoo/startup.py
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet -c constraints.txt torch
	$(BIN)/pip install --quiet -c constraints.txt -e ".[dev]"
	touch $@

clean:
	rm -rf $(VENV) docs/_build build dist *.egg-info
