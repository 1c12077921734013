# `make demo` installs what is needed and finds a strike; `make test` installs what tests need and runs those that take
# seconds, `make test-all` runs every test.
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin/python
# two at a time; the threads of one test would spin beside those of the other; Python compiles the modules that tests import
# and keeps them, or each of the hundreds of processes that tests start would compile them
TEST := env -u PYTHONDONTWRITEBYTECODE OMP_NUM_THREADS=1 $(RUN) -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder
INSTALL := $(RUN) -m pip install --quiet --disable-pip-version-check --constraint requirements.lock

.PHONY: demo test test-all mutants maps check docs docs-commands clean
.DELETE_ON_ERROR:

demo: $(VENV)/.core
	$(RUN) -m whiptool.optimize --method directl

test: check
	$(TEST) -m "not slow"

test-all: check
	$(TEST)

# does a wrong formula fail a test? goes on where it was stopped; MUTANTS="--package rl --sample 20" for a part
mutants: $(VENV)/.dev
	$(RUN) -m tools.mutants $(MUTANTS)

# the maps that come with the package, as users build them; goes on where it was stopped
maps: $(VENV)/.dev
	for model in lemon2024 panda ur5e; do \
	  run=build/maps/$$model; \
	  if [ -d $$run ]; then options="--resume $$run"; else options="--model $$model --out $$run"; fi; \
	  $(RUN) -m whiptool.map build $$options || exit 1; \
	done
	$(RUN) -m tools.ship_maps build/maps

# every command of README and documentation, as it is typed, to its end: hours; PAGES="how-to and identify" for some
docs-commands: $(VENV)/.dev
	$(RUN) -m pytest -m "slow or hours" tests/whole/test_page_commands.py -k "as_it_is_typed and ($(or $(PAGES),md))"

docs: $(VENV)/.dev
	$(RUN) -m sphinx -j auto -W --keep-going -b html docs docs/_build/html

check: $(VENV)/.dev
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m pyrefly check
	$(VENV)/bin/lint-imports
	$(RUN) -m tools.plain_english

$(VENV)/.python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "whiptool needs Python 3.11 or newer: make PYTHON=/path/to/python3.11 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.core: $(VENV)/.python pyproject.toml requirements.lock
	@echo "installing whiptool into $(VENV) ..."
	$(INSTALL) --no-compile --editable .
	touch $@

$(VENV)/.dev: $(VENV)/.core
	@echo "installing what the tests need into $(VENV) ..."
	$(INSTALL) --no-compile --editable .[dev]
	touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .ruff_cache .import_linter_cache .grimp_cache .hypothesis docs/_build docs/_made docs/api docs/gallery docs/notebooks
