# Sets up a virtual environment with pinned versions and runs the project's commands in it.

PYTHON := $(shell command -v python3.11)
VENV := .venv
READY := $(VENV)/.ready
BIN := $(VENV)/bin

.DEFAULT_GOAL := help
.PHONY: help setup demo test fast lint bench acceptance picture clean

help:            ## list the targets
	@grep -E '^[a-z]+: .*##' $(MAKEFILE_LIST) | sed 's/:.*## */\t/' | expand -t 14

setup: $(READY)  ## create .venv and install everything, pinned

$(READY): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "make: python3.11 not found; install Python 3.11 (PyBullet has no wheels for later versions)" >&2; exit 1; }
	"$(PYTHON)" -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[all,dev]'
	@touch $@

demo: setup      ## fly the city with the paper's corrector
	$(BIN)/voxdepth run city

test: setup      ## lint and run all tests
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest -n 2

fast: setup      ## run the tests that answer within two minutes
	$(BIN)/pytest -n 2 -m "not slow"

bench: setup     ## measure and print speeds
	$(BIN)/pytest tests/bench -m bench -s -q -p no:xdist

acceptance: setup ## fly every scenario's acceptance check over 20 seeds
	$(BIN)/voxdepth accept --seeds 20

picture: setup   ## render the pictures of the README
	$(BIN)/voxdepth picture city --seed 0 --drone 5 --at 9 --out docs/city.jpg

clean:           ## remove the virtual environment and caches
	rm -rf $(VENV) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
