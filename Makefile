.DEFAULT_GOAL := help
# Two commands matter: `make run` and `make test`. Each makes what it needs first.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
SEED   ?= 1
SCALE  ?= 1
# One process more than cores: at any time one waits for the browser, the guest or a server. More would starve the tests
# that keep real time.
PROCESSES ?= $(shell echo $$(($$(nproc) + 1)))
# Many small matrices: a second thread of the linear algebra only waits for the first.
export OPENBLAS_NUM_THREADS ?= 1
# Tests start Python some hundred times and in several processes: what one of them compiled the others read.
test blind torture fuzz: export PYTHONDONTWRITEBYTECODE =

.PHONY: docs validation release drawing help run demo test check lock blind torture fuzz bench bench-diagnosis pictures clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(VENV)/.run: requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

$(VENV)/.dev: requirements-dev.lock $(VENV)/.run
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-dev.lock
	touch $@

# What only benchmarks compare with.
$(VENV)/.bench: requirements-bench.lock $(VENV)/.dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-bench.lock
	touch $@

run: $(VENV)/.run  ## four simulated units through the recipe on a virtual bus
	$(BIN)/station run --simulate --units 4

demo: $(VENV)/.run  ## a tour in the folder station-demo: good load, bad load, hidden effect, audit
	$(BIN)/station demo station-demo

test: $(VENV)/.dev  ## every test, the vcan ones included, on all cores; of long tables each kind of row, ALL=1: every row
	$(if $(ALL),STATION_TESTS=all) $(BIN)/python -m pytest -n $(PROCESSES) --no-loadscope-reorder

check: $(VENV)/.dev  ## import contracts, types, lint: the same on a desk and in CI
	$(BIN)/lint-imports
	$(BIN)/mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

torture: $(VENV)/.dev  ## the worst days in earnest, as one table: an hour and more; with SCALE=0.01 some minutes
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --group fuzz
	$(BIN)/python tests/endurance/torture.py --seed $(SEED) --scale $(SCALE)

fuzz: $(VENV)/.dev  ## every reader fuzzed for a minute, beside its start; what went new ways stays in build/fuzz-corpus
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --group fuzz
	$(BIN)/python tests/endurance/torture_fuzz.py --seconds 60 --seed $(SEED) --corpus build/fuzz-corpus

bench: $(VENV)/.dev  ## every goal of speed in one table; a quarter of an hour, QUICK=1: a few minutes; WRITE=1: into docs/benchmarks.md
	PYTHONPATH=. $(BIN)/python benchmarks/table.py $(if $(QUICK),--quick) $(if $(WRITE),--write docs/benchmarks.md)

bench-diagnosis: $(VENV)/.bench  ## how good the diagnosis is, beside other ways to choose a cause; a quarter of an hour
	PYTHONPATH=. $(BIN)/python benchmarks/diagnosis.py --seed $(SEED)

validation: $(VENV)/.dev  ## report of the uncertainties for an auditor, into validation.txt; half an hour
	PYTHONPATH=. $(BIN)/python benchmarks/metrology.py --units 1000 > validation.txt
	@cat validation.txt

lock:  ## renew the lock files from pyproject.toml
	$(PYTHON) -m pip install --quiet uv
	uv pip compile --universal --upgrade --quiet --no-emit-index-url --no-emit-find-links --generate-hashes pyproject.toml --group build -o requirements.lock
	uv pip compile --universal --upgrade --quiet --no-emit-index-url --no-emit-find-links --generate-hashes pyproject.toml --group dev -o requirements-dev.lock
	uv pip compile --universal --upgrade --quiet --no-emit-index-url --no-emit-find-links --generate-hashes pyproject.toml --group bench --group build -c requirements-dev.lock -o requirements-bench.lock

blind: $(VENV)/.dev  ## hide new causes (make blind SEED=7) and see whether the diagnosis finds them
	STATION_TESTS=all SEED=$(SEED) $(BIN)/python -m pytest -n $(PROCESSES) tests/blind tests/conformance/test_signatures.py tests/integration/test_diagnose_next_run.py

pictures: $(VENV)/.dev  ## renew the guide's pictures of the page, as the tests see it
	STATION_PICTURES=docs/pictures $(BIN)/python -m pytest tests/browser

docs: $(VENV)/.dev  ## the documentation as a static site with a search, into build/site; a dead link ends it
	PYTHONPATH=. $(BIN)/python docs/site/build.py build/site

drawing: $(VENV)/.dev  ## renew the picture of the rooms in docs/architecture.md from the imports
	$(BIN)/python docs/draw_architecture.py

# A lock and its bill side by side: scanners read the one or the other. "dev" holds the extras and the tools, too.
release: $(VENV)/.dev  ## wheel, source, locks, their bills of materials (CycloneDX) and SHA-256 sums, in dist/
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --group release
	rm -rf dist && $(BIN)/hatchling build
	for lock in requirements requirements-dev; do \
	  cp $$lock.lock dist/$$lock.txt && $(BIN)/cyclonedx-py requirements $$lock.lock --pyproject pyproject.toml \
	    --of JSON --output-reproducible --validate -o dist/$$lock.cdx.json || exit 1; done
	cd dist && sha256sum * > SHA256SUMS && cat SHA256SUMS

clean:  ## remove what the targets made
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
