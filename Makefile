# PM01 Navigation. `make demo` and `make test` work from a fresh clone.
#
# PYTHON       the Python (3.10 or later) to make .venv with
# TORCH_INDEX  an index to take torch from; on a machine without an NVIDIA GPU,
#              TORCH_INDEX=https://download.pytorch.org/whl/cpu saves gigabytes of CUDA
PYTHON ?= python3
TORCH_INDEX ?=
VENV := .venv
BIN := $(VENV)/bin
PIP_FLAGS := --quiet --disable-pip-version-check -c constraints.txt

.PHONY: demo docs test lint format type imports unit test-slow wheel bench clean help

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

demo: $(VENV)/.demo  ## train, measure and film a policy into runs/demo
	$(BIN)/pm01 demo

test: lint type imports unit  ## everything that CI checks

lint: $(VENV)/.dev  ## style and spelling
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell

type: $(VENV)/.dev  ## types
	$(BIN)/pyright

imports: $(VENV)/.dev  ## who may import whom
	$(BIN)/lint-imports

unit: $(VENV)/.dev  ## tests, without the slow ones
	$(BIN)/python tests/compile_kernels.py
	$(BIN)/pytest -m "not slow" -n auto --dist loadfile

test-slow: $(VENV)/.dev  ## the slow tests
	$(BIN)/pytest -m slow

docs: $(VENV)/.docs  ## the documentation site into build/docs; a warning fails
	$(BIN)/sphinx-build -q -W --keep-going -E -c docs -d build/doctrees . build/docs

wheel: $(VENV)/.dev  ## build a wheel and an sdist into dist/, and use the wheel without the checkout
	$(BIN)/pytest -m slow tests/packaging
	$(BIN)/python -m build --no-isolation --outdir dist

format: $(VENV)/.dev  ## mend what can be mended by machine
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(VENV)/.dev  ## measure the simulator's speed into runs/throughput.json
	$(BIN)/python benchmarks/throughput.py --out runs/throughput.json

clean:  ## remove the environment and all runs
	rm -rf $(VENV) runs

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10) and "Python 3.10 or later is needed")'
	$(PYTHON) -m venv $(VENV)

# torch comes first and by itself, so that TORCH_INDEX decides for it alone; what it needs comes
# with the next step.
$(VENV)/.torch: constraints.txt | $(VENV)/bin/python
	@echo "installing torch (once; a large download)"
	$(BIN)/pip install $(PIP_FLAGS) $(if $(TORCH_INDEX),--no-deps --index-url $(TORCH_INDEX)) torch
	@touch $@

# The kernels are compiled at installation, so that the first training loses no time to it.
$(VENV)/.demo: pyproject.toml constraints.txt $(VENV)/.torch
	@echo "installing PM01 Navigation (once)"
	$(BIN)/pip install $(PIP_FLAGS) -e '.[train,viz]'
	@echo "compiling the simulator (once, about half a minute)"
	$(BIN)/python -m pm01_nav.sim.warm_up
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt $(VENV)/.torch
	@echo "installing the development tools (once)"
	$(BIN)/pip install $(PIP_FLAGS) -e '.[dev]'
	@touch $@

$(VENV)/.docs: $(VENV)/.demo
	@echo "installing the documentation tools (once)"
	$(BIN)/pip install $(PIP_FLAGS) -e '.[train,viz,docs]'
	@touch $@
