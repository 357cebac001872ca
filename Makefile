# Sets up a virtual environment with pinned versions and runs the project's commands in it.

PYTHON := $(shell command -v python3.11)
VENV := .venv
INSTALLED := $(VENV)/.installed
READY := $(VENV)/.ready
BIN := $(VENV)/bin
ROS := build/ros

.DEFAULT_GOAL := help
.PHONY: help setup demo test fast fuzz bounds matrix ros lint portable bench results acceptance picture sequences regress docs release clean

help:            ## list the targets
	@grep -E '^[a-z]+: .*##' $(MAKEFILE_LIST) | sed 's/:.*## */\t/' | expand -t 14

setup: $(READY)  ## create .venv and install everything with pinned versions

$(INSTALLED): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "make: python3.11 not found; install Python 3.11 (PyBullet has no wheels for later versions)" >&2; exit 1; }
	@test "$$(uname -sm)" = "Linux x86_64" || { echo "make: this is $$(uname -sm), and the testbed needs Linux on x86-64 (PyBullet has no wheels for others); pip install . installs the library" >&2; exit 1; }
	@echo "installing the pinned packages into $(VENV), in place of any other Python there, 3.5 GB; this takes two to three minutes and prints nothing"
	@$(BIN)/python -c 'import pip, sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null || "$(PYTHON)" -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e '.[all,dev]'
	@touch $@

$(READY): $(INSTALLED)
	@echo "compiling most of the loops over pixels, once; this takes about 25 s"
	@$(BIN)/voxdepth run city --drones 2 --duration 1 --no-record --out $(VENV)/first-run > $(VENV)/first-run.log 2>&1 \
		|| { cat $(VENV)/first-run.log >&2; exit 1; }
	@touch $@

demo: setup      ## fly the city scenario by corrected depth
	$(BIN)/voxdepth run city --seed 2

lint: $(INSTALLED) ## check style, types, layers, and that modules import each other in no circle
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/mypy ros2/voxdepth_ros/voxdepth_ros/stream.py ros2/voxdepth_ros/voxdepth_ros/health.py
	$(BIN)/lint-imports

test: setup lint ## run lint and all tests
	$(BIN)/pytest -n 2 --dist worksteal

fast: setup      ## run the tests that answer within a minute
	$(BIN)/pytest -n 2 --dist worksteal -m "not slow"

fuzz: setup      ## try EXAMPLES streams of odd frames by SEED, or the usual number
	VOXDEPTH_FUZZ_EXAMPLES=$(EXAMPLES) VOXDEPTH_FUZZ_SEED=$(SEED) $(BIN)/pytest tests/fuzz

bounds: setup    ## run the tests of library and simulator with a check of each index in a compiled loop, 15 minutes
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(CURDIR)/build/bounds $(BIN)/pytest -n 2 --dist worksteal -m "not slow" tests/unit tests/property
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(CURDIR)/build/bounds $(BIN)/pytest tests/fuzz

matrix: $(INSTALLED) ## run the library's tests with its lowest and newest versions on every Python
	$(BIN)/python -m tests.matrix

ros: setup $(ROS)/.ready ## run the node on real ROS 2, which comes from the package registry
	$(ROS)/bin/python -m pytest -q tests/ros

$(ROS)/.ready: ros2/voxdepth_ros/setup.py constraints.txt | $(INSTALLED)
	@echo "installing ROS 2 into $(ROS), 250 MB"
	@rm -rf $(ROS)
	@"$(PYTHON)" -m venv $(ROS)
	@echo "import site; site.addsitedir('$(CURDIR)/$(VENV)/lib/python3.11/site-packages')" > $(ROS)/lib/python3.11/site-packages/project.pth
	@$(ROS)/bin/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e 'ros2/voxdepth_ros[wheels]' > $(ROS)/log 2>&1 \
		|| { echo "make: cannot install ROS 2, $(ROS)/log says why; its wheels are for Python 3.11 on Linux with glibc 2.28, and come from a package registry: is one reachable?" >&2; exit 1; }
	@touch $@

docs: setup      ## build the documentation site in site/, and check its links
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	$(BIN)/mkdocs build --quiet

release: setup   ## build wheel and source archive in dist/, install them into new environments of every Python, and use them
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[release]'
	$(BIN)/python -m tests.release

regress: setup   ## tell in what the correctors became worse since the commit AGAINST, which is HEAD
	$(BIN)/voxdepth regress --corrector voxdepth --against $(or $(AGAINST),HEAD)
	$(BIN)/voxdepth regress --corrector temporal --against $(or $(AGAINST),HEAD)

portable: setup  ## compare all outputs under the features that processors have; takes half an hour on two cores
	$(BIN)/python -m tests.portable

bench: setup     ## measure and print the speed of correctors and simulator
	$(BIN)/voxdepth bench
	$(BIN)/pytest tests/bench -m bench -s -q -p no:xdist

results: setup   ## remake the tables in the documents, all or NAME, with the recordings of real cameras in RECORDINGS
	$(BIN)/python -m tests.results $(if $(RECORDINGS),--recordings $(RECORDINGS)) $(NAME)

acceptance: setup ## fly every scenario's acceptance check over 20 seeds
	$(BIN)/voxdepth accept --seeds 20

picture: setup   ## make the pictures of docs/corrector.md, docs/scenes.md and of how the methods work
	$(BIN)/voxdepth picture city --seed 1 --drone 4 --at 7 --out docs/city.jpg
	$(BIN)/voxdepth picture scenes --seed 1 --out docs/scenes.jpg
	$(BIN)/python -m tests.pictures

sequences: setup ## record 60 frames of the reference and hard sequences into build/ and make the contact sheets in docs/
	@for name in LN MB KTS KTC PLF PLW hover yaw cut cross ghost approach; do \
		test -f build/sequences/sim-$$name.done || $(BIN)/voxdepth record sim-$$name --frames 60 --out build/sequences/sim-$$name || exit 1; \
		touch build/sequences/sim-$$name.done; \
		$(BIN)/voxdepth picture build/sequences/sim-$$name --out docs/sim-$$name.jpg || exit 1; \
	done

clean:           ## remove the virtual environment and caches
	rm -rf $(VENV) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
