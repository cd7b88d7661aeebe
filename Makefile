# Thin targets; every one of them sets up what it needs in $(VENV) first.
VENV ?= .venv
PYTHON ?= python3
RUN = $(VENV)/bin/python

paint: $(VENV)/.paint  ## paint the default picture
	$(RUN) run.py $(ARGS)

test: $(VENV)/.dev  ## run the tests
	$(RUN) -m pytest $(ARGS)

lint: $(VENV)/.dev  ## format check, lint, types
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

bench: $(VENV)/.dev  ## the figures of docs/performance.md (minutes, on an idle machine)
	$(RUN) benchmarks/step.py
	$(RUN) benchmarks/pictures.py
	$(RUN) benchmarks/partial.py
	$(RUN) benchmarks/losses.py
	$(RUN) benchmarks/outputs.py

docs: $(VENV)/.dev  ## the documentation as a site in site/, which opens from disk
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --quiet

changes: $(VENV)/.dev  ## what the next version's entry in CHANGELOG.md will be
	$(VENV)/bin/towncrier build --draft --version next

$(VENV)/.paint: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip install --quiet -c constraints.txt -e '.[video]'
	touch $@

$(VENV)/.dev: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip install --quiet -c constraints.txt -e '.[dev]'
	touch $@

.PHONY: paint test lint bench docs changes
