# setup, demo, test, test-all, bench, lint, clean. PYTHON picks the interpreter of a new .venv: make setup PYTHON=python3.12
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/pip install --quiet --quiet --disable-pip-version-check --constraint constraints.txt
EXTRAS := ros,interfaces,export,test
# An unqualified torch brings several GB of CUDA: ask for the CPU build, first where pip looks anyway.
TORCH ?= torch==2.13.0+cpu
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu

INTERFACES := $(shell find bdnn_interfaces -path '*/build' -prune -o -path '*.egg-info' -prune -o -type f -print)
PACKAGING := setup.py setup.cfg package.xml pyproject.toml $(wildcard resource/* scripts/launchers/* launch/*.py config/*.*)
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal
BENCHMARKS := $(wildcard benchmarks/[!_]*.py)

.PHONY: setup demo test test-all bench lint clean
.DELETE_ON_ERROR:

setup: $(VENV)/.package $(VENV)/.interfaces

demo: setup
	$(BIN)/bdnn demo --out demo_output

# What a change is tried by; test-all takes nearly three times as long and is run before a release.
test: setup lint
	$(PYTEST) -m "not slow" test

test-all: setup lint
	$(PYTEST) test

bench: setup
	@set -e; for file in $(BENCHMARKS); do echo "== $$file"; $(BIN)/python $$file; done

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

clean:
	rm -rf $(VENV) build install log demo_output bdnn_interfaces/build
	rm -rf *.egg-info bdnn_interfaces/*.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/.dependencies: constraints.txt setup.py scripts/check_machine.py
	@$(PYTHON) scripts/check_machine.py
	@echo "building $(VENV): about 2 GB on disk, 2 to 5 minutes"
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	@$(PIP) $(TORCH) 2>/dev/null || $(PIP) --retries 1 --extra-index-url $(TORCH_INDEX) $(TORCH) 2>/dev/null \
	  || { echo "no CPU build of torch for this Python found: taking the default one"; $(PIP) torch; }
	@$(PIP) setuptools wheel
	@$(PIP) --no-build-isolation --editable '.[$(EXTRAS)]'
	@touch $@

$(VENV)/.package: $(VENV)/.dependencies $(PACKAGING)
	@$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@

$(VENV)/.interfaces: $(VENV)/.dependencies $(INTERFACES)
	@echo "generating the ROS 2 interfaces"
	@$(PIP) --no-deps --no-build-isolation --use-pep517 --force-reinstall ./bdnn_interfaces
	@touch $@
