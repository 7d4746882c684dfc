# Everything a person does here is one word: make demo, make test, make serve, make lint, make bench.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/pip --disable-pip-version-check

.PHONY: help demo serve test acceptance fuzz lint docs picture bench calibrate found release lock clean

help:  ## Say what can be made
	@sed -n 's/^\([a-z]*\):.*  ## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 16

demo: .venv/runtime  ## Localise the built-in burst of 2012-06-07 and print the result
	$(BIN)/bella run

serve: .venv/runtime  ## API and pages on http://127.0.0.1:8000
	$(BIN)/bella serve

test: .venv/test  ## Everything that must hold, without a network
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder

acceptance: .venv/test  ## What takes longer: whole services, replays, many seeds, long sampling
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m acceptance

fuzz: .venv/test  ## Read thousands of damaged files (MUTATIONS=20000), and answer 2000 made-up requests and 500 walks
	BELLA_MUTATIONS=$(or $(MUTATIONS),20000) $(BIN)/pytest tests/fuzz
	BELLA_API_CASES=60 $(BIN)/pytest tests/conformance/test_description_holds.py -k "not operation_to_operation"
	BELLA_API_CASES=500 $(BIN)/pytest tests/conformance/test_description_holds.py -k operation_to_operation

lint: .venv/test  ## Style, types, and who may import whom
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache | tail -n 12

docs: .venv/test  ## The documentation site, docs/_build/html (3 minutes); warnings are errors
	OPENBLAS_NUM_THREADS=1 $(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

picture: .venv/test  ## Photograph the page of the burst for README, after make demo
	$(BIN)/python docs/picture.py

bench: .venv/test  ## Measure what docs/speed.md says about speed
	$(BIN)/python -m benchmarks

calibrate: .venv/runtime  ## Check the posterior against simulated sources (8 minutes)
	$(BIN)/bella calibrate --output docs

found: .venv/runtime  ## Check answers about simulated bursts that are found (10 minutes on two cores)
	$(BIN)/bella calibrate --found --bursts 21 --seed 5 --workers 2 --output docs
	cp docs/calibration-found.csv bella/calibration/found.csv

release: .venv/runtime  ## Freeze the catalogue into releases/bella-VERSION and check it (VERSION=2026.1)
	@test -n "$(VERSION)" || { echo "Give the release a label: make release VERSION=2026.1" >&2; exit 2; }
	@mkdir -p releases
	$(BIN)/bella release make $(VERSION) --output releases
	$(BIN)/bella release verify releases/bella-$(VERSION)

lock:  ## Pin every dependency anew, without any registry address
	$(PYTHON) -m venv .venv/lock && .venv/lock/bin/pip install --quiet uv
	.venv/lock/bin/uv pip compile $(LOCK_OPTIONS) --extra build --extra all -o .lock/runtime.txt pyproject.toml
	.venv/lock/bin/uv pip compile $(LOCK_OPTIONS) --extra build --extra test --extra docs -c .lock/runtime.txt -o .lock/test.txt pyproject.toml

clean:  ## Remove what was installed and made here
	rm -rf .venv bella-home test-artifacts docs/_build docs/gallery

LOCK_OPTIONS := --universal --fork-strategy fewest --python-version 3.11 --generate-hashes \
	--no-annotate --no-header --quiet

.venv/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' \
	|| { echo "BELLA needs Python 3.11 to 3.13: make PYTHON=python3.12 ..." >&2; exit 2; }
	@$(PYTHON) -m venv .venv \
	|| { echo "Python's venv is missing: apt install python3-venv" >&2; exit 2; }
	@touch $@

.venv/runtime: .lock/runtime.txt pyproject.toml | .venv/python
	@echo "Installing 170 pinned packages into .venv (1.3 GB; a minute or two, once) ..."
	@$(PIP) install --quiet --no-deps --require-hashes -r .lock/runtime.txt
	@$(PIP) install --quiet --no-build-isolation --no-deps --editable .
	@touch $@

.venv/test: .lock/test.txt .venv/runtime
	@echo "Installing what the tests need into .venv ..."
	@$(PIP) install --quiet --no-deps --require-hashes -r .lock/test.txt
	@touch $@
