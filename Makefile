# The whole set-up on a fresh machine: `make demo` and `make test` make their own environment in .venv.
PYTHON ?= python3
LOWEST ?= python3.11
NEWEST ?= python3.13
BIN := .venv/bin
ENV := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
# Tests start hundreds of interpreters: where this is set, each of them compiles 2600 modules anew, three seconds of it.
unexport PYTHONDONTWRITEBYTECODE
# Without asserts nothing would be tested: pytest refuses it.
unexport PYTHONOPTIMIZE

.PHONY: demo test tests test-lowest test-newest stress soak randomness lint style types docs docs-measure bench lock clean

# An environment of exactly the releases in a file, all of them checked by hash, and stimlib itself built in it by one of them.
define environment
	@$(2) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "stimlib needs Python 3.11 or later; say make PYTHON=python3.12, for instance"; exit 1; }
	@$(2) -c 'import ensurepip' 2>/dev/null || { \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then apt-get update -q && apt-get install -y -q python3-venv; \
	  else echo "Python's venv is missing; install it first, for instance: sudo apt-get install python3-venv"; exit 1; fi; }
	$(2) -m venv $(1)
	$(1)/bin/python -m pip install -q --disable-pip-version-check --no-compile --require-hashes -r $(3)
	$(1)/bin/python -m pip install -q --disable-pip-version-check --no-deps --no-build-isolation \
	  --config-settings editable_mode=compat -e .
	@touch $(1)/ready
endef

.venv/ready: pyproject.toml requirements.txt
	$(call environment,.venv,$(PYTHON),requirements.txt)

.venv-lowest/ready: pyproject.toml requirements-lowest.txt
	$(call environment,.venv-lowest,$(LOWEST),requirements-lowest.txt)

.venv-newest/ready: pyproject.toml requirements-newest.txt
	$(call environment,.venv-newest,$(NEWEST),requirements-newest.txt)

demo: .venv/ready
	$(BIN)/stimlib demo demo

lint: style types
	$(BIN)/mypy --platform win32
	$(BIN)/mypy --platform darwin

style: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: .venv/ready
	$(BIN)/mypy

# What every worker imports, compiled once while mypy runs: in a new environment each of them would do it for itself.
.venv/compiled: .venv/ready
	@$(BIN)/python -m pytest --collect-only -q >/dev/null 2>&1; touch $@

# Three workers on two cores: a tenth of the tests wait for real time.  What each of them does, and when: tests/conftest.py.
WORKERS := -n 3 --dist loadgroup --no-loadscope-reorder

test: style
	@sh tests/devices/install.sh
	@$(MAKE) -j 2 types tests

tests: .venv/compiled
	$(ENV) $(BIN)/python -m pytest -q $(WORKERS)

# The same tests on the lowest versions that pyproject.toml allows, on the lowest Python.
test-lowest: .venv-lowest/ready
	@sh tests/devices/install.sh
	$(ENV) .venv-lowest/bin/python -m pytest -q $(WORKERS)

# The same tests on the newest releases, on the newest Python that all of them support.
test-newest: .venv-newest/ready
	@sh tests/devices/install.sh
	$(ENV) .venv-newest/bin/python -m pytest -q $(WORKERS)

# The tests that have more to try when there is time, at length; the others are in `make test`.
stress: .venv/ready .venv/browsers
	@sh tests/devices/install.sh firefox-esr
	STIMLIB_STRESS=1 $(ENV) $(BIN)/python -m pytest -q $(WORKERS) -m 'stress or longer or hypothesis'

# What drives Chromium and Firefox: 150 MB that only tests/stress/test_browsers.py needs.
.venv/browsers: .venv/ready requirements-browsers.txt
	$(BIN)/python -m pip install -q --disable-pip-version-check --require-hashes -r requirements-browsers.txt
	@touch $@

# Statistics of the noise, by dieharder too where it is installed; an hour.
randomness: .venv/ready
	$(ENV) PYTHONPATH=tests $(BIN)/python tests/stress/randomness.py

# Half an hour in real time, by hand: memory must not grow, every sample must be accounted for, and the log must replay.
soak: .venv/ready
	@sh tests/devices/install.sh
	$(ENV) PYTHONPATH=tests $(BIN)/python benchmarks/soak.py

# What compiles the scenes that can be played on the pages, where neither clang with wasm-ld nor zig is installed: 100 MB.
.venv/wasm: .venv/ready requirements-wasm.txt
	{ command -v clang && command -v wasm-ld || command -v zig; } >/dev/null 2>&1 || \
	  $(BIN)/python -m pip install -q --disable-pip-version-check --require-hashes -r requirements-wasm.txt
	@touch $@

docs: .venv/ready .venv/wasm
	$(BIN)/python -m sphinx -W -E --keep-going -b html docs docs/_build

# What a browser makes of the pages: cut code, overflow, alt texts, the front page, search, copying.
docs-measure: docs
	PYTHONPATH=tests $(BIN)/python tests/docs_pages.py docs/_build

# A quarter of an hour on an idle machine; `make bench RECORD=--record` keeps the figures, else no tracked file changes.
BENCHMARKS := short chain latency channels growth compile edits springpot bumps path streaming page work_precision power sweep cluster vocabulary vocabulary_blocks elementary plate jax_target psychometric recovery experiments papers export cortex_m patterns peers closed_loop schemes fits

bench: .venv/ready
	@set -e; for name in $(BENCHMARKS); do echo "# $$name"; PYTHONPATH=tests $(BIN)/python benchmarks/$$name.py $(RECORD); done

# Writes the requirements files anew after a change in pyproject.toml, keeping every release that still fits; to take a newer
# one, delete its lines first.  Hashes of all files of a release: one file serves every Python and platform.
LOCK := .venv-lock/bin/uv pip compile -q pyproject.toml --all-extras --group dev --universal --python-version 3.11 --generate-hashes \
	--no-annotate --custom-compile-command "make lock"
LOCK_BROWSERS := $(subst pyproject.toml --all-extras --group dev,--group browsers -c requirements.txt,$(LOCK))
LOCK_WASM := $(subst pyproject.toml --all-extras --group dev,--group wasm,$(LOCK))
LOCK_NEWEST := $(subst --universal --python-version 3.11,--python-version 3.13,$(LOCK))

lock:
	$(PYTHON) -m venv .venv-lock
	.venv-lock/bin/python -m pip install -q --disable-pip-version-check uv
	$(LOCK) -o requirements.txt
	$(LOCK) --resolution lowest-direct -o requirements-lowest.txt
	$(LOCK_BROWSERS) -o requirements-browsers.txt
	$(LOCK_WASM) -o requirements-wasm.txt
	$(LOCK_NEWEST) --upgrade -o requirements-newest.txt

clean:
	rm -rf .venv .venv-lowest .venv-newest .venv-lock demo docs/_build docs/gallery
