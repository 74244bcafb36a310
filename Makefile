# The whole set-up on a fresh machine: `make demo` and `make test` make their own environment in .venv.
PYTHON ?= python3
BIN := .venv/bin
ENV := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

.PHONY: demo test stress soak lint docs bench clean

.venv/ready: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "stimlib needs Python 3.11 or later; say make PYTHON=python3.12, for instance"; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then apt-get update -q && apt-get install -y -q python3-venv; \
	  else echo "Python's venv is missing; install it first, for instance: sudo apt-get install python3-venv"; exit 1; fi; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

demo: .venv/ready
	@mkdir -p demo
	$(BIN)/stimlib render squeeze --motion "minimum_jerk(depth=0.02)" --seconds 4.8 --fs 8000 --full-scale 50 --out demo/squeeze.wav --picture demo/squeeze.png
	@echo "Listen to demo/squeeze.wav (force in N, full scale as its .json says) and look at demo/squeeze.png"

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

test: lint
	@sh tests/devices/install.sh
	$(ENV) $(BIN)/python -m pytest -q -n 2 --dist loadgroup

# Devices at length, on servers without hardware: all rates, blocks and channels, a minute in real time, a busy interpreter.
# Then a minute of changed files for everything that reads one; with coverage as a guide: tests/fuzz/run.py --guided 600 csv
stress: .venv/ready
	@sh tests/devices/install.sh
	STIMLIB_STRESS=1 $(ENV) $(BIN)/python -m pytest -q tests/devices
	$(ENV) $(BIN)/python tests/fuzz/run.py 60

# Half an hour in real time, by hand: memory must not grow, and every sample must be accounted for.
soak: .venv/ready
	@sh tests/devices/install.sh
	$(ENV) PYTHONPATH=tests $(BIN)/python tests/stress/soak.py

docs: .venv/ready
	$(BIN)/python -m sphinx -W --keep-going -b html docs docs/_build

bench: .venv/ready
	$(ENV) $(BIN)/python benchmarks/chain.py
	$(ENV) PYTHONPATH=tests $(BIN)/python benchmarks/streaming.py

clean:
	rm -rf .venv demo docs/_build
