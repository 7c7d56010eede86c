# Everything runs from this checkout; the package itself is not installed into .venv, where it would be a copy.
# The names below that are lower case are meant for typing: `make` lists them.

REQUIREMENTS := $(addprefix requirements/,base.txt fleet.txt ros.txt test.txt lint.txt)
FLOOR_REQUIREMENTS := $(addprefix requirements/,floor.txt test.txt)
BENCH_REQUIREMENTS := $(addprefix requirements/,base.txt fleet.txt bench.txt)
DOCS_REQUIREMENTS := requirements/docs.txt

# The first Python on the path that can make a virtual environment and is one of the versions named.
# Both can be set: make PYTHON=/opt/python3.12/bin/python3 demo
find_python = $(shell for name in $(1); do \
	$$name -c 'import ensurepip, sys, venv; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, $(2)))' \
	>/dev/null 2>&1 && command -v $$name && break; done)
PYTHON = $(call find_python,python3 python3.12 python3.13 python3.11 python3.10 python3.14 python,14)
FLOOR_PYTHON = $(call find_python,python3.12 python3.11 python3.10 python3 python,12)

# A ROS installation sourced in this shell must not mix with the one in .venv, and nothing leaves this machine.
ifdef AMENT_PREFIX_PATH
unexport LD_LIBRARY_PATH
endif
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
export AMENT_PREFIX_PATH := $(CURDIR)/.venv
export PYTHONPATH := $(CURDIR)
export RMW_IMPLEMENTATION := rmw_fastrtps_cpp
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
unexport ROS_LOCALHOST_ONLY

.PHONY: help
help:  ## list these targets
	@sed -n 's/^\([a-z.][a-z-]*\):.*## /\1\t/p' Makefile | expand -t 12

.PHONY: .venv
.venv: .venv/ready  ## the virtual environment with everything, ROS 2 Jazzy included (Python 3.10 to 3.14, x86-64 Linux)

.PHONY: demo
demo: .venv  ## play half a minute of drive to the real node, and report; the answer goes to demo/
	.venv/bin/python -m stereo_selfcal demo

.PHONY: demo-lines
demo-lines: .venv  ## the same with a second of a bare road
	.venv/bin/python -m stereo_selfcal demo --lines

# Tests run in one process more than there are cores, as many of them wait for a node or a program. What one has
# finished it takes over from another, from the end of its share: tests of a file stay together, and with them the
# pictures that they have in common. Many start programs: without compiled modules those would take a minute more.
PYTEST = -m pytest -n $$(($$(nproc) + 1)) --dist worksteal
WITH_COMPILED_MODULES = env -u PYTHONDONTWRITEBYTECODE

.PHONY: test
test: .venv  ## run the tests (ARGS="-k name" to choose, ARGS="-m 'not slow'": those of a minute)
	$(WITH_COMPILED_MODULES) .venv/bin/python $(PYTEST) $(ARGS)

.PHONY: test-floor
test-floor: .venv-floor/ready  ## run the tests that need no ROS on a vehicle's versions (OpenCV 4.6, numpy 1.26)
	$(WITH_COMPILED_MODULES) .venv-floor/bin/python $(PYTEST) -m "not ros" --ignore test/ros $(ARGS)

.PHONY: lint
lint: .venv  ## check style and types
	.venv/bin/python -m ruff check .
	.venv/bin/python -m ruff format --check .
	.venv/bin/python -m mypy

.PHONY: bench
bench: .venv-bench/ready .venv  ## measure accuracy, time and the alternatives (ARGS="--quick", ARGS="noise seeds": sections)
	.venv-bench/bin/python -m benchmarks $(ARGS)

.PHONY: docs
docs: .venv-docs/ready  ## build the site of docs/ into site/; warnings are errors
	NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build --strict  # --quiet would silence what is to be an error
	@echo "site/index.html"

.PHONY: figures
figures: .venv  ## make the figures of the docs anew
	.venv/bin/python -m benchmarks.figures

.PHONY: bags
bags: .venv  ## make the bags in bags/ anew, byte for byte
	.venv/bin/python -m stereo_selfcal synth --named-all bags

.PHONY: clean
clean:  ## remove everything the other targets made, but for bags/
	rm -rf .venv .venv-floor .venv-bench .venv-docs site demo build install log .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/ready: $(REQUIREMENTS)
	@test -n "$(PYTHON)" || { echo "No Python 3.10 to 3.14 with venv and ensurepip found (apt install python3-venv?); name one: make PYTHON=..." >&2; exit 1; }
	$(PYTHON) -m venv --clear .venv
	.venv/bin/python -m pip --disable-pip-version-check install --quiet $(addprefix -r ,$(REQUIREMENTS))
	touch $@

.venv-floor/ready: $(FLOOR_REQUIREMENTS)
	@test -n "$(FLOOR_PYTHON)" || { echo "No Python 3.10 to 3.12 with venv and ensurepip found; name one: make FLOOR_PYTHON=..." >&2; exit 1; }
	$(FLOOR_PYTHON) -m venv --clear .venv-floor
	.venv-floor/bin/python -m pip --disable-pip-version-check install --quiet $(addprefix -r ,$(FLOOR_REQUIREMENTS))
	touch $@

.venv-bench/ready: $(BENCH_REQUIREMENTS)
	@test -n "$(PYTHON)" || { echo "No Python 3.10 to 3.14 with venv and ensurepip found; name one: make PYTHON=..." >&2; exit 1; }
	$(PYTHON) -m venv --clear .venv-bench
	.venv-bench/bin/python -m pip --disable-pip-version-check install --quiet $(addprefix -r ,$(BENCH_REQUIREMENTS))
	touch $@

.venv-docs/ready: $(DOCS_REQUIREMENTS)
	@test -n "$(PYTHON)" || { echo "No Python 3.10 to 3.14 with venv and ensurepip found; name one: make PYTHON=..." >&2; exit 1; }
	$(PYTHON) -m venv --clear .venv-docs
	.venv-docs/bin/python -m pip --disable-pip-version-check install --quiet $(addprefix -r ,$(DOCS_REQUIREMENTS))
	touch $@
